"""Time per element and iteration beside the bound in C, cold and warm start (``start.py``), and what leaving features out saves.

    python benchmarks/engine.py [--quick] [--out FILE]

Every row is measured in a fresh process. Times are the smallest of many short batches: on a shared machine noise only adds. The C
loop of ``bound.c`` runs in turn with the kernels, in the same process.
"""

from __future__ import annotations

import argparse
import ctypes
import json
import os
import platform
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from start import start_table

HERE = Path(__file__).resolve().parent
SCENE = HERE.parent / "scenes" / "cantilever.toml"
# around x along of a tube, near-equilateral triangles: about 1 k, 16 k, 70 k and 1 M triangles
SIZES = {"1 k": (14, 36), "16 k": (57, 144), "70 k": (118, 298), "1 M": (446, 1122)}


def smallest(call: Callable[[], None], batch: int, repeats: int) -> float:
    """Seconds per call, the smallest over ``repeats`` batches."""
    call()
    best = float("inf")
    for _ in range(repeats):
        started = time.perf_counter()
        for _ in range(batch):
            call()
        best = min(best, (time.perf_counter() - started) / batch)
    return best


def compiled_bound(folder: Path) -> ctypes.CDLL | None:
    """The C loop as a library, or None where there is no C compiler."""
    library = folder / "bound.so"
    command = ["cc", "-O3", "-shared", "-fPIC", "-o", str(library), str(HERE / "bound.c"), "-lm"]
    try:
        subprocess.run(command, check=True, capture_output=True)
    except (FileNotFoundError, subprocess.CalledProcessError):
        return None
    loaded = ctypes.CDLL(str(library))
    loaded.iterate.restype = ctypes.c_double
    return loaded


def c_iterations(bound: ctypes.CDLL, work: Any) -> Callable[[int], None]:
    """A function that runs that many iterations of the C loop on the arrays of an analysis."""
    from taichi_membrane.mechanics.preparation import gather_lists

    system = work.system
    mesh, fabric = system.structure.mesh, system.structure.fabrics[0]
    start, corners = gather_lists(mesh.triangles.ravel(), mesh.node_count)
    zeros = np.zeros_like(mesh.points)
    geometry = system.geometry
    before = [
        mesh.triangles, mesh.points - system.origin, zeros.copy(), geometry.side_length,
        geometry.area * fabric.thickness, geometry.strain_matrix,
    ]  # fmt: skip
    after = [
        start, corners, zeros.copy(), work.relaxation.node_mass.to_numpy(), system.structure.node_held.astype(np.int32),
        zeros.copy(), zeros.copy(), np.zeros((3 * mesh.tri_count, 3)),
    ]  # fmt: skip
    before, after = ([np.ascontiguousarray(a) for a in arrays] for arrays in (before, after))
    stiffness = fabric.stiffness()
    constants = [stiffness[0, 0], stiffness[0, 1], stiffness[2, 2], fabric.e_warp, 0.035]

    def pointers(arrays: list[np.ndarray]) -> list[ctypes.c_void_p]:
        return [a.ctypes.data_as(ctypes.c_void_p) for a in arrays]

    def iterate(count: int) -> None:
        numbers = [ctypes.c_double(value) for value in constants]
        bound.iterate(count, mesh.tri_count, mesh.node_count, *pointers(before), *numbers, *pointers(after))

    return iterate


def build(overrides: dict[str, Any], *, precision: str, threads: int) -> tuple[Any, float, float]:
    """An analysis of the cantilever with some keys changed, seconds of set-up and seconds of compilation."""
    import tomllib

    from taichi_membrane.device import runtime
    from taichi_membrane.scene import Scene
    from taichi_membrane.simulation.model import build_mesh, build_model

    data = tomllib.loads(SCENE.read_text(encoding="utf-8"))
    for key, value in overrides.items():
        table, _, name = key.partition(".")
        if name:
            data[table][name] = value
        else:
            data[table] = value
    data["checks"] = []
    data.pop("curve", None)
    scene = Scene.model_validate(data)
    model = build_model(scene, build_mesh(scene))
    runtime.start(precision=precision, threads=threads)  # type: ignore[arg-type]
    from taichi_membrane.simulation.analysis import Analysis
    from taichi_membrane.simulation.solver_choice import chosen_solver

    started = time.perf_counter()
    model.structure.prepare(matrix=chosen_solver(model).kind != "relaxation")
    prepared = time.perf_counter()
    work = Analysis(model)
    work.compile()
    compiled = time.perf_counter()
    work.system.set_surface_loads(np.full(len(model.pressure_names), 0.035))
    return work, prepared - started, compiled - prepared


def measure(case: dict[str, Any]) -> dict[str, Any]:
    """Measure one case in this process."""
    around, along = case["size"]
    overrides = {"mesh.around": around, "mesh.along": along, **case.get("overrides", {})}
    work, setup, compiling = build(overrides, precision=case["precision"], threads=case["threads"])
    count = work.system.tri_count
    batch = max(1, int(2e5 / count))
    repeats = 200 if count < 50_000 else 40
    solver = work.relaxation
    solver.start_from_rest()
    # An unreachable tolerance: the solver never stops. Kernels and C loop alternate, so that both see the same machine.
    kernel_time, c_time = float("inf"), float("inf")
    with tempfile.TemporaryDirectory() as folder:
        bound = compiled_bound(Path(folder)) if case.get("bound") else None
        iterate_c = c_iterations(bound, work) if bound is not None else None
        for _ in range(4):
            kernel_time = min(kernel_time, smallest(lambda: solver._iterate(1e-300, 1.0), batch, repeats // 4))
            if iterate_c is not None:
                c_time = min(c_time, smallest(lambda: iterate_c(batch), 1, repeats // 4) / batch)
    return {
        "triangles": count,
        "precision": case["precision"],
        "threads": case["threads"],
        "ns_per_element": kernel_time / count * 1e9,
        "c_ns_per_element": None if c_time == float("inf") else c_time / count * 1e9,
        "setup_s": setup,
        "compile_s": compiling,
        "bytes_per_triangle": work.system.bytes_allocated() / count,
    }


def in_fresh_process(case: dict[str, Any], cache: Path | None = None) -> dict[str, Any]:
    """Measure one case in a new process, with its own kernel cache if one is given."""
    environment = dict(os.environ)
    if cache is not None:
        environment["TI_OFFLINE_CACHE_FILE_PATH"] = str(cache)
    command = [sys.executable, __file__, "--case", json.dumps(case)]
    done = subprocess.run(command, env=environment, check=True, capture_output=True, text=True)
    return json.loads(done.stdout.splitlines()[-1])


def speed_table(quick: bool) -> list[str]:
    """Rows of nanoseconds per element and iteration."""
    lines = [
        "| triangles | precision | threads | ns per element and iteration | C, one thread |",
        "|---|---|---|---|---|",
    ]
    for name, size in SIZES.items():
        if quick and name == "1 M":
            continue
        for precision in ("f64", "f32"):
            for threads in (1, 2):
                case = {"size": size, "precision": precision, "threads": threads, "bound": precision == "f64"}
                row = in_fresh_process(case)
                bound = "" if row["c_ns_per_element"] is None else f"{row['c_ns_per_element']:.1f}"
                lines.append(
                    f"| {row['triangles']} | {precision} | {threads} | {row['ns_per_element']:.1f} | {bound} |"
                )
    return lines


def feature_table() -> list[str]:
    """What a scene saves that does without features, on 16 k triangles and one thread."""
    orthotropic = {
        "E_warp": 4000.0, "E_weft": 2000.0, "nu": 0.1, "G": 500.0, "thickness": 0.1, "prestress": [0.1, 0.1, 0.0],
    }  # fmt: skip
    isotropic = {"E": 4000.0, "nu": 0.1, "thickness": 0.1}
    pulled = {"push": {"kind": "translation", "group": "end", "direction": [1.0, 0.0, 0.0], "hold": "x"}}
    cases: dict[str, dict[str, Any]] = {
        "two orthotropic fabrics, tension field, prestress, two pressures, loads, slanted support": {
            "fabric": orthotropic,
            "fabrics": {"cap_end": isotropic},
            "pressures": {"inside": {"group": "wall"}, "cap": {"group": "cap_end"}},
            "supports": [{"group": "start", "hold": "xyz"}, {"group": "end", "normal": [0.0, 1.0, 1.0]}],
            "stages": [{"name": "load", "pressure": {"inside": 0.035, "cap": 0.035}, "loads": {"tip": 1.0}}],
        },
        "one orthotropic fabric, tension field, prestress, pressure, loads": {"fabric": orthotropic},
        "isotropic tension field, pressure, loads": {"fabric": isotropic},
        "no wrinkling": {"fabric": {**isotropic, "law": "none"}},
        "no wrinkling, no pressure, no loads (a prescribed motion)": {
            "fabric": {**isotropic, "law": "none"},
            "loads": {},
            "motions": pulled,
            "stages": [{"name": "pull", "motions": {"push": 1.0}}],
        },
    }
    lines = [
        "| what the scene uses | compile, cold [s] | ns per element and iteration | bytes per triangle |",
        "|---|---|---|---|",
    ]
    for name, parts in cases.items():
        case = {"size": SIZES["16 k"], "precision": "f64", "threads": 1, "overrides": parts}
        with tempfile.TemporaryDirectory() as cache:
            row = in_fresh_process(case, Path(cache))
        lines.append(
            f"| {name} | {row['compile_s']:.2f} | {row['ns_per_element']:.1f} | {row['bytes_per_triangle']:.0f} |"
        )
    return lines


def main() -> None:
    """Run the benchmark, or one case of it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="leave out the million triangles")
    parser.add_argument("--out", type=Path, help="also write the tables to this file")
    parser.add_argument("--case", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.case:
        print(json.dumps(measure(json.loads(arguments.case))))
        return
    text = [
        f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}",
        "",
    ]
    for table in (speed_table(arguments.quick), feature_table(), start_table(1)):
        text += [*table, ""]
        print("\n".join([*table, ""]), flush=True)
    if arguments.out is not None:
        arguments.out.write_text("\n".join(text), encoding="utf-8")


if __name__ == "__main__":
    main()
