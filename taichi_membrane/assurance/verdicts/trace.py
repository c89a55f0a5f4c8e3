"""The way of a case by fine arc length, of its own: where the load first has a maximum, or the path loses its stability.

``python -m taichi_membrane.assurance.verdicts.trace NAME …`` traces cases and stores what it found in ``truths.json``.
Only mechanics and algebra of the program are used: forces, tangent, its factor and the signs of its pivots. Corrections are
perpendicular to each step; a step that turns, or takes many corrections, is halved, so that no branch is left unnoticed.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import dataclass
from importlib import metadata
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_membrane.assurance.verdicts import truth
from taichi_membrane.assurance.verdicts.bench import scene_of
from taichi_membrane.assurance.verdicts.case import Case
from taichi_membrane.scene.drivers import shut_by
from taichi_membrane.simulation.load_state import Course, stage_targets, unloaded
from taichi_membrane.simulation.model import build_mesh, build_model, with_scene_groups

Floats = NDArray[np.float64]

# First step as a share of the way by the first tangent; no step is longer: micro-snaps of a wrinkled mesh are seen that move the
# structure by more than this. Half of it gave the same bounds for the tube under 0.05 of radius 27.
FINE = 0.01
_TOLERANCE = 1e-9  # of the residual over the applied loads
_CORRECTIONS, _STRAIGHT = 6, 0.9  # at most so many; least cosine between the foretold and the corrected step
_SHORTEST = 1e-6  # of the first step
_WIDTH = 1e-4  # of the limit, at which it counts as bracketed


@dataclass(frozen=True, eq=False)
class Point:
    """An equilibrium: displacements, share of the way, tangent du/dλ, negative pivots."""

    position: Floats
    share: float
    tangent: Floats
    negative: int


@dataclass(frozen=True)
class Limit:
    """Shares of the way between which the first limit is, or (1, 1) where there is none.

    :param falling: whether the load falls behind it; else the path loses its stability while it rises.
    """

    lower: float
    upper: float
    falling: bool
    points: int


class Tracer:
    """Follows the last stage of a case; the runtime runs in double precision.

    :raises ArithmeticError: a case that is not followed this way.
    """

    def __init__(self, case: Case) -> None:
        from taichi_membrane.simulation import analysis

        problem = case.problem(1)
        scene = scene_of(problem)
        mesh = build_mesh(scene) if problem.mesh is None else with_scene_groups(scene, problem.mesh)
        self.model = build_model(scene, mesh)
        self.work: Any = analysis.ready(self.model)
        targets = [unloaded(scene), *stage_targets(scene)]
        self.course = Course(targets[-2], targets[-1])
        steps, start = self.work.steps(), np.zeros_like(mesh.points)
        for stage in scene.stages[:-1]:  # the states before are the program's, of one stage after the other
            for _ in range(stage.steps):
                start = next(steps).displacement
        last = scene.stages[-1]
        if shut_by(scene, last) or last.motions or self.work.newton is None:
            raise ArithmeticError("shut chambers, motions and laws without a tangent are not traced")
        self.start = start
        self.free = ~self.model.structure.node_held

    def _load(self, share: float) -> None:
        state = self.course.at(share)
        self.work.system.set_surface_loads(self.model.surface_values(state))
        self.work.system.set_loads(self.model.nodal_loads(state))

    def _force(self, position: Floats, share: float) -> Floats:
        self.work.system.set_displacement(position)
        self._load(share)
        return np.where(self.free, self.work.system.in_frames(self.work.system.out_of_balance()), 0.0)

    def _factor(self) -> Any:
        tangent = self.work.newton.tangent
        factor = tangent.solver.factorise(tangent.assemble(), indefinite=True)
        if factor is None:
            raise ArithmeticError("the tangent is singular")
        return factor

    def _correct(self, position: Floats, share: float, advance: Floats | None) -> Point | None:
        """The equilibrium near a state, perpendicular to ``advance``, or at a given share; None where it is not near."""
        reference = max(self.model.reference_load(state) for state in (self.course.at(share), self.course.target))
        foretold = advance
        for _ in range(_CORRECTIONS + (30 if advance is None else 0)):
            force = self._force(position, share)
            factor = self._factor()
            change = self._force(position, share + 1.0) - force
            tangent = factor.solve(change)
            if np.linalg.norm(force) <= _TOLERANCE * reference:
                if advance is not None and foretold is not None:
                    cosine = np.vdot(advance, foretold) / np.linalg.norm(advance) / np.linalg.norm(foretold)
                    if cosine < _STRAIGHT:
                        return None
                return Point(position, share, tangent, factor.negative)
            step = factor.solve(force)
            if foretold is not None:
                more = -float(np.vdot(foretold, step) / np.vdot(foretold, tangent))
                step, share = step + more * tangent, share + more
            advance = None if advance is None else advance + step
            position = position + self.work.system.from_frames(step)
        return None

    def limit(self, *, fine: float = FINE, most: int = 5000) -> Limit:
        """The first limit on the way.

        :raises ArithmeticError: the path is lost, or longer than ``most`` points.
        """
        last = self._correct(self.start, 0.0, None)
        if last is None or last.negative:
            raise ArithmeticError("no stable equilibrium to start from")
        first = fine * float(np.linalg.norm(last.tangent))
        length, direction = first, last.tangent
        for number in range(most):
            sign = 1.0 if np.vdot(last.tangent, direction) >= 0.0 else -1.0
            step = sign * length * last.tangent / np.linalg.norm(last.tangent)
            position = last.position + self.work.system.from_frames(step)
            share = last.share + sign * length / float(np.linalg.norm(last.tangent))
            point = self._correct(position, share, step)
            if point is None:
                length *= 0.5
                if length < _SHORTEST * first:
                    raise ArithmeticError(f"the path is lost at {last.share:.6g} of the way")
                continue
            if point.negative or point.share <= last.share:
                advance = point.position - last.position
                falling = float(np.vdot(self.work.system.from_frames(point.tangent), advance)) < 0.0
                upper = _crossing(last, point, advance) if falling else max(point.share, last.share)
                if 0.0 <= upper - last.share <= _WIDTH * abs(upper):
                    return Limit(last.share, upper, falling, number + 1)
                length *= 0.3
                if length < _SHORTEST * first:
                    raise ArithmeticError(f"no bounds of the limit after {last.share:.6g} of the way")
                continue
            if point.share >= 1.0:
                return Limit(1.0, 1.0, False, number + 1)
            last, direction = point, point.position - last.position
            length = min(first, 1.5 * length)
        raise ArithmeticError(f"{most} points lead to {last.share:.6g} of the way")


def _crossing(before: Point, after: Point, advance: Floats) -> float:
    """Share at which the tangents of a rising and a falling point meet: not below a concave path between them."""
    length = float(np.linalg.norm(advance))
    rise = 1.0 / float(np.linalg.norm(before.tangent))
    fall = -1.0 / float(np.linalg.norm(after.tangent))
    at = (after.share - before.share - fall * length) / (rise - fall)
    return before.share + rise * at


def entry(case: Case, found: Limit, tracer: Tracer) -> dict[str, Any]:
    """What is stored of a case: the truth, and by what it was found."""
    made = {
        "source": "fine arc length",
        "nodes": tracer.model.structure.mesh.node_count,
        "points": found.points,
        "step": FINE,
        "version": metadata.version("taichi-membrane"),
    }
    if found.lower >= 1.0:
        return {"kind": "holds", **made}
    low, high = tracer.course.at(found.lower), tracer.course.at(found.upper)
    target = tracer.course.target
    ways = [(f"load.{name}", low.loads[name], high.loads[name], target.loads[name]) for name in low.loads]
    ways += [
        (f"pressure.{name}", low.pressures[name], high.pressures[name], target.pressures[name])
        for name in low.pressures
    ]
    name, lower, upper, aim = max(ways, key=lambda one: abs(one[2] - one[1]))
    bounds = sorted((lower, upper))
    told = {"name": name, "lower": bounds[0], "upper": bounds[1], "target": aim, "branching": not found.falling}
    return {"kind": "limit", **told, **made}


def main() -> None:
    """Trace the named cases and store what is found."""
    from taichi_membrane.assurance.verdicts import catalogue
    from taichi_membrane.device import runtime

    runtime.start(threads=1)
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("names", nargs="+")
    for name in parser.parse_args().names:
        case = catalogue.CASES[name]
        try:
            tracer = Tracer(case)
            found = entry(case, tracer.limit(), tracer)
        except ArithmeticError as error:
            print(f"{name}: {error}", flush=True)
            continue
        stored = json.loads(truth.FILE.read_text(encoding="utf-8"))
        stored["truths"][name] = found
        stored["truths"] = dict(sorted(stored["truths"].items()))
        truth.FILE.write_text(json.dumps(stored, indent=1) + "\n", encoding="utf-8")
        print(f"{name}: {found}", flush=True)


if __name__ == "__main__":
    main()
