"""Six-node triangles: forces, energies, tangents, pressure and masses against each other, exact identities and patch tests."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import meshio
import numpy as np
import oracle
import pytest
import scipy.linalg
from bodies import ISOTROPIC, ORTHOTROPIC, law
from oracle import Floats

from taichi_membrane import shapes
from taichi_membrane.errors import InputError
from taichi_membrane.mechanics.preparation import FabricConstants, volume_gradient
from taichi_membrane.mechanics.rim import Rim
from taichi_membrane.mechanics.structure import Structure
from taichi_membrane.mechanics.system import System
from taichi_membrane.mechanics.tangent import Tangent
from taichi_membrane.mesh import Mesh, quadratic, read_mesh
from taichi_membrane.mesh.middles import straight, with_middles
from taichi_membrane.mesh.survey import survey
from taichi_membrane.solvers.relaxation import Relaxation

pytestmark = pytest.mark.usefixtures("runtime_cpu")

FABRICS = {
    "linear": ISOTROPIC,
    "tension field": law("tension_field"),
    "orthotropic": ORTHOTROPIC,
    "Green": law("tension_field", side_strain="green"),
    "prestressed": FabricConstants(
        e_warp=2.0, e_weft=0.3, poisson=0.4, shear=0.05, thickness=1.0, side_strain="green", prestress=(0.1, 0.05, 0.02)
    ),
}
# Every fabric, with three points or six.
CASES = list(zip(FABRICS, (6, 3, 3, 6, 3), strict=True))


def body_mesh() -> Mesh:
    """A closed body of random shape; the nodes amid sides lie off their middles."""
    rng = np.random.default_rng(21)
    base, triangles = oracle.icosahedron()
    mesh = Mesh.build(base * [1.0, 1.3, 0.8] + rng.uniform(-0.1, 0.1, base.shape), triangles)
    return with_middles(mesh, lambda a, b: 1.1 * straight(a, b) + rng.uniform(-0.05, 0.05, a.shape))


def structure_of(mesh: Mesh, fabric: FabricConstants, samples: int = 3, *, pressed: bool = True) -> Structure:
    """A free body of one fabric, its warp at random."""
    count = mesh.tri_count
    return Structure(
        mesh=mesh,
        fabrics=(fabric,),
        tri_fabric=np.zeros(count, dtype=np.int32),
        tri_warp=np.random.default_rng(3).normal(size=(count, 3)),
        node_held=np.zeros((mesh.node_count, 3), dtype=bool),
        tri_chamber=np.full(count, 0 if pressed else -1, dtype=np.int32),
        loads=False,
        sampling=samples,
    )


def tangent_of(system: System, step: float = 1e-6) -> Floats:
    """-∂f/∂x by central differences, (3 n, 3 n)."""
    u = system.displacement()
    columns = []
    for number in range(u.size):
        force = {}
        for sign in (1, -1):
            moved = u.copy()
            moved.flat[number] += sign * step
            system.set_displacement(moved)
            force[sign] = system.out_of_balance().ravel()
        columns.append((force[-1] - force[1]) / (2 * step))
    system.set_displacement(u)
    return np.array(columns).T


@pytest.fixture(scope="module", params=CASES, ids=lambda case: f"{case[0]}-{case[1]}")
def system(request: pytest.FixtureRequest) -> System:
    """A body for each fabric and number of points, under pressure, in a state with wrinkles."""
    name, samples = request.param
    one = System(structure_of(body_mesh(), FABRICS[name], samples))
    rng = np.random.default_rng(7)
    one.set_displacement(0.05 * one.structure.points + rng.uniform(-0.03, 0.03, one.structure.points.shape))
    one.set_surface_loads(np.array([0.2]))
    return one


def test_forces_are_the_gradient_of_the_potential(system: System) -> None:
    u, rng, force = system.displacement(), np.random.default_rng(1), system.out_of_balance()
    nothing = np.zeros_like(u)
    for _ in range(5):
        way, step = rng.normal(size=u.shape), 1e-5
        energy = []
        for sign in (1, -1):
            system.set_displacement(u + sign * step * way)
            energy.append(system.potential_energy(nothing)[0])
        system.set_displacement(u)
        found = -(energy[0] - energy[1]) / (2 * step)
        assert found == pytest.approx(
            float(np.vdot(force, way)), abs=1e-7 * np.linalg.norm(force) * np.linalg.norm(way)
        )


def test_tangent_is_the_change_of_the_forces(system: System) -> None:
    """On a closed body the whole of it is symmetric."""
    states = system.element_state().state
    assert system.features.variants[0].law == "none" or {0, 1} <= set(states.tolist())
    matrix = Tangent(system).matrix().toarray()
    found = tangent_of(system)
    assert np.abs(matrix - found).max() < 2e-8 * np.abs(matrix).max()
    assert np.abs(matrix - matrix.T).max() < 1e-14 * np.abs(matrix).max()


def test_masses_bound_the_highest_frequency(system: System) -> None:
    """Central differences with step 1 are stable up to 4; in states from rest to crumpled, from slack to blown up."""
    before, loads = system.displacement(), system.surface_loads()
    relaxation, rng, found = Relaxation(system), np.random.default_rng(4), []
    for spread, pressure in [(0.0, 0.0), (0.0, 20.0), (0.02, 0.2), (0.3, 0.0), (0.3, 2.0)]:
        system.set_displacement(rng.normal(size=before.shape) * spread)
        system.set_surface_loads(np.array([pressure]))
        relaxation.start_from_rest()
        mass = np.repeat(relaxation.masses(), 3)
        stiffness = tangent_of(system)
        found.append(scipy.linalg.eigh(0.5 * (stiffness + stiffness.T), np.diag(mass), eigvals_only=True)[-1])
    system.set_displacement(before)
    system.set_surface_loads(loads)
    assert max(found) < 4 * (1 + 1e-6), found
    assert max(found) > 1, found  # no more than a small factor too heavy


def test_pressure_on_a_free_rim() -> None:
    """Where pressure ends at a free rim the tangent is S + Z, and the work that has no potential is that of the forces."""
    mesh = shapes.tube(radius=1.0, length=1.5, around=5, along=2, cap_end="none", order=2)
    structure = structure_of(mesh, FABRICS["Green"])
    system = System(structure)
    rng = np.random.default_rng(2)
    u = rng.uniform(-0.05, 0.05, mesh.points.shape)
    system.set_displacement(u)
    pressure = np.array([0.3])
    system.set_surface_loads(pressure)
    skew = Rim.of(structure).at(pressure, u)
    assert skew is not None
    symmetric, found = Tangent(system).matrix().toarray(), tangent_of(system)
    whole = np.array([skew.times(one.reshape(-1, 3)).ravel() for one in np.eye(u.size)]).T
    assert np.abs(whole).max() > 0.01 * np.abs(found).max()
    assert np.abs(symmetric + whole - found).max() < 2e-8 * np.abs(found).max()
    # The pressure's work on the straight way, by Gauss' rule, and p times the change of the swept volume less what is beyond.
    step, done = rng.uniform(-0.1, 0.1, u.shape), 0.0
    at, weights = np.polynomial.legendre.leggauss(4)
    for share, weight in zip(0.5 * (at + 1.0), 0.5 * weights, strict=True):
        push = 0.3 * volume_gradient(mesh.points + u + share * step, mesh.cells, np.ones(mesh.tri_count))
        done += weight * float(np.vdot(push, step))
    swept = [float(system.swept_volumes(at).sum()) for at in (u, u + step)]
    beyond = skew.work_beyond(u + step)
    assert abs(beyond) > 1e-5
    assert 0.3 * (swept[1] - swept[0]) - beyond == pytest.approx(done, rel=1e-11)


def test_pressure_acts_on_the_quadratic_surface(system: System) -> None:
    """Forces and moments on a closed body cancel, and the forces are p times the gradient of the volume."""
    u = system.displacement()
    total = system.out_of_balance()
    system.set_surface_loads(np.array([0.0]))
    push = total - system.out_of_balance()
    system.set_surface_loads(np.array([0.2]))
    places = system.structure.points + u
    size = np.abs(push).sum()
    assert np.abs(push.sum(axis=0)).max() < 1e-14 * size
    assert np.abs(np.cross(places, push).sum(axis=0)).max() < 1e-14 * size
    cells = system.structure.mesh.cells
    assert push == pytest.approx(0.2 * volume_gradient(places, cells, np.ones(len(cells))), abs=1e-14)
    swept = quadratic.volumes(places, cells).sum() - quadratic.volumes(system.structure.points, cells).sum()
    assert system.swept_volumes(u).sum() == pytest.approx(swept, rel=1e-12)


def test_rigid_motion_strains_nothing(system: System) -> None:
    before = system.displacement()
    turn = scipy.linalg.expm(np.cross(np.eye(3), [0.7, -1.1, 0.4]))
    system.set_displacement(system.structure.points @ turn.T + [3.0, 1.0, -2.0] - system.structure.points)
    state = system.element_state()
    offset = system.structure.fabrics[0].compliance() @ np.array(system.structure.fabrics[0].prestress)
    system.set_displacement(before)
    assert np.abs(state.strain - offset).max() < 1e-14 * 10


def patch(curved: bool) -> Mesh:
    """A flat irregular patch; with ``curved`` the sides within it are bent, in its plane."""
    rng = np.random.default_rng(5)
    points, triangles, _ = oracle.irregular_patch(rng, 3)
    mesh = Mesh.build(points, triangles)
    rim = mesh.node_groups["boundary"]
    inner = ~np.isin(mesh.edge_table.nodes, rim).all(axis=1)
    bend = (
        np.where(inner[:, None], rng.uniform(-0.04, 0.04, (len(inner), 3)), 0.0) * [1, 1, 0] * (1.0 if curved else 0.0)
    )
    return with_middles(mesh, lambda a, b: straight(a, b) + bend)


@pytest.mark.parametrize("samples", [3, 6])
def test_patch_test(samples: int) -> None:
    """A uniform deformation gives a uniform stress and no forces within, on straight and on curved sides."""
    fabric = law("none", side_strain="green")
    gradient = np.array([[0.1, 0.04, 0.0], [-0.02, 0.07, 0.0], [0.05, -0.03, 0.0]])
    stretch = (np.eye(3) + gradient)[:, :2]
    green = 0.5 * (stretch.T @ stretch - np.eye(2))
    strain = np.array([green[0, 0], green[1, 1], 2 * green[0, 1]])
    system: System | None = None
    for curved in (False, True):
        mesh = patch(curved)
        one = replace(structure_of(mesh, fabric, samples, pressed=False), tri_warp=along_x(mesh))
        if system is None:
            system = System(one)
        else:
            assert system.accepts(one)
            system.upload(one)
        u = mesh.points @ gradient.T
        system.set_displacement(u)
        found = system.element_state().strain
        assert found == pytest.approx(np.tile(strain, (len(found), 1)), abs=1e-14)
        inner = np.setdiff1d(np.arange(mesh.node_count), mesh.node_groups["boundary"])
        force = system.out_of_balance()
        assert np.abs(force[inner]).max() < 1e-13 * np.abs(force).max()
        density = 0.5 * strain @ fabric.stiffness() @ strain
        stored = system.potential_energy(np.zeros_like(u))[1]
        assert stored == pytest.approx(density * mesh.tri_areas().sum(), rel=1e-12)


def along_x(mesh: Mesh) -> Floats:
    """A warp along x."""
    return np.tile([1.0, 0.0, 0.0], (mesh.tri_count, 1))


def test_volume_of_a_sphere() -> None:
    """Order 4, as the nodes lie on it; three-node triangles have order 2."""
    exact = 4.0 / 3.0 * np.pi
    errors = [shapes.sphere(radius=1.0, divisions=n, order=2).enclosed_volume() / exact - 1.0 for n in (4, 8, 16)]
    assert abs(errors[0]) < 1e-3
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert orders == pytest.approx([4.0, 4.0], abs=0.05)


# ---- meshes


def test_nodes_amid_sides_lie_on_the_surface() -> None:
    tube = shapes.tube(radius=25.0, length=100.0, around=8, along=4, cap_start="flat", order=2)
    x, y, z = tube.points.T
    wall, cap = (x > 0.0) & (x <= 100.0), x > 100.0
    assert np.hypot(y, z)[wall] == pytest.approx(25.0, rel=1e-14)
    assert np.linalg.norm(tube.points[cap] - [100.0, 0.0, 0.0], axis=1) == pytest.approx(25.0, rel=1e-14)
    assert np.hypot(y, z)[x == 0.0].max() == pytest.approx(25.0, rel=1e-14)
    arch = shapes.arch(span=12.0, radius=0.4, around=8, along=8, order=2)
    out = np.hypot(arch.points[:, 0], arch.points[:, 2]) - 6.0
    assert np.hypot(out, arch.points[:, 1]) == pytest.approx(0.4, rel=1e-12)
    assert len(arch.node_groups["crown"]) == 16
    assert len(arch.node_groups["boundary"]) == 32


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda middles: middles[:, [1, 0, 2]], "have different nodes amid it"),
        (lambda middles: np.where(middles == middles[0, 0], 0, middles), "but a corner as well"),
        (lambda middles: middles + 1000, "but node numbers run from 0 to 17"),
        (lambda middles: middles[:4], "must be whole numbers of shape (8, 3)"),
    ],
)
def test_bad_middles_are_refused(change, told: str) -> None:
    mesh = shapes.sphere(radius=1.0, divisions=1, order=2)
    with pytest.raises(InputError) as caught:
        Mesh.build(mesh.points, mesh.triangles, tri_middle=change(np.array(mesh.tri_middle)))
    assert told in str(caught.value)


def test_a_look_at_a_mesh_tells_true_lengths_and_volumes() -> None:
    tube = survey(shapes.tube(radius=25.0, length=100.0, around=12, along=6, order=2))
    assert tube.loops[0].length == pytest.approx(2.0 * np.pi * 25.0, rel=1e-4)
    (ball,) = survey(shapes.sphere(radius=1.0, divisions=6, order=2)).bodies
    assert ball.volume == pytest.approx(4.0 / 3.0 * np.pi, rel=3e-4)


def test_folded_cells_are_refused() -> None:
    mesh = shapes.panel(width=1.0, height=1.0, along_x=1, along_y=1, order=2)
    points = np.array(mesh.points)
    points[mesh.tri_middle[0, 0]] = points[mesh.triangles[0, 1]] * 0.9 + points[mesh.triangles[0, 2]] * 0.1
    with pytest.raises(InputError, match="element 0 is folded"):
        Mesh.build(points, mesh.triangles, tri_middle=mesh.tri_middle)


@pytest.mark.parametrize("name", ["sheet.vtu", "sheet.vtk", "sheet.msh", "old.msh"])
def test_six_node_triangles_are_read_from_files(tmp_path: Path, name: str) -> None:
    """Corners, nodes amid sides, groups of cells and curved lines, from gmsh, VTK and what meshio reads."""
    made = shapes.disc(radius=1.0, rings=2, order=2)
    cells = made.cells[:, [0, 1, 2, 5, 3, 4]]
    rim = made.edge_table.tri_count == 1
    edges = np.column_stack([made.edge_table.nodes[rim], made.edge_middles[rim]])
    tags = [np.where(np.arange(len(cells)) < 6, 7, 8), np.full(len(edges), 9)]
    both = {"gmsh:physical": tags, "gmsh:geometrical": tags} if name.endswith(".msh") else {"part": tags}
    places = {"gmsh:dim_tags": np.tile([2, 1], (len(made.points), 1))} if name == "sheet.msh" else {}
    blocks = [("triangle6", cells), ("line3", edges)]
    mesh = meshio.Mesh(made.points, blocks, cell_data=both, point_data=places)
    kind = {"sheet.msh": {"file_format": "gmsh"}, "old.msh": {"file_format": "gmsh22", "binary": False}}
    mesh.write(tmp_path / name, **kind.get(name, {}))
    read = read_mesh(tmp_path / name)
    assert read.order == 2
    assert read.tri_areas() == pytest.approx(made.tri_areas(), rel=1e-12)
    assert read.points[read.cells] == pytest.approx(made.points[made.cells])
    assert len(read.lines) == 2 * len(edges)
    if name == "sheet.msh":
        return  # physical groups are those of entities there
    assert sorted(len(group) for group in read.tri_groups.values()) == [6, 18, 24]
    (line_group,) = read.line_groups.values()
    assert len(line_group) == 2 * len(edges)
    assert 24 in [len(group) for group in read.node_groups.values()]


def test_triangles_of_both_kinds_in_one_file_are_refused(tmp_path: Path) -> None:
    made = shapes.panel(width=1.0, height=1.0, along_x=1, along_y=1, order=2)
    cells = made.cells[:, [0, 1, 2, 5, 3, 4]]
    meshio.Mesh(made.points, [("triangle6", cells[:1]), ("triangle", cells[1:, :3])]).write(tmp_path / "mixed.vtu")
    with pytest.raises(InputError, match="1 six-node triangle beside 1 triangle of three nodes"):
        read_mesh(tmp_path / "mixed.vtu")
