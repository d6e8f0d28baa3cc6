"""Small plots over time as SVG text that takes its colours from the page.

Long series are drawn as the smallest and largest value of each pixel column, so that a plot
looks as the full data would and its size does not grow with the drive.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from html import escape
from typing import Literal

import numpy as np

from automap.records import FloatArray, IntArray

WIDTH, HEIGHT = 400, 190
LEFT, RIGHT, TOP, BOTTOM = 64, 8, 8, 32
"""Seven digits of a tick and the axis's label find room at the left."""
COLUMNS = 300
LINE_ROWS = 200_000
"""Rows of a line that are looked at, hundreds for each pixel column."""


@dataclass(frozen=True)
class Series:
    """One series of a plot: ``x`` [n], ``y`` [n] and, for a band, ``upper`` [n].

    ``colour`` is the number of the page's plot colour, or the name of a fixed role.
    """

    label: str
    x: FloatArray
    y: FloatArray
    kind: Literal["line", "dots", "band"] = "line"
    colour: int | Literal["bad", "quiet"] = 0
    upper: FloatArray | None = None

    @property
    def css(self) -> str:
        """The page's class of its colour."""
        return f"c{self.colour}" if isinstance(self.colour, int) else self.colour


@dataclass(frozen=True)
class Axis:
    """A linear or logarithmic map from values to pixels."""

    low: float
    high: float
    start: float
    end: float
    log: bool = False

    def __call__(self, values: FloatArray) -> FloatArray:
        low, high = self.low, self.high
        if self.log:
            low, high = np.log10(low), np.log10(high)
            values = np.log10(np.maximum(values, self.low))
        part = (np.clip(values, min(low, high), max(low, high)) - low) / (high - low)
        return np.asarray(self.start + part * (self.end - self.start))


def thin_line(series: Series) -> Series:
    """The smallest and the largest of each few rows of a long line, which is drawn alike."""
    n = len(series.y)
    step = 2 * n // LINE_ROWS
    if series.kind != "line" or step < 3:
        return series
    whole = n // step * step
    blocks = series.y[:whole].reshape(-1, step)
    known = np.isfinite(blocks)
    first = np.arange(0, whole, step)
    low = first + np.where(known, blocks, np.inf).argmin(axis=1)
    high = first + np.where(known, blocks, -np.inf).argmax(axis=1)
    rows = np.unique(np.concatenate([low, high, np.arange(whole, n)]))
    return replace(series, x=series.x[rows], y=series.y[rows])


def time_unit(span_s: float) -> tuple[float, str]:
    """Seconds in the unit that suits a span, and the unit's name."""
    if span_s > 3 * 3600:
        return 3600.0, "h"
    return (60.0, "min") if span_s > 240 else (1.0, "s")


def plot(
    series: Sequence[Series],
    title: str,
    y_label: str,
    x_label: str,
    log: bool = False,
    include: Sequence[float] = (),
) -> str:
    """SVG of the series; an empty text when none has a finite value.

    ``include`` are values that the vertical axis must show. With ``log`` the vertical axis
    is logarithmic and values not above zero lie on its floor.
    """
    drawn = [s for s in map(_finite, series) if len(s.x)]
    if not drawn:
        return ""
    x_axis = _x_axis(drawn)
    y_axis = _y_axis(drawn, include, log)
    parts = [
        opening(title, HEIGHT),
        *grid(x_axis, y_axis, x_label, y_label),
    ]
    parts += [_draw(s, x_axis, y_axis) for s in drawn]
    parts.append("</svg>")
    return "".join(parts)


def opening(title: str, height: int) -> str:
    """The start of a plot of that height."""
    return (
        f'<svg class="plot" viewBox="0 0 {WIDTH} {height}" role="img" '
        f'aria-label="{escape(title, quote=True)}"><title>{escape(title)}</title>'
    )


def _finite(series: Series) -> Series:
    good = np.isfinite(series.x) & np.isfinite(series.y)
    if series.upper is not None:
        good &= np.isfinite(series.upper)
    upper = None if series.upper is None else series.upper[good]
    return Series(series.label, series.x[good], series.y[good], series.kind, series.colour, upper)


def _x_axis(series: Sequence[Series]) -> Axis:
    low = min(float(s.x.min()) for s in series)
    high = max(float(s.x.max()) for s in series)
    if high - low < _least_span(low, high):
        high = low + max(abs(low), 1.0)
    return Axis(low, high, LEFT, WIDTH - RIGHT)


def _least_span(low: float, high: float) -> float:
    """Spans below this cannot be told from rounding."""
    return max(1e-9 * max(abs(high), abs(low)), 1e-30)


def _y_axis(series: Sequence[Series], include: Sequence[float], log: bool) -> Axis:
    values = [s.y for s in series] + [s.upper for s in series if s.upper is not None]
    everything = np.concatenate([*values, np.asarray(include, np.float64)])
    if log:
        high = max(float(everything.max()), 1e-30)
        # more than eight decades would show nothing
        low = float(everything[everything >= 1e-8 * high].min(initial=high))
        low, high = 10 ** np.floor(np.log10(low)), 10 ** np.ceil(np.log10(high))
        return Axis(low, high if high > low else 10 * low, HEIGHT - BOTTOM, TOP, log=True)
    low, high = float(everything.min()), float(everything.max())
    if high - low < _least_span(low, high):
        half = 0.5 * max(abs(low), abs(high))
        half = half if half > 1e-30 else 0.5
        low, high = low - half, high + half
    margin = 0.04 * (high - low)
    floor = low if low == 0.0 else low - margin
    return Axis(floor, high + margin, HEIGHT - BOTTOM, TOP)


def ticks(low: float, high: float, count: int = 5) -> FloatArray:
    """Round values in [low, high], about ``count`` of them, steps of 1, 2 or 5."""
    raw = (high - low) / count
    power = 10.0 ** np.floor(np.log10(raw))
    step = power * next(m for m in (1, 2, 5, 10) if m * power >= raw * 0.7)
    return np.asarray(np.arange(np.ceil(low / step), np.floor(high / step) + 1) * step)


def _log_ticks(low: float, high: float) -> FloatArray:
    first, last = round(np.log10(low)), round(np.log10(high))
    step = max(1, (last - first) // 5)
    return np.asarray(10.0 ** np.arange(first, last + 1, step))


def tick_label(value: float, step: float) -> str:
    """A tick's value with the digits its step needs."""
    if value == 0 or abs(value) < 1e-9 * step:
        return "0"
    if not 1e-3 <= step < 1e5:
        digits = max(0, int(np.floor(np.log10(abs(value))) - np.floor(np.log10(step))))
        mantissa, exponent = f"{value:.{digits}e}".split("e")
        return f"{mantissa}e{int(exponent)}"
    return f"{value:.{max(0, -int(np.floor(np.log10(step) + 1e-9)))}f}"


def grid(x_axis: Axis, y_axis: Axis, x_label: str, y_label: str) -> list[str]:
    """Lines, ticks and labels of a plot whose axes end where the drawing does."""
    parts: list[str] = []
    x_ticks = ticks(x_axis.low, x_axis.high, 6)
    y_ticks = (
        _log_ticks(y_axis.low, y_axis.high) if y_axis.log else ticks(y_axis.low, y_axis.high, 4)
    )
    bottom, right = round(y_axis.start), round(x_axis.end)
    y_step = float(y_ticks[1] - y_ticks[0]) if len(y_ticks) > 1 else 1.0
    for value, y in zip(y_ticks.tolist(), y_axis(y_ticks).tolist(), strict=True):
        label = f"{value:g}" if y_axis.log else tick_label(value, y_step)
        parts.append(f'<path class="g" d="M{LEFT} {y:.1f}H{right}"/>')
        parts.append(f'<text class="e" x="{LEFT - 6}" y="{y + 3.5:.1f}">{label}</text>')
    x_step = float(x_ticks[1] - x_ticks[0]) if len(x_ticks) > 1 else 1.0
    for value, x in zip(x_ticks.tolist(), x_axis(x_ticks).tolist(), strict=True):
        parts.append(f'<path class="g" d="M{x:.1f} {TOP}V{bottom}"/>')
        label = tick_label(value, x_step)
        parts.append(f'<text class="m" x="{x:.1f}" y="{bottom + 14}">{label}</text>')
    parts.append(f'<path class="a" d="M{LEFT} {TOP}V{bottom}H{right}"/>')
    parts.append(f'<text class="e" x="{right}" y="{bottom + BOTTOM - 4}">{escape(x_label)}</text>')
    middle = (TOP + bottom) / 2
    parts.append(
        f'<text class="m" transform="translate(12 {middle:.0f}) rotate(-90)">{escape(y_label)}'
        "</text>"
    )
    return parts


def _draw(series: Series, x_axis: Axis, y_axis: Axis) -> str:
    css = series.css
    if series.kind == "dots":
        return dots(x_axis(series.x), y_axis(series.y), css)
    if series.kind == "band" and series.upper is not None:
        return "".join(_band(series.x, series.y, series.upper, x_axis, y_axis, css))
    path = "".join(_line(series.x, series.y, x_axis, y_axis))
    return f'<path class="l {css}" d="{path}"/>'


def dots(x: FloatArray, y: FloatArray, css: str) -> str:
    """Dots at pixels [n]."""
    # a dot is a line of no length with round ends: a tenth of the size of circles
    spots = "".join(f"M{a:.1f} {b:.1f}h0" for a, b in zip(x.tolist(), y.tolist(), strict=True))
    return f'<path class="d {css}" d="{spots}"/>'


def _runs(x: FloatArray) -> list[slice]:
    """Pieces of a series between holes much longer than its usual step."""
    steps = np.diff(x)
    if len(steps) == 0:
        return [slice(0, len(x))]
    hole = max(20.0 * float(np.median(steps)), (float(x[-1]) - float(x[0])) / 100.0)
    cuts = np.flatnonzero(steps > hole) + 1
    edges = [0, *cuts.tolist(), len(x)]
    return [slice(a, b) for a, b in itertools.pairwise(edges)]


def _columns(x_pixels: FloatArray) -> IntArray:
    """First row [k] of each pixel column that holds a row."""
    column = np.floor(x_pixels * (COLUMNS / WIDTH)).astype(np.int64)
    return np.flatnonzero(np.diff(column, prepend=column[0] - 1) != 0)


def _line(x: FloatArray, y: FloatArray, x_axis: Axis, y_axis: Axis) -> list[str]:
    parts = []
    for run in _runs(x):
        px, py = x_axis(x[run]), y_axis(y[run])
        if len(px) > 3 * COLUMNS:
            starts = _columns(px)
            low, high = np.minimum.reduceat(py, starts), np.maximum.reduceat(py, starts)
            px = np.repeat(px[starts], 2)
            py = np.column_stack([low, high]).ravel()
        points = [f"{a:.1f} {b:.1f}" for a, b in zip(px.tolist(), py.tolist(), strict=True)]
        parts.append("M" + "L".join(points) + ("h0" if len(points) == 1 else ""))
    return parts


def _band(
    x: FloatArray, lower: FloatArray, upper: FloatArray, x_axis: Axis, y_axis: Axis, css: str
) -> list[str]:
    parts = []
    for run in _runs(x):
        px, top, bottom = x_axis(x[run]), y_axis(upper[run]), y_axis(lower[run])
        if len(px) > COLUMNS:
            starts = _columns(px)
            # pixels grow downwards
            top, bottom = np.minimum.reduceat(top, starts), np.maximum.reduceat(bottom, starts)
            px = px[starts]
        there = [f"{a:.1f} {b:.1f}" for a, b in zip(px.tolist(), top.tolist(), strict=True)]
        back = [f"{a:.1f} {b:.1f}" for a, b in zip(px.tolist(), bottom.tolist(), strict=True)]
        parts.append(f'<path class="b {css}" d="M{"L".join(there + back[::-1])}Z"/>')
    return parts


def thin_dots(size: int, limit: int) -> IntArray:
    """Rows of every k-th of ``size`` dots so that at most ``limit`` remain."""
    return np.arange(0, size, max(1, -(-size // limit)), dtype=np.int64)
