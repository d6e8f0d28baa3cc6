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
from functools import cached_property

import numpy as np

from automap.fusion.doubts import limits
from automap.fusion.doubts.path import Misses
from automap.fusion.doubts.position_jump import Places
from automap.fusion.doubts.reason import Span
from automap.fusion.doubts.velocity_step import last_term
from automap.gates import gate, sd_by_median
from automap.records import BoolArray, FloatArray, IntArray

_FILLED = 1.5
"""Fixes that follow one another last for less than so many times their number: no hole between."""


@dataclass(frozen=True)
class Bridge:
    """The readings' way over stretches of positions, or of heights, ``seen`` beside them; ``sound``
    rows of these, ``misses`` of fixes off the path, whose tags are ``zero`` s later. What curves
    over sound positions lead astray by is found once for each length."""

    seen: Places
    sound: IntArray
    misses: Misses
    zero: float
    astray: dict[tuple[int, int, int], float] = field(default_factory=dict)
    apart: dict[tuple[int, int], float] = field(default_factory=dict)

    def off(self, span: Span) -> float:
        """How far, m, the path may be off in the ``span``; endless where readings show nothing."""
        seen, misses = self.seen, self.misses
        gone = self._rows(span)
        if not len(gone):
            return 0.0
        before, after = self._sides(gone, 2 * self._half)
        sides = self._either(len(before), len(after))
        if sides is None:
            return math.inf
        before, after = before[len(before) - sides[0] :], after[: sides[1]]
        if not self._whole(np.concatenate([before, gone, after])):
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
        key = len(gone), *sides
        if key not in self.astray:
            self.astray[key] = self._astray(*key)
        return float(np.hypot(apart, self.astray[key]))

    def shift(self, span: Span) -> tuple[float, float]:
        """By how much, m, positions behind the ``span`` lie off the way from those before, and the
        sigma of an axis of that; 0 and endless where readings show nothing."""
        gone = self._rows(span)
        half = self._half
        size = max(len(gone), half)
        before, after = self._sides(gone, size, span[0])
        size = min(len(before), len(after))
        best = 0.0, math.inf
        # by as much of either side as tells it best
        while size >= half:
            key = len(gone), size
            if key not in self.apart:
                self.apart[key] = self._apart(*key)
            rows = np.concatenate([before[-size:], after[:size]])
            if self.apart[key] < best[1] and self._whole(np.insert(rows, size, gone)):
                best = float(np.hypot(*_steps(self.seen, rows[None])[0])), self.apart[key]
            size //= 2
        return best

    def _rows(self, span: Span) -> IntArray:
        first, last = np.searchsorted(self.seen.t, [np.nextafter(span[0], np.inf), span[1]])
        return np.arange(first, last)

    @cached_property
    def _spacing(self) -> float:
        return float(np.median(np.diff(self.seen.t)))

    @cached_property
    def _half(self) -> int:
        return max(round(limits.STEP_WINDOW_S / self._spacing), limits.STEP_FIXES)

    def _sides(
        self, gone: IntArray, size: int, start_gps_s: float = math.inf
    ) -> tuple[IntArray, IntArray]:
        """The last ``size`` sound rows before those that are ``gone`` and the first behind."""
        begin = self.seen.t[gone[0]] if len(gone) else np.nextafter(start_gps_s, np.inf)
        at = int(np.searchsorted(self.seen.t[self.sound], begin))
        return self.sound[max(at - size, 0) : at], self.sound[at : at + size]

    def _either(self, before: int, after: int) -> tuple[int, int] | None:
        """How many of so many sound rows ``before`` and ``after`` a curve is taken to: as many of
        both, or of one alone, at an end of a drive; None where there are too few."""
        half = self._half
        wanted = (half, half), (2 * half, 0), (0, 2 * half)
        return next((w for w in wanted if before >= w[0] and after >= w[1]), None)

    def _whole(self, rows: IntArray) -> bool:
        """Whether no readings are lost between the ends of ``rows``, and few fixes are missing."""
        seen, reach = self.seen, len(rows) * self._spacing
        lost = seen.lost_s[rows[-1]] == seen.lost_s[rows[0]]
        return bool(lost and seen.t[rows[-1]] - seen.t[rows[0]] < _FILLED * reach)

    def _windows(self, size: int) -> IntArray:
        """Sound rows [k, size] that follow one another, of windows a half apart."""
        starts = np.arange(0, len(self.sound) - size + 1, self._half)
        # of a long drive some tell it as well
        starts = starts[:: len(starts) // limits.MOST_USUAL + 1]
        rows = np.asarray(self.sound[starts[:, None] + np.arange(size)])
        t, lost = self.seen.t[rows], self.seen.lost_s[rows]
        whole = (lost[:, -1:] == lost[:, :1]) & (
            t[:, -1:] - t[:, :1] < _FILLED * size * self._spacing
        )
        return np.asarray(rows[whole[:, 0]])

    def _astray(self, left_out: int, before: int, after: int) -> float:
        """How far, m, curves to so many fixes on either side lead astray over ``left_out`` sound
        ones; endless where the drive does not show it."""
        found, axes = [], self.seen.at.shape[1]
        for rows in self._windows(before + left_out + after):
            gone = rows[before : before + left_out]
            led = _led(self.seen, np.delete(rows, np.s_[before : before + left_out]), gone)
            found.append(float(np.linalg.norm(self.seen.at[gone] - led, axis=1).max()))
        if len(found) < limits.LEAST_USUAL:
            return math.inf
        # the rms of a distance, normal in each axis, by its median
        return float(np.median(found)) / math.sqrt(gate(0.5, axes) / axes)

    def _apart(self, left_out: int, half: int) -> float:
        """The sigma, m an axis, of shifts over ``left_out`` sound fixes; endless where the drive
        does not show it."""
        rows = self._windows(2 * half + left_out)
        if len(rows) < limits.LEAST_USUAL:
            return math.inf
        rows = np.delete(rows, np.s_[half : half + left_out], axis=1)
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
