"""The tables of docs/seed.md: the seed paper's beams and arch beside the closed forms of seed_theory.py.

    python benchmarks/seed_study.py [references table1 cantilever beam arch stiffness collapse resolved]

Without arguments everything is printed, in some minutes. Every run starts from a shipped scene ``scenes/seed_*.toml`` and changes
what its table is about. Units: N with mm (beams) or m (arch).
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from seed_theory import (
    ARCH_TUBE,
    BEAM,
    CANTILEVER,
    TABLE1,
    Tube,
    arch_first_wrinkle,
    arch_flexibility,
    arch_mechanism,
    flattening,
)

from taichi_membrane.execution.run import run
from taichi_membrane.scene import Scene
from taichi_membrane.scene.file import load_scene
from taichi_membrane.simulation.results import RunResult, StepResult

SCENES = Path(__file__).resolve().parent.parent / "scenes"


PRINTED = {
    5: (1.438, 1.436), 10: (2.876, 2.872), 15: (4.313, 4.308), 20: (5.749, 5.744), 25: (7.184, 7.719),
    30: (8.618, 8.608), 35: (10.05, 10.04), 40: (11.48, 11.48), 45: (12.91, 12.91), 50: (14.34, 14.35),
}  # fmt: skip


def solve(name: str, *overrides: str, **parts: Any) -> RunResult:
    """Run a shipped scene with values replaced by ``overrides`` and whole parts by ``parts``; its checks are left out."""
    scene = load_scene(SCENES / f"{name}.toml", ["checks=[]", "solver.max_iterations=3000", *overrides])
    return run(Scene.model_validate({**scene.model_dump(), **parts}))


def loaded(result: RunResult, stage: str = "load") -> list[StepResult]:
    """The converged steps of a stage."""
    return [step for step in result.steps if step.stage == stage and step.converged]


def onset(result: RunResult, load: str, away: float, axis: int, crown: float = 0.0) -> float:
    """Load at which the first element wrinkles that is further than ``away`` from the held ends along ``axis``, and than ``crown``
    from the plane x = 0.

    The smallest minor trial stress of these elements, interpolated to zero between load steps; NaN where none wrinkles.
    """
    middle = result.mesh.points[result.mesh.triangles].mean(axis=1)
    centroid = middle[:, axis]
    region = np.abs(middle[:, 0]) >= crown
    region &= (centroid > away) & (centroid < centroid.max() - away if axis == 0 else True)
    steps = loaded(result, "inflate") + loaded(result)
    field = "taut_margin" if result.mesh.order == 1 else "point_taut_margin"
    margins = [float(getattr(step.elements, field)[region].min()) for step in steps]
    for k in range(1, len(steps)):
        if margins[k] < 0.0:
            share = margins[k - 1] / (margins[k - 1] - margins[k])
            return steps[k - 1].loads[load] + share * (steps[k].loads[load] - steps[k - 1].loads[load])
    return math.nan


def carried_onset(result: RunResult, tube: Tube, step: StepResult, force: float) -> float:
    """Root onset of a cantilever from the axial stress of a taut step: fitted N₀ + (a + b x) cos θ at x = 0."""
    middle = result.mesh.points[result.mesh.triangles].mean(axis=1)
    wall = (middle[:, 0] > 3.0 * tube.radius) & (middle[:, 0] < tube.length - 3.0 * tube.radius)
    cosine = middle[wall, 2] / np.hypot(middle[wall, 1], middle[wall, 2])
    columns = np.stack([np.ones_like(cosine), cosine, cosine * middle[wall, 0]], axis=1)
    level, at_root, _ = np.linalg.lstsq(columns, step.elements.stress[wall, 0], rcond=None)[0]
    return float(force * level / abs(at_root))


def table(title: str, head: list[str], rows: list[list[str]]) -> None:
    """Print a Markdown table."""
    print(f"\n{title}\n\n| {' | '.join(head)} |\n|{'---|' * len(head)}")
    for row in rows:
        print(f"| {' | '.join(row)} |")
    sys.stdout.flush()


def study_references() -> None:
    """First-wrinkle and collapse loads of the closed forms, with nominal and inflated dimensions."""
    rows = []
    for name, tube, both in (
        ("table 1", TABLE1, 1.0),
        ("figure 5, N", CANTILEVER, 1.0),
        ("figure 4, load at a point, N", replace(BEAM, strap=0.0), 2.0),
        ("figure 4, strap, N", BEAM, 2.0),
    ):
        values = [both * t.collapse_force * share for share in (0.5, 1.0) for t in (tube, tube.inflated())]
        rows.append([name, *(f"{value:.3f}" for value in values)])
    head = ["", "first wrinkle, nominal", "inflated", "collapse, nominal", "inflated"]
    table("Closed forms: straight tubes", head, rows)
    rows = [[feet, f"{arch_first_wrinkle(feet):.1f}", f"{arch_mechanism(feet):.0f}"] for feet in ("pinned", "fixed")]
    table("Closed forms: arch, N", ["feet", "first wrinkle", "hinge mechanism"], rows)
    bent = [
        f"{1e6 * arch_flexibility(stiffness):.2f} mm/kN at E t = {1e-3 * stiffness:.0f} N/mm"
        for stiffness in (5e5, 5e6)
    ]
    print(f"\nArch, crown deflection before wrinkling, pinned: {', '.join(bent)}")


def study_table1() -> None:
    """Table 1 beside the seed's columns, its mesh convergence, and what end and load do to it."""
    result = solve("seed_table1")
    ours = [-step.probes["deflection"] for step in loaded(result)]
    rows = [
        [f"{load}", *(f"{v:g}" for v in printed), f"{d:.4f}", f"{100 * (d / printed[0] - 1):+.2f} %"]
        for (load, printed), d in zip(PRINTED.items(), ours, strict=True)
    ]
    table("Table 1, mm", ["N", "seed", "LUSAS", "ours", "ours to seed"], rows)
    meshes = [(16, 28), (24, 42), (32, 56), (48, 84), (64, 112)]
    changes = {f"{n} × {m}": [f"mesh.around={n}", f"mesh.along={m}"] for n, m in meshes}
    changes |= {
        "32 × 56, uniform diagonals": ["mesh.pattern=diagonal"],
        "32 × 56, flat cap": ["mesh.cap_end=flat"],
        "32 × 56, load at the cap's pole": ["loads.tip.group=tip"],
        "32 × 56, load over the cap": ["loads.tip.group=cap_end", "loads.tip.spread=area"],
        "32 × 56, load on the top node of the end ring": [
            "groups.one={where='x = 1500 within 1e-6 and z > 149.9'}",
            "loads.tip.group=one",
        ],
        "32 × 56, Green strain": ["fabric.side_strain=green"],
    }
    rows = []
    for name, overrides in changes.items():
        run_ = solve("seed_table1", *overrides)
        values = [-step.probes["deflection"] for step in loaded(run_)]
        first, last = values[0], values[-1]
        rows.append([name, str(run_.mesh.tri_count), f"{first:.4f}", f"{last:.4f}", f"{last / first / 10 - 1:+.4%}"])
    table("Table 1: mesh, end and load", ["", "elements", "5 N, mm", "50 N, mm", "bend of the curve"], rows)


SHARES = (6, 10, 12, 14, 16, 17, 18, 19)  # load steps of 0.05 of the collapse load


def excess(result: RunResult, tube: Tube, half: float) -> list[str]:
    """Deflection over beam theory at the load steps SHARES; ``half`` is 0.5 where the load goes to two half spans."""
    steps = {step.stage_step: step for step in loaded(result)}
    name = next(iter(result.scene.loads), "")
    inflated = tube.inflated()
    values = []
    for number in SHARES:
        if number not in steps:
            values.append("–")
            continue
        force = half * steps[number].loads[name]
        values.append(f"{100 * (-steps[number].probes['deflection'] / inflated.deflection(force) - 1):+.1f} %")
    return values


def study_cantilever() -> None:
    """Deflection over Comer-Levy by mesh, slenderness and root; and where wrinkling starts."""
    rows, onsets = [], []
    for n, m in ((24, 60), (32, 80), (48, 120)):
        result = solve("seed_fig5_load", f"mesh.around={n}", f"mesh.along={m}")
        rows.append([f"L = 400, {n} × {m}", *excess(result, CANTILEVER, 1.0)])
        steps = loaded(result)
        carried = carried_onset(result, CANTILEVER, steps[4], steps[4].loads["tip"])
        onsets.append(
            [f"{n} × {m}", f"{onset(result, 'tip', 0, 0):.3f}", f"{onset(result, 'tip', 25, 0):.3f}", f"{carried:.3f}"]
        )
    for length in (200, 800):
        tube = replace(CANTILEVER, length=float(length))
        result = solve(
            "seed_fig5_load",
            f"mesh.length={length}",
            f"mesh.along={length // 5}",
            f"stages.load.loads={{tip={0.95 * tube.collapse_force}}}",
        )
        rows.append([f"L = {length}, 32 × {length // 5}", *excess(result, tube, 1.0)])
    free = solve("seed_fig5_load", **FREE_ROOT)
    rows.append(["L = 400, root free to widen and flatten", *excess(free, CANTILEVER, 1.0)])
    head = ["load over collapse (nominal)", *(f"{0.05 * k:.2f}" for k in SHARES)]
    table("Cantilever: deflection over beam theory of the inflated dimensions", head, rows)
    head = ["mesh", "any element", "further than r from the ring", "taut stress carried to the root"]
    table("Cantilever: first wrinkle, N", head, onsets)
    inflated = CANTILEVER.inflated()
    at_root = 0.5 * inflated.collapse_force
    print(f"\ntheory: {at_root:.3f} N at the root, {at_root / (1 - 25 / 400):.3f} N at r from it (inflated dimensions)")


FREE_ROOT: dict[str, Any] = {
    "groups": {
        "free_wall": {"where": "x > 25 and x < 375", "kind": "elements"},
        "root_mirror": {"where": "x = 0 within 1e-6 and y = 0 within 1e-6"},
        "root_sides": {"where": "x = 0 within 1e-6 and z = 0 within 1e-6"},
    },
    "supports": [
        {"group": "start", "hold": "x"},
        {"group": "root_mirror", "hold": "y"},
        {"group": "root_sides", "hold": "z"},
    ],
}


def devices() -> dict[str, list[str]]:
    """Ways to bring the centre load into the beam, as overrides of seed_fig4_load."""
    node = "groups.strap={where='x = 200 within 1e-6 and y = 0 within 1e-6 and z > 0'}"
    return {
        "strap, 50 mm": [],
        "strap, 17 mm": ["groups.strap={where='x > 194 and x < 206'}"],
        "strap, 83 mm": ["groups.strap={where='x > 160 and x < 240'}"],
        "middle ring, equal forces": ["loads.centre.group=middle"],
        "saddle: upper half of the strap": ["groups.strap={where='x > 176 and x < 224 and z > -0.1'}"],
        "patch: 45° each side of the top": ["groups.strap={where='x > 176 and x < 224 and z > 17'}"],
        "one node": [node],
        "one node, 24 × 72": [node, "mesh.around=24"],
        "one node, 48 × 120": [node, "mesh.around=48", "mesh.along=120"],
    }


def study_beam() -> None:
    """The simply supported beam by the way its load is applied, and by mesh and span."""
    point = replace(BEAM, strap=0.0)
    rows, onsets = [], []
    for name, overrides in devices().items():
        result = solve("seed_fig4_load", *overrides)
        rows.append([name, *excess(result, point, 0.5)])
        onsets.append([name, f"{onset(result, 'centre', 25.0, 0):.2f}"])
    rigid = solve("seed_fig5_load", "mesh.length=200", "mesh.along=40", f"stages.load.loads={{tip={0.95 * point.collapse_force}}}",
                  "groups.free_wall.where='x > 25 and x < 175'")  # fmt: skip
    rows.append(["rigid collar (cantilever of half the span)", *excess(rigid, point, 1.0)])
    for factor in (2, 4):
        tube = replace(point, length=200.0 * factor)
        result = solve(
            "seed_fig4_load",
            f"mesh.length={400 * factor}",
            f"mesh.along={72 * factor}",
            "mesh.around=24",
            f"groups.strap={{where='x > {200 * factor - 24} and x < {200 * factor + 24}'}}",
            f"stages.load.loads={{centre={1.9 * tube.collapse_force}}}",
        )
        rows.append([f"strap, 50 mm, span {400 * factor}", *excess(result, tube, 0.5)])
    head = ["load over collapse (nominal)", *(f"{0.05 * k:.2f}" for k in SHARES)]
    table("Beam: deflection over beam theory of a load at a point", head, rows)
    table("Beam: first wrinkle further than r from the supports, N", ["load", "N"], onsets)


def foot_forces(total: float, **others: float) -> str:
    """A stage's loads as an override: half of ``total`` (upwards) on each foot ring, and others."""
    forces = {**others, "foot_start": 0.5 * total, "foot_end": 0.5 * total}
    return "{" + ", ".join(f"{name}={value}" for name, value in forces.items()) + "}"


def study_arch() -> None:
    """First wrinkle of the arch by load, fabric, feet and mesh."""
    fixed = {"supports": [{"group": "feet", "hold": "xyz"}]}
    rows = []
    for scene in ("seed_arch_ring", "seed_arch_patch", "seed_arch_node"):
        for modulus in ("5e8", "5e9"):
            fine = (scene, modulus) in (("seed_arch_ring", "5e8"), ("seed_arch_patch", "5e9"))
            for n, m in ((24, 96), (32, 128), (48, 192))[: 3 if fine else 2]:
                mesh = [f"mesh.around={n}", f"mesh.along={m}", f"fabric.E={modulus}", "stages.load.steps=17"]
                area = n * ARCH_TUBE.radius**2 * math.sin(2 * math.pi / n) * ARCH_TUBE.pressure
                mesh.append(f"stages.inflate.loads={foot_forces(-area)}")
                mesh.append(f"stages.load.loads={foot_forces(1360 - area, crown=1360)}")
                values = []
                for parts in ({}, fixed):
                    result = solve(scene, *mesh, **parts)
                    values.append(f"{onset(result, 'crown', 0.4, 2):.0f}")
                rows.append([scene.removeprefix("seed_arch_"), f"{float(modulus) / 1e6:.0f}", f"{n} × {m}", *values])
    head = ["load", "E t, N/mm", "mesh", "pinned", "fixed"]
    table("Arch: first wrinkle further than r above the feet, N", head, rows)
    bending = []
    for scene, stiffness in (("ring", 5e5), ("patch", 5e5), ("patch_stiff", 5e6), ("node", 5e5)):
        steps = loaded(solve(f"seed_arch_{scene}", "stages.load.steps=20"))
        first, last = steps[0], steps[2]
        sink = (first.probes["deflection"] - last.probes["deflection"]) / (last.loads["crown"] - first.loads["crown"])
        bending.append([scene, f"{1e6 * sink:.2f}", f"{1e6 * arch_flexibility(stiffness):.2f}"])
        bending[-1].append(f"{1e6 * arch_flexibility(stiffness, flattening(stiffness)):.2f}")
    table(
        "Arch: crown deflection before wrinkling, mm/kN",
        ["scene", "ours", "thin arch", "section free to flatten"],
        bending,
    )


def study_stiffness() -> None:
    """Tangent stiffness over that before wrinkling, at loads relative to each structure's theoretical first wrinkle."""
    rows = []
    cases: tuple[tuple[str, str, str, float], ...] = (
        ("cantilever", "seed_fig5_load", "tip", 0.5 * CANTILEVER.collapse_force),
        ("simply supported, strap", "seed_fig4_load", "centre", replace(BEAM, strap=0.0).collapse_force),
        ("arch, pinned, ring load", "seed_arch_ring", "crown", arch_first_wrinkle("pinned")),
        ("arch, pinned, patch load", "seed_arch_patch", "crown", arch_first_wrinkle("pinned")),
    )
    for name, scene, load, wrinkle in cases:
        steps = loaded(solve(scene))
        force = np.array([step.loads[load] for step in steps])
        down = np.array([-step.probes["deflection"] for step in steps])
        stiffness = np.diff(force) / np.diff(down)
        at = 0.5 * (force[1:] + force[:-1]) / wrinkle
        shares = np.interp((1.1, 1.25, 1.5, 1.75), at, stiffness / stiffness[0])
        rows.append([name, *(f"{share:.2f}" for share in shares)])
    down_ = [CANTILEVER.deflection(share * 0.5 * CANTILEVER.collapse_force) for share in (0.1, 0.2)]
    initial = 0.1 / (down_[1] - down_[0])
    theory = []
    for share in (1.1, 1.25, 1.5, 1.75):
        low, high = (CANTILEVER.deflection((share + e) * 0.5 * CANTILEVER.collapse_force) for e in (-0.01, 0.01))
        theory.append(f"{0.02 / (high - low) / initial:.2f}")
    rows.append(["Comer-Levy, cantilever", *theory])
    table("Tangent stiffness over the initial one", ["load over first wrinkle", "1.10", "1.25", "1.50", "1.75"], rows)


def study_collapse() -> None:
    """Bracket of the load beyond which no equilibrium is found, on coarse meshes: the failing step is halved six times."""
    cases: tuple[tuple[str, str, str, list[str], float], ...] = (
        ("cantilever, 24 × 60", "seed_fig5_load", "tip", ["mesh.around=24", "mesh.along=60"], 1.2 * CANTILEVER.collapse_force),
        ("beam, strap, 24 × 72", "seed_fig4_load", "centre", ["mesh.around=24"], 2.4 * replace(BEAM, strap=0.0).collapse_force),
        ("arch, ring, 24 × 96", "seed_arch_ring", "crown", [], 2400.0),
        ("arch, patch, 24 × 96", "seed_arch_patch", "crown", [], 2400.0),
        ("arch, patch, E t = 5000", "seed_arch_patch_stiff", "crown", [], 2400.0),
        ("arch, node, 24 × 96", "seed_arch_node", "crown", [], 2400.0),
    )  # fmt: skip
    rows = []
    for name, scene, load, overrides, highest in cases:
        pull = sum(load_scene(SCENES / f"{scene}.toml").stages[0].loads.values())
        loads = foot_forces(highest + pull, crown=highest) if load == "crown" else f"{{{load}={highest}}}"
        steps = 24
        result = solve(
            scene, *overrides, f"stages.load.loads={loads}", f"stages.load.steps={steps}", "solver.max_cuts=4",
            "solver.max_iterations=500",
        )  # fmt: skip
        last = result.steps[-1]
        top = last.loads[load] + (0.0 if result.converged else highest / steps / 2**last.cuts)
        sink = -loaded(result)[-1].probes["deflection"]
        rows.append(
            [name, f"{last.loads[load]:.4g}", "none found" if result.converged else f"{top:.4g}", f"{sink:.3g}"]
        )
    head = ["", "last equilibrium, N", "none found at, N", "deflection at the last full step"]
    table("Collapse under load control", head, rows)


def six_nodes(around: int, along: int) -> list[str]:
    """Overrides for six-node triangles on rings graded towards boundary layers, and loads that are even along rings."""
    pattern = ["mesh.order=2", "mesh.grade=auto", "mesh.pattern=alternating"]
    return [*pattern, f"mesh.around={around}", f"mesh.along={along}"]


def ring_area(radius: float, around: int) -> float:
    """Within a ring of parabolas through 2 ``around`` points of a circle."""
    half = math.pi / around
    return around * radius**2 * (0.5 * math.sin(2 * half) + 4 / 3 * math.sin(half) * (1 - math.cos(half)))


def study_resolved() -> None:
    """Cantilever and arch with their boundary layers resolved: deflection over beam theory, first wrinkles."""
    rows, onsets = [], []
    for n, m in ((8, 20), (12, 20)):
        result = solve("seed_fig5_load", *six_nodes(n, m), "loads.tip.spread=edges")
        rows.append([f"{n} × {m}", str(3 * result.mesh.node_count), *excess(result, CANTILEVER, 1.0)])
        onsets.append([f"{n} × {m}", f"{onset(result, 'tip', 0, 0):.3f}", f"{onset(result, 'tip', 25, 0):.3f}"])
    head = ["load over collapse (nominal)", "components", *(f"{0.05 * k:.2f}" for k in SHARES)]
    table("Cantilever, layers resolved: deflection over beam theory of the inflated dimensions", head, rows)
    table(
        "Cantilever, layers resolved: first wrinkle, N", ["mesh", "any point", "further than r from the ring"], onsets
    )
    fixed = {"supports": [{"group": "feet", "hold": "xyz"}]}
    rows = []
    for n, m in ((8, 24), (12, 24), (12, 48)):
        area = ring_area(ARCH_TUBE.radius, n) * ARCH_TUBE.pressure
        loads = [
            f"stages.inflate.loads={foot_forces(-area)}",
            f"stages.load.loads={foot_forces(1200 - area, crown=1200)}",
        ]
        values = []
        for parts in ({}, fixed):
            result = solve(
                "seed_arch_ring", *six_nodes(n, m), "loads.crown.spread=edges", "stages.load.steps=15", *loads, **parts
            )
            values += [f"{onset(result, 'crown', 0.4, 2, crown):.0f}" for crown in (0.0, 0.1)]
        rows.append([f"{n} × {m}", str(3 * result.mesh.node_count), *values])
    head = ["mesh", "components", "pinned", "pinned, 4 l from the crown", "fixed", "fixed, 4 l from the crown"]
    table("Arch, ring load, layers resolved: first wrinkle further than r above the feet, N", head, rows)


STUDIES: dict[str, Callable[[], None]] = {
    "references": study_references,
    "table1": study_table1,
    "cantilever": study_cantilever,
    "beam": study_beam,
    "arch": study_arch,
    "stiffness": study_stiffness,
    "collapse": study_collapse,
    "resolved": study_resolved,
}

if __name__ == "__main__":
    for chosen in sys.argv[1:] or STUDIES:
        if chosen not in STUDIES:
            sys.exit(f"no study {chosen!r}; there are {', '.join(STUDIES)}")
        STUDIES[chosen]()
