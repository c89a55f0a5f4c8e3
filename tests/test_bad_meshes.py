"""Thousands of bad meshes, in memory and as files: each is refused with one message, or is a surface that can be computed with."""

from __future__ import annotations

import contextlib
import io
import resource
import signal
import subprocess
import sys
import warnings
from collections.abc import Iterator
from pathlib import Path

import meshio
import numpy as np
import pytest
from bad_input import PROFILE, assert_one_message
from hypothesis import given, settings
from hypothesis import strategies as st

from taichi_membrane.errors import InputError
from taichi_membrane.mesh import Mesh, read, read_mesh
from taichi_membrane.shapes import cushion, panel, sphere

ROOT = Path(__file__).resolve().parent.parent
FORMATS = {
    "gmsh.msh": {"file_format": "gmsh"},
    "text.msh": {"file_format": "gmsh", "binary": False},
    "old.msh": {"file_format": "gmsh22", "binary": False},
    "ball.vtk": {}, "ball.vtu": {}, "ball.obj": {}, "ball.ply": {}, "ball.stl": {}, "ball.off": {}, "ball.inp": {},
    "ball.mesh": {}, "ball.meshb": {}, "ball.bdf": {}, "ball.vol": {},
    "ball.avs": {}, "ball.xml": {},
}  # fmt: skip


def assert_sound(mesh: Mesh) -> None:
    """Areas above zero, edges of two triangles passed in opposite senses (where a wall ends there is none), groups within range."""
    assert (mesh.tri_areas() > 0.0).all()
    assert np.isfinite(mesh.tri_normals()).all()
    runs = np.concatenate([mesh.triangles[:, [k, (k + 1) % 3]] for k in range(3)])
    _, edge, count = np.unique(np.sort(runs, axis=1), axis=0, return_inverse=True, return_counts=True)
    plain = runs[count[edge.ravel()] == 2]
    assert len(np.unique(plain, axis=0)) == len(plain)
    assert set(mesh.cells.ravel().tolist()) == set(range(mesh.node_count))
    for groups, count in ((mesh.node_groups, mesh.node_count), (mesh.tri_groups, mesh.tri_count)):
        for members in groups.values():
            assert len(members)
            assert 0 <= members.min() <= members.max() < count


_COORDINATES = st.one_of(
    st.integers(-2, 2).map(float),
    st.sampled_from([float("nan"), float("inf"), 1e300, -1e300, 1e-300, 1e30, -1e30, 1e-30, 1e16]),
    st.floats(),
)
_NODES = st.one_of(st.integers(0, 6), st.integers(0, 6), st.sampled_from([-1, 7, 2**31, 2**40, -(2**63), 2**63 - 1]))


@settings(PROFILE, max_examples=1200)
@given(
    points=st.lists(st.tuples(*[st.integers(-2, 2).map(float)] * 3), min_size=3, max_size=7),
    odd=st.lists(st.tuples(st.integers(0, 20), _COORDINATES), max_size=2),
    triangles=st.lists(st.tuples(_NODES, _NODES, _NODES), max_size=6),
    group=st.lists(_NODES, max_size=3),
)
def test_random_triangles_are_refused_or_sound(points: list, odd: list, triangles: list, group: list) -> None:
    xyz = np.array(points)
    for place, value in odd:
        xyz.ravel()[place % xyz.size] = value
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            mesh = Mesh.build(xyz, triangles, {"some": group} if group else {}, {"few": group[:1]} if group else {})
    except InputError as error:
        assert_one_message(str(error), "mesh: ")
    else:
        assert_sound(mesh)


@settings(PROFILE, max_examples=700)
@given(data=st.data())
def test_a_damaged_surface_is_refused_or_sound(data: st.DataObject) -> None:
    """Faults that random triangles rarely make: extra, missing, turned and doubled triangles, nodes that fall together."""
    good = data.draw(st.sampled_from(_SURFACES))
    points, triangles = good.points.copy(), good.triangles.copy()
    t, n = st.integers(0, len(triangles) - 1), st.integers(0, len(points) - 1)
    for fault in data.draw(st.lists(st.sampled_from(range(6)), min_size=1, max_size=4)):
        if fault == 0:
            triangles = np.delete(triangles, data.draw(t) % len(triangles), axis=0)
        elif fault == 1:
            row = data.draw(t) % len(triangles)
            triangles[row] = triangles[row, ::-1]
        elif fault == 2:
            triangles = np.vstack(
                (triangles, triangles[data.draw(t) % len(triangles)][data.draw(st.permutations(range(3)))])
            )
        elif fault == 3:
            points[data.draw(n)] = points[data.draw(n)]
        elif fault == 4:
            triangles[triangles == data.draw(n)] = data.draw(n)
        else:
            triangles = np.vstack((triangles, [data.draw(n), data.draw(n), data.draw(n)]))
    try:
        mesh = Mesh.build(points, triangles)
    except InputError as error:
        assert_one_message(str(error), "mesh: ")
    else:
        assert_sound(mesh)


_SURFACES = [
    sphere(radius=1.0, divisions=2),
    panel(width=2.0, height=2.0, along_x=3, along_y=2),
    cushion(width=1.0, height=1.0, along_x=3, along_y=3),
]


@pytest.fixture(scope="module")
def good_files(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, bytes]]:
    """A small ball in every format that meshio writes triangles in without another package."""
    folder = tmp_path_factory.mktemp("good")
    ball = sphere(radius=3.0, divisions=1)
    content = {}
    monkeypatch = pytest.MonkeyPatch()
    monkeypatch.setattr(read, "_PATIENCE", 0.3)  # a cut PLY header is read for ever
    for name, options in FORMATS.items():
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
            meshio.Mesh(ball.points, [("triangle", ball.triangles)]).write(folder / name, **options)
        content[name] = (folder / name).read_bytes()
    yield content
    monkeypatch.undo()


def refused_or_sound(path: Path) -> bool:
    """Whether the file is refused; asserts that it is one or the other."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            mesh = read_mesh(path)
    except InputError as error:
        assert_one_message(str(error), f"{path}: ")
        return True
    assert_sound(mesh)
    return False


@settings(PROFILE, max_examples=1000)
@given(data=st.data())
def test_a_damaged_file_is_refused_or_sound(tmp_path: Path, good_files: dict[str, bytes], data: st.DataObject) -> None:
    name = data.draw(st.sampled_from(sorted(FORMATS)))
    content = bytearray(good_files[name])
    for fault in data.draw(
        st.lists(st.sampled_from(["byte", "cut", "drop", "number", "repeat"]), min_size=1, max_size=3)
    ):
        at = data.draw(st.integers(0, max(len(content) - 1, 0)))
        if fault == "byte":
            content[at : at + 1] = data.draw(st.binary(min_size=1, max_size=4))
        elif fault == "cut":
            del content[at:]
        elif fault == "drop":
            del content[at : at + data.draw(st.integers(1, 40))]
        elif fault == "repeat":
            content[at:at] = content[at : at + data.draw(st.integers(1, 60))]
        else:  # where a number stands in text, one that is worse
            content[at : at + 1] = data.draw(
                st.sampled_from([b" 99999999999 ", b" -1 ", b" nan ", b" 1e999 ", b" 0 ", b" 2147483648 "])
            )
    path = tmp_path / name
    path.write_bytes(bytes(content))
    refused_or_sound(path)
    assert [item.name for item in tmp_path.iterdir() if item.name not in FORMATS] == []


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("tin.wkt", b"TIN (((" + b"0 0 0, 1 0 0, 1 1 0, 0 0 0)), ((" * 20),
    ],
)
def test_a_reader_that_never_ends_is_stopped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, content: bytes
) -> None:
    monkeypatch.setattr(read, "_PATIENCE", 0.3)
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(InputError, match=rf"the mesh cannot be read: its {len(content)} bytes took more than 0.3"):
        read_mesh(path)
    assert signal.getsignal(signal.SIGALRM) is signal.SIG_DFL
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)


NODES = (
    "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Nodes\n{}\n$EndNodes\n$Elements\n1 1 1 1\n2 1 2 1\n1 1 2 3\n$EndElements\n"
)
OLD = "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n{}\n$EndNodes\n$Elements\n{}\n$EndElements\n"
VTK = "# vtk DataFile Version 3.0\nx\nBINARY\nDATASET UNSTRUCTURED_GRID\nPOINTS {} double\n"
CLAIMS = {
    "nodes.msh": NODES.format("1 9999999999 1 9999999999\n2 1 0 9999999999\n1"),
    "tag.msh": NODES.format("1 3 1 999999999\n2 1 0 3\n1\n2\n999999999\n0 0 0\n1 0 0\n1 1 0")
    .replace("1 1 2 3", "1 1 2 999999998"),
    "old.msh": OLD.format(4_000_000_000, 1),
    "oldtag.msh": OLD.format("3\n1 0 0 0\n2 1 0 0\n3000000000 1 1 0", "1\n1 2 0 1 2 3000000001"),
    "points.vtk": VTK.format(10**10),
    "less.vtk": VTK.format(10**8),
    "count.stl": "\0" * 80 + "\xff\xff\xff\x7f",
    "count.ply": "ply\nformat ascii 1.0\nelement vertex 9999999999\nproperty float x\nproperty float y\nend_header\n",
    "count.off": "OFF\n9999999999 9999999999 0\n",
    "beyond.obj": "v 0 0 0\nv 1 0 0\nv 1 1 0\nf 1 2 9999999999\n",
}  # fmt: skip


def test_claims_of_gigabytes_take_no_memory(tmp_path: Path) -> None:
    """In a process of its own, whose largest size is measured."""
    for name, content in CLAIMS.items():
        (tmp_path / name).write_bytes(content.encode("latin-1"))
    script = (
        "import sys\nfrom pathlib import Path\nfrom taichi_membrane.mesh import read_mesh\n"
        "for path in sorted(Path(sys.argv[1]).iterdir()):\n"
        "    try:\n        read_mesh(path)\n        print('READ', path)\n"
        "    except ValueError as error:\n        print(type(error).__name__, error)\n"
        # Not ru_maxrss, which a child inherits from its parent.
        "print(next(line.split()[1] for line in open('/proc/self/status') if line.startswith('VmHWM')))"
    )
    command = [sys.executable, "-c", script, str(tmp_path)]
    done = subprocess.run(
        command, env={"PYTHONPATH": str(ROOT)}, capture_output=True, text=True, timeout=120, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")
    *told, peak = done.stdout.splitlines()
    assert len(told) == len(CLAIMS)
    for line, path in zip(told, sorted(tmp_path.iterdir()), strict=True):
        assert_one_message(line, f"InputError {path}: ")
    assert int(peak) * 1024 < 1.5e9


def test_a_process_with_little_memory_ends_with_one_message(tmp_path: Path) -> None:
    """The command itself, in 2 GB of address space: meshes and load steps that would not fit."""
    (tmp_path / "ball.toml").write_text(BALL)
    for changes, expected in (
        (["mesh.divisions=1500"], "18000000 triangles; a mesh of that size needs at least 2.88 GB of memory, and there are 2 GB"),
        (["mesh.divisions=60", "stages.1.steps=10000"], "51 GB of memory, and there are 2 GB: 10000 load steps of 14402 nodes"),
        (["mesh.divisions=900"], "error: not enough memory: "),
    ):  # fmt: skip
        command = [sys.executable, "-m", "taichi_membrane", "check", "ball.toml"]
        done = subprocess.run(
            [*command, *(part for change in changes for part in ("--set", change))],
            cwd=tmp_path,
            env={"PYTHONPATH": str(ROOT), "OPENBLAS_NUM_THREADS": "1"},
            preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (2_000_000_000, 2_000_000_000)),
            capture_output=True,
            text=True,
            timeout=60,
            check=False,
        )
        assert (done.returncode, done.stdout) == (2, ""), done.stderr
        assert len(done.stderr.splitlines()) == 1
        assert expected in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["ball.toml"]


BALL = """
name = "ball"
units = { length = "mm", force = "N" }
mesh = { shape = "sphere", radius = 100.0, divisions = 3 }
fabric = { E = 10.0, nu = 0.3, thickness = 1.0 }
supports = [{ group = "south", hold = "xyz" }, { group = "north", hold = "xy" }, { group = "x_plus", hold = "y" }]
stages = [{ name = "inflate", pressure = 0.002 }]
"""


@settings(PROFILE, max_examples=300)
@given(content=st.binary(max_size=200) | st.text(max_size=100).map(str.encode), name=st.sampled_from(sorted(FORMATS)))
def test_garbage_is_refused(tmp_path: Path, content: bytes, name: str) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    assert refused_or_sound(path)
