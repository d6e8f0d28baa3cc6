"""The path of the held-out drive under the old and the new model: plan view, what differs, and what
each effect costs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from automap.earth import metres_per_radian
from automap.fusion.layout import HAS_POS_H
from automap.gap.costs import HeldPath, Moved, cost_between, held_path, moved
from automap.records import FloatArray
from pipeline.gap.sizes import about
from pipeline.gap.words import LEAST_M
from pipeline.pages.plan_plot import draw_plan
from pipeline.pages.section import Figure, Plot, Section, draw_over_time
from pipeline.pages.svg_plot import Series

if TYPE_CHECKING:
    from automap.gap import GapResult
    from automap.gap.fit import Fit

CLOSE_S = 20.0
"""The close view shows no more before and after the instant at which the paths are furthest apart:
a street may be driven twice."""
CLOSE_UP = 8.0
"""It reaches so many times their distance to all sides, so that both lines can be seen."""
LEAST_VIEW_M = 5.0
EDGE_S = 10.0
"""At its ends a path hangs on few fixes; the close view looks elsewhere where there is a middle."""


@dataclass(frozen=True)
class _Plane:
    """Metres per radian about a place, for plan views."""

    lat: float
    lon: float
    north: float
    east: float

    def __call__(self, lat: FloatArray, lon: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Metres east and north [n] of the place."""
        return (lon - self.lon) * self.east, (lat - self.lat) * self.north


def path_plots(before: Fit, after: Fit) -> list[Plot]:
    """The whole drive and the place where the paths differ most from above, with the receiver's
    fixes, and how far the paths are apart along time."""
    old, new = held_path(before), held_path(after)
    known = np.isfinite(new.pos).all(axis=1)
    if not known.any():
        return []
    lat, lon, height = new.pos[known][0]
    north, east = metres_per_radian(lat, height)
    plane = _Plane(float(lat), float(lon), float(north), float(east))
    apart = moved(new, old)
    plots = _plan("the held-out drive from above", plane, old, new, after, np.inf, 0.0, np.inf)
    if len(apart.t):
        inner = np.abs(apart.t - 0.5 * (apart.t[0] + apart.t[-1]))
        middle = inner <= max(0.5 * float(np.ptp(apart.t)) - EDGE_S, 0.0)
        level = np.where(middle, apart.level, 0.0) if middle.any() else apart.level
        row = int(np.argmax(level))
        at, reach = float(apart.t[row]), max(CLOSE_UP * float(level[row]), LEAST_VIEW_M)
        title = f"where the paths are furthest apart, {at:.0f} s into the held-out data"
        plots += _plan(title, plane, old, new, after, CLOSE_S, at, reach)
    return plots + _differences(apart)


def _plan(
    title: str,
    plane: _Plane,
    old: HeldPath,
    new: HeldPath,
    fit: Fit,
    within_s: float,
    at_s: float,
    reach_m: float,
) -> list[Plot]:
    """Paths and fixes within seconds of ``at_s`` and metres of where the vehicle then is."""
    fixes = fit.opened.session.fixes
    has = (fixes.flags & HAS_POS_H) > 0
    places = (
        (fixes.t[has], *plane(fixes.values[has, 0], fixes.values[has, 1])),
        (old.t, *plane(old.pos[:, 0], old.pos[:, 1])),
        (new.t, *plane(new.pos[:, 0], new.pos[:, 1])),
    )
    t, east, north = places[-1]
    centre = int(np.argmin(np.abs(t - at_s)))
    shown = []
    for when, e, n in places:
        near = np.maximum(np.abs(e - east[centre]), np.abs(n - north[centre])) <= reach_m
        keep = near & (np.abs(when - at_s) <= within_s)
        shown.append((e[keep], n[keep]))
    dots = [Series("fixes", *shown[0], "dots", 1)]
    lines = [
        Series("old model", *shown[1], "line", "bad"),
        Series("new model", *shown[2], "line", 0),
    ]
    # many dots close together would hide the paths, few far apart would lie hidden under them
    return draw_plan(title, [*dots, *lines] if np.isinf(reach_m) else [*lines, *dots])


def _differences(apart: Moved) -> list[Plot]:
    if not len(apart.t):
        return []
    end = float(apart.t[-1])
    turned = np.degrees(apart.heading)
    kinds = (
        ("old path off the new one, level", apart.level, "m"),
        ("old path off the new one, height", apart.height, "m, up"),
        ("old path off the new one, heading", turned, "deg, clockwise"),
    )
    plots = []
    for title, values, unit in kinds:
        line = [Series("", apart.t, values, "line", 0)]
        plots += draw_over_time(title, line, unit, end, include=(0.0,))
    return plots


def path_figure(result: GapResult) -> Figure:
    """How far the held-out path moves, as a key figure."""
    before, after = (
        [held_path(fit) for fit in fits] if result.findings or result.formulas else []
        for fits in result.held_out
    )
    if not before or not after:
        return Figure("0 m", "the held-out path moves", "no effect is missing")
    cost = cost_between(after, before)
    largest = about(cost.level.largest, "m", LEAST_M)
    rms = about(cost.level.rms, "m", LEAST_M)
    return Figure(rms, "the held-out path moves", f"level, rms; at most {largest}")


def path_section(result: GapResult) -> Section:
    """The first held-out drive under both models, from above and along time."""
    before, after = result.held_out
    if not before or not after:
        return Section(absent="No held-out data.")
    sentence = (
        "The smoothed path of the IMU under the old and the new model at the same stamps, and the "
        "fixes of the antenna. Neither model was fitted to these data. What differs "
        "along the road, as with a delay, shows over time only."
    )
    return Section([sentence], path_plots(before[0], after[0]))


def cost_section(result: GapResult) -> Section:
    """What each effect costs on held-out data, as a table."""
    names = ("level", "height", "heading", "tilt")
    header = ("effect", *(f"{n}, {'m' if n in names[:2] else '°'}" for n in names))
    section = Section(header=header)
    if not result.costs:
        section.absent = "Nothing was found that would cost anything."
        return section
    section.sentences.append(
        "How far the smoothed held-out path is off where one effect is left out of the new model: "
        "root mean square, and at most. Noise is compared with noise as stated."
    )
    for name, cost in result.costs.items():
        metres = [f"{e.rms:.3f}, {e.largest:.3f}" for e in (cost.level, cost.height)]
        angles = [np.degrees([e.rms, e.largest]) for e in (cost.heading, cost.tilt)]
        section.rows.append((name, *metres, *(f"{a:.3f}, {b:.3f}" for a, b in angles)))
    return section
