"""Scenes with six-node triangles: closed forms, every way to equilibrium, files, pictures, and what is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest
from PIL import Image
from run_files import same
from scipy.optimize import brentq
from two_boxes import two_boxes

import taichi_membrane as tm
from taichi_membrane import shapes
from taichi_membrane.errors import InputError
from taichi_membrane.execution.observer import Observer
from taichi_membrane.mesh.middles import straight, with_middles
from taichi_membrane.output.reader import read_run
from taichi_membrane.page.content import head_and_block
from taichi_membrane.scene import Scene
from taichi_membrane.simulation.model import build_mesh, build_model

pytestmark = pytest.mark.usefixtures("runtime_cpu")

BALL = {
    "name": "ball",
    "units": {"length": "m", "force": "N"},
    "fabric": {"E": 100.0, "nu": 0.3, "thickness": 0.1},
    "groups": {
        "on_x": {"where": "y = 0 within 1e-9 and z = 0 within 1e-9"},
        "on_y": {"where": "x = 0 within 1e-9 and z = 0 within 1e-9"},
        "on_z": {"where": "x = 0 within 1e-9 and y = 0 within 1e-9"},
    },
    "supports": [{"group": "on_x", "hold": "yz"}, {"group": "on_y", "hold": "xz"}, {"group": "on_z", "hold": "xy"}],
    "pressures": {"gas": {"ambient": 10.0}, "outside": {"kind": "fixed"}},
    "stages": [
        {"name": "inflate", "pressure": {"gas": 2.0}},
        {"name": "squeeze", "pressure": {"outside": -1.5}, "closed": ["gas"]},
    ],
    "probes": {
        "radius": {"kind": "radius", "group": "all", "axis": "centre"},
        "volume": {"kind": "volume"},
        "gas": {"kind": "factor", "of": "pressure.gas"},
        "stress": {"kind": "stress", "reduce": "mean"},
    },
    "solver": {"kind": "newton", "tolerance": 1e-10},
}  # fmt: skip


def squeezed() -> tuple[float, float]:
    """Stretch of the inflated ball and of the squeezed one: (p λ² - q) R = 2 t S λ, S = E (λ² - 1)/(2 (1 - ν)), p_abs λ³ kept."""

    def load(stretch: float) -> float:
        return 0.2 * 100.0 * (stretch**2 - 1) / 1.4 * stretch

    first = float(brentq(lambda s: 2.0 * s**2 - load(s), 1.0, 1.3))
    return first, float(brentq(lambda s: (12.0 * (first / s) ** 3 - 10.0) * s**2 - 1.5 - load(s), 0.9, first))


def test_a_shut_ball_converges_to_its_closed_form_with_order_four() -> None:
    """Volumes before and after a dead pressure squeezes it; the gas follows the volume, at three nodes a tenth as well."""
    exact = np.array(squeezed()) ** 3 * 4.0 / 3.0 * np.pi
    errors = []
    for divisions in (8, 4, 2):  # the largest first: the others go in its kernels
        mesh = {"shape": "sphere", "radius": 1.0, "divisions": divisions, "order": 2}
        result = tm.run(Scene.model_validate({**BALL, "mesh": mesh}))
        assert result.converged, result.steps[-1].reason
        volume = result.probe("volume")
        errors.append(np.abs(volume / exact - 1.0))
        assert (12.0 * volume[0]) == pytest.approx((result.probe("gas")[1] + 10.0) * volume[1], rel=1e-9)
        assert np.all([step.imbalance < 1e-9 for step in result.steps])
    assert (errors[1] < 1.1e-3).all(), errors  # with 258 nodes
    assert (np.log2(errors[2] / errors[1]) > 3.5).all(), errors
    assert (np.log2(errors[1] / errors[0]) > 3.5).all(), errors


def beam(**changes: Any) -> Scene:
    """A tube that is bent until it wrinkles."""
    scene = {
        "name": "beam",
        "units": {"length": "mm", "force": "N"},
        "mesh": {"shape": "tube", "radius": 25, "length": 200, "around": 8, "along": 6, "order": 2},
        "fabric": {"E": 4000, "nu": 0.1, "thickness": 0.1, "density": 1e-9},
        "supports": [{"group": "start", "hold": "xyz"}],
        "loads": {"tip": {"group": "end", "direction": [0, 0, -1], "spread": "edges"}},
        "stages": [
            {"name": "inflate", "pressure": 0.035},
            {"name": "load", "steps": 2, "loads": {"tip": 6.5}},
        ],
        "probes": {
            "tip": {"kind": "displacement", "group": "end", "component": "z"},
            "root": {"kind": "reaction", "group": "start", "component": "z"},
            "volume": {"kind": "volume"},
            "wrinkled": {"kind": "area_share"},
            "stress": {"kind": "stress", "reduce": "max"},
            "resultant": {"kind": "resultant", "reduce": "mean"},
        },
        "camera": {"size": [320, 240]},
        "solver": {"tolerance": 1e-9},
    }  # fmt: skip
    return Scene.model_validate({**scene, **changes})


@pytest.fixture(scope="module")
def bent() -> tm.RunResult:
    """The tube, by Newton."""
    result = tm.run(beam(derivatives=["tip", "volume"]))
    assert result.converged, result.steps[-1].reason
    return result


def test_a_bent_tube_wrinkles_and_balances(bent: tm.RunResult) -> None:
    last = bent.steps[-1]
    assert last.probes["root"] == pytest.approx(6.5, rel=1e-6)
    assert last.stable
    assert 0.02 < last.probes["wrinkled"] < 0.4
    points = last.elements.point_state
    assert points.shape == (bent.mesh.tri_count, 3)
    assert set(np.unique(points)) == {0, 1}
    mixed = (points != points[:, :1]).any(axis=1)
    assert mixed.any()
    assert (last.elements.state[mixed] == 1).all()
    assert (last.elements.state[~mixed] == points[~mixed, 0]).all()
    # In the inflated tube: hoop p r, axial p r/2, per width.
    wall = bent.mesh.points[bent.mesh.triangles].mean(axis=1)[:, 0]
    middle = (wall > 70.0) & (wall < 130.0)
    assert bent.steps[0].elements.major_resultant[middle] == pytest.approx(0.035 * 25.0, rel=0.02)
    assert bent.steps[0].elements.minor_resultant[middle] == pytest.approx(0.035 * 12.5, rel=0.02)
    around = bent.steps[0].elements.major_direction[middle]
    assert np.abs(around[:, 0]).max() < 0.05


def test_relaxation_finds_the_same(bent: tm.RunResult) -> None:
    result = tm.run(beam(solver={"kind": "relaxation", "tolerance": 1e-7}))
    assert result.converged, result.steps[-1].reason
    for name in ("tip", "volume", "wrinkled"):
        assert result.probe(name) == pytest.approx(bent.probe(name), rel=2e-5, abs=1e-5)


def test_the_path_by_arc_length_ends_there_too(bent: tm.RunResult) -> None:
    stages = [
        {"name": "inflate", "pressure": 0.035},
        {"name": "load", "steps": 12, "loads": {"tip": 6.5}, "control": "arc_length"},
    ]
    result = tm.run(beam(stages=stages, derivatives=["tip", "volume"]))
    assert result.converged, result.steps[-1].reason
    assert result.steps[-1].probes["tip"] == pytest.approx(bent.steps[-1].probes["tip"], rel=1e-6)


def test_derivatives_are_those_of_differences(bent: tm.RunResult) -> None:
    """By the adjoint, at the unwrinkled and the wrinkled state."""
    found = bent.steps[-1].derivatives
    step = 1e-3
    values: dict[str, list[dict[str, float]]] = {}
    for sign in (1, -1):
        load = {"name": "load", "steps": 2, "loads": {"tip": 6.5 + sign * step}}
        pressure = 0.035 * (1 + 1e-4 * sign)
        for name, stages in {
            "load.tip": [{"name": "inflate", "pressure": 0.035}, load],
            "pressure.inside": [
                {"name": "inflate", "pressure": pressure},
                {"name": "load", "steps": 2, "loads": {"tip": 6.5}},
            ],
        }.items():
            result = tm.run(beam(stages=stages, derivatives=["tip", "volume"]))
            values.setdefault(name, []).append(result.steps[-1].probes)
    for name, change in (("load.tip", 2 * step), ("pressure.inside", 2 * 0.035e-4)):
        for probe in ("tip", "volume"):
            difference = (values[name][0][probe] - values[name][1][probe]) / change
            assert found[probe][name] == pytest.approx(difference, rel=2e-3), (probe, name)


def test_frequencies_of_a_stretched_square() -> None:
    """√2/2 √(N/μ)/L and √5/2 √(N/μ)/L of a flat membrane under equal tension."""
    scene = {
        "name": "drum",
        "units": {"length": "m", "force": "N"},
        "mesh": {"shape": "panel", "width": 1.0, "height": 1.0, "along_x": 6, "along_y": 6, "order": 2},
        "fabric": {"E": 1e4, "nu": 0.3, "thickness": 0.1, "density": 10.0, "prestress": [20.0, 20.0, 0.0]},
        "supports": [{"group": "boundary", "hold": "xyz"}],
        "stages": [{"name": "rest"}],
        "modes": {"kind": "vibration", "count": 3},
    }
    result = tm.run(Scene.model_validate(scene))
    modes = result.steps[-1].modes
    assert modes is not None
    assert modes.values == pytest.approx(np.sqrt([2.0, 5.0, 5.0]) / 2.0 * np.sqrt(2.0 / 1.0), rel=4e-3)


def test_a_wall_between_two_chambers_and_a_cable_along_sides() -> None:
    """A box in two: the wall bears the difference of pressures; the cable around it lies on both halves of each side."""
    flat = two_boxes()
    mesh = with_middles(flat, straight)
    scene = Scene.model_validate(
        {
            "name": "boxes",
            "units": {"length": "m", "force": "N"},
            "mesh": {"shape": "given", "order": 2},
            "fabric": {"E": 1e4, "nu": 0.3, "thickness": 0.01},
            "supports": [{"group": "floor", "hold": "xyz"}],
            "cables": {"hoop": {"along": "seam", "EA": 50.0}},
            "pressures": {
                "left": {"group": ["left", "wall"], "ambient": 100.0},
                "right": {"group": "right", "against": "wall", "ambient": 100.0},
            },
            "stages": [
                {"name": "blow", "pressure": {"left": 1.0, "right": 1.0}, "steps": 2},
                {"name": "differ", "pressure": {"left": 2.0}, "closed": ["right"]},
            ],
            "probes": {
                "left": {"kind": "volume", "pressure": "left"},
                "right": {"kind": "volume", "pressure": "right"},
                "gas": {"kind": "factor", "of": "pressure.right"},
                "wall": {"kind": "displacement", "group": "amid_wall", "component": "x"},
                "hoop": {"kind": "cable", "cable": "hoop", "what": "force", "reduce": "max"},
            },
            "solver": {"tolerance": 1e-9},
        }
    )
    result = tm.run(scene, mesh=mesh)
    assert result.converged, result.steps[-1].reason
    blown, differ = result.steps[1:]
    assert result.steps[-1].imbalance < 1e-8
    assert differ.probes["wall"] > blown.probes["wall"] + 1e-3
    assert differ.probes["right"] < blown.probes["right"]
    assert (101.0 * blown.probes["right"]) == pytest.approx(
        (100.0 + differ.probes["gas"]) * differ.probes["right"], rel=1e-8
    )
    assert differ.probes["hoop"] > 0.0
    assert len(differ.cable_forces) == 2 * 4 * 2


# ---- files and pictures


class Stop(Observer):
    """Ends a run with its second load step, as by an interrupt."""

    def step_done(self, step: Any) -> None:
        if step.number == 1:
            raise KeyboardInterrupt


@pytest.mark.parametrize("points", [3, 6])
def test_files_hold_quadratic_triangles_and_a_stopped_run_goes_on(tmp_path: Path, points: int) -> None:
    mesh = {"shape": "tube", "radius": 25, "length": 200, "around": 6, "along": 4, "order": 2, "points": points}
    scene = beam(mesh=mesh, solver={})
    result = tm.run(scene, out=tmp_path / "whole", render=points == 3)
    content = meshio.read(tmp_path / "whole/step_0002.vtu")
    assert [block.type for block in content.cells] == ["triangle6"]
    cells = content.cells[0].data
    middle = content.points[cells[:, 3:]]  # amid the sides from corner 0 to 1, 1 to 2, 2 to 0
    far = [np.linalg.norm(content.points[cells[:, ends]] - middle, axis=2) for ends in ([0, 1, 2], [1, 2, 0])]
    assert far[0] == pytest.approx(far[1], rel=1e-12)
    assert content.cell_data["point_state"][0].shape == (result.mesh.tri_count, points)
    saved = read_run(tmp_path / "whole")
    assert np.array_equal(saved.mesh.cells, result.mesh.cells)
    assert saved.mesh.node_groups.keys() == result.mesh.node_groups.keys()
    for name, group in saved.mesh.node_groups.items():
        assert np.array_equal(group, result.mesh.node_groups[name])
    assert all(same(one, other) for one, other in zip(saved.steps, result.steps, strict=True))
    with pytest.raises(KeyboardInterrupt):
        tm.run(scene, out=tmp_path / "part", render=False, observer=Stop())
    again = tm.resume(tmp_path / "part", render=False)
    assert len(again.steps) == 3
    for one, other in zip(again.steps, result.steps, strict=True):
        assert np.array_equal(one.displacement, other.displacement)
        assert one.probes == other.probes


def test_pictures_have_round_outlines(tmp_path: Path) -> None:
    """Seen along its axis, a tube of six cells around has twelve sides, not six."""
    mesh = {
        "shape": "tube",
        "radius": 25,
        "length": 50,
        "around": 6,
        "along": 2,
        "cap_end": "flat",
        "pattern": "diagonal",
    }
    camera = {"azimuth": 90, "elevation": 0, "size": [400, 400], "supports": False, "loads": False, "outline": False}
    covered = []
    for order in (1, 2):
        scene = beam(
            name="prism",
            mesh=mesh | {"order": order},
            fabric={"E": 4000, "nu": 0.1, "thickness": 0.1, "law": "none"},
            camera=camera,
            stages=[{"name": "rest", "pressure": 1e-4}],
            loads={},
            solver={},
        )
        out = tmp_path / str(order)
        result = tm.run(scene, out=out)
        assert result.converged
        picture = np.asarray(Image.open(out / "step_0000.png").convert("RGB")).astype(int)
        coloured = (
            np.abs(picture - picture.mean(axis=2, keepdims=True)).max(axis=2)[35:] > 12
        )  # below the legend's words
        rows = np.flatnonzero(coloured[:, 150:230].any(axis=1))
        covered.append(float(coloured.sum()) / (0.5 * np.ptp(rows)) ** 2)
    # Area over the square of the radius.
    assert covered == pytest.approx([1.5 * np.sqrt(3.0), 3.0], rel=0.02)


# ---- what is refused


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        (
            {"loads": {"snow": {"kind": "snow", "group": "wall"}}, "stages": [{"name": "rest"}]},
            "kind = 'snow' is not implemented for six-node triangles",
        ),
        ({"planes": {"floor": {"through": [0, 0, -100], "normal": [0, 0, 1]}}}, "planes: contact is not implemented"),
        (
            {
                "stages": [{"name": "form", "kind": "form_find", "pressure": 0.01}],
                "fabric": {"E": 4000, "nu": 0.1, "thickness": 0.1, "prestress": [1.0, 1.0, 0.0]},
            },
            "form finding is not implemented for six-node triangles",
        ),
    ],
)
def test_what_six_nodes_do_not_have_is_refused(changes: dict[str, Any], told: str) -> None:
    with pytest.raises(ValueError, match=told):
        beam(**changes)


@pytest.mark.parametrize(
    ("mesh", "told"),
    [
        ({"grade": "auto"}, "grade needs pattern = 'diagonal' or 'alternating'"),
        ({"pattern": "alternating", "order": 1}, "pattern = 'alternating' is for order = 2"),
        ({"pattern": "alternating", "around": 7}, "needs an even number of elements around, not 7"),
        ({"pattern": "diagonal", "grade": {"end": 50}}, r"grade\.end = 50 must be above 0 and below .* 33\.3333"),
    ],
)
def test_bad_patterns_are_refused(mesh: dict[str, Any], told: str) -> None:
    given = {"shape": "tube", "radius": 25, "length": 200, "around": 8, "along": 6, "order": 2}
    with pytest.raises(InputError, match=told):
        tm.run(beam(mesh=given | mesh))


def test_a_mesh_of_the_other_kind_is_refused(bent: tm.RunResult, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"mesh\.order = 1, but the mesh has six-node triangles"):
        tm.run(beam(mesh={"shape": "given"}), mesh=bent.mesh)
    flat = shapes.tube(radius=25, length=200, around=8, along=6)
    with pytest.raises(InputError, match=r"mesh\.order = 2, but the mesh has three-node triangles"):
        tm.run(beam(mesh={"shape": "given", "order": 2}), mesh=flat)
    with pytest.raises(InputError, match="cannot be written"):
        bent.mesh.save(tmp_path / "mesh.vtu")
    with pytest.raises(InputError, match="pages of runs with six-node triangles"):
        head_and_block(bent)
    with pytest.raises(InputError, match="cannot be repaired"):
        tm.Mesh.build(bent.mesh.points, bent.mesh.triangles, tri_middle=bent.mesh.tri_middle, repair=True)


def test_scenes_of_three_nodes_have_none_of_it(bent: tm.RunResult) -> None:
    """Neither fields nor branches nor values at points."""
    mesh = {"shape": "tube", "radius": 25, "length": 200, "around": 8, "along": 6}
    scene = beam(mesh=mesh)
    assert not [name for name in scene.extra_fields if name.startswith("point_")]
    assert scene.samples == 1
    structure = build_model(scene, build_mesh(scene)).structure
    assert structure.samples == 1
    assert "six-node triangles" in structure.features().describe()[1]
    assert [name for name in bent.scene.extra_fields if name.startswith("point_")]
