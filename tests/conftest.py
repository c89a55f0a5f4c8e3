"""One Taichi runtime serves the whole test process: a second one would destroy the fields of the first."""

from __future__ import annotations

import pytest

from taichi_membrane.device import runtime


@pytest.fixture(scope="session")
def runtime_cpu() -> runtime.Runtime:
    """The CPU runtime in double precision, on all cores."""
    return runtime.start(arch="cpu", precision="f64")
