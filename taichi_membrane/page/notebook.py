"""A run's page inside a notebook, in a frame that can reach neither the notebook nor a network."""

from __future__ import annotations

from dataclasses import dataclass, field
from html import escape

from taichi_membrane.errors import InputError
from taichi_membrane.page.document import page
from taichi_membrane.simulation.results import RunResult

LIMIT = 20.0  # MB; a notebook keeps all of the page in its file, and editors open files of tens of MB slowly


@dataclass(frozen=True)
class Frame:
    """What a notebook shows for a run's page, ``height`` pixels high."""

    html: str = field(repr=False)
    height: int

    def _repr_html_(self) -> str:
        return (
            f'<iframe sandbox="allow-scripts" srcdoc="{escape(self.html)}" title="Run" '
            f'style="width: 100%; height: {self.height}px; border: 0"></iframe>'
        )


def show(result: RunResult, *, height: int = 900, limit: float = LIMIT) -> Frame:
    """The page of a run, as the last value of a notebook's cell.

    :param height: of the frame, in pixels.
    :param limit: in MB, of what the notebook has to keep.
    :raises InputError: the run has no load steps; its page is larger than the limit.
    """
    frame = Frame(page(result), height)
    size = len(frame._repr_html_().encode("utf-8")) / 1e6
    if size > limit:
        raise InputError(
            f"show: the page has {size:.1f} MB, above limit = {limit:g}, and a notebook would keep all of it; raise the limit, or "
            "run with out and open the page that 'taichi-membrane report' writes"
        )
    return frame
