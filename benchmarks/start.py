"""From the start of a process to the first load step of the cantilever, cold and warm: by phase, and kernel by kernel.

    python benchmarks/start.py [--repeat N] [--out FILE]

Every run is a fresh process. Cold means that Taichi's cache is empty, warm that the run before has filled it. On a shared machine
processor time is steadier than the clock: both are told.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

RUN = """
import json, sys, taichi_membrane as tm
scene = tm.load_scene("cantilever", ["checks=[]"])
result = tm.run(scene.model_copy(update={"stages": scene.stages[:1], "curve": None}))
assert result.converged
print(json.dumps(result.seconds))
"""

# Processor seconds of Python's pass over each kernel's source, and of its first launch, which compiles or reads the cache.
WATCHED = (
    """
import collections, json, time
from taichi_membrane.device.language import ti

python, launch, seen = collections.Counter(), collections.Counter(), set()
kernel = ti.lang.kernel_impl.Kernel
materialize, launched = kernel.materialize, kernel.launch_kernel


def watched_pass(self, key=None, args=None, arg_features=None):
    started = time.process_time()
    materialize(self, key, args, arg_features)
    if key not in seen:
        python[self.func.__qualname__] += time.process_time() - started
    seen.add(key)


def watched_launch(self, compiled, *args):
    started = time.process_time()
    result = launched(self, compiled, *args)
    if id(compiled) not in seen:
        launch[self.func.__qualname__] += time.process_time() - started
    seen.add(id(compiled))
    return result


kernel.materialize, kernel.launch_kernel = watched_pass, watched_launch
"""
    + RUN
    + """
print(json.dumps({name: [python[name], launch[name]] for name in python}))
"""
)


def measured(code: str, cache: str) -> tuple[float, float, dict[str, Any]]:
    """Seconds by the clock and of the processor of a process, and what it printed last."""
    environment = {**os.environ, "TI_OFFLINE_CACHE_FILE_PATH": cache}
    before, started = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    done = subprocess.run([sys.executable, "-c", code], env=environment, check=True, capture_output=True, text=True)
    seconds, after = time.perf_counter() - started, resource.getrusage(resource.RUSAGE_CHILDREN)
    spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return seconds, spent, json.loads(done.stdout.splitlines()[-1])


def start_table(repeat: int) -> list[str]:
    """Cold and warm start, each the quickest of some."""
    lines = [
        "| start to first load step | seconds | of the processor | start of Taichi | compile |",
        "|---|---|---|---|---|",
    ]
    rows = {"cold (kernels compiled)": [], "warm (kernels from Taichi's cache)": []}  # type: dict[str, list[Any]]
    cold, warm = rows.values()
    for _ in range(repeat):
        with tempfile.TemporaryDirectory() as cache:
            cold.append(measured(RUN, cache))
            warm += [measured(RUN, cache) for _ in range(3)]
    for name, runs in rows.items():
        seconds, spent, phases = min(runs, key=lambda run: run[0])
        lines.append(f"| {name} | {seconds:.2f} | {spent:.2f} | {phases['start']:.2f} | {phases['compile']:.2f} |")
    return lines


def kernel_table() -> list[str]:
    """Each kernel that the first load step compiles."""
    lines = ["| kernel | Python pass [ms] | first launch, cold [ms] | warm [ms] |", "|---|---|---|---|"]
    with tempfile.TemporaryDirectory() as cache:
        cold, warm = (measured(WATCHED, cache)[2] for _ in range(2))
    rows = {name: [1e3 * one for one in (warm[name][0], cold[name][1], warm[name][1])] for name in cold}
    rows["all"] = [sum(column) for column in zip(*rows.values(), strict=True)]
    lines += [f"| `{name}` | " + " | ".join(f"{value:.0f}" for value in row) + " |" for name, row in rows.items()]
    return lines


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeat", type=int, default=3, help="cold starts, with three warm ones after each")
    parser.add_argument("--out", type=Path, help="also write the tables to this file")
    arguments = parser.parse_args()
    text = "\n".join([*start_table(arguments.repeat), "", *kernel_table(), ""])
    print(text)
    if arguments.out is not None:
        arguments.out.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
