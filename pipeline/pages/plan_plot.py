"""Plan views as SVG text: east to the right, north up, a metre as long one way as the other."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from automap.records import FloatArray, IntArray
from pipeline.pages.section import Plot
from pipeline.pages.svg_plot import (
    BOTTOM,
    LEFT,
    RIGHT,
    TOP,
    WIDTH,
    Axis,
    Series,
    dots,
    grid,
    opening,
    thin_dots,
)

HEIGHT = 320
MARGIN = 0.04
MOST_DOTS = 1500
LEAST_SPAN_M = 0.1
"""A vehicle at rest shows what its fixes scatter by, not rounding."""


def draw_plan(title: str, series: Sequence[Series]) -> list[Plot]:
    """A plan view as a list of one, or an empty list where there is nothing to draw.

    ``series`` lines and dots whose ``x`` [n] are metres east and ``y`` [n] metres north; lines may
    cross themselves.
    """
    shown = [_finite(s) for s in series]
    shown = [s for s in shown if len(s.x)]
    if not shown:
        return []
    x_axis, y_axis = _axes(shown)
    parts = [opening(title, HEIGHT), *grid(x_axis, y_axis, "east, m", "north, m")]
    parts += [_drawn(s, x_axis, y_axis) for s in shown]
    return [Plot(title, "".join([*parts, "</svg>"]), tuple((s.label, s.css) for s in shown))]


def _finite(series: Series) -> Series:
    good = np.isfinite(series.x) & np.isfinite(series.y)
    return Series(series.label, series.x[good], series.y[good], series.kind, series.colour)


def _axes(series: Sequence[Series]) -> tuple[Axis, Axis]:
    """Axes of one scale that show everything, in the middle of the drawing."""
    x = np.concatenate([s.x for s in series])
    y = np.concatenate([s.y for s in series])
    wide, high = WIDTH - RIGHT - LEFT, HEIGHT - BOTTOM - TOP
    metres = max(float(np.ptp(x)) / wide, float(np.ptp(y)) / high, LEAST_SPAN_M / wide)
    metres *= 1.0 + 2.0 * MARGIN
    east, north = (0.5 * float(v.min() + v.max()) for v in (x, y))
    half_e, half_n = 0.5 * metres * wide, 0.5 * metres * high
    return (
        Axis(east - half_e, east + half_e, LEFT, WIDTH - RIGHT),
        Axis(north - half_n, north + half_n, HEIGHT - BOTTOM, TOP),
    )


def _drawn(series: Series, x_axis: Axis, y_axis: Axis) -> str:
    x, y = x_axis(series.x), y_axis(series.y)
    if series.kind == "dots":
        rows = thin_dots(len(x), MOST_DOTS)
        return dots(x[rows], y[rows], series.css)
    rows = _pixels_apart(x, y)
    path = "L".join(f"{a:.1f} {b:.1f}" for a, b in zip(x[rows], y[rows], strict=True))
    return f'<path class="l {series.css}" d="M{path}"/>'


def _pixels_apart(x: FloatArray, y: FloatArray) -> IntArray:
    """Rows of a line, half a pixel along it and more from one to the next: it looks as the whole
    does."""
    along = np.cumsum(np.hypot(np.diff(x, prepend=x[0]), np.diff(y, prepend=y[0])))
    _, rows = np.unique(np.floor(2.0 * along), return_index=True)
    return np.union1d(rows, [len(x) - 1]).astype(np.int64)
