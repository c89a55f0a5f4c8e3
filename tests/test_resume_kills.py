"""A run killed at random moments and gone on with ends bit by bit as one that was left alone."""

from __future__ import annotations

import json
import random
import re
import signal
import subprocess
import sys
import threading
from collections import Counter
from pathlib import Path

import pytest
from resume_cases import NO_MOTION, RELAXATION, SCENE, environment
from run_files import different, outcome


@pytest.fixture
def scene(tmp_path: Path) -> str:
    """The scene in an empty folder."""
    (tmp_path / "beam.toml").write_text(SCENE, encoding="utf-8")
    return "beam.toml"


class Killer:
    """Runs the command and kills it at random moments, until the run is done."""

    def __init__(self, cwd: Path, scene: str, arguments: tuple[str, ...]) -> None:
        self.cwd = cwd
        self.begin = ("run", scene, *arguments)
        code, told = self.session((*self.begin, "--out", "whole"))
        assert code == 0, told
        self.lines = len(told)
        self.whole = outcome(cwd / "whole")
        self.killed: Counter[str] = Counter()  # how often, by what the process said last

    def session(self, arguments: tuple[str, ...], line: int = -1, delay: float = 0.0) -> tuple[int, list[str]]:
        """One process, killed ``delay`` seconds after it has said ``line`` lines; its exit code and what it said."""
        command = [sys.executable, "-m", "taichi_membrane", *arguments]
        with subprocess.Popen(
            command, cwd=self.cwd, env=environment(self.cwd), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
        ) as process:  # fmt: skip
            assert process.stderr is not None
            timer, told = threading.Timer(delay, process.kill), list[str]()
            if line == 0:
                timer.start()
            for said in process.stderr:
                told.append(said.strip())
                if len(told) == line:
                    timer.start()
            code = process.wait()
            timer.cancel()
        return code, told

    def chain(self, directory: str, kills: int, rng: random.Random) -> int:
        """A run that is killed up to ``kills`` times and otherwise left to end; how often it was."""
        folder, command, done, lines = self.cwd / directory, (*self.begin, "--out", directory), 0, self.lines
        while True:
            # While a phase or load step is at work, or a little later; drawing takes longest.
            line = min(rng.randrange(lines + 3), lines)
            delay = rng.uniform(0.0, 0.6 if line < 4 or line == lines else 0.05)
            code, told = self.session(command, line if done < kills else -1, delay)
            if code == -signal.SIGKILL:
                done += 1
                self.killed[re.sub(r"[\d/]+:.*| …", "", told[-1]) if told else "starting Python"] += 1
                command = ("run", "--resume", directory)
                summary = folder / "summary.json"
                kept = len(json.loads(summary.read_text("utf-8"))["steps"]) if summary.exists() else 0
                lines = self.lines + 1 - kept
            elif code == 2 and command[1] == "--resume":
                assert not (folder / "mesh.vtu").exists(), told  # it was killed before it began
                command = (*self.begin, "--out", directory)
            else:
                assert code == 0, told
                assert not different(outcome(folder), self.whole)
                return done


def test_a_run_killed_at_random_moments_ends_as_if_it_had_not_been(scene: str, tmp_path: Path) -> None:
    killer = Killer(tmp_path, scene, RELAXATION)
    assert killer.chain("killed", 3, random.Random(1)) > 0
    assert "animation.gif" in killer.whole
    assert "curve.png" in killer.whole


@pytest.mark.slow  # some minutes
@pytest.mark.parametrize(
    "arguments", [(), ("--precision=f32", *(f"--set={one}" for one in NO_MOTION))], ids=["f64", "f32"]
)
def test_25_kills_at_random_moments(scene: str, tmp_path: Path, arguments: tuple[str, ...]) -> None:
    killer, rng = Killer(tmp_path, scene, (*arguments, "--set=stages.load.steps=30")), random.Random(2)
    count = chains = 0
    while count < 25:
        count += killer.chain(f"killed_{chains}", min(9, 25 - count), rng)
        chains += 1
    print(f"\n{count} kills in {chains} runs, all alike; by what the process was at: {dict(killer.killed)}")
