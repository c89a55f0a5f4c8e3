"""Guides as a reader carries them out: their blocks in order, and whether the output that they show is the program's.

A fenced block is one of four kinds. ``sh``: lines of ``taichi-membrane``, of exit code 0 unless a comment says ``# exit code N``.
``python``: a program, with the names of those before it. ``toml``: text for the file that its first line names, ``# NAME.toml``, or
for the end of that file, ``# at the end of NAME.toml``. ``text``: what the block before it prints: each line as a run of
words and numbers, in order, with ``…`` for what is left out; numbers to one unit in the last digit shown.
"""

from __future__ import annotations

import contextlib
import io
import re
import shlex
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from typer.testing import CliRunner

from taichi_membrane.commands.cli import app

_BLOCK = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
_TOKEN = re.compile(r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?|[^\W\d_]+|[^\w\s]|_")
_FILE = re.compile(r"# (at the end of )?([a-z_]+\.toml)\Z")
_EXIT = re.compile(r"exit code (\d+)")


@dataclass(frozen=True)
class Block:
    """A fenced block: its kind, its text, and the line of the guide where it begins."""

    kind: str
    text: str
    line: int


def blocks(text: str) -> list[Block]:
    """The fenced blocks of a page."""
    return [Block(m[1], m[2], text[: m.start()].count("\n") + 2) for m in _BLOCK.finditer(text)]


class Reader:
    """Carries out blocks in the present folder.

    :ivar printed: what the last block printed.
    """

    def __init__(self) -> None:
        self.printed = ""
        self._names: dict[str, Any] = {"__name__": "__main__"}

    def carry_out(self, block: Block) -> None:
        """Do what a block says; AssertionError where it is not as the guide has it."""
        {"sh": self._shell, "python": self._python, "toml": self._file, "text": self._compare}[block.kind](block)

    def _shell(self, block: Block) -> None:
        printed = []
        for line in block.text.replace("\\\n", " ").splitlines():
            command, _, remark = line.partition("  # ")
            program, *arguments = shlex.split(command)
            assert program == "taichi-membrane", f"line {block.line}: no command of the program: {line}"
            told = _EXIT.search(remark)
            code, output = _run(arguments)
            printed.append(output)
            wanted = int(told[1]) if told else 0
            assert code == wanted, f"line {block.line}: {line}: {code}\n{output}"
        self.printed = "\n".join(printed)

    def _python(self, block: Block) -> None:
        with contextlib.redirect_stdout(io.StringIO()) as printed:
            exec(compile("\n" * (block.line - 1) + block.text, "<guide>", "exec"), self._names)
        self.printed = printed.getvalue()

    def _file(self, block: Block) -> None:
        named = _FILE.match(block.text.splitlines()[0])
        assert named, f"line {block.line}: no name of a file"
        path = Path(named[2])
        before = path.read_text(encoding="utf-8") + "\n" if named[1] else ""
        assert named[1] or not path.exists(), f"line {block.line}: {path} is there"
        path.write_text(before + block.text, encoding="utf-8")

    def _compare(self, block: Block) -> None:
        missing = first_missing(block.text, self.printed)
        assert missing is None, f"line {block.line}: not printed: {missing}\n{self.printed}"


def _run(arguments: list[str]) -> tuple[int, str]:
    """Exit code and output of a command: in this process, but for another precision, as Taichi runs in one only."""
    if "f32" in arguments:
        done = subprocess.run([sys.executable, "-m", "taichi_membrane", *arguments], capture_output=True, text=True)
        return done.returncode, done.stdout + done.stderr
    here = CliRunner().invoke(app, arguments)
    return here.exit_code, here.output


def first_missing(shown: str, printed: str) -> str | None:
    """The first line of what is shown that is not printed after those above it; None where all are."""
    words = _TOKEN.findall(printed)
    start = 0
    for line in filter(str.strip, shown.splitlines()):
        for part in line.split("…"):
            tokens = _TOKEN.findall(part)
            ends = (k + len(tokens) for k in range(start, len(words) + 1) if _same(tokens, words[k : k + len(tokens)]))
            start = next(ends, -1)
            if start < 0:
                return line
    return None


def _same(shown: Sequence[str], printed: Sequence[str]) -> bool:
    return len(shown) == len(printed) and all(_alike(a, b) for a, b in zip(shown, printed, strict=True))


def _alike(shown: str, printed: str) -> bool:
    """The same word, or numbers that differ by at most one unit in the last digit shown."""
    if shown == printed:
        return True
    try:
        a, b = float(shown), float(printed)
    except ValueError:
        return False
    mantissa, _, power = shown.partition("e")
    digits = len(mantissa.partition(".")[2])
    if digits == 0 and not power:
        return False  # counts are exact
    return abs(a - b) <= 1.01 * 10.0 ** (int(power or 0) - digits)
