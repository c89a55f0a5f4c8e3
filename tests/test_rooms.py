"""The order of the rooms, read from their imports: none knows of one above it, and one alone knows Taichi."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from itertools import chain
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parent.parent / "taichi_membrane"
# From the ground up; rooms of one floor do not know each other.
FLOORS = (
    ("errors", "names", "arrays", "bounds", "collector"),
    ("fields", "device"),
    ("mesh", "scene"),
    ("shapes", "algebra"),
    ("mechanics",),
    ("solvers",),
    ("simulation",),
    ("output",),
    ("pictures",),
    ("page",),
    ("execution",),
    ("study", "assurance"),
    ("parametric",),
    ("commands",),
)
# One message class serves all that read a user's input, and a mesh that is too large is refused where it is read.
NEIGHBOURS = {("names", "errors"), ("bounds", "errors")}
FLOOR = {room: number for number, floor in enumerate(FLOORS) for room in floor}


def imports(path: Path) -> Iterator[str]:
    """Modules that a file imports, wherever in it, for types alone included."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: a relative import"
            assert node.module is not None
            # ``from taichi_membrane import mesh`` names a room as well.
            yield from (
                [f"{node.module}.{alias.name}" for alias in node.names]
                if node.module == PACKAGE.name
                else [node.module]
            )
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)


def room(path: Path) -> str:
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


FILES = sorted(path for path in PACKAGE.rglob("*.py") if room(path) not in ("__init__", "__main__", "shipped_scenes"))


def test_every_room_has_its_floor() -> None:
    assert {room(path) for path in FILES} == set(chain(*FLOORS))


@pytest.mark.parametrize("name", list(FLOOR))
def test_a_room_knows_none_above_it_nor_beside_it(name: str) -> None:
    found = []
    for path in FILES:
        for module in imports(path) if room(path) == name else ():
            head, _, rest = module.partition(".")
            other = rest.partition(".")[0]
            if head != PACKAGE.name or not other or other == name or (name, other) in NEIGHBOURS:
                continue
            if FLOOR[other] >= FLOOR[name]:
                found.append(f"{path.relative_to(PACKAGE)} imports {module}")
    assert not found


def test_one_room_alone_imports_taichi() -> None:
    found = {room(path) for path in FILES if any(module.partition(".")[0] == "taichi" for module in imports(path))}
    assert found == {"device"}
