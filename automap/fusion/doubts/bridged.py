"""How far a path may be off over a stretch without positions that can be believed, by the way that
the readings tell between those before and after, and whether these lie on one way.

The curve that takes the readings' way to the positions on both sides holds between them as well.
How far it leads astray over so long the drive itself shows where positions are sound: there some
are left out.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from automap.fusion.doubts import limits
from automap.fusion.doubts.path import Misses
from automap.fusion.doubts.position_jump import Places
from automap.fusion.doubts.reason import Span
from automap.fusion.doubts.velocity_step import last_term
from automap.gates import gate, sd_by_median
from automap.records import BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class Bridge:
    """The readings' way over stretches of positions, or of heights, ``seen`` beside them; ``sound``
    rows of these, ``misses`` of fixes off the path, whose tags are ``zero`` s later. What curves
    over sound positions lead astray by is found once for each length."""

    seen: Places
    sound: IntArray
    misses: Misses
    zero: float
    astray: dict[int, float] = field(default_factory=dict)
    apart: dict[tuple[int, int], float] = field(default_factory=dict)

    def off(self, span: Span) -> float:
        """How far, m, the path may be off in the ``span``; endless where readings show nothing."""
        seen, misses = self.seen, self.misses
        gone = self._rows(span)
        if not len(gone):
            return 0.0
        half = self._half()
        before, after = self._sides(gone, half)
        reach = (len(gone) + 2 * half) * self._spacing()
        if min(len(before), len(after)) < half or not _whole(seen, before, after, reach):
            return math.inf
        led = _led(seen, np.concatenate([before, after]), gone)
        tag = misses.t + self.zero
        near = np.clip(np.searchsorted(tag, seen.t[gone] - limits.SAME_FIX_S), 0, len(tag) - 1)
        known = np.abs(tag[near] - seen.t[gone]) < limits.SAME_FIX_S
        if not known.any():
            return math.inf
        miss = misses.miss[near[known]]
        # fixes less what they miss the path by are the path
        on_path = seen.at[gone[known]] - (miss[:, :2] if seen.at.shape[1] == 2 else -miss[:, 2:])
        apart = float(np.linalg.norm(on_path - led[known], axis=1).max())
        if len(gone) not in self.astray:
            self.astray[len(gone)] = self._astray(len(gone), half, reach)
        return float(np.hypot(apart, self.astray[len(gone)]))

    def shift(self, span: Span) -> tuple[float, float]:
        """By how much, m, positions behind the ``span`` lie off the way from those before, and the
        sigma of an axis of that; 0 and endless where readings show nothing."""
        gone = self._rows(span)
        half = self._half()
        size = max(len(gone), half)
        before, after = self._sides(gone, size, span[0])
        size = min(len(before), len(after))
        # as much of either side as there is drive to compare it with
        while size >= half:
            reach = (len(gone) + 2 * size) * self._spacing()
            key = len(gone), size
            if key not in self.apart:
                self.apart[key] = self._apart(*key, reach)
            if math.isfinite(self.apart[key]) and _whole(
                self.seen, before[-size:], after[:size], reach
            ):
                rows = np.concatenate([before[-size:], after[:size]])
                return float(np.hypot(*_steps(self.seen, rows[None])[0])), self.apart[key]
            size //= 2
        return 0.0, math.inf

    def _rows(self, span: Span) -> IntArray:
        first, last = np.searchsorted(self.seen.t, [np.nextafter(span[0], np.inf), span[1]])
        return np.arange(first, last)

    def _spacing(self) -> float:
        return float(np.median(np.diff(self.seen.t)))

    def _half(self) -> int:
        return max(round(limits.STEP_WINDOW_S / self._spacing()), limits.STEP_FIXES)

    def _sides(
        self, gone: IntArray, size: int, start_gps_s: float = math.inf
    ) -> tuple[IntArray, IntArray]:
        """The last ``size`` sound rows before those that are ``gone`` and the first behind."""
        begin = self.seen.t[gone[0]] if len(gone) else np.nextafter(start_gps_s, np.inf)
        at = int(np.searchsorted(self.seen.t[self.sound], begin))
        return self.sound[max(at - size, 0) : at], self.sound[at : at + size]

    def _windows(self, left_out: int, half: int) -> IntArray:
        """Sound rows [k, n] of windows of twice ``half`` and the ``left_out`` between."""
        size = 2 * half + left_out
        starts = np.arange(0, len(self.sound) - size + 1, half)
        # of a long drive some tell it as well
        starts = starts[:: len(starts) // limits.MOST_USUAL + 1]
        return np.asarray(self.sound[starts[:, None] + np.arange(size)])

    def _astray(self, left_out: int, half: int, reach_s: float) -> float:
        """How far, m, curves lead astray over ``left_out`` sound fixes; endless where the drive
        does not show it."""
        found, axes = [], self.seen.at.shape[1]
        for part in self._windows(left_out, half):
            before, gone, after = np.split(part, [half, half + left_out])
            if _whole(self.seen, before, after, reach_s):
                led = _led(self.seen, np.concatenate([before, after]), gone)
                found.append(float(np.linalg.norm(self.seen.at[gone] - led, axis=1).max()))
        if len(found) < limits.LEAST_USUAL:
            return math.inf
        # the rms of a distance, normal in each axis, by its median
        return float(np.median(found)) / math.sqrt(gate(0.5, axes) / axes)

    def _apart(self, left_out: int, half: int, reach_s: float) -> float:
        """The sigma, m an axis, of shifts over ``left_out`` sound fixes; endless where the drive
        does not show it."""
        rows = self._windows(left_out, half)
        rows = np.concatenate([rows[:, :half], rows[:, half + left_out :]], axis=1)
        t, lost = self.seen.t[rows], self.seen.lost_s[rows]
        rows = rows[(lost[:, -1] == lost[:, 0]) & (t[:, -1] - t[:, 0] < 1.5 * reach_s)]
        if len(rows) < limits.LEAST_USUAL:
            return math.inf
        return sd_by_median(_steps(self.seen, rows).ravel())


def outside(misses: Misses, spans: Sequence[Span]) -> Misses:
    """Those of the ``misses`` that are in none of the ``spans``."""
    keep = ~in_any(misses.t, spans)
    return Misses(misses.t[keep], misses.miss[keep], misses.white_var[keep], misses.slow_var[keep])


def in_any(t: FloatArray, spans: Sequence[Span]) -> BoolArray:
    """Which instants [n] lie within one of the ``spans``, which follow one another."""
    if not spans:
        return np.zeros(len(t), np.bool_)
    first, last = np.array(sorted(spans)).T
    at = np.searchsorted(first, t) - 1
    return np.asarray((at >= 0) & (t < last[at]))


def _whole(seen: Places, before: IntArray, after: IntArray, reach_s: float) -> bool:
    """Whether no readings are lost between the ends, and the fixes no further apart than that."""
    ends = before[0], after[-1]
    lost = seen.lost_s[ends[1]] == seen.lost_s[ends[0]]
    return bool(lost and seen.t[ends[1]] - seen.t[ends[0]] < 1.5 * reach_s)


def _led(seen: Places, rows: IntArray, gone: IntArray) -> FloatArray:
    """Where [k, 2] m the readings lead at the fixes ``gone`` [k], by the parabola that takes them
    to the positions of ``rows``: attitude and start are known to nobody."""
    middle = int(gone[len(gone) // 2])
    scale = max(float(np.ptp(seen.t[rows])), 1e-9)

    def curve(of: IntArray) -> FloatArray:
        t = (seen.t[of] - seen.t[middle]) / scale
        return np.stack([np.ones_like(t), t, t**2], axis=-1)

    def felt(of: IntArray) -> FloatArray:
        return np.asarray((seen.felt[of] - seen.felt[middle]) @ seen.turn[middle].T)

    fit, *_ = np.linalg.lstsq(curve(rows), seen.at[rows] - felt(rows), rcond=None)
    return np.asarray(curve(gone) @ fit + felt(gone))


def _steps(seen: Places, rows: IntArray) -> FloatArray:
    """By how much [k, 2] m positions of the latter half of ``rows`` [k, 2 n] lie off the parabola
    that takes the readings to those of the former half."""
    half = rows.shape[1] // 2
    at = rows[:, half - 1]
    t = seen.t[rows] - 0.5 * (seen.t[at] + seen.t[rows[:, half]])[:, None]
    t /= np.maximum(np.ptp(t, axis=1), 1e-9)[:, None]
    felt = seen.felt[rows] - seen.felt[at, None]
    y = seen.at[rows] - seen.at[at, None] - np.einsum("kij,knj->kni", seen.turn[at], felt)
    after = np.broadcast_to(np.arange(2 * half) >= half, t.shape)
    step, _ = last_term(np.stack([np.ones_like(t), t, t**2, after], axis=-1), y)
    return step
