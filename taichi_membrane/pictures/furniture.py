"""What stands around the surface: title, legend, colour bar, scale bar, axes, load arrows, supports (matplotlib).

Everything is placed in pixels of the picture, y downwards, with sizes given for 1600 x 1000 and scaled together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import matplotlib.patheffects as effects
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backend_bases import RendererBase
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch, Polygon, Rectangle
from matplotlib.text import Text
from matplotlib.ticker import MaxNLocator
from matplotlib.transforms import Bbox
from numpy.typing import NDArray

from taichi_membrane.errors import InputError
from taichi_membrane.names import STATE_NAMES
from taichi_membrane.pictures.camera import CORNER_BOXES, PAGE_MARGIN, Camera, furniture_scale

DPI = 100
INK, GREY = "#16181d", "#5a5f69"
LOAD, SUPPORT, OUTLINE, OBSTACLE = "#c2185b", "#00695c", "#4a4f58", "#5a5f69"
SLACK_CABLE = (0.45, 0.45, 0.45)
AXIS_COLOURS = ("#c0392b", "#1e8449", "#1f5fb0")
TITLE, TEXT, SMALL = 29.0, 21.0, 18.0  # pixels


@dataclass(frozen=True, kw_only=True)
class ColourBar:
    """Colours (k, 3) from ``low`` to ``high``; ``below``, ``above``: some of the surface lies outside and is drawn as the end."""

    label: str
    low: float
    high: float
    ramp: NDArray[np.float32]
    below: bool
    above: bool


class _Backdrop(Artist):
    """Pixels copied as they are; matplotlib's own images are resampled, which costs more than the whole raster."""

    def __init__(self, colour: NDArray[np.uint8]) -> None:
        super().__init__()
        self.set_zorder(0)
        opaque = np.full((*colour.shape[:2], 1), 255, np.uint8)
        self._rgba = np.concatenate((colour, opaque), axis=2)

    def draw(self, renderer: RendererBase) -> None:
        """Called by matplotlib."""
        context = renderer.new_gc()
        renderer.draw_image(context, 0, 0, self._rgba[::-1])
        context.restore()


class Page:
    """One picture under construction: a background of pixels and vector furniture over it."""

    def __init__(self, background: NDArray[np.uint8], camera: Camera) -> None:
        self.width, self.height = camera.size
        self.camera = camera
        self.unit = furniture_scale(camera.size)
        self.figure = Figure(figsize=(self.width / DPI, self.height / DPI), dpi=DPI)
        self.canvas = FigureCanvasAgg(self.figure)
        self.figure.add_artist(_Backdrop(background))
        self.axes: Axes = self.figure.add_axes((0.0, 0.0, 1.0, 1.0), zorder=1, facecolor="none")
        self.axes.set(xlim=(0, self.width), ylim=(self.height, 0))
        self.axes.set_axis_off()
        self._taken: list[Bbox] = []  # text that labels must not hit, in pixels with y downwards

    def pixels(self) -> NDArray[np.uint8]:
        """The finished picture, (h, w, 3)."""
        self.canvas.draw()
        return np.asarray(self.canvas.buffer_rgba())[..., :3]

    def points(self, pixels: float) -> float:
        """Matplotlib's points of a length given in pixels at 1600 x 1000."""
        return pixels * self.unit * 72.0 / DPI

    def text(self, x: float, y: float, words: str, *, size: float = TEXT, colour: str = INK, **style: object) -> Text:
        """Text at a pixel position, ``size`` in pixels at 1600 x 1000."""
        return self.axes.text(x, y, words, fontsize=self.points(size), color=colour, **style)  # type: ignore[arg-type]

    def title(self, title: str, subtitle: str) -> None:
        """Title and subtitle in the upper left corner, smaller when they would run into the legend."""
        left, room = PAGE_MARGIN * self.unit, self.width - (CORNER_BOXES["legend"][0] + 1.5 * PAGE_MARGIN) * self.unit
        y = 52.0 * self.unit
        for words, size, colour, weight in ((title, TITLE, INK, "bold"), (subtitle, TEXT, GREY, "normal")):
            text = self.text(left, y, words, size=size, colour=colour, weight=weight, va="center")
            try:
                width = text.get_window_extent(self.canvas.get_renderer()).width
            except ValueError as error:  # mathtext between dollar signs
                raise InputError(f"{words!r} cannot be typeset: {error}") from error
            text.set_fontsize(self.points(size) * min(1.0, (room - left) / max(width, 1.0)))
            self._taken.append(
                Bbox(((left, y - size * self.unit), (left + min(width, room - left), y + size * self.unit)))
            )
            y += 44.0 * self.unit

    def state_legend(self, shares: Sequence[float], palette: NDArray[np.float32]) -> float:
        """States with their share of the area (0..1); returns the y of the next row."""
        left, y = self._legend_left(), 52.0 * self.unit
        self.text(left, y, "membrane state (% of area)", va="center")
        for name, share, colour in zip(STATE_NAMES, shares, palette, strict=True):
            y += 34.0 * self.unit
            box = Rectangle(
                (left, y - 9 * self.unit), 34 * self.unit, 18 * self.unit, facecolor=tuple(colour), edgecolor=INK,
                linewidth=self.points(1.0),
            )  # fmt: skip
            self.axes.add_patch(box)
            percent = "< 0.1" if 0.0 < share < 0.0005 else f"{100.0 * share:.1f}"
            self.text(left + 50 * self.unit, y, f"{name}  ({percent} %)", va="center")
        return y + 34.0 * self.unit

    def colour_bar(self, bar: ColourBar, y: float | None = None) -> float:
        """Horizontal colour bar with label and ticks, in the corner or from a row's y on; returns the y of the next row."""
        left, y = self._legend_left(), 52.0 * self.unit if y is None else y
        width, height = self.width - PAGE_MARGIN * self.unit - left, 22.0 * self.unit
        top = y + 22.0 * self.unit
        self.axes.imshow(
            bar.ramp[None], extent=(left, left + width, top + height, top), aspect="auto", interpolation="nearest"
        )
        self.axes.set(xlim=(0, self.width), ylim=(self.height, 0))
        frame = [(left, top), (left + width, top), (left + width, top + height), (left, top + height)]
        for outside, x, sign, colour in (
            (bar.below, left, -1, bar.ramp[0]),
            (bar.above, left + width, 1, bar.ramp[-1]),
        ):
            if outside:
                tip = [(x, top), (x + sign * 0.8 * height, top + 0.5 * height), (x, top + height)]
                self.axes.add_patch(Polygon(tip, facecolor=tuple(colour), edgecolor=INK, linewidth=self.points(1.0)))
        self.axes.add_patch(Polygon(frame, fill=False, edgecolor=INK, linewidth=self.points(1.0)))
        ticks, words, factor = _ticks(bar.low, bar.high)
        label = self.text(left, y, f"{bar.label}{factor}", va="center")
        if label.get_window_extent(self.canvas.get_renderer()).width > width:
            label.set(x=left + width, ha="right")
        for tick, word in zip(ticks, words, strict=True):
            x = left + width * (tick - bar.low) / (bar.high - bar.low)
            self.axes.plot([x, x], [top + height, top + height + 6 * self.unit], color=INK, lw=self.points(1.2))
            self.text(x, top + height + 20 * self.unit, word, size=SMALL, ha="center", va="center")
        return top + height + 56.0 * self.unit

    def line_legend(self, y: float, rows: Sequence[tuple[str, dict[str, object]]]) -> None:
        """Rows of a line or marker sample (matplotlib's Line2D properties) and its meaning."""
        left = self._legend_left()
        for words, style in rows:
            x = [left + 17 * self.unit] if "marker" in style else [left, left + 34 * self.unit]
            self.axes.plot(x, [y] * len(x), **style)  # type: ignore[arg-type]
            self.text(left + 50 * self.unit, y, words, va="center")
            y += 34.0 * self.unit
        self._taken.append(Bbox(((left, 0.0), (self.width, y - 17.0 * self.unit))))

    def scale_bar(self, length_unit: str) -> None:
        """A round length in the lower right corner; in perspective it holds at the depth of the centre, and says so."""
        longest = 300.0 * self.unit / self.camera.pixels_per_length
        power = 10.0 ** np.floor(np.log10(longest))
        length = power * max(step for step in (1, 2, 5) if step * power <= longest)
        right, y = self.width - PAGE_MARGIN * self.unit, self.height - 40.0 * self.unit
        left = right - length * self.camera.pixels_per_length
        self.axes.plot([left, right], [y, y], color=INK, lw=self.points(4.5), solid_capstyle="butt")
        label = self.text(
            0.5 * (left + right), y - 20 * self.unit, f"{length:g} {length_unit}", ha="center", va="center"
        )
        if self.camera.projection == "perspective":
            label.set(x=right, ha="right")
            width = label.get_window_extent(self.canvas.get_renderer()).width
            note = self.text(right - width, label.get_position()[1], "at mid-depth  ", size=SMALL, colour=GREY)
            note.set(ha="right", va="center")

    def axis_triad(self) -> None:
        """Directions of x, y, z in the lower left corner; the ones that point away are drawn first."""
        x0, y0 = 100.0 * self.unit, self.height - 92.0 * self.unit
        for k in np.argsort(self.camera.axes[2]):
            right, up, towards = self.camera.axes[:, k]
            x, y = x0 + 58.0 * self.unit * right, y0 - 58.0 * self.unit * up
            length = float(np.hypot(right, up))
            if length > 0.35:
                self.arrow((x0, y0), (x, y), colour=AXIS_COLOURS[k], width=2.6, head=min(11.0, 26.0 * length))
                gap = 17.0 * self.unit / length
                x, y = x + gap * right, y - gap * up
            else:  # along the line of sight: a dot when it points to the viewer, a ring when away
                fill = AXIS_COLOURS[k] if towards > 0 else "white"
                self.axes.plot(x0, y0, "o", ms=self.points(10.0), mfc=fill, mec=AXIS_COLOURS[k], mew=self.points(2.0))
                x, y = x0 - 18.0 * self.unit, y0 + 18.0 * self.unit
            self.text(x, y, "xyz"[k], colour=AXIS_COLOURS[k], style="italic", ha="center", va="center")

    def arrow(
        self,
        tail: Sequence[float] | NDArray[np.float64],
        tip: Sequence[float] | NDArray[np.float64],
        *,
        colour: str,
        width: float,
        head: float,
    ) -> None:
        """A straight arrow with a filled head and a thin white edge, so that it stays readable on any ground."""
        outline = effects.withStroke(linewidth=self.points(width + 3.0), foreground="white")
        style = f"-|>,head_length={self.points(head):.3f},head_width={self.points(0.42 * head):.3f}"
        self.axes.add_patch(
            FancyArrowPatch(
                tuple(tail), tuple(tip), arrowstyle=style, mutation_scale=1.0, shrinkA=0, shrinkB=0, color=colour,
                joinstyle="miter", linewidth=self.points(width), path_effects=[outline], zorder=6,
            )
        )  # fmt: skip

    def lines(
        self,
        lines: Sequence[NDArray[np.float64]],
        *,
        colours: Sequence[str] | str | NDArray[np.float64],
        width: float,
        **style: object,
    ) -> None:
        """Polylines (k, 2) in pixels; ``width`` in pixels at 1600 x 1000."""
        self.axes.add_collection(
            LineCollection(list(lines), colors=colours, linewidths=self.points(width), **style), autolim=False  # type: ignore[arg-type]
        )  # fmt: skip

    def dashed(self, lines: Sequence[NDArray[np.float64]], *, colour: str) -> None:
        """Dashed polylines on a pale band, so that they can be followed over light and dark ground."""
        width, dash, gap = 1.8, 9.0, 7.0
        self.lines(lines, colours="white", width=width + 2.0, alpha=0.45)
        self.lines(lines, colours=colour, width=width, linestyles=[(0, (dash / width, gap / width))], capstyle="butt")

    def arrow_end_on(self, at: NDArray[np.float64], *, towards: bool, colour: str) -> None:
        """An arrow along the line of sight: its tip (a dot in a ring) or its feathers (a cross in a ring)."""
        ring = {"mfc": "white", "mec": colour, "mew": self.points(2.6), "zorder": 6}
        self.axes.plot(*at, "o", ms=self.points(26.0), **ring)  # type: ignore[arg-type]
        ring["mfc"] = colour
        self.axes.plot(*at, "o" if towards else "x", ms=self.points(7.0 if towards else 13.0), **ring)  # type: ignore[arg-type]

    def label_beyond(
        self, places: Sequence[tuple[NDArray[np.float64], NDArray[np.float64]]], words: str, *, colour: str
    ) -> None:
        """Text at the free end of an arrow.

        ``places`` are alternative positions (free end, loaded end) in order of preference. Taken is the first where the text,
        beyond the end or beside it, is on the page and clear of all other text; if there is none, the first.
        """
        text = self.text(0.0, 0.0, words, colour=colour, ha="center", va="center", zorder=7)
        text.set_path_effects([effects.withStroke(linewidth=self.points(4.0), foreground="white")])
        extent = text.get_window_extent(self.canvas.get_renderer())
        half = 0.5 * np.array((extent.width, extent.height)) + 10.0 * self.unit
        page = np.array((self.width, self.height), np.float64)
        options = []
        for free, loaded in places:
            outwards = free - loaded
            way = outwards / np.hypot(*outwards) if np.any(outwards) else np.array((0.0, -1.6))
            beyond = free + way * (np.min(half / np.abs(way).clip(1e-9)) + 2.0 * self.unit)
            on_page = np.clip(beyond, half, page - half)  # pushed back a little it still stands beyond the end
            options.append(on_page if (np.abs(on_page - beyond) < 0.6 * half).all() else beyond)
        for free, _ in places:
            options += [free + np.array((side * (half[0] + 2.0 * self.unit), 0.0)) for side in (1.0, -1.0)]
        spot = next((option for option in options if self._is_free(option, half)), options[0])
        spot = np.clip(spot, half, page - half)
        text.set_position((float(spot[0]), float(spot[1])))
        self._taken.append(Bbox((spot - half, spot + half)))

    def keep_clear(self, start: NDArray[np.float64], end: NDArray[np.float64]) -> None:
        """No label shall stand on the box with these two corners."""
        self._taken.append(Bbox((np.minimum(start, end), np.maximum(start, end))))

    def hits_text(self, start: NDArray[np.float64], end: NDArray[np.float64]) -> bool:
        """Whether the box with these two corners meets anything that is to be kept clear."""
        box = Bbox((np.minimum(start, end), np.maximum(start, end)))
        return any(box.overlaps(other) for other in self._taken)

    def _is_free(self, spot: NDArray[np.float64], half: NDArray[np.float64]) -> bool:
        low, high = spot - half, spot + half
        on_page = low.min() >= 0.0 and high[0] <= self.width and high[1] <= self.height
        return bool(on_page) and not any(Bbox((low, high)).overlaps(other) for other in self._taken)

    def _legend_left(self) -> float:
        return self.width - (CORNER_BOXES["legend"][0] - 18.0) * self.unit


def _ticks(low: float, high: float) -> tuple[NDArray[np.float64], list[str], str]:
    """Round tick values within the range, their labels, and the power of ten taken out of the labels."""
    largest = max(abs(low), abs(high))
    power = int(np.floor(np.log10(largest))) if largest else 0
    power = 0 if -2 <= power < 4 else power
    locator = MaxNLocator(nbins=4, steps=[1, 2, 2.5, 5, 10])
    scaled = np.asarray(locator.tick_values(low / 10.0**power, high / 10.0**power))
    slack = 1e-9 * (high - low) / 10.0**power
    scaled = scaled[(scaled >= low / 10.0**power - slack) & (scaled <= high / 10.0**power + slack)]
    words = [f"{value:.10g}".replace("-", "−") for value in np.round(scaled, 9)]
    return scaled * 10.0**power, words, f"  × $10^{{{power}}}$" if power else ""
