"""Form finding: closed forms of films, bubbles, cables and nets, verdicts where there is no shape, and the rest shape after it."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError
from scipy import sparse
from scipy.sparse import linalg

from taichi_membrane import shapes
from taichi_membrane.execution.run import read_result, resume, run
from taichi_membrane.mesh import Mesh, placed
from taichi_membrane.scene import Scene
from taichi_membrane.shapes.rings import wall_triangles
from taichi_membrane.simulation import rest_shape
from taichi_membrane.simulation.analysis import Analysis
from taichi_membrane.simulation.model import build_mesh, build_model, with_scene_groups
from taichi_membrane.simulation.results import RunResult
from taichi_membrane.simulation.shape_space import ShapeSpace

pytestmark = pytest.mark.usefixtures("runtime_cpu")

FABRIC = {"E": 500.0, "nu": 0.3, "thickness": 1.0, "prestress": [1.0, 1.0, 0.0], "warp": [1.0, 0.0, 0.0]}
FORM = {"name": "form", "kind": "form_find"}


def a_scene(**changed: Any) -> Scene:
    data = {"name": "case", "units": {"length": "m", "force": "kN"}, "mesh": {"shape": "given"}, "fabric": FABRIC}
    data |= {"stages": [FORM, {"name": "rest"}]}
    return Scene.model_validate(data | changed)


def found(given: Mesh | None = None, **changed: Any) -> RunResult:
    return run(a_scene(**changed), mesh=given, render=False)


def tube(half: float, radius: Any, along: int = 8) -> Mesh:
    """Staggered rings between x = ±half of a radius that is a function of x."""
    around = 4 * along
    axial = np.linspace(-half, half, along + 1)[:, None]
    angle = 2.0 * np.pi * (np.arange(around)[None, :] + 0.5 * (np.arange(along + 1)[:, None] % 2)) / around
    size = radius(axial)
    points = np.stack([axial + 0.0 * angle, -size * np.sin(angle), size * np.cos(angle)], axis=2).reshape(-1, 3)
    ring = np.arange(around)
    groups = {"left": ring, "right": along * around + ring, "neck": along // 2 * around + ring}
    triangles = wall_triangles(around=around, along=along, pattern="staggered", first_phase=0)
    return Mesh.build(points, triangles, groups, None, np.tile([1.0, 0.0, 0.0], (len(triangles), 1)))


RINGS = [{"group": "left", "hold": "xyz"}, {"group": "right", "hold": "xyz"}]
NECK = {"neck": {"kind": "radius", "group": "neck", "axis": "x"}}


def film(half: float, radius: Any = lambda x: 1.0 + 0.0 * x, along: int = 8, **changed: Any) -> RunResult:
    fabric = {key: value for key, value in FABRIC.items() if key != "warp"}
    return found(tube(half, radius, along), **{"fabric": fabric, "supports": RINGS, "probes": NECK} | changed)


def test_a_film_between_rings_is_a_catenoid_to_second_order_and_rests_there() -> None:
    """1 = c cosh(h/c), c = 0.8483379 for h = 1/2; started from a tube. The next stage moves nothing."""
    errors = []
    for along in (8, 16):
        result = film(0.5, along=along)
        assert result.converged, result.steps[-1].reason
        errors.append(result.probe("neck")[0] / 0.8483379380949791 - 1.0)
        assert np.abs(result.steps[1].displacement).max() < 1e-8
        assert result.steps[1].residual <= 1e-6
    assert math.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.2)
    assert abs(errors[1]) < 1e-3


def test_near_the_limit_the_film_is_found_and_beyond_it_there_is_none() -> None:
    """The largest half distance over the radius is 0.6627434."""
    near = film(0.655)
    assert near.converged, near.steps[-1].reason
    beyond = film(0.69)
    assert not beyond.converged
    assert "no surface of this stress hangs in these supports" in beyond.steps[0].reason
    assert len(beyond.steps) == 1


def test_an_unstable_film_is_told_to_be_one() -> None:
    """The narrower catenoid between rings at h = 0.5, where the mesh lies on it to the accuracy asked for."""
    half, neck = 0.5, 0.23509499
    assert neck * math.cosh(half / neck) == pytest.approx(1.0, abs=1e-6)
    result = film(half, lambda x: neck * np.cosh(x / neck), 24, solver={"tolerance": 0.05})
    assert not result.converged
    assert "the shape is unstable: 1 ways" in result.steps[0].reason


def test_a_bubble_has_the_radius_of_laplace() -> None:
    """p R = 2 n; its nodes lie on the sphere, and its rise is that of the shallow cap over the ring, to second order."""
    rise, errors = 1.25 - math.sqrt(1.25**2 - 1.0), []
    for rings in (6, 12):
        result = found(
            mesh={"shape": "disc", "radius": 1.0, "rings": rings},
            supports=[{"group": "rim", "hold": "xyz"}],
            stages=[FORM | {"pressure": 1.6}, {"name": "rest"}],
        )
        assert result.converged, result.steps[-1].reason
        radius = np.linalg.norm(result.mesh.points - [0.0, 0.0, rise - 1.25], axis=1)
        errors.append(result.mesh.points[:, 2].max() / rise - 1.0)
        assert np.abs(radius / 1.25 - 1.0).max() < 0.1 / rings
        assert np.abs(result.steps[1].displacement).max() < 1e-8
    assert math.log2(errors[0] / errors[1]) > 1.7


def test_a_pressure_above_the_largest_that_a_bubble_bears_is_told() -> None:
    """2 n/a: that of the hemisphere."""
    disc = {"mesh": {"shape": "disc", "radius": 1.0, "rings": 6}, "supports": [{"group": "rim", "hold": "xyz"}]}
    assert found(**disc, stages=[FORM | {"pressure": 1.9}]).converged
    beyond = found(**disc, stages=[FORM | {"pressure": 2.2}])
    assert not beyond.converged
    assert "no surface of this stress holds these loads: it grows on" in beyond.steps[0].reason


def sail(n: int = 8) -> Mesh:
    corner = np.array([[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [3.0, 8.0, 0.0]])
    number = {(i, j): k for k, (i, j) in enumerate((i, j) for i in range(n + 1) for j in range(n + 1 - i))}
    points = [corner[0] + (corner[1] - corner[0]) * i / n + (corner[2] - corner[0]) * j / n for i, j in number]
    lower = [[number[i, j], number[i + 1, j], number[i, j + 1]] for i in range(n) for j in range(n - i)]
    upper = [[number[i + 1, j], number[i + 1, j + 1], number[i, j + 1]] for i in range(n) for j in range(n - i - 1)]
    groups = {
        "a": [number[i, 0] for i in range(n + 1)],
        "b": [number[0, j] for j in range(n + 1)],
        "c": [number[i, n - i] for i in range(n + 1)],
        "corners": [number[0, 0], number[n, 0], number[0, n]],
    }
    return Mesh.build(np.array(points), np.array(lower + upper), groups)


FORCES = {"a": 30.0, "b": 27.0, "c": 36.0}
SAIL = {
    "supports": [{"group": "corners", "hold": "xyz"}, {"group": "all", "hold": "z"}],
    "cables": {name: {"along": name, "EA": 2000.0, "force": force} for name, force in FORCES.items()},
}


def test_edge_cables_of_a_flat_sail_are_circular_arcs_of_radius_force_over_stress() -> None:
    """1/r = n/T, with one force all along each."""
    result = found(sail(), **SAIL)
    assert result.converged, result.steps[-1].reason
    for name, force in FORCES.items():
        x, y = result.mesh.points[result.mesh.node_groups[name], :2].T
        fit = np.linalg.lstsq(np.column_stack([2 * x, 2 * y, np.ones_like(x)]), x**2 + y**2, rcond=None)[0]
        assert math.sqrt(fit[2] + fit[0] ** 2 + fit[1] ** 2) == pytest.approx(force, rel=1e-3)
    assert result.steps[0].cable_forces == pytest.approx(np.repeat([30.0, 27.0, 36.0], 8), rel=1e-4)
    assert np.abs(result.steps[1].displacement).max() < 1e-8


@pytest.mark.parametrize(("side_strain", "rigid"), [("green", False), ("engineering", False), ("green", True)])
def test_the_stiffness_of_a_shape_is_that_of_its_forces_by_differences(side_strain: str, rigid: bool) -> None:
    """Forces of the given stress and cable forces where nodes are moved, on a curved sail, with one edge held or a rigid body.

    Rotations do not commute: away from balance the differences of a body's moment have a skew part, and the stiffness has none.
    """
    mesh = sail(4)
    x, y = mesh.points[:, 0], mesh.points[:, 1]
    mesh = placed(mesh, np.column_stack([x, y, 0.3 * np.sin(x) * np.cos(y)]))
    cables = {name: one for name, one in SAIL["cables"].items() if name != "b"}
    scene = a_scene(
        fabric=FABRIC | {"side_strain": side_strain},
        cables=cables,
        bodies={"edge": {"group": "b", "hold": "xyz"}} if rigid else {},
        supports=[
            {"group": "far", "hold": "xyz"},
            {"group": "low", "hold": "z"},
            *([] if rigid else [{"group": "b", "hold": "xyz"}]),
        ],
        groups={"far": {"where": "x > 9.9"}, "low": {"where": "x > 4.9 and x < 5.1 and y < 0.1"}},
    )
    model = build_model(scene, with_scene_groups(scene, mesh))
    here = rest_shape.soft(rest_shape.asked(model, mesh.points), 1e-9)
    work = Analysis(here)
    space = ShapeSpace.of(here)
    assert work.newton is not None
    stiffness = space.stiffness(work.newton.tangent.matrix())
    rng = np.random.default_rng(3)
    direction = rng.standard_normal(stiffness.shape[0])
    step, forces = 1e-5, []
    for sign in (1.0, -1.0):
        moved = (space.basis @ (sign * step * direction)).reshape(-1, 3)
        places = mesh.points + work.system.retract(np.zeros_like(mesh.points), moved)
        assert work.take(rest_shape.soft(rest_shape.asked(model, places), 1e-9))
        forces.append(space.components(np.where(here.structure.node_held, 0.0, work.system.balance())))
        assert work.take(here)
    measured = (forces[1] - forces[0]) / (2.0 * step)
    error = stiffness @ direction - measured
    assert abs(direction @ error) < 1e-7 * abs(direction @ measured)
    if not rigid:
        assert np.linalg.norm(error) < 1e-7 * np.linalg.norm(measured)


def test_a_net_of_force_densities_is_the_solution_of_its_linear_system() -> None:
    """Σ q (x_j - x_i) = 0 at each free node, whatever the lengths; the membrane in it has next to no stress."""
    flat = shapes.panel(width=1.0, height=1.0, along_x=6, along_y=6)
    x, y = flat.points[:, 0], flat.points[:, 1]
    mesh = placed(flat, np.column_stack([x, y, x * y + 0.3 * np.sin(3 * x)]))
    result = found(
        mesh,
        fabric=FABRIC | {"prestress": [1e-9, 1e-9, 0.0]},
        supports=[{"group": "boundary", "hold": "xyz"}],
        cables={
            "net": {"along": "all", "EA": 1e3, "force_density": 2.0},
            "more": {"nodes": ["corner_00", "centre"], "EA": 1e3, "force_density": 1.0},
        },
        stages=[FORM | {"stress_tolerance": 0.9}],
    )
    assert result.converged, result.steps[-1].reason
    free = np.setdiff1d(np.arange(mesh.node_count), mesh.node_groups["boundary"])
    pairs = np.concatenate([mesh.edges(), [[mesh.node_groups["corner_00"][0], mesh.node_groups["centre"][0]]]])
    density = np.append(np.full(len(mesh.edges()), 2.0), 1.0)
    branch = sparse.csr_matrix(
        (np.tile([1.0, -1.0], len(pairs)), (np.repeat(np.arange(len(pairs)), 2), pairs.ravel())),
        shape=(len(pairs), mesh.node_count),
    )
    whole = sparse.csr_matrix(branch.T @ sparse.diags(density) @ branch)
    held = mesh.node_groups["boundary"]
    right = -whole[free][:, held] @ mesh.points[held]
    expected = linalg.spsolve(sparse.csc_matrix(whole[free][:, free]), right)
    assert np.abs(result.mesh.points[free] - expected).max() < 1e-6


def test_a_cable_of_given_length_keeps_it() -> None:
    """The corner that a tie holds: its length stays EA-stiff, with the force that balance asks for."""
    cables = SAIL["cables"] | {"tie": {"nodes": ["post", "free"], "EA": 1e7, "length": 2.0}}
    mesh = sail()
    mesh = Mesh.build(
        mesh.points,
        mesh.triangles,
        {**{k: v for k, v in mesh.node_groups.items() if k not in ("all", "boundary")}}
        | {"free": mesh.node_groups["corners"][:1], "fixed": mesh.node_groups["corners"][1:]},
    )
    supports = [{"group": "fixed", "hold": "xyz"}, {"group": "sheet", "hold": "z"}]
    result = found(
        mesh,
        groups={"sheet": {"where": "z = 0 within 1e-9 and x > -0.5"}},
        anchors={"post": [-1.5, -1.0, 0.0]},
        cables=cables,
        supports=supports,
        probes={
            "length": {"kind": "cable", "cable": "tie", "what": "length"},
            "force": {"kind": "cable", "cable": "tie", "what": "force"},
        },
    )
    assert result.converged, result.steps[-1].reason
    assert result.probe("length")[0] == pytest.approx(2.0 * (1.0 + result.probe("force")[0] / 1e7), rel=1e-9)
    assert result.probe("force")[0] > 30.0
    assert np.abs(result.steps[1].displacement).max() < 1e-8


def test_a_cable_that_slides_over_the_edge_has_its_force_and_lets_nodes_move_along() -> None:
    mesh = sail(4)
    edge = mesh.node_groups["a"]
    names = {f"n{k}": [int(node)] for k, node in enumerate(edge)}
    kept = {name: members for name, members in mesh.node_groups.items() if name not in ("all", "boundary")}
    mesh = Mesh.build(mesh.points, mesh.triangles, kept | names)
    cables = SAIL["cables"] | {"a": {"nodes": list(names), "EA": 2000.0, "force": 30.0, "sliding": True}}
    result = found(mesh, **SAIL | {"cables": cables})
    assert result.converged, result.steps[-1].reason
    assert result.steps[0].cable_forces[-4:] == pytest.approx([30.0] * 4, rel=1e-3)
    assert np.abs(result.steps[1].displacement).max() < 1e-8


def test_relaxation_finds_the_shape_that_newton_finds() -> None:
    disc = {"mesh": {"shape": "disc", "radius": 1.0, "rings": 4}, "supports": [{"group": "rim", "hold": "xyz"}]}
    stages = [FORM | {"pressure": 1.0}]
    newton, relaxed = (found(**disc, stages=stages, solver={"kind": kind}) for kind in ("newton", "relaxation"))
    assert newton.converged
    assert relaxed.converged, relaxed.steps[0].reason
    for result in (newton, relaxed):  # of nodes at other places within the surface
        radius = np.linalg.norm(result.mesh.points - [0.0, 0.0, -math.sqrt(3.0)], axis=1)
        assert radius == pytest.approx(2.0, rel=1e-3)


def test_a_stress_that_no_shape_has_is_told_with_the_range_found_and_taken_where_that_is_allowed() -> None:
    """Twice as much in warp as in weft over a saddle, warp directions projected: the rest shape has what was found."""
    flat = shapes.panel(width=2.0, height=2.0, along_x=8, along_y=8, pattern="crossed")
    x, y = flat.points[:, 0] - 1.0, flat.points[:, 1] - 1.0
    mesh = placed(flat, np.column_stack([x, y, x * y]))
    fabric = FABRIC | {"prestress": [2.0, 1.0, 0.0]}
    supports = [{"group": "boundary", "hold": "xyz"}]
    result = found(mesh, fabric=fabric, supports=supports)
    assert not result.converged
    assert "no shape has this stress everywhere: stress asked in warp 2, found " in result.steps[0].reason
    taken = found(mesh, fabric=fabric, supports=supports, stages=[FORM | {"stress_tolerance": 0.5}, {"name": "rest"}])
    assert taken.converged, taken.steps[-1].reason
    assert np.abs(taken.steps[1].displacement).max() < 1e-8
    assert np.ptp(taken.steps[0].fields["stress"][:, 0]) > 0.02


def test_unequal_stress_in_a_flat_sheet_is_found() -> None:
    """It is in balance there: nothing moves but what was out of the plane."""
    flat = shapes.panel(width=2.0, height=1.0, along_x=8, along_y=4)
    bump = np.where(np.isin(np.arange(flat.node_count), flat.node_groups["boundary"]), 0.0, 0.2)
    mesh = placed(flat, flat.points + bump[:, None] * [0.0, 0.0, 1.0])
    fabric = FABRIC | {"prestress": [3.0, 1.0, 0.0]}
    result = found(mesh, fabric=fabric, supports=[{"group": "boundary", "hold": "xyz"}])
    assert result.converged, result.steps[-1].reason
    assert np.abs(result.mesh.points[:, 2]).max() < 1e-5


BEAM = {
    "mesh": {"shape": "disc", "radius": 1.0, "rings": 4},
    "supports": [{"group": "rim", "hold": "xyz"}],
    "cables": {"tie": {"nodes": ["post", "mid"], "EA": 500.0, "force": 0.4}},
    "anchors": {"post": [0.0, 0.0, -1.0]},
    "groups": {"mid": {"where": "x = 0 within 1e-9 and y = 0 within 1e-9"}},
    "stages": [FORM | {"pressure": 1.0, "stress_tolerance": 0.1}, {"name": "more", "pressure": 2.0, "steps": 2}],
    "probes": {"top": {"kind": "position", "group": "mid", "component": "z"}},
}


def test_files_hold_the_shape_found_and_a_run_goes_on_from_it_to_the_last_bit(tmp_path: Path) -> None:
    whole = run(a_scene(**BEAM), render=False, out=tmp_path / "whole")
    assert whole.converged, whole.steps[-1].reason

    class Stop:
        """Ends the run after so many load steps, as Ctrl-C would."""

        def __init__(self, after: int) -> None:
            self.left = after

        def step_done(self, step: Any) -> None:
            del step

        def wrote(self, path: Path) -> None:
            self.left -= path.name.startswith("step_")
            if self.left < 0 and path.name == "summary.json":
                raise KeyboardInterrupt

        def __getattr__(self, name: str) -> Any:
            return lambda *_: None

    for after in (0, 1):
        folder = tmp_path / f"stopped_{after}"
        with pytest.raises(KeyboardInterrupt):
            run(a_scene(**BEAM), render=False, out=folder, observer=Stop(after))
        begun = read_result(folder)
        assert len(begun.steps) == after + 1
        assert np.array_equal(begun.mesh.points, whole.mesh.points)
        done = resume(folder)
        for one, other in zip(whole.steps, done.steps, strict=True):
            assert one.probes == other.probes
            assert all(np.array_equal(one.fields[name], other.fields[name]) for name in one.fields)
        assert np.array_equal(done.mesh.points, whole.mesh.points)
    assert np.array_equal(read_result(tmp_path / "whole").mesh.points, whole.mesh.points)
    assert np.abs(whole.mesh.points[:, 2]).max() > 0.05


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        ({"stages": [{"name": "a"}, FORM]}, "stages.form.kind = 'form_find': it is stage 2"),
        ({"fabric": FABRIC | {"prestress": [1.0, 0.0, 0.0]}}, "warp and weft above 0"),
        ({"stages": [FORM | {"steps": 3}]}, "leave out steps"),
        ({"stages": [FORM | {"control": "arc_length"}]}, "leave out control"),
        ({"stages": [{"name": "a", "stress_tolerance": 0.1}]}, "stress_tolerance is for kind = 'form_find'"),
        (
            {"cables": {"a": SAIL["cables"]["a"]}, "stages": [{"name": "a"}]},
            "cables.a.force is for a scene whose first",
        ),
        ({"cables": {"a": SAIL["cables"]["a"] | {"force_density": 1.0}}}, "give one of force and force_density"),
        (
            {"cables": {"a": SAIL["cables"]["a"] | {"length": 1.0}}},
            "force decides the unstressed length; leave out length",
        ),
        ({"planes": {"p": {"through": [0, 0, 0], "normal": [0, 0, 1]}}}, "not implemented for a scene with planes"),
    ],
)
def test_mistakes_are_told(changed: dict[str, Any], told: str) -> None:
    with pytest.raises(ValidationError, match="(?s)" + "".join(f"[{c}]" if c in "[]()." else c for c in told)):
        a_scene(supports=[{"group": "boundary", "hold": "xyz"}], **changed)


def test_a_scene_without_form_finding_has_no_prestress_by_element() -> None:
    scene = a_scene(
        mesh={"shape": "disc", "radius": 1.0, "rings": 2},
        stages=[{"name": "rest"}],
        supports=[{"group": "rim", "hold": "xyz"}],
    )
    assert build_model(scene, build_mesh(scene)).structure.features().offset == "by_fabric"
