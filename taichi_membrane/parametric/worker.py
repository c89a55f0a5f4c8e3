"""A process that keeps its compiled kernels: a trial in on standard input, its result out on standard output, a line each."""

from __future__ import annotations

import os
import sys

from taichi_membrane.parametric.task import carry_out


def main() -> None:
    """Answer line by line until the input ends, which it also does when the process that started this one dies."""
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # whatever a library prints must not be taken for an answer
    for line in sys.stdin:
        answers.write(carry_out(line) + "\n")
        answers.flush()


if __name__ == "__main__":
    main()
