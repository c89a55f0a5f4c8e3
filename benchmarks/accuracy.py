"""Error against processor time of four shipped scenes with three- and six-node triangles, on true references.

    python benchmarks/accuracy.py [--write]

Prints Markdown tables; with --write puts them in docs/speed.md, between its two marks, and draws renders/gallery/accuracy.png.
References: the cantilever's tip at 0.3, 0.6, 0.8 and 0.9 of π p r³/L and the arch's crown are those that independent codes agree on
(Fourier series with p-elements on the exact geometry, and shells of vanishing thickness), by Green strain with loads even along
rings; the cushion's volume that of fine six-node meshes, 0.12500 m³; the Mylar balloon's half thickness is exact. Seconds
are of the processor, one thread, set-up and solving without compiling, the least of two.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from taichi_membrane.device import runtime
from taichi_membrane.pictures.plots import COLOURS
from taichi_membrane.scene.file import load_scene

ROOT = Path(__file__).resolve().parent.parent
SCENES, PAGE, PICTURE = ROOT / "scenes", ROOT / "docs" / "speed.md", ROOT / "renders" / "gallery" / "accuracy.png"
MARKS = ("<!-- benchmarks/accuracy.py -->", "<!-- end -->")
GREEN = ["checks=[]", "fabric.side_strain=green"]
RINGS = ["mesh.order=2", "mesh.grade=auto", "mesh.pattern=alternating"]
TIP, CROWN, SUNK, VOLUME, HEIGHT = (-1.43855, -2.943, -5.075, -8.50), -9.465e-3, 27.182e-3, 0.12500, 0.4569465810444633

Row = tuple[str, list[str], Callable[[Sequence[dict[str, float]]], list[float]]]


def measured(name: str, overrides: Sequence[str]) -> tuple[int, int, int, float, list[dict[str, float]]]:
    """Unknowns, elements, Newton iterations, processor seconds, and the probes of each load step.

    :raises ArithmeticError: no equilibrium was found.
    """
    from taichi_membrane.simulation.analysis import ready
    from taichi_membrane.simulation.model import build_mesh, build_model

    scene, spent = load_scene(SCENES / f"{name}.toml", overrides), math.inf
    for _ in range(2):
        started = time.process_time()
        model = build_model(scene, build_mesh(scene))
        model.structure.prepare(matrix=True)
        set_up = time.process_time() - started
        work = ready(model)
        started = time.process_time()
        steps = list(work.steps())
        spent = min(spent, set_up + time.process_time() - started)
    if not steps[-1].converged:
        raise ArithmeticError(steps[-1].reason.partition(";")[0])
    free = int((~model.structure.node_held).sum())
    iterations = sum(step.iterations for step in steps)
    return free, model.structure.mesh.tri_count, iterations, spent, [step.probes for step in steps]


def ring_area(around: int, order: int) -> float:
    """Within the arch's rings of radius 0.4: polygons, or parabolas through 2 ``around`` points."""
    half = math.pi / around
    bows = 4 / 3 * math.sin(half) * (1 - math.cos(half)) if order == 2 else 0.0
    return around * 0.16 * (0.5 * math.sin(2 * half) + bows)


def cantilever() -> Iterator[Row]:
    """Nine steps to 0.9 of collapse."""

    def errors(steps: Sequence[dict[str, float]]) -> list[float]:
        return [steps[k]["deflection"] / exact - 1 for k, exact in zip((3, 6, 8, 9), TIP, strict=True)]

    for n, m in ((16, 40), (24, 60), (36, 90), (54, 135)):
        yield f"three nodes, {n} × {m}", [f"mesh.around={n}", f"mesh.along={m}"], errors
    for n, m, points in ((6, 16, 3), (8, 20, 3), (8, 20, 6), (12, 20, 6)):
        mesh = [*RINGS, f"mesh.points={points}", f"mesh.around={n}", f"mesh.along={m}"]
        yield f"six nodes, {points} points, {n} × {m}", mesh, errors


def arch() -> Iterator[Row]:
    """Inflation, then 500 N round the crown; each mesh with the forces p A of its own rings on the feet."""

    def errors(steps: Sequence[dict[str, float]]) -> list[float]:
        first, last = steps[0]["deflection"], steps[-1]["deflection"]
        return [last / CROWN - 1, (first - last) / SUNK - 1]

    meshes = [(1, n, 4 * n) for n in (12, 16, 24, 32)] + [(2, 6, 24), (2, 6, 32), (2, 8, 24), (2, 12, 24)]
    for order, n, m in meshes:
        foot = -1e4 * ring_area(n, order)
        loads = [f"stages.inflate.loads={{foot_start={foot},foot_end={foot}}}"]
        loads += [
            f"stages.load.loads={{crown=500,foot_start={foot + 250},foot_end={foot + 250}}}",
            "stages.load.steps=1",
        ]
        yield (
            f"{'three' if order == 1 else 'six'} nodes, {n} × {m}",
            [*(RINGS if order == 2 else []), f"mesh.around={n}", f"mesh.along={m}", "loads.crown.spread=edges", *loads],
            errors,
        )


def cushion() -> Iterator[Row]:
    """Inflated from exactly flat."""
    for order, cells in ((1, 8), (1, 16), (1, 32), (2, 4), (2, 8), (2, 16)):
        mesh = [f"mesh.order={order}", f"mesh.along_x={cells}", f"mesh.along_y={cells}"]
        name = f"{'three' if order == 1 else 'six'} nodes, {cells} × {cells}"
        yield name, mesh, lambda steps: [steps[-1]["volume"] / VOLUME - 1]


def mylar() -> Iterator[Row]:
    """A wedge of the disc, inflated until it no longer stretches."""
    for order, rings in ((1, 8), (1, 16), (1, 32), (1, 64), (2, 4), (2, 8), (2, 16), (2, 32)):
        name = f"{'three' if order == 1 else 'six'} nodes, {rings} rings"
        yield name, [f"mesh.order={order}", f"mesh.rings={rings}"], lambda steps: [steps[-1]["height"] / HEIGHT - 1]


TABLES: dict[str, tuple[str, list[str], list[str], Callable[[], Iterator[Row]]]] = {
    "cantilever": ("cantilever", [*GREEN, "loads.tip.spread=edges"], ["0.3", "0.6", "0.8", "0.9"], cantilever),
    "arch": ("seed_arch_ring", GREEN, ["crown", "from 0 to 500 N"], arch),
    "cushion": ("cushion", ["checks=[]"], ["volume"], cushion),
    "mylar": ("mylar", ["checks=[]"], ["half thickness"], mylar),
}


def points(lines: Sequence[str]) -> dict[str, list[tuple[str, float, float]]]:
    """Of each table its rows that have numbers: name, processor seconds, size of the last error in percent."""
    found: dict[str, list[tuple[str, float, float]]] = {}
    for line in lines:
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if cells[0] in TABLES:
            own = found[cells[0]] = []
        elif len(cells) > 3 and cells[-3].endswith("%"):
            own.append((cells[0], float(cells[-1]), abs(float(cells[-3].split()[0]))))
    return found


def draw(lines: Sequence[str]) -> None:
    """A panel for each table: size of the last error over processor seconds, by elements."""
    found = points(lines)
    figure = Figure(figsize=(14.0, 3.6), dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    for axes, (scene, rows) in zip(figure.subplots(1, len(found)), found.items(), strict=True):
        for kind, colour in (("three nodes", COLOURS[0]), ("six nodes", COLOURS[2])):
            own = [(seconds, error) for name, seconds, error in rows if name.startswith(kind)]  # from coarse to fine
            axes.loglog([one for one, _ in own], [error for _, error in own], "o-", color=colour, label=kind)
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_minor_formatter(NullFormatter())
        axes.set(title=f"{scene}: {TABLES[scene][2][-1]}", xlabel="processor seconds", ylabel="error [%]")
        axes.grid(visible=True, which="both", alpha=0.2)
        axes.legend(frameon=False)
    figure.savefig(PICTURE)


def main() -> None:
    """Print the tables, and put them where they belong."""
    runtime.start(arch="cpu", precision="f64", threads=1)
    lines: list[str] = []

    def say(line: str) -> None:
        lines.append(line)
        print(line, flush=True)

    for chosen, (scene, common, heads, rows) in TABLES.items():
        head = [chosen, "unknowns", "elements", *heads, "Newton iterations", "processor seconds"]
        say("")
        say(f"| {' | '.join(head)} |")
        say("|---" * len(head) + "|")
        for name, overrides, errors in rows():
            try:
                unknowns, elements, iterations, seconds, probes = measured(scene, [*common, *overrides])
            except ArithmeticError as error:
                say(f"| {' | '.join([name, '–', '–', *['no equilibrium'] * len(heads), '–', str(error)])} |")
                continue
            cells = [f"{100 * one:+.2g} %" for one in errors(probes)]
            say(f"| {' | '.join([name, str(unknowns), str(elements), *cells, str(iterations), f'{seconds:.2f}'])} |")
    if "--write" in sys.argv:
        text = PAGE.read_text(encoding="utf-8")
        before, after = text.split(MARKS[0])[0], text.split(MARKS[1])[1]
        PAGE.write_text("\n".join([before + MARKS[0], *lines, "", MARKS[1]]) + after, encoding="utf-8")
        draw(lines)


if __name__ == "__main__":
    main()
