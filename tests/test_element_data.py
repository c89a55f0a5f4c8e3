"""Thickness, prestress, warp and pressure coefficients from the mesh's element data: as by groups, gone on with, and refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest
from resume_cases import run_until
from run_files import different, outcome, same
from typer.testing import CliRunner

import taichi_membrane as tm
from taichi_membrane.commands.cli import app
from taichi_membrane.errors import InputError
from taichi_membrane.execution.run import run
from taichi_membrane.mechanics.nodes import room
from taichi_membrane.mechanics.system import System
from taichi_membrane.mesh import Mesh, read_mesh
from taichi_membrane.output.reader import read_run
from taichi_membrane.page.content import head_and_block
from taichi_membrane.scene import Scene
from taichi_membrane.shapes import panel
from taichi_membrane.simulation.model import build_mesh, build_model
from taichi_membrane.simulation.results import RunResult

pytestmark = pytest.mark.usefixtures("runtime_cpu")

FABRIC: dict[str, Any] = {
    "E_warp": 900.0,
    "E_weft": 500.0,
    "nu": 0.2,
    "G": 40.0,
    "thickness": 0.5,
    "warp": [1.0, 0.2, 0.0],
    "density": 2.0,
}
THIN = np.arange(32) % 3 == 0


def sheet(**fields: Any) -> Mesh:
    """A square of 32 elements, a third of them in the group "thin", with element data."""
    mesh = panel(width=2.0, height=2.0, along_x=4, along_y=4)
    return Mesh.build(
        mesh.points,
        mesh.triangles,
        {"rim": mesh.node_groups["boundary"]},
        {"thin": np.flatnonzero(THIN)},
        tri_fields=fields,
    )


def scene(fabric: dict[str, Any] | None = None, thin: dict[str, Any] | None = None, **changes: Any) -> Scene:
    """A sheet held at its rim, under pressure and its weight."""
    content = {
        "name": "sheet",
        "units": {"length": "m", "force": "N"},
        "mesh": {"shape": "given"},
        "fabric": FABRIC | (fabric or {}),
        "fabrics": {} if thin is None else {"thin": FABRIC | thin},
        "supports": [{"group": "rim", "hold": "xyz"}],
        "loads": {"own": {"kind": "weight", "g": 9.81}},
        "stages": [{"name": "blow", "steps": 2, "pressure": 3.0, "loads": {"own": 0.5}}],
        "probes": {"rise": {"kind": "displacement", "group": "all", "component": "z"}},
        "derivatives": ["rise"],
        "solver": {"kind": "newton", "tolerance": 1e-11},
        **changes,
    }
    return Scene.model_validate(content)


def assert_same(one: RunResult, other: RunResult) -> None:
    """To the last digit."""
    assert one.converged
    for step, twin in zip(one.steps, other.steps, strict=True):
        assert np.array_equal(step.displacement, twin.displacement)
        assert np.array_equal(step.elements.stress, twin.elements.stress)
        assert np.array_equal(step.elements.major_resultant, twin.elements.major_resultant)
        assert step.energy == twin.energy


def test_thickness_by_element_is_that_of_groups_digit_for_digit(tmp_path: Path) -> None:
    """Through a file, with self-weight; the derivative by its scale is that of all thicknesses growing alike."""
    sheet(t=np.where(THIN, 200.0, 500.0)).save(tmp_path / "sheet.vtu")
    by_field = run(scene({"thickness": {"field": "t", "scale": 1e-3}}), mesh=read_mesh(tmp_path / "sheet.vtu"))
    by_group = run(scene(thin={"thickness": 0.2}), mesh=sheet())
    assert_same(by_field, by_group)
    slopes = by_group.steps[-1].derivatives["rise"]
    scaled = by_field.steps[-1].derivatives["rise"]["thickness.scale"]
    assert 1e-3 * scaled == pytest.approx(0.5 * slopes["thickness.all"] + 0.2 * slopes["thickness.thin"], rel=1e-9)


@pytest.mark.parametrize("components", [2, 3])
def test_prestress_by_element_is_that_of_groups(components: int) -> None:
    """To round-off, as stress is made of strain in another order; the shear is zero where the array has none."""
    stress = np.where(THIN[:, None], [8.0, 4.0, 1.0], [5.0, 6.0, 0.0])[:, :components]
    thin = [8.0, 4.0, 1.0 if components == 3 else 0.0]
    by_field = run(scene({"prestress": {"field": "pre"}}), mesh=sheet(pre=stress))
    by_group = run(scene({"prestress": [5.0, 6.0, 0.0]}, {"prestress": thin}), mesh=sheet())
    assert by_field.converged
    for step, twin in zip(by_field.steps, by_group.steps, strict=True):
        assert np.abs(step.displacement - twin.displacement).max() < 1e-13
        assert np.abs(step.elements.stress - twin.elements.stress).max() < 1e-11
        assert step.energy == pytest.approx(twin.energy, rel=1e-12)


def test_warp_and_coefficients_by_element_are_those_of_groups_digit_for_digit() -> None:
    wind = {"kind": "wind", "q": 4.0}
    stages = [{"name": "blow", "loads": {"wind": -1.0}}]
    fibre = np.where(THIN[:, None], [0.0, 1.0, 0.3], [2.0, 1.0, 0.0])
    by_field = run(
        scene({"warp": {"field": "fibre"}}, loads={"wind": wind | {"cp": {"field": "cp"}}}, stages=stages),
        mesh=sheet(fibre=fibre, cp=np.where(THIN, 0.4, 0.9)),
    )
    loads = {"wind": wind | {"cp": {"thin": 0.4, "all": 0.9}}}
    by_group = run(
        scene({"warp": [2.0, 1.0, 0.0]}, {"warp": [0.0, 1.0, 0.3]}, loads=loads, stages=stages), mesh=sheet()
    )
    assert_same(by_field, by_group)


def test_a_stopped_run_goes_on_to_the_same_bytes_and_keeps_the_data_it_uses(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    fields = {"t": rng.uniform(0.2, 0.5, 32), "my pre": rng.uniform(1.0, 5.0, (32, 2)), "other": np.ones(32)}
    asked = scene({"thickness": {"field": "t"}, "prestress": {"field": "my pre"}, "warp": {"along": "spine"}})
    mesh = sheet(**fields)
    mesh = Mesh.build(
        mesh.points, mesh.triangles, mesh.node_groups, mesh.tri_groups, lines=[[0, 6], [6, 12]], line_groups={"spine": [0, 1]},
        tri_fields=fields,
    )  # fmt: skip
    whole = run(asked, mesh=mesh, out=tmp_path / "whole", render=False)
    assert whole.converged
    assert whole.mesh.tri_fields.keys() == {"t", "my pre", "along:spine"}
    assert whole.mesh.notes == ("element data not used by the scene: other",)
    run_until(0, asked, mesh=mesh, out=tmp_path / "part", render=False)
    tm.resume(tmp_path / "part")
    assert different(outcome(tmp_path / "whole"), outcome(tmp_path / "part")) == []


def test_what_differs_by_element_is_in_files_pictures_and_the_page(tmp_path: Path) -> None:
    """And only there where the scene has it; with the stress-free strain of each step."""
    thickness, stress = np.linspace(0.2, 0.5, 32), np.linspace([1.0, 2.0, 0.0], [3.0, 1.0, 0.5], 32)
    asked = scene(
        {"thickness": {"field": "t"}, "prestress": {"field": "pre", "scale": 2.0}},
        shrinkages={"cure": {"group": "thin", "weft": 0.01}},
        stages=[{"name": "cure", "steps": 2, "shrinkages": {"cure": 1.0}}], loads={}, derivatives=[],
        camera={"size": [320, 240], "field": "thickness"},
    )  # fmt: skip
    result = run(asked, mesh=sheet(t=thickness, pre=stress), out=tmp_path, render=True)
    assert result.converged
    free = np.where(THIN, -0.01 + 0.5 * 0.01**2, 0.0)
    last = result.steps[-1].elements
    assert np.array_equal(last.thickness, thickness)
    assert np.array_equal(last.prestress, 2.0 * stress)
    assert np.abs(last.free_strain - np.column_stack((0.0 * free, free))).max() < 1e-15
    arrays = meshio.read(tmp_path / "step_0001.vtu").cell_data
    assert np.array_equal(arrays["thickness"][0], thickness)
    assert np.array_equal(arrays["prestress_weft_pk2"][0], 2.0 * stress[:, 1])
    (_, again) = read_run(tmp_path).steps
    assert same(again, result.steps[-1])
    names = [one["name"] for one in head_and_block(result)[0]["fields"]]
    assert {"thickness", "prestress_shear", "free_strain_weft"} <= set(names)
    drawn = {}
    for name in ("thickness", "free_strain"):
        told = CliRunner().invoke(app, ["render", str(tmp_path), "--field", name])
        assert told.exit_code == 0, told.output
        drawn[name] = (tmp_path / "step_0001.png").read_bytes()
    assert drawn["thickness"] != drawn["free_strain"]
    plain = run(scene(derivatives=[]), mesh=sheet(), out=tmp_path / "plain", render=False)
    assert not {"thickness", "prestress", "free_strain"} & plain.steps[-1].fields.keys()
    told = CliRunner().invoke(app, ["render", str(tmp_path / "plain"), "--field", "thickness"])
    assert told.exit_code == 2
    assert "camera.field: 'thickness' needs a thickness by element data in the scene" in " ".join(told.stderr.split())
    with pytest.raises(ValueError, match=r"camera\.field: 'free_strain' needs shrinkages or temperatures in the scene"):
        scene(camera={"field": "free_strain"})


def test_element_data_survive_saving_and_what_cannot_hold_them_is_refused(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    mesh = sheet(t=rng.random(32), v=rng.random((32, 3)))
    mesh.save(tmp_path / "a.vtu")
    again = read_mesh(tmp_path / "a.vtu")
    assert again.tri_fields.keys() == {"t", "v"}
    for name, values in mesh.tri_fields.items():
        assert np.array_equal(again.tri_fields[name], values)
    with pytest.raises(InputError, match=r"'\.inp' cannot say the element data 't', 'v'; \.vtu can"):
        mesh.save(tmp_path / "a.inp")
    with pytest.raises(InputError, match=r"the element data 't' have shape \(5,\), 32 elements are there"):
        sheet(t=np.ones(5))


def test_the_halves_of_a_quadrilateral_have_its_data(tmp_path: Path) -> None:
    points = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [2, 0, 0], [2, 1, 0]]
    cells = [("quad", np.array([[0, 1, 2, 3]])), ("triangle", np.array([[1, 4, 5], [1, 5, 2]]))]
    given = meshio.Mesh(points, cells, cell_data={"t": [np.array([3.0]), np.array([4.0, 5.0])]})
    assert Mesh.from_object(given).tri_fields["t"].tolist() == [3.0, 3.0, 4.0, 5.0]
    given.write(tmp_path / "quad.vtk")
    assert read_mesh(tmp_path / "quad.vtk").tri_fields["t"].tolist() == [3.0, 3.0, 4.0, 5.0]


def test_thickness_by_element_costs_nothing_and_prestress_a_vector_for_each(tmp_path: Path) -> None:
    mesh = sheet(t=np.full(32, 0.5), pre=np.ones((32, 3)))
    plain, thick, stressed = (
        System(build_model(scene(one), mesh).structure)
        for one in ({}, {"thickness": {"field": "t"}}, {"prestress": {"field": "pre"}})
    )
    assert thick.bytes_allocated() == plain.bytes_allocated()
    assert {name for name, _ in thick.fields()} == {name for name, _ in plain.fields()}
    assert {name for name, _ in stressed.fields()} - {name for name, _ in plain.fields()} == {"tri_offset"}
    assert stressed.bytes_allocated() - plain.bytes_allocated() == 24 * room(32)
    assert thick.structure.features() == plain.structure.features()


def tube(warp: dict[str, Any]) -> Scene:
    """A lying tube with a warp of its own."""
    return Scene.model_validate(
        {
            "name": "tube",
            "units": {"length": "m", "force": "N"},
            "mesh": {"shape": "tube", "radius": 1.0, "length": 4.0, "around": 12, "along": 6, "cap_end": "none"},
            "groups": {"line": {"where": "z > 0.99"}, "front": {"where": "x > 3.5"}},
            "fabric": FABRIC | {"warp": warp},
            "supports": [{"group": "start", "hold": "xyz"}, {"group": "end", "hold": "xyz"}],
            "stages": [{"name": "a", "pressure": 1.0}],
        }
    )


def test_warp_around_an_axis_and_along_a_line() -> None:
    """Hoops are square to the axis and to the normal; the nearest piece of a ring of nodes has the direction of the hoop."""
    built = tube({"around": [2.0, 0.0, 0.0]})
    mesh = build_mesh(built)
    normals = mesh.tri_normals()
    around = build_model(built, mesh).structure.geometry.warp
    assert np.abs(around[:, 0]).max() < 0.2  # staggered facets lean a little
    centre = mesh.points[mesh.triangles].mean(axis=1)
    exact = np.cross([1.0, 0.0, 0.0], centre)
    exact -= (exact * normals).sum(axis=1, keepdims=True) * normals
    assert np.abs(around - exact / np.linalg.norm(exact, axis=1, keepdims=True)).max() < 1e-12
    ring = build_model(tube({"along": "end"}), mesh).structure.geometry.warp
    near = centre[:, 0] > 3.5
    assert np.abs(np.einsum("ij,ij->i", ring, around))[near].min() > np.cos(2.0 * np.pi / 12.0)


def test_warp_along_a_line_is_that_of_its_nearest_piece() -> None:
    """Against a search piece by piece: a bent line of three pieces, as a group of lines and as mesh edges."""
    mesh = panel(width=2.0, height=2.0, along_x=4, along_y=4)
    ends = np.array([[0, 0, 0], [2, 0, 0], [2, 2, 0], [0.0, 2.0, 0.0]])
    nodes = [int(np.linalg.norm(mesh.points - end, axis=1).argmin()) for end in ends]
    bent = Mesh.build(
        mesh.points, mesh.triangles, {"rim": mesh.node_groups["boundary"], "left": mesh.node_groups["x_min"]},
        lines=np.column_stack((nodes[:-1], nodes[1:])), line_groups={"spine": [0, 1, 2]},
    )  # fmt: skip
    found = build_model(scene({"warp": {"along": "spine"}}), bent).structure.geometry.warp
    x, y = bent.points[bent.triangles].mean(axis=1)[:, :2].T
    distance = np.column_stack((y, 2.0 - x, 2.0 - y))
    wanted = np.array([[1.0, 0, 0], [0, 1.0, 0], [-1.0, 0, 0]])[distance.argmin(axis=1)]
    clear = np.ptp(np.sort(distance, axis=1)[:, :2], axis=1) > 1e-9
    assert np.abs(found - wanted)[clear].max() < 1e-12
    assert clear.sum() > 20
    by_edges = build_model(scene({"warp": {"along": "left"}}), bent).structure.geometry.warp
    assert np.abs(np.abs(by_edges) - [0.0, 1.0, 0.0]).max() < 1e-12


def test_check_tells_ranges_and_how_near_the_warp_comes_to_a_normal(tmp_path: Path) -> None:
    sheet(t=np.linspace(0.2, 0.5, 32), pre=np.ones((32, 2))).save(tmp_path / "sheet.vtu")
    text = tmp_path / "sheet.toml"
    text.write_text(
        'name = "sheet"\nunits = { length = "m", force = "N" }\nmesh = { shape = "file", path = "sheet.vtu" }\n'
        'supports = [{ group = "rim", hold = "xyz" }]\nstages = [{ name = "a", pressure = 1.0 }]\n'
        "[fabric]\nE_warp = 900.0\nE_weft = 500.0\nnu = 0.2\nG = 40.0\nwarp = [1.0, 0.0, 1.0]\n"
        'thickness = { field = "t" }\nprestress = { field = "pre", scale = 2.0 }\n',
        encoding="utf-8",
    )
    told = CliRunner().invoke(app, ["check", str(text)])
    assert told.exit_code == 0, told.output
    said = " ".join(told.output.split())
    assert "all: thickness from 0.2 to 0.5 m" in said
    assert "prestress warp 2 to 2, weft 2 to 2, shear 0 to 0 Pa" in said
    assert "all: warp at least 45° from the normal (element 0)" in said
    assert "thickness by 't' m" in said
    assert "prestress [by 'pre' × 2] Pa" in said


BAD = np.where(np.arange(32) == 5, -0.1, 0.5)


@pytest.mark.parametrize(
    ("fabric", "expected"),
    [
        ({"thickness": {"field": "s"}}, r"all\.thickness\.field: no element data 's' in this mesh; allowed: t, v, hole$"),
        ({"thickness": {"field": "v"}}, r"fabrics\.all\.thickness\.field: 'v' has 3 values for each element, 1 are needed"),
        ({"thickness": {"field": "t"}}, r"the thickness of element 5 \(and 0 others\) is -0\.1; it must be above 0"),
        ({"thickness": {"field": "hole"}}, r"'hole' is not finite in element 7 \(and 1 others\)"),
        ({"prestress": {"field": "t"}}, r"prestress\.field: 't' has 1 values for each element, 2 or 3 are needed"),
        ({"warp": {"field": "t"}}, r"warp\.field: 't' has 1 values for each element, 3 are needed"),
        ({"warp": {"field": "v"}}, r"warp\.field: 'v' is zero, no direction, in element 3 \(and 0 others\)"),
        ({"warp": [0.0, 0.0, 1.0]}, r"all\.warp: the direction .* is perpendicular to element 0 \(and 31 others\)"),
        ({"warp": {"along": "spine"}}, r"warp\.along: no group of lines or nodes 'spine' in this mesh; allowed: all, boundary"),
        ({"warp": {"around": [0, 0, 1], "through": [0.3333333333333333, 0.16666666666666666, 0]}},
         r"warp\.around: element 0 \(and 0 others\) lies on the axis"),
        ({"warp": {"around": [0, 0, 1], "along": "rim"}}, r"give one of field, along and around"),
        ({"warp": {"field": "v", "through": [0, 0, 0]}}, r"through is a point of the axis of around"),
    ],
)  # fmt: skip
def test_bad_element_data_are_named(fabric: dict[str, Any], expected: str) -> None:
    vector = np.ones((32, 3))
    vector[3] = 0.0
    mesh = sheet(t=BAD, v=vector, hole=np.where(np.isin(np.arange(32), [7, 9]), np.nan, 1.0))
    with pytest.raises((ValueError, InputError), match=expected):
        build_model(scene(fabric), mesh)


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("fabric.thickness = -1.0", "fabric.thickness: -1.0 must be above 0"),
        ("fabric.thickness = { feld = 't' }", "fabric.thickness.feld: unknown key; did you mean 'field'?"),
        ("fabric.thickness = { field = 't', scale = 0.0 }", "fabric.thickness.scale: 0.0 must be above 0"),
        ("fabric.warp = [0.0, 0.0, 0.0]", "fabric.warp: a direction needs a length above zero"),
        ("fabric.warp = { arond = [0, 0, 1] }", "fabric.warp.arond: unknown key; did you mean 'around'?"),
        ("fabric.prestress = 1.0", "fabric.prestress: must be a list, not 1.0"),
        ("fabric.prestress = [1.0, 2.0]", "fabric.prestress"),
    ],
)
def test_bad_keys_have_one_short_message(line: str, expected: str, tmp_path: Path) -> None:
    given = line.partition(" = ")[0].partition(".")[2]
    keys = {"thickness": "0.5", "E": "100.0", "nu": "0.3"}
    keys.pop(given, None)
    fabric = "\n".join(f"fabric.{key} = {value}" for key, value in keys.items())
    (tmp_path / "a.toml").write_text(
        f'name = "a"\nunits = {{ length = "m", force = "N" }}\nmesh = {{ shape = "sphere", radius = 1.0, divisions = 2 }}\n'
        f'{fabric}\n{line}\nstages = [{{ name = "a", pressure = 1.0 }}]\n',
        encoding="utf-8",
    )
    told = CliRunner().invoke(app, ["check", str(tmp_path / "a.toml")])
    assert told.exit_code == 2
    said = told.stderr
    assert expected in " ".join(said.split())
    assert said.count("fabric.") <= 2
