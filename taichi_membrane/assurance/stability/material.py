"""Extreme materials: moduli, Poisson's ratio and thickness far apart."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from taichi_membrane.assurance.stability import structures
from taichi_membrane.assurance.stability.case import Problem, Sweep
from taichi_membrane.mesh import Mesh
from taichi_membrane.simulation.results import StepResult

PEERS = "the other solvers in double precision"
_SMALL = 1e-7  # strain at which linear elasticity is right to as much


def warp_weft() -> Sweep:
    """The beam with its axial threads ever stiffer than its hoop threads."""

    def problem(level: float) -> Problem:
        fabric = {"E_warp": level, "E_weft": 1.0, "nu": 0.3, "G": 0.3, "thickness": 1.0}
        return Problem(scene=structures.beam(fabric), measure=structures.beam_tip)

    return Sweep(
        name="warp_weft", theme="material", title="E_warp/E_weft", parameter="E_warp/E_weft",
        setting="Beam, inflated and loaded to 60 % of collapse: p r/(E_weft t) = 0.01, G = 0.3 E_weft, ν = 0.3.",
        levels=(1e0, 1e1, 1e2, 1e3, 1e4, 1e5), more_levels=(1e6, 1e7, 1e8), problem=problem,
        against="peers", source=PEERS, bound=0.01, required=1e5,
    )  # fmt: skip


def weft_warp() -> Sweep:
    """The same with its hoop threads the stiffer ones."""

    def problem(level: float) -> Problem:
        fabric = {"E_warp": 1.0, "E_weft": level, "nu": 0.3 / level, "G": 0.3, "thickness": 1.0}
        return Problem(scene=structures.beam(fabric), measure=structures.beam_tip)

    return Sweep(
        name="weft_warp", theme="material", title="E_weft/E_warp", parameter="E_weft/E_warp",
        setting="Beam, inflated and loaded to 60 % of collapse: p r/(E_warp t) = 0.01, G = 0.3 E_warp.",
        levels=(1e0, 1e1, 1e2, 1e3, 1e4, 1e5), more_levels=(1e6, 1e7, 1e8), problem=problem,
        against="peers", source=PEERS, bound=0.01, required=1e5,
    )  # fmt: skip


def shear() -> Sweep:
    """The beam with a shear modulus going to nothing."""

    def problem(level: float) -> Problem:
        fabric = {"E_warp": 1.0, "E_weft": 1.0, "nu": 0.3, "G": level, "thickness": 1.0}
        return Problem(scene=structures.beam(fabric), measure=structures.beam_tip)

    return Sweep(
        name="shear", theme="material", title="Weak in shear", parameter="G/E",
        setting="Beam, inflated and loaded to 60 % of collapse: p r/(E t) = 0.01, ν = 0.3.",
        levels=(1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6), more_levels=(1e-7, 1e-8, 1e-9), problem=problem,
        against="peers", source=PEERS, bound=0.01, required=1e-6,
    )  # fmt: skip


def poisson() -> Sweep:
    """Equal stresses both ways in a sheet that resists changes of area more and more."""

    def problem(level: float) -> Problem:
        fabric = {"E": 1.0, "nu": 1.0 - level, "thickness": 1.0}

        def measure(mesh: Mesh, steps: Sequence[StepResult]) -> dict[str, float]:
            along_x, along_y, deviation = structures.patch_strains(mesh, steps)
            return {"x": along_x / (_SMALL * level), "y": along_y / (_SMALL * level), "deviation": 1.0 + deviation}

        return Problem(
            scene=structures.patch_test(fabric, (_SMALL, _SMALL)), mesh=_square(), measure=measure,
            exact={"x": 1.0, "y": 1.0, "deviation": 1.0},
        )  # fmt: skip

    return Sweep(
        name="poisson", theme="material", title="Poisson's ratio near 1", parameter="1 - ν",
        setting="Isotropic square in its plane, equal stresses 1e-7 E both ways, 6 × 6 uneven cells.",
        levels=(1e-1, 1e-2, 1e-3, 1e-4, 1e-6, 1e-8), more_levels=(1e-10, 1e-12), problem=problem,
        against="exact", source="ε = σ (1 - ν)/E", bound=0.01, required=1e-4,
    )  # fmt: skip


def compliance() -> Sweep:
    """An orthotropic sheet whose compliance is nearly singular, stressed where it is stiff and where it is not."""

    def problem(level: float) -> Problem:
        ratio = 100.0  # E_warp/E_weft; ν may be as large as its root
        nu = np.sqrt(ratio) * (1.0 - level)
        fabric = {"E_warp": ratio, "E_weft": 1.0, "nu": nu, "G": 0.3, "thickness": 1.0}
        exact = np.array([_SMALL * (1.0 - nu) / ratio, _SMALL * (1.0 - nu / ratio)])

        def measure(mesh: Mesh, steps: Sequence[StepResult]) -> dict[str, float]:
            along_x, along_y, _ = structures.patch_strains(mesh, steps)
            return {"warp": along_x / exact[0], "weft": along_y / exact[1]}

        return Problem(
            scene=structures.patch_test(fabric, (_SMALL, _SMALL)), mesh=_square(), measure=measure,
            exact={"warp": 1.0, "weft": 1.0},
        )  # fmt: skip

    return Sweep(
        name="compliance", theme="material", title="Compliance nearly singular", parameter="1 - ν/ν_max",
        setting="Orthotropic square in its plane, E_warp/E_weft = 100, ν_max = 10, equal stresses 1e-7 E_weft both ways.",
        levels=(1e-1, 1e-2, 1e-3, 1e-4, 1e-6, 1e-8), more_levels=(1e-10, 1e-12), problem=problem,
        against="exact", source="ε = S σ", bound=0.01, required=1e-4,
    )  # fmt: skip


def thickness() -> Sweep:
    """A strip of two thicknesses in series, pulled lengthwise."""

    def problem(level: float) -> Problem:
        x = np.linspace(0.0, 2.0, 13)
        panel = structures.graded_panel(x, np.linspace(0.0, 1.0, 5))
        middle = panel.points[panel.triangles].mean(axis=1)
        thin = np.flatnonzero(middle[:, 0] > 1.0)
        mesh = Mesh.build(panel.points, panel.triangles, panel.node_groups, {"thin": thin}, panel.tri_warp)
        wall = {"E": 1.0, "nu": 0.0}
        pull = _SMALL / level  # the thin half strains by 1e-7
        exact = pull * (1.0 + level)

        def measure(mesh: Mesh, steps: Sequence[StepResult]) -> dict[str, float]:
            end = steps[-1].displacement[mesh.node_groups["x_max"], 0]
            return {"end": float(end.mean()) / exact}

        return Problem(
            scene={
                "mesh": structures.GIVEN,
                # Stress across the strip keeps it taut: without it the strip lies on the border of wrinkling everywhere.
                "fabric": wall | {"thickness": 1.0, "prestress": [0.0, pull, 0.0]},
                "fabrics": {"thin": wall | {"thickness": 1.0 / level, "prestress": [0.0, pull, 0.0]}},
                "supports": [{"group": "all", "hold": "yz"}, {"group": "x_min", "hold": "x"}],
                "loads": {"pull": {"group": "x_max", "kind": "line", "direction": [pull, 0.0, 0.0]}},
                "stages": [{"name": "pull", "loads": {"pull": 1.0}}],
            },
            mesh=mesh, measure=measure, exact={"end": 1.0},
        )  # fmt: skip

    return Sweep(
        name="thickness", theme="material", title="Jump of thickness", parameter="thick/thin",
        setting="Strip of two halves in series, N = 1e-7 E t of the thin one.",
        levels=(1e0, 1e1, 1e2, 1e3, 1e4, 1e5), more_levels=(1e6, 1e7), problem=problem,
        against="exact", source="u = N Σ l/(E t)", bound=0.01, required=1e4,
    )  # fmt: skip


def stiff_patch() -> Sweep:
    """The beam with a much stiffer patch on its upper side, where it is pulled."""

    def problem(level: float) -> Problem:
        scene = structures.beam()
        patch = {"E": level, "nu": 0.3, "thickness": 1.0}
        scene["groups"] = {"patch": {"where": "x > 1 and x < 2.5 and z > 0.5", "kind": "elements"}}
        scene["fabrics"] = {"patch": patch}
        return Problem(scene=scene, measure=structures.beam_tip)

    return Sweep(
        name="stiff_patch", theme="material", title="Patch of stiffer fabric", parameter="E of the patch/E",
        setting="Beam, inflated and loaded to 60 % of collapse, with a patch over a third of its upper side.",
        levels=(1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6), more_levels=(1e7, 1e8), problem=problem,
        against="peers", source=PEERS, bound=0.01, required=1e6,
    )  # fmt: skip


def _square() -> Mesh:
    """A unit square with cells of uneven width."""
    lines = np.linspace(0.0, 1.0, 7)
    return structures.graded_panel(lines**1.3, lines**0.8)


CASES = (warp_weft, weft_warp, shear, poisson, compliance, thickness, stiff_patch)
