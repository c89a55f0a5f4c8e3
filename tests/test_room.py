"""Fields have room for more than a structure needs, so that structures of about one size share kernels."""

from __future__ import annotations

import subprocess
import sys

import pytest

from taichi_membrane.device.language import ti
from taichi_membrane.execution.run import run
from taichi_membrane.mechanics.nodes import room
from taichi_membrane.scene.file import load_scene
from taichi_membrane.simulation.results import RunResult

SIZES = [0, 1, 4095, 4096, 4097, 5000, 8191, 8192, 8193, 100_000, 1_048_575, 1_048_576, 1_048_577, 123_456_789]
PILLOW = """
import taichi_membrane as tm
result = tm.run(tm.load_scene("cushion", {overrides}))
print(result.steps[-1].displacement.tobytes().hex())
"""


def overrides(cells: int) -> list[str]:
    return [f"mesh.along_x={cells}", f"mesh.along_y={cells}", "checks=[]"]


def pillow(cells: int) -> RunResult:
    return run(load_scene("cushion", overrides(cells)))


@pytest.mark.parametrize("count", SIZES)
def test_room_is_enough_and_no_waste(count: int) -> None:
    assert count <= room(count) <= max(4096, 17 * count / 16)
    assert room(room(count)) == room(count)
    assert room(count) <= room(count + 1)
    assert room(3 * count, 3) >= 3 * 4096


@pytest.mark.usefixtures("runtime_cpu")
def test_a_larger_structure_takes_the_kernels_of_a_smaller_one_and_the_bits_are_those_of_its_own() -> None:
    pillow(4)
    compiled = ti.lang.impl.get_runtime().get_num_compiled_functions()
    here = pillow(6).steps[-1].displacement
    assert ti.lang.impl.get_runtime().get_num_compiled_functions() == compiled
    alone = subprocess.run(
        [sys.executable, "-c", PILLOW.format(overrides=overrides(6))], capture_output=True, text=True, check=True
    )
    assert alone.stdout.strip() == here.tobytes().hex()
