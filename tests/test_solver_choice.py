"""Where Newton cannot work: the hybrid relaxes alone and says why, what insists on Newton is refused with both numbers."""

from __future__ import annotations

from typing import Any

import pytest

from taichi_membrane.errors import InputError
from taichi_membrane.execution.run import run
from taichi_membrane.scene import Scene
from taichi_membrane.simulation.model import Model, build_mesh, build_model
from taichi_membrane.simulation.solver_choice import SolverChoice, chosen_solver

pytestmark = pytest.mark.usefixtures("runtime_cpu")

STAGE = {"name": "inflate", "pressure": 0.01}


def scene(*, law: str = "tension_field", stage: dict[str, Any] = STAGE, **solver: Any) -> Scene:
    """A small square film under pressure."""
    return Scene.model_validate(
        {
            "name": "film",
            "units": {"length": "m", "force": "N"},
            "mesh": {"shape": "panel", "width": 1.0, "height": 1.0, "along_x": 4, "along_y": 4},
            "fabric": {"E": 100.0, "nu": 0.3, "thickness": 0.01, "law": law, "prestress": [1.0, 1.0, 0.0], "warp": [1, 0, 0]},
            "supports": [{"group": "boundary", "hold": "xyz"}],
            "stages": [stage],
            "solver": solver,
        }
    )  # fmt: skip


def model(**changes: Any) -> Model:
    """The film's model."""
    film = scene(**changes)
    return build_model(film, build_mesh(film))


@pytest.mark.parametrize("kind", ["hybrid", "newton", "relaxation"])
def test_the_scenes_own_solver_where_it_works(kind: str) -> None:
    """Memory for a film of 25 nodes there is; relaxation needs none."""
    assert chosen_solver(model(kind=kind)) == SolverChoice(kind)
    assert chosen_solver(model(kind="relaxation", memory=1e-9)) == SolverChoice("relaxation")


def test_the_hybrid_relaxes_alone_and_says_why() -> None:
    """A border that the factor just passes, and just does not; and a law without a tangent."""
    needed = model().structure.elimination.memory() / 2**30
    assert chosen_solver(model(memory=1.01 * needed)).kind == "hybrid"
    short = chosen_solver(model(memory=0.99 * needed))
    assert short.kind == "relaxation"
    assert f"{needed:.3g} GiB, and it may take {0.99 * needed:.3g} GiB" in short.reason
    assert "'clip' has no energy" in chosen_solver(model(law="clip")).reason
    result = run(scene(memory=1e-9))
    assert result.converged
    assert result.steps[0].solver == "relaxation"
    assert result.provenance["solver"] == "relaxation"
    assert "takes" in result.provenance["solver_reason"]


def test_what_insists_on_newton_is_refused() -> None:
    """Newton alone, and a path by arc length."""
    with pytest.raises(InputError, match=r"solver\.kind = 'newton': factorising the tangent of 25 nodes takes .* GiB"):
        chosen_solver(model(kind="newton", memory=1e-9))
    with pytest.raises(InputError, match=r"stages\.inflate\.control = 'arc_length' needs Newton: the law 'clip'"):
        chosen_solver(model(law="clip", stage={**STAGE, "control": "arc_length"}))
