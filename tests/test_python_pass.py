"""Taichi's pass over the source of kernels: each function parsed once, with the same outcome as Taichi's own."""

import ast
import importlib
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from taichi_membrane.device import python_pass, runtime
from taichi_membrane.device.language import ti

PACKAGE = Path(python_pass.__file__).resolve().parent.parent
Array = ti.types.ndarray()


@ti.func
def length(x):
    return x.norm()


@ti.func
def power(x, n: ti.template()):
    """Inlined within itself: no tree may be in use twice."""
    result = x * 0.0 + 1.0
    if ti.static(n > 0):
        result = power(x, ti.static(n - 1)) * x + 0.0 * power(x, ti.static(n - 1))
    return result


@ti.func
def first_of(x: ti.template()):
    """Of a Taichi vector ``sum`` is a function of Taichi's, of a Python object its own method."""
    return x.sum()


class Three:
    def sum(self) -> float:
        return 3.0


three = Three()


@ti.kernel
def several(out: Array):
    for i in range(1):
        v = ti.Vector([3.0, 4.0])
        out[i] = length(v) + length(2.0 * v)
        out[1] = power(v[0], 4)
        out[2] = first_of(v)
        out[3] = first_of(three)
        out[4] = first_of(v)


@ti.kernel
def wrong(out: Array):
    for i in range(1):
        out[i] = length(unknown)  # noqa: F821


def test_functions_inlined_again_and_within_themselves_do_what_they_do(runtime_cpu: runtime.Runtime) -> None:
    out = np.zeros(5)
    several(out)
    assert out.tolist() == [15.0, 81.0, 7.0, 3.0, 7.0]


def test_a_mistake_is_told_with_its_file_line_and_function(runtime_cpu: runtime.Runtime) -> None:
    line = next(n for n, text in enumerate(Path(__file__).read_text().splitlines(), 1) if "length(unknown)" in text)
    with pytest.raises(ti.TaichiCompilationError, match="unknown") as told:
        wrong(np.zeros(1))
    assert f'File "{__file__}", line {line}, in wrong' in str(told.value)


@pytest.mark.parametrize("version", [(1, 7, 5), None])
def test_another_taichi_is_left_as_it_is(version: tuple[int, ...] | None) -> None:
    before = ti.lang.kernel_impl.transform_tree
    assert not python_pass.hasten(SimpleNamespace(__version__=version))
    assert ti.lang.kernel_impl.transform_tree is before


@pytest.mark.parametrize(("module", "name"), [(m, name) for m, names in python_pass._NAMES.items() for name in names])
def test_taichi_without_one_of_the_names_is_left_as_it_is(
    module: str, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = ti.lang.kernel_impl.transform_tree
    monkeypatch.delattr(importlib.import_module(f"taichi.lang.{module}"), name)
    assert not python_pass.hasten(ti)
    monkeypatch.undo()
    assert ti.lang.kernel_impl.transform_tree is before


SAME = """
from taichi_membrane.device import python_pass
if {plain}:
    python_pass.hasten = lambda taichi: False
import taichi_membrane as tm
step = tm.run(tm.load_scene("cushion", ["mesh.along_x=4", "mesh.along_y=4", "checks=[]"])).steps[-1]
print(step.displacement.tobytes().hex())
"""


def test_results_are_those_without_it_to_the_last_bit() -> None:
    found = [
        subprocess.run(
            [sys.executable, "-c", SAME.format(plain=plain)], capture_output=True, text=True, check=True
        ).stdout
        for plain in (True, False)
    ]
    assert len(found[0]) > 1000
    assert found[0] == found[1]


def is_compiled(node: ast.FunctionDef) -> bool:
    return any(
        isinstance(one, ast.Attribute) and isinstance(one.value, ast.Name) and one.value.id == "ti"
        for one in node.decorator_list
    )


def test_no_variable_of_a_kernel_stands_for_values_of_several_kinds() -> None:
    """What is not needed has a name of its own: a ``_`` that is a vector first and a number then breaks the compiler."""
    kernels = [
        (path.name, node)
        for path in sorted(PACKAGE.rglob("*.py"))
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.FunctionDef) and is_compiled(node)
    ]
    assert len(kernels) > 100
    found = [
        f"{name}:{one.lineno}"
        for name, node in kernels
        for one in ast.walk(node)
        if isinstance(one, ast.Tuple) and any(isinstance(part, ast.Name) and part.id == "_" for part in one.elts)
    ]
    assert not found
