"""Names with a closed set of values, shared by scenes, solvers and pictures."""

from __future__ import annotations

from typing import Literal

Arch = Literal["cpu", "gpu", "cuda", "vulkan", "metal", "opengl"]
Precision = Literal["f64", "f32"]
WrinklingLaw = Literal["none", "clip", "tension_field"]
SideStrain = Literal["engineering", "green"]

TAUT, WRINKLED, SLACK = 0, 1, 2
STATE_NAMES = ("taut", "wrinkled", "slack")

# How a run ended: all stages done; stopped at the largest stable load; a stage that should have met that load did not; a stage
# along the path took all its steps and did not come to its loads; stopped without equilibrium; stopped from outside.
Outcome = Literal["finished", "collapse", "no collapse", "steps used up", "not converged", "interrupted"]

# Which load steps of a run are solved again on a finer mesh.
EstimatedSteps = Literal["", "last", "all"]
# What became of a load case: its loads are reached in a state that is stable, as far as that is told; the structure collapses
# before; no equilibrium was found; the state is unstable; its stage did not come to its end; the run was stopped before.
Verdict = Literal["reached", "collapse", "not converged", "unstable", "not started", "interrupted"]
# What became of refining a mesh: the estimate of the error meets the tolerance; it does, but layers are not resolved, which it
# tells nothing of; the rounds, or the elements, are used up; the error could not be estimated on the last mesh; the state was not
# found on a finer one; the run did not come to its end, or ended in another state than that which the mesh was refined for.
AdaptVerdict = Literal[
    "reached",
    "layers not resolved",
    "rounds used up",
    "elements used up",
    "error not known",
    "state lost",
    "not run to its end",
    "another state",
]
