"""Good scenes to damage, what to damage them with, and what every refusal must look like."""

from __future__ import annotations

import datetime
import re
from collections.abc import Iterator
from typing import Any

from hypothesis import HealthCheck, settings
from hypothesis import strategies as st

# The same examples on every machine and every day; kernels and files make the time of one example vary too much for a deadline.
PROFILE = settings(
    derandomize=True,
    deadline=None,
    database=None,
    print_blob=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)

LONGEST_MESSAGE = 3000  # characters; the longest good one lists the names of a mesh

_CHAMBERS = {
    "arch_tent": "arch_1",
    "mattress": "cell_1",
    "drop_stitch": "shell",
    "hull": "hull",
}  # not all of their elements enclose one

# Between them these use every table of a scene.
GOOD: list[dict[str, Any]] = [
    {
        "name": "beam",
        "title": "A beam",
        "units": {"length": "mm", "force": "N"},
        "mesh": {"shape": "tube", "radius": 25.0, "length": 100.0, "around": 6, "along": 4, "cap_end": "flat"},
        "groups": {"upper": {"where": "z > 5"}, "far": {"where": "x >= 50 and z > 0", "kind": "elements"}},
        "fabric": {
            "E_warp": 4000.0,
            "E_weft": 2500.0,
            "nu": 0.1,
            "G": 150.0,
            "thickness": 0.1,
            "warp_angle": 5.0,
            "density": 1e-9,
        },
        "fabrics": {
            "far": {
                "E": 10.0,
                "nu": 0.3,
                "thickness": 1.0,
                "law": "clip",
                "prestress": [1.0, 0.0, 0.5],
                "mass_per_area": 2e-9,
            }
        },
        "supports": [{"group": "start", "hold": "xyz"}],
        "pressures": {"inside": {"group": "wall"}, "dead": {"group": "cap_end", "kind": "fixed"}},
        "loads": {
            "tip": {"group": "end", "direction": [0.0, 0.0, -1.0], "spread": "edges"},
            "line": {"group": "end", "direction": [0.0, 1.0, 0.0], "kind": "line"},
            "area": {"group": "far", "direction": [0.0, 0.0, 2.0], "kind": "area"},
            "oil": {
                "kind": "water",
                "specific_weight": 1e-5,
                "group": ["wall"],
                "floor": [0, 0, -30],
                "up": [0.1, 0, 1],
            },
            "own": {"kind": "weight", "g": 9810.0},
            "snow": {"kind": "snow", "group": ["far", "wall"], "direction": [0.0, 0.5, -1.0]},
            "gust": {"kind": "wind", "q": 1e-3, "cp": {"far": -0.5, "all": 0.8}, "face": "back"},
            "storm": {
                "kind": "wind",
                "q": 1e-3,
                "table": {
                    "angles": [0, 90, 180],
                    "cp": [1.0, -1.0, 0.2],
                    "direction": [0.0, 1.0, 0.0],
                    "centre": [0.0, 0.0, 0.0],
                    "axis": [1.0, 0.0, 0.0],
                    "group": "wall",
                },
            },
        },
        "motions": {"push": {"kind": "translation", "group": "tip", "direction": [1.0, 0.0, 0.0], "hold": "x"}},
        "stages": [
            {"name": "inflate", "pressure": {"inside": 0.035, "dead": 0.01}},
            {
                "name": "load",
                "steps": 3,
                "loads": {"tip": 4.5, "line": 1.0, "own": 1.0, "snow": 1e-4, "gust": 1.0, "storm": 0.5, "oil": 20.0},
                "motions": {"push": 2.0},
            },
        ],
        "probes": {
            "deflection": {"kind": "displacement", "group": "end", "component": "z"},
            "foot": {"kind": "reaction", "group": "start", "component": "x"},
            "root": {"kind": "moment", "group": "start", "axis": [0.0, 1.0, 0.0], "through": [0.0, 0.0, 0.0]},
            "turn": {"kind": "rotation", "group": "end", "axis": [0.0, 1.0, 0.0], "through": [0.0, 0.0, 0.0]},
            "girth": {"kind": "radius", "group": "middle", "axis": "x"},
            "content": {"kind": "volume"},
            "peak": {"kind": "stress", "group": "wall", "which": "minor", "reduce": "mean"},
            "wrinkled": {"kind": "area_share", "state": "wrinkled"},
        },
        "checks": [
            {"probe": "deflection", "stage": "load", "step": 2, "reference": -1.0, "tolerance": 0.1, "source": "beam"},
            {"probe": "content", "stage": "inflate", "reference": 0.0, "absolute": 1.0, "source": "none"},
        ],
        "curve": {
            "x": "deflection",
            "y": "load.tip",
            "stage": "load",
            "lines": [{"label": "collapse", "axis": "y", "value": 4.0}],
            "references": [{"label": "theory", "x": [0.0, 1.0], "y": [0.0, 2.0]}],
        },
        "camera": {"field": "major_stress", "azimuth": 30.0, "size": [400, 300]},
        "solver": {"kind": "newton", "tolerance": 1e-5, "max_iterations": 100, "max_cuts": 2},
    },
    {
        "name": "sheet",
        "units": {"length": "m", "force": "kN"},
        "mesh": {"shape": "panel", "width": 4.0, "height": 2.0, "along_x": 4, "along_y": 2, "pattern": "crossed"},
        "fabrics": {"all": {"E": 10.0, "nu": 0.3, "thickness": 1.0, "warp": [1.0, 0.5, 0.0]}},
        "supports": [{"group": "x_min", "normal": [1.0, 1.0, 0.0]}, {"group": "x_min", "hold": "xyz"}],
        "motions": {
            "twist": {"kind": "rotation", "group": "x_max", "axis": [1.0, 0.0, 0.0], "through": [0.0, 1.0, 0.0]}
        },
        "stages": [{"name": "turn", "motions": {"twist": 20.0}}],
    },
    *(
        {
            "name": mesh["shape"],
            "units": {"length": "m", "force": "N"},
            "mesh": mesh,
            "fabric": {"E": 10.0, "nu": 0.3, "thickness": 1.0},
            **({"pressures": {"inside": {"group": _CHAMBERS[mesh["shape"]]}}} if mesh["shape"] in _CHAMBERS else {}),
            "supports": [{"group": "all", "hold": "xyz"}],
            "stages": [{"name": "inflate", "pressure": 1.0}],
        }
        for mesh in (
            {"shape": "arch", "span": 12.0, "radius": 0.5, "around": 5, "along": 4, "angle": 120.0},
            {"shape": "cushion", "width": 2.0, "height": 3.0, "along_x": 3, "along_y": 2},
            {"shape": "sphere", "radius": 2.0, "divisions": 2},
            {"shape": "disc", "radius": 2.0, "rings": 2, "sectors": 5},
            {"shape": "annulus", "inner": 1.0, "outer": 2.0, "around": 5, "rings": 2},
            {"shape": "wedge", "radius": 2.0, "angle": 30.0, "rings": 3, "around": 2},
            {
                "shape": "arch_tent",
                "span": 6.0,
                "radius": 0.5,
                "spacing": 3.0,
                "around": 6,
                "along": 8,
                "across": 2,
                "ends": "closed",
            },
            {
                "shape": "mattress",
                "width": 2.0,
                "length": 1.0,
                "height": 0.2,
                "cells_x": 2,
                "along_x": 2,
                "along_y": 2,
                "up": 1,
            },
            {"shape": "hypar", "width": 2.0, "depth": 3.0, "rise": 1.0, "along": 2},
            {"shape": "cone", "radius": 2.0, "ring": 0.5, "height": 1.0, "around": 6, "up": 2, "corners": 3},
            {
                "shape": "drop_stitch",
                "width": 1.0,
                "length": 2.0,
                "height": 0.2,
                "along_x": 2,
                "along_y": 4,
                "up": 2,
                "yarns": "webs",
            },
            {"shape": "airbag", "outline": "disc", "size": 1.0, "divisions": 2},
            {"shape": "water_tube", "radius": 0.5, "length": 2.0, "around": 8, "along": 2, "ends": "flat"},
            {"shape": "pumpkin", "radius": 2.0, "gores": 6, "along": 4, "across": 2},
            {"shape": "hull", "length": 9.0, "radius": 1.5, "around": 8, "along": 12, "fins": 2, "fin_from": 0.6},
            {"shape": "file", "path": "square.obj", "scale": 2.0},
        )
    ),
]

_NUMBERS = st.one_of(
    st.integers(-3, 12),
    st.sampled_from([0, -1, 2**31, 2**63, -(2**63) - 1, 2**64, 10**9, 10**30, 10**400]),
    st.sampled_from([0.0, -0.0, 1.5, -2.5, 1e-12, 1e9, 1e300, -1e300, 1.7e308, 5e-324, 1e-200, -1e-160, 1e160]),
    st.sampled_from([float("nan"), float("inf"), float("-inf")]),
    st.floats(width=64),
)
_TEXTS = st.one_of(
    st.sampled_from(["", " ", "all", "end", "boundary", "x", "xyz", "xx", "tube", "file", "total", "__class__", "a" * 5000]),
    st.sampled_from(["../../etc/passwd", "/etc/passwd", "..", "/", "C:\\x", "a/b", "a\x00b", "x\ny", "\x1b[2J", "\u202e", "$x^{$"]),
    st.sampled_from(["x < " + "9" * 400, "x = 1 within 1e-400", "x < 1 and " * 2000 + "y < 1", "(" * 3000, "square.obj"]),
    st.text(st.characters(exclude_categories=("Cs",)), max_size=12),
)  # fmt: skip
_PLAIN = st.one_of(
    _NUMBERS, _TEXTS, st.booleans(), st.just(datetime.date(2024, 2, 29)), st.just(datetime.time(1, 2, 3))
)
JUNK = st.recursive(
    _PLAIN,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(_TEXTS, inner, max_size=3),
    max_leaves=6,
)


def places(data: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Every key and every list position of a scene, deep first level last."""
    items = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    for key, value in items:
        yield (*path, key)
        yield from places(value, (*path, key))


def copied(data: Any) -> Any:
    """A deep copy of tables and lists."""
    if isinstance(data, dict):
        return {key: copied(value) for key, value in data.items()}
    return [copied(item) for item in data] if isinstance(data, list) else data


def _like(draw: st.DrawFn, value: Any) -> Any:
    """Another value of the same type, which gets further than one that the first look refuses."""
    if isinstance(value, bool):
        return not value
    if isinstance(value, int):
        return draw(st.integers(-2, 40) | _NUMBERS)
    if isinstance(value, float):
        return value * draw(st.sampled_from([-1.0, 0.0, 0.5, 3.0, 1e-6, 1e6, 1e-25, 1e25, 1e-29, 1e29, 1e-180, 1e180]))
    if isinstance(value, str):
        return draw(st.sampled_from(_WORDS) | _TEXTS)
    if isinstance(value, list):
        return [_like(draw, item) for item in value] if draw(st.booleans()) else value[: draw(st.integers(0, 2))]
    if isinstance(value, dict):
        return {key: _like(draw, item) if draw(st.integers(0, 3)) == 0 else item for key, item in value.items()}
    return value


def _words(data: Any) -> set[str]:
    """All texts and keys of a scene."""
    if isinstance(data, dict):
        return set(data).union(*(_words(item) for item in data.values()))
    return {data} if isinstance(data, str) else set().union(*map(_words, data)) if isinstance(data, list) else set()


_WORDS = sorted(_words(GOOD) | {"x_min", "x_max", "rim", "centre", "xy", "z = 0 within 1", "r < 1e29", "y > 0"})


@st.composite
def damaged_scenes(draw: st.DrawFn) -> dict[str, Any]:
    """A good scene with one to three faults: a value replaced, a key removed, an unknown key or an item added."""
    scene: dict[str, Any] = copied(draw(st.sampled_from(GOOD)))
    for _ in range(draw(st.sampled_from([1, 1, 1, 2, 3]))):
        paths = list(places(scene))
        if not paths:
            break
        *above, key = draw(st.sampled_from(paths))
        table = scene
        for part in above:
            table = table[part]
        fault = draw(st.sampled_from(["like", "like", "like", "replace", "replace", "remove", "add", "repeat"]))
        if fault == "like":
            table[key] = _like(draw, table[key])
        elif fault == "replace":
            table[key] = draw(JUNK)
        elif fault == "remove":
            del table[key]
        elif isinstance(table, dict):
            table[draw(_TEXTS)] = copied(table[key]) if fault == "repeat" else draw(JUNK)
        else:
            table.append(copied(table[key]) if fault == "repeat" else draw(JUNK))
    return scene


def toml(value: Any) -> str:
    """TOML text of a value; the top table has a line per key, everything below is inline."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{_quoted(key)} = {toml(item)}" for key, item in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(map(toml, value)) + "]"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int):
        return str(value)
    if isinstance(value, float | datetime.date | datetime.time):
        return str(value)
    return _quoted(value)


def scene_toml(scene: dict[str, Any]) -> str:
    """TOML text of a whole scene."""
    return "".join(f"{_quoted(key)} = {toml(value)}\n" for key, value in scene.items())


def _quoted(text: str) -> str:
    escaped = re.sub(r'[\x00-\x1f\x7f"\\]', lambda match: f"\\u{ord(match[0]):04x}", text)
    return f'"{escaped}"'


def assert_one_message(text: str, begins: str) -> None:
    """One line of bounded length that names its source and nothing of the machinery behind it."""
    assert text.startswith(begins), text[:300]
    assert len(text) < LONGEST_MESSAGE + len(begins), text[:300]
    for noise in ("pydantic", "https://", "Value error", "validation error", "input_value", "Traceback", "numpy."):
        assert noise not in text, text[:300]
