"""Stretches of a drive in which positions err by more than elsewhere: between houses, under trees.

No receiver without corrections knows its reflections, and what it states of its accuracy hardly
changes there. Errors of one size all along, large enough for the worst of it, leave a path to what
velocities and the IMU make of it; errors of their own size there leave it to the good positions.
Told from what fixes do against the path from one window to the next, by a hidden Markov model of
two sizes (L. R. Rabiner, Proceedings of the IEEE 77, 1989).
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from automap.earth import local_ned
from automap.frames import quat_to_matrix
from automap.fusion.layout import HAS_POS_H
from automap.fusion.limits import (
    MOVING_SPEED,
    WORSE_FACTORS,
    WORSE_SHARES,
    WORSE_STAYS,
)
from automap.fusion.measurements.position import quick_factor
from automap.fusion.nodes import FixModel
from automap.fusion.options import FusionOptions
from automap.fusion.passes import Pass
from automap.records import BoolArray, FloatArray, IntArray
from automap.sync.limits import CERTAIN_LEAD_NATS

_USUAL: FloatArray = np.exp2(0.25 * np.arange(-6.0, 3.0))
"""Sizes that are tried for what is usual, over that of the median window."""
_ALONE: FloatArray = np.exp2(0.125 * np.arange(-12.0, 25.0))
"""The same where there is one size alone."""
_WILD = 0.01
"""Share of windows in which positions jump or are wild by any distance (Cauchy's distribution): one
in a hundred, by which what is of one window or two tells no stretch."""
WINDOWS = 0.5
"""Of the time that quick errors last: in it most of one still shows as a step."""
_LEAST_FIXES = 3
"""Of a window, that one wild fix is not its median."""
_WINDOWS_AGAIN = 5
"""In place of one where each fix shows how it errs, by where a stretch begins: a second, in which a
car in town passes a house."""


@dataclass(frozen=True)
class WorseStretches:
    """Positions err by ``times`` what is usual in ``spans``, s from the first sample; ``factor``
    [n] is by how much, of each row of the fixes, 1 where it is as usual; what lasts for minutes
    is larger, too, where errors are ``slow``."""

    times: float
    spans: tuple[tuple[float, float], ...]
    factor: FloatArray
    slow: bool = True

    @property
    def seconds(self) -> float:
        """Of all spans together."""
        return float(sum(b - a for a, b in self.spans))

    @property
    def there(self) -> BoolArray:
        """Which rows [n] of the fixes are more probably in one than not."""
        return np.asarray(self.factor**2 > 0.5 * (1.0 + self.times**2))

    def as_dict(self) -> dict[str, Any]:
        """For a summary."""
        return {"times": self.times, "spans_s": self.spans}

    def text(self) -> str:
        """One sentence for a user."""
        many = f"{len(self.spans)} stretches" if len(self.spans) > 1 else "a stretch"
        return (
            f"positions err by {self.times:.2g} times what is usual in {many}, "
            f"{self.seconds:.0f} s in all, by the way that IMU and velocities show: they were "
            "trusted less there"
        )


def find_worse(last: Pass, window_s: float, rows: int) -> WorseStretches | None:
    """Where positions err by more than for most of the drive, if odds of a million say so.

    ``window_s`` in which their lasting errors show, ``rows`` of the fix table.
    """
    off = _off_path(last)
    if len(off.t) < _LEAST_FIXES:
        return None
    edges, place, way = _windows(off, window_s, _LEAST_FIXES)
    step, speed = _steps(place, way), np.hypot(*way.T)
    # a receiver that stands still repeats itself, which says nothing of how it errs
    fitted = _two_sizes(step, np.isfinite(step).all(axis=1) & (speed > MOVING_SPEED))
    # errors that the receiver's figure holds are the figure's matter
    if fitted is None or fitted[1] < float(np.median(off.stated_sd)):
        return None
    return _stretches(off, edges, fitted, rows)


def find_again(last: Pass, window_s: float, worse: WorseStretches) -> WorseStretches:
    """Where they do by a path that trusted them less in ``worse`` stretches: it does not go along
    with them there, so that each fix shows how it errs and not the steps between windows alone."""
    off = _off_path(last)
    edges, place, way = _windows(off, window_s / _WINDOWS_AGAIN, 1)
    told = np.isfinite(place).all(axis=1) & (np.hypot(*way.T) > MOVING_SPEED)
    fitted = _two_sizes(place, told, [_WINDOWS_AGAIN * stay for stay in WORSE_STAYS])
    return worse if fitted is None else _stretches(off, edges, fitted, len(worse.factor))


@dataclass(frozen=True)
class _OffPath:
    """How far fixes are off a path: at ``t`` [k] s, by ``apart`` [k, 2] m north and east where the
    path's ``velocity`` [k, 2] m/s is, good to ``stated_sd`` [k, 2] m; ``row`` [k] of the fixes."""

    t: FloatArray
    apart: FloatArray
    velocity: FloatArray
    stated_sd: FloatArray
    row: IntArray


def _off_path(last: Pass) -> _OffPath:
    nodes, smooth = last.nodes, last.smooth
    at = np.flatnonzero((nodes.flags & HAS_POS_H) > 0)
    state = smooth.nominal[at]
    # heights are as good as they are: those of fixes may be of another surface
    ref = (float(state[0, 0]), float(state[0, 1]), float(state[0, 2])) if len(at) else (0.0,) * 3
    seen = local_ned(nodes.values[at, 0], nodes.values[at, 1], state[:, 2], ref)
    found = local_ned(state[:, 0], state[:, 1], state[:, 2], ref)
    totals = last.totals()
    arm = np.array([totals.get(f"gnss_lever_arm_{axis}", 0.0) for axis in "xyz"])
    apart = seen - found - quat_to_matrix(state[:, 6:10]) @ arm
    stated = nodes.stated_sd[at, :2]
    return _OffPath(nodes.t[at], apart[:, :2], state[:, 3:5], stated, nodes.fix_row[at])


def _stretches(
    off: _OffPath, edges: FloatArray, fitted: tuple[float, float, FloatArray], rows: int
) -> WorseStretches:
    """Those of which windows between ``edges`` [w + 1] are likely."""
    times, _, worse = fitted
    factor = np.ones(rows)
    window = np.clip(np.searchsorted(edges, off.t, side="right") - 1, 0, len(worse) - 1)
    # variances, by how probable it is
    factor[off.row] = np.sqrt(1.0 + (times**2 - 1.0) * worse[window])
    return WorseStretches(times, _spans(edges, worse > 0.5), factor)


def fixes_in(model: FixModel, worse: WorseStretches, options: FusionOptions) -> FixModel:
    """Fixes with errors as large as they are there.

    Houses and trees add to what errs, for as long as they are passed; what air and orbits make
    lasts on unchanged. A size that changes at each edge leaves no error that lasts.
    """
    factor = worse.factor[model.row][:, None]
    white = model.white_var.copy()
    white[:, :3] *= factor**2
    if worse.slow:
        return replace(model, white_var=white, stated_sd=model.stated_sd * factor)
    there = worse.there[model.row]
    larger = np.where(there[:, None], [worse.times, quick_factor(worse.times, options)], 1.0)
    return replace(model, white_var=white, larger=larger)


def _windows(
    off: _OffPath, window_s: float, least: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Edges [w + 1] of windows, medians of how far positions are off the path [w, 2], m, NaN where
    there are fewer than ``least``, and of its velocities [w, 2]."""
    t = off.t
    count = max(int((t[-1] - t[0]) / window_s), 1)
    edges = t[0] + window_s * np.arange(count + 1)
    first = np.searchsorted(t, edges)
    place, way = np.full((2, count, 2), np.nan)
    for k in range(count):
        part = slice(first[k], first[k + 1])
        if part.stop - part.start >= least:
            place[k] = np.median(off.apart[part], axis=0)
            way[k] = np.median(off.velocity[part], axis=0)
    return edges, place, way


def _steps(place: FloatArray, way: FloatArray) -> FloatArray:
    """By how much ``place`` [w, 2] changes from one window to the next, but for what is of another
    instant, which comes off as the vehicle gathers speed; ``way`` [w, 2] m/s."""
    step = np.diff(place, axis=0, prepend=np.nan)
    faster = np.diff(way, axis=0, prepend=np.nan)
    told = np.isfinite(step).all(axis=1)
    late = float((step[told] * faster[told]).sum() / max((faster[told] ** 2).sum(), 1e-9))
    return np.asarray(step - late * faster)


def _two_sizes(
    step: FloatArray, told: BoolArray, stay: Sequence[float] = WORSE_STAYS
) -> tuple[float, float, FloatArray] | None:
    """How many times larger ``step`` [w, 2] is in the worse windows, how large, m an axis, and how
    probable it is of each [w] that it is one, where such stretches last for one of ``stay``
    windows; None where one size is as likely, or most windows are the worse."""
    if not told.any():
        return None
    squared = np.where(told, (step**2).sum(axis=1), 0.0)
    # of two axes: half of squares lie beyond
    median = max(float(np.median(squared[told])) / (2.0 * np.log(2.0)), 1e-12)

    def log_density(size: FloatArray, usual: FloatArray) -> FloatArray:
        var, wide = size**2 * median, usual**2 * median
        each = np.log1p(-_WILD) - np.log(var) - 0.5 * squared[:, None] / var
        wild = np.log(_WILD) - np.log(wide) - 1.5 * np.log1p(squared[:, None] / wide)
        return np.where(told[:, None], np.logaddexp(each, wild), 0.0)

    one = float(log_density(_ALONE, _ALONE).sum(axis=0).max())
    usual, times = np.array(list(itertools.product(_USUAL, WORSE_FACTORS))).T
    stays, shares = np.array(list(itertools.product(stay, WORSE_SHARES))).T
    ended = 1.0 / stays
    begun = ended * shares / (1.0 - shares)
    density = np.stack([log_density(usual, usual), log_density(usual * times, usual)], axis=2)
    score, _ = _forward(density, shares, begun, ended)
    best, k = np.unravel_index(int(np.argmax(score)), score.shape)
    # what of the grids fits best was chosen on the same drive
    if score[best, k] - one < CERTAIN_LEAD_NATS:
        return None
    density = density[:, best : best + 1]
    _, forward = _forward(density, shares[k : k + 1], begun[k : k + 1], ended[k : k + 1])
    moves = np.array([[1.0 - begun[k], begun[k]], [ended[k], 1.0 - ended[k]]])
    probable, behind = np.empty(len(squared)), np.ones(2)
    for w in range(len(squared) - 1, -1, -1):
        both = np.array([1.0 - forward[w], forward[w]]) * behind
        probable[w] = both[1] / both.sum()
        each = density[w, 0]
        behind = moves @ (behind * np.exp(each - each.max()))
        behind /= behind.sum()
    if (probable[told] > 0.5).mean() >= 0.5:
        return None
    return float(times[best]), float(usual[best] * times[best] * np.sqrt(median)), probable


def _forward(
    density: FloatArray, shares: FloatArray, begun: FloatArray, ended: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Log-likelihoods [p, q] of sizes [w, p, 2], in nats by window, and ways of coming and going
    [q]; of the first of each how probable it is [w] of a window, by those up to it, to be worse."""
    score = np.zeros((density.shape[1], len(shares)))
    worse = np.broadcast_to(shares, score.shape)
    first = np.empty(len(density))
    for w, each in enumerate(density):
        top = each.max(axis=1)
        usual, larger = np.exp(each - top[:, None]).T
        of_worse = worse * larger[:, None]
        total = of_worse + (1.0 - worse) * usual[:, None]
        score += np.log(total) + top[:, None]
        now = of_worse / total
        first[w] = now[0, 0]
        worse = (1.0 - now) * begun + now * (1.0 - ended)
    return score, first


def _spans(edges: FloatArray, worse: BoolArray) -> tuple[tuple[float, float], ...]:
    turns = np.flatnonzero(np.diff(np.concatenate([[0], worse.astype(np.int8), [0]])))
    return tuple(
        (float(edges[a]), float(edges[b])) for a, b in zip(turns[::2], turns[1::2], strict=True)
    )
