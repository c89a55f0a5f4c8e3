"""One Taichi runtime serves the whole test process: a second one would destroy the fields of the first."""

from __future__ import annotations

import signal

import pytest

from taichi_membrane.device import runtime

# A process that a shell started in the background ignores Ctrl-C, and so would those that tests start and interrupt.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session")
def runtime_cpu() -> runtime.Runtime:
    """The CPU runtime in double precision, on all cores."""
    return runtime.start(arch="cpu", precision="f64")
