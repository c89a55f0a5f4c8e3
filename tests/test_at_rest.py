"""What the tangent at rest tells: vibration and buckling modes against closed forms, derivatives against finite differences."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from test_path import LIMIT, RISE, SLANT, VOLUME, E, tent

from taichi_membrane.execution.run import run
from taichi_membrane.scene import Scene
from taichi_membrane.simulation.analysis import Analysis
from taichi_membrane.simulation.load_state import Course, LoadState
from taichi_membrane.simulation.model import build_mesh, build_model
from taichi_membrane.solvers.record import SolveRecord

pytestmark = pytest.mark.usefixtures("runtime_cpu")


def drum(cells: int) -> np.ndarray:
    """Frequencies of a square membrane of side 1 under uniform prestress 2, density 3, held at its rim."""
    scene = {
        "name": "drum",
        "units": {"length": "m", "force": "N"},
        "mesh": {"shape": "panel", "width": 1.0, "height": 1.0, "along_x": cells, "along_y": cells},
        "fabric": {
            "E": 1e3,
            "nu": 0.3,
            "thickness": 0.01,
            "prestress": [2.0, 2.0, 0.0],
            "density": 3.0,
            "warp": [1, 0, 0],
        },
        "supports": [{"group": "boundary", "hold": "xyz"}],
        "pressures": {},
        "stages": [{"name": "rest"}],
        "modes": {"kind": "vibration", "count": 4},
    }
    result = run(Scene.model_validate(scene))
    modes = result.steps[0].modes
    assert result.converged
    assert modes is not None
    assert np.abs(modes.shapes).max(axis=(1, 2)) == pytest.approx(1.0)
    return np.array(modes.values)


def test_a_drum_has_its_frequencies() -> None:
    """½ √(σ/ρ) √(m² + n²): errors fall with the square of the mesh size, to below 0.9 % for the fourth at 20 cells."""
    exact = 0.5 * np.sqrt(2.0 / 3.0) * np.sqrt([2.0, 5.0, 5.0, 8.0])
    coarse, fine = (drum(cells) / exact - 1.0 for cells in (10, 20))
    assert np.abs(fine).max() < 9e-3
    assert np.log2(np.abs(coarse / fine)) == pytest.approx(2.0, abs=0.25)


def test_buckling_extrapolates_the_tangent() -> None:
    """The tent's tangent is known: K = E V (3 z² - h²)/(2 s⁴), so K' along the path and the extrapolated load are, too."""
    target = 1.5 * LIMIT
    stage = {"name": "push", "steps": 10, "loads": {"push": target}, "until": "collapse"}
    result = tent([stage], modes={"kind": "buckling", "count": 1})
    predicted = []
    for step in result.steps[:5]:
        height = RISE + step.probes["sink"]
        stiffness = E * VOLUME * (3 * height**2 - RISE**2) / (2 * SLANT**4)
        sinking = -target / stiffness  # dz per share of the stage
        change = E * VOLUME * 3 * height / SLANT**4 * sinking
        assert step.modes is not None
        assert step.modes.values[0] == pytest.approx(step.loads["push"] / target - stiffness / change, rel=1e-5)
        assert step.modes.shapes[0, 0] == pytest.approx([0, 0, 1])
        predicted.append(step.modes.values[0] * target)
    errors = np.abs(np.array(predicted) / LIMIT - 1.0)
    assert np.all(np.diff(errors) < 0.0)  # the nearer the limit, the better the prediction


TUBE: dict[str, Any] = {
    "name": "tube",
    "units": {"length": "mm", "force": "N"},
    "mesh": {"shape": "tube", "radius": 25.0, "length": 120.0, "around": 10, "along": 10},
    "fabrics": {
        "wall": {"E_warp": 4000.0, "E_weft": 2000.0, "nu": 0.1, "G": 200.0, "thickness": 0.1},
        "cap_end": {"E": 8000.0, "nu": 0.2, "thickness": 0.3},
    },
    "supports": [{"group": "start", "hold": "xyz"}],
    "loads": {"tip": {"group": "end", "direction": [0.0, 0.3, -1.0]}},
    "stages": [{"name": "inflate", "pressure": 0.035}, {"name": "load", "steps": 2, "loads": {"tip": 10.0}}],
    "probes": {
        "tip": {"kind": "displacement", "group": "end", "component": "z"},
        "way": {"kind": "displacement", "group": "end", "component": "magnitude"},
        "girth": {"kind": "radius", "group": "end", "axis": "x"},
        "turn": {"kind": "rotation", "group": "end", "axis": [0.0, 1.0, 0.0], "through": [120.0, 0.0, 0.0]},
        "volume": {"kind": "volume"},
    },
    "solver": {"kind": "newton", "tolerance": 1e-11},
    "derivatives": ["tip", "way", "girth", "turn", "volume"],
}


def test_derivatives_are_those_of_finite_differences() -> None:
    """Central differences of equilibria, in a wrinkled state; load, pressure and the thickness of both fabrics."""
    scene = Scene.model_validate(TUBE)
    work = Analysis(build_model(scene, build_mesh(scene)))
    *_, step = work.steps()
    assert work.outcome == "finished"
    assert step.elements.count()["wrinkled"] > 10
    course = Course(*[LoadState.of(pressure={"inside": 0.035}, load={"tip": 10.0})] * 2)

    def probes_at(state: LoadState) -> dict[str, float]:
        work.system.set_displacement(step.displacement)
        assert work.equilibrium.step(course.start, state, None).reached == 1.0
        record = SolveRecord(converged=False, reason="", iterations=0, residual=0.0, seconds=0.0, method="")
        return work.measure.step(0, scene.stages[1], 1, Course(state, state), 1.0, record, 0, 0.0).probes

    def with_thickness(number: int) -> Callable[[float], dict[str, float]]:
        def probes(share: float) -> dict[str, float]:
            work.system.scale_thickness(number, share)
            values = probes_at(course.start)
            work.system.scale_thickness(number, 1.0)
            return values

        return probes

    ways: dict[str, tuple[float, Callable[[float], dict[str, float]]]] = {
        "load.tip": (
            10.0,
            lambda share: probes_at(LoadState.of(pressure={"inside": 0.035}, load={"tip": 10.0 * share})),
        ),
        "pressure.inside": (
            0.035,
            lambda share: probes_at(LoadState.of(pressure={"inside": 0.035 * share}, load={"tip": 10.0})),
        ),
        "thickness.wall": (0.1, with_thickness(0)),
        "thickness.cap_end": (0.3, with_thickness(1)),
    }
    for parameter, (value, probes) in ways.items():
        above, below = probes(1.0 + 1e-4), probes(1.0 - 1e-4)
        for probe in TUBE["derivatives"]:
            difference = (above[probe] - below[probe]) / (2e-4 * value)
            largest = abs(step.probes[probe]) / value
            # Differences of second order and the solver's 1e-11; derivatives near zero are compared with the probe's own size.
            assert step.derivatives[probe][parameter] == pytest.approx(difference, rel=1e-4, abs=1e-6 * largest), (
                probe,
                parameter,
            )


def test_what_cannot_be_differentiated_is_refused() -> None:
    """With the kinds that can."""
    probes = TUBE["probes"] | {"peak": {"kind": "stress"}}
    with pytest.raises(
        ValueError, match=r"derivatives\[1\]: probe 'peak' is of kind 'stress'; derivatives exist for displace"
    ):
        Scene.model_validate(TUBE | {"probes": probes, "derivatives": ["peak"]})
    with pytest.raises(
        ValueError, match=r"fabrics\.wall\.density is missing \(or mass_per_area\): modes\.kind = 'vibration' needs it"
    ):
        Scene.model_validate(TUBE | {"modes": {"kind": "vibration"}})
    with pytest.raises(ValueError, match=r"need the tangent of solver\.kind"):
        Scene.model_validate(TUBE | {"solver": {"kind": "relaxation"}})
