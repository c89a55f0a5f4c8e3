"""Newton's figures: time to 93 % of collapse, ratio to relaxation, growth with size, cost of the parts, direct solvers compared.

    python benchmarks/newton.py [--quick] [--out FILE] [--only TABLE]

Every row is measured in a fresh process. Direct solvers other than our own are measured where they are installed.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from engine import build
from scipy import sparse

# around x along of the cantilever's tube
TARGET = (64, 128)
SIZES = [(32, 64), (64, 128), (128, 256), (256, 512)]
MILLION = (480, 980)
_LIMIT = 200.0  # seconds for a process that tries a solver
_REPEATED = 20.0  # solvers that took less are tried twice, and the shorter times count
COLLAPSE = np.pi * 0.035 * 25.0**3 / 400.0
LOADED = [
    {"name": "inflate", "pressure": 0.035},
    {"name": "load", "steps": 5, "loads": {"tip": 0.93 * COLLAPSE}},
]
ONE_STEP = [{"name": "inflate", "pressure": 0.035}, {"name": "load", "loads": {"tip": 0.3 * COLLAPSE}}]
SOLVERS = ("multifrontal", "SuperLU", "Pardiso", "CHOLMOD (cvxopt, GPL)", "cholespy", "qdldl", "AMG-CG (pyamg)")


def analysis(case: dict[str, Any]) -> tuple[Any, dict[str, float]]:
    """A compiled analysis and the seconds of set-up and compilation."""
    around, along = case["size"]
    overrides: dict[str, Any] = {"mesh.around": around, "mesh.along": along, "stages": case.get("stages", ONE_STEP)}
    overrides["solver"] = case.get("solver", {})
    work, setup, compiling = build(overrides, precision="f64", threads=os.cpu_count() or 1)
    return work, {"setup": setup, "compile": compiling}


def run_case(case: dict[str, Any]) -> dict[str, Any]:
    """Solve the steps of a case; the time of each."""
    started = time.perf_counter()
    work, seconds = analysis(case)
    began = time.perf_counter()
    steps = list(work.steps())
    solve = time.perf_counter() - began
    return {
        **seconds,
        "triangles": work.system.tri_count,
        "converged": work.outcome == "finished",
        "solve": solve,
        "whole": time.perf_counter() - started,
        "iterations": sum(step.iterations for step in steps),
        "residual": max(step.residual for step in steps),
        "tip": steps[-1].probes["deflection"],
        "memory": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024**2,
    }


def parts_case(case: dict[str, Any]) -> dict[str, Any]:
    """Seconds of the parts of one Newton iteration at the inflated state."""
    work, seconds = analysis(case)
    next(work.steps())
    newton = work.newton
    system = work.system

    def smallest(call: Callable[[], Any], repeats: int = 5) -> float:
        call()
        best = np.inf
        for _ in range(repeats):
            began = time.perf_counter()
            call()
            best = min(best, time.perf_counter() - began)
        return float(best)

    factor = newton.factorised()
    force = np.random.default_rng(0).normal(size=system.displacement().shape)
    position = system.displacement()
    loads = np.zeros_like(position)
    return {
        **seconds,
        "triangles": system.tri_count,
        "tangent": smallest(newton.tangent.assemble),
        "residual": smallest(system.out_of_balance),
        "energy": smallest(lambda: system.potential_energy(loads)),
        "factor": smallest(newton.factorised) - smallest(newton.tangent.assemble),
        "solve": smallest(lambda: factor.solve(force)),
        "state": smallest(lambda: system.set_displacement(position)),
        "entries": newton.tangent.elimination.factor_entries(),
    }


def solver_case(case: dict[str, Any]) -> dict[str, Any]:
    """Order, factorise and solve with the tangent of the inflated tube, by one of the solvers."""
    work, _ = analysis({**case, "stages": ONE_STEP[:1]})
    system, newton = work.system, work.newton
    # A state under tension everywhere, near the inflated one, without solving for it.
    points = system.structure.mesh.points
    system.set_displacement(points * np.array([1e-3, 2e-3, 2e-3]))
    system.set_surface_loads(np.array([0.035]))
    force = np.random.default_rng(0).normal(size=points.shape)
    force[~newton.free] = 0.0
    blocks = newton.tangent.assemble()
    if case["solver_name"] == "multifrontal":
        from taichi_membrane.algebra.elimination import eliminate
        from taichi_membrane.algebra.multifrontal import Multifrontal

        began = time.perf_counter()
        elimination = eliminate(points, system.structure.mesh.edges())
        _ = elimination.additions, elimination.groups, elimination.entries
        solver = Multifrontal(elimination)
        order = time.perf_counter() - began
        seconds = []
        for _ in range(
            3
        ):  # the first one touches fresh memory, which later ones take over from factors that are no more
            factor = None
            began = time.perf_counter()
            factor = solver.factorise(blocks)
            seconds.append(time.perf_counter() - began)
        began = time.perf_counter()
        found = factor.solve(force)
        times = (order, min(seconds), time.perf_counter() - began)
        residual = np.abs(newton.tangent.matrix() @ found.ravel() - force.ravel()).max() / np.abs(force).max()
    else:
        free = newton.free.ravel()
        matrix = newton.tangent.matrix()[free][:, free].tocsc()
        right = force.ravel()[free]
        times, found = OTHERS[case["solver_name"]](matrix, right, points, free)
        if sum(times) < _REPEATED:
            again, _ = OTHERS[case["solver_name"]](matrix, right, points, free)
            times = tuple(map(min, times, again))
        residual = np.abs(matrix @ found - right).max() / np.abs(right).max()
    return {
        "unknowns": int(newton.free.sum()),
        "times": times,
        "residual": residual,
        "memory": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024**2,
    }


Found = tuple[tuple[float, float, float], np.ndarray]


def superlu(matrix: Any, right: np.ndarray, points: np.ndarray, free: np.ndarray) -> Found:
    """scipy's SuperLU in its symmetric mode; order and factor are one call."""
    from scipy.sparse.linalg import splu

    began = time.perf_counter()
    factor = splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    factorised = time.perf_counter()
    found = factor.solve(right)
    return (0.0, factorised - began, time.perf_counter() - factorised), found


def pardiso(matrix: Any, right: np.ndarray, points: np.ndarray, free: np.ndarray) -> Found:
    """MKL Pardiso, symmetric positive definite."""
    import pypardiso

    solver = pypardiso.PyPardisoSolver(mtype=2)
    upper = sparse.triu(matrix, format="csr")
    upper.sort_indices()
    began = time.perf_counter()
    solver.factorize(upper)  # order and factor
    whole = time.perf_counter() - began
    solver.set_phase(22)
    began = time.perf_counter()
    solver._call_pardiso(upper, np.zeros((upper.shape[0], 1)))
    numeric = time.perf_counter() - began
    solver.set_phase(33)
    began = time.perf_counter()
    found = solver._call_pardiso(upper, right[:, None])
    return (whole - numeric, numeric, time.perf_counter() - began), found.ravel()


def cholmod(matrix: Any, right: np.ndarray, points: np.ndarray, free: np.ndarray) -> Found:
    """CHOLMOD, supernodal, from cvxopt."""
    import cvxopt
    import cvxopt.cholmod

    cvxopt.cholmod.options["supernodal"] = 2
    lower = sparse.tril(matrix, format="coo")
    given = cvxopt.spmatrix(lower.data, lower.row.astype(int), lower.col.astype(int), matrix.shape)
    began = time.perf_counter()
    factor = cvxopt.cholmod.symbolic(given)
    ordered = time.perf_counter()
    cvxopt.cholmod.numeric(given, factor)
    factorised = time.perf_counter()
    found = cvxopt.matrix(right)
    cvxopt.cholmod.solve(factor, found)
    times = (ordered - began, factorised - ordered, time.perf_counter() - factorised)
    return times, np.array(found).ravel()


def cholesky_py(matrix: Any, right: np.ndarray, points: np.ndarray, free: np.ndarray) -> Found:
    """cholespy; order and factor are one call."""
    import cholespy

    lower = sparse.coo_matrix(matrix)
    began = time.perf_counter()
    factor = cholespy.CholeskySolverD(
        matrix.shape[0], lower.row, lower.col, lower.data.astype(np.float64), cholespy.MatrixType.COO
    )
    factorised = time.perf_counter()
    found = np.zeros((len(right), 1))
    factor.solve(right[:, None].copy(), found)
    return (0.0, factorised - began, time.perf_counter() - factorised), found.ravel()


def ldl(matrix: Any, right: np.ndarray, points: np.ndarray, free: np.ndarray) -> Found:
    """qdldl; order and factor are one call."""
    import qdldl

    began = time.perf_counter()
    factor = qdldl.Solver(matrix)
    factorised = time.perf_counter()
    found = factor.solve(right)
    return (0.0, factorised - began, time.perf_counter() - factorised), found


def multigrid(matrix: Any, right: np.ndarray, points: np.ndarray, free: np.ndarray) -> Found:
    """Conjugate gradients to 1e-8, with smoothed aggregation that knows the rigid motions."""
    import pyamg

    x, y, z = points.T
    zero, one = np.zeros_like(x), np.ones_like(x)
    motions = [(one, zero, zero), (zero, one, zero), (zero, zero, one), (zero, -z, y), (z, zero, -x), (-y, x, zero)]
    near_null = np.stack([np.stack(motion, axis=1).ravel()[free] for motion in motions], axis=1)
    began = time.perf_counter()
    levels = pyamg.smoothed_aggregation_solver(matrix.tocsr(), B=near_null, symmetry="symmetric")
    built = time.perf_counter()
    found = levels.solve(right, tol=1e-8, maxiter=500, accel="cg")
    return (0.0, built - began, time.perf_counter() - built), found


OTHERS: dict[str, Callable[..., Found]] = {
    "SuperLU": superlu, "Pardiso": pardiso, "CHOLMOD (cvxopt, GPL)": cholmod, "cholespy": cholesky_py, "qdldl": ldl,
    "AMG-CG (pyamg)": multigrid,
}  # fmt: skip
KINDS = {"run": run_case, "parts": parts_case, "solver": solver_case}


def fresh(case: dict[str, Any], *, cache: Path | None = None, limit: float = 1500.0) -> dict[str, Any] | None:
    """Measure a case in its own process; None where it fails or takes too long."""
    environment = dict(os.environ)
    if cache is not None:
        environment["TI_OFFLINE_CACHE_FILE_PATH"] = str(cache)
    command = [sys.executable, __file__, "--case", json.dumps(case)]
    try:
        done = subprocess.run(command, env=environment, check=True, capture_output=True, text=True, timeout=limit)
    except subprocess.CalledProcessError as error:
        print(f"{case}: {error.stderr.strip().splitlines()[-1]}", file=sys.stderr)
        return None
    except subprocess.TimeoutExpired:
        print(f"{case}: over {limit:g} s", file=sys.stderr)
        return None
    row: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return row


def target_table() -> list[str]:
    """The cantilever to 93 % of collapse: cold, warm, and relaxation to the same error."""
    lines = [
        "| 64 × 128, inflation and five loads to 93 % of collapse | compile [s] | solve [s] | iterations | tip [mm] |",
        "|---|---|---|---|---|",
    ]
    case = {"kind": "run", "size": TARGET, "stages": LOADED}
    with tempfile.TemporaryDirectory() as cache:
        rows = {"hybrid, cold": fresh(case, cache=Path(cache))}
        rows["hybrid, warm"] = fresh(case, cache=Path(cache))
        relaxed = {"kind": "relaxation", "tolerance": 1e-5}
        rows["relaxation to 1e-5, warm"] = fresh({**case, "solver": relaxed}, cache=Path(cache))
    for name, row in rows.items():
        if row is not None:
            kept = "" if row["converged"] else " (not converged)"
            lines.append(
                f"| {name}{kept} | {row['compile']:.1f} | {row['solve']:.2f} | {row['iterations']} | {row['tip']:.4f} |"
            )
    return lines


def growth_table(quick: bool) -> list[str]:
    """Inflation and one load step on growing meshes."""
    lines = [
        "| triangles | set-up [µs per triangle] | solve [s] | iterations | s per iteration | memory [GiB] |",
        "|---|---|---|---|---|---|",
    ]
    measured = []
    for size in SIZES if quick else [*SIZES, MILLION]:
        row = fresh({"kind": "run", "size": size})
        if row is None:
            continue
        measured.append((row["triangles"], row["solve"] / row["iterations"]))
        lines.append(
            f"| {row['triangles']} | {1e6 * row['setup'] / row['triangles']:.2f} | {row['solve']:.2f} | "
            f"{row['iterations']} | {row['solve'] / row['iterations']:.3f} | {row['memory']:.2f} |"
        )
    count, cost = np.log(measured).T
    lines += ["", f"Time per iteration grows as N^{np.polyfit(count, cost, 1)[0]:.2f}."]
    return lines


def parts_table(quick: bool) -> list[str]:
    """Cost of the parts of one iteration; on the smallest mesh it is the overhead of Python."""
    names = ("tangent", "residual", "energy", "factor", "solve", "state")
    lines = [f"| triangles | {' | '.join(f'{name} [ms]' for name in names)} |", "|---" * 7 + "|"]
    for size in ((8, 8), *(SIZES[:3] if quick else SIZES)):
        row = fresh({"kind": "parts", "size": size})
        if row is not None:
            lines.append(f"| {row['triangles']} | {' | '.join(f'{1e3 * row[name]:.2f}' for name in names)} |")
    return lines


def solver_table(quick: bool) -> list[str]:
    """Direct solvers, and an iterative one, on the same matrix."""
    lines = [
        "| solver | unknowns | order [s] | factorise [s] | solve [s] | residual | process [GiB] |",
        "|---|---|---|---|---|---|---|",
    ]
    for size in ((40, 80), (124, 256), *(() if quick else ((400, 810),))):
        for name in SOLVERS:
            row = fresh({"kind": "solver", "size": size, "solver_name": name}, limit=_LIMIT)
            if row is None:
                reason = f"failed, over {_LIMIT:g} s in all, or not installed"
                lines.append(f"| {name} | {size[0]} × {size[1]} mesh | {reason} | | | | |")
                continue
            order, factor, solve = row["times"]
            lines.append(
                f"| {name} | {row['unknowns']} | {order:.2f} | {factor:.2f} | {solve:.3f} | {row['residual']:.0e} | "
                f"{row['memory']:.1f} |"
            )
    return lines


def main() -> None:
    """Run the benchmark, or one case of it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="leave out the largest meshes")
    parser.add_argument("--only", choices=("target", "growth", "parts", "solvers"))
    parser.add_argument("--out", type=Path, help="also write the tables to this file")
    parser.add_argument("--case", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.case:
        case = json.loads(arguments.case)
        print(json.dumps(KINDS[case["kind"]](case)))
        return
    tables: dict[str, Callable[[], list[str]]] = {
        "target": target_table,
        "parts": lambda: parts_table(arguments.quick),
        "growth": lambda: growth_table(arguments.quick),
        "solvers": lambda: solver_table(arguments.quick),
    }
    text: list[str] = []
    for name, table in tables.items():
        if arguments.only in (None, name):
            lines = table()
            print("\n".join([*lines, ""]), flush=True)
            text += [*lines, ""]
    if arguments.out is not None:
        arguments.out.write_text("\n".join(text), encoding="utf-8")


if __name__ == "__main__":
    main()
