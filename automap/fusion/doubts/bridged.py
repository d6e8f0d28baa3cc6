"""How far a path may be off where positions and velocities of a receiver contradict each other, by
the way that the readings tell between the positions before and after.

The curve that takes the readings' way to the positions on both sides holds between them as well.
How far it leads astray over so long the drive itself shows where nothing contradicts: positions are
left out there.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from automap.fusion.doubts import limits
from automap.fusion.doubts.path import Misses
from automap.fusion.doubts.position_jump import Places
from automap.fusion.doubts.reason import Reason, Span
from automap.fusion.limits import LEAST_JUDGED
from automap.records import BoolArray, FloatArray, IntArray
from automap.sync.velocity_consistency import Interval


def bridged(
    reasons: Sequence[Reason],
    parted: Sequence[Interval],
    seen: Places,
    misses: Misses,
    start_gps_s: float,
    age_s: float,
    sd_m: float,
) -> list[Reason]:
    """The ``reasons``, of which that of the stretches ``parted`` says how far the path is off in
    each where the readings show it.

    ``seen`` positions beside the readings, ``misses`` of fixes ``age_s`` old off the path that
    begins at ``start_gps_s`` and is good to ``sd_m`` m an axis. The reason is none to doubt the
    path where that is no more.
    """
    if min(len(seen.t), len(misses)) < LEAST_JUDGED:
        return list(reasons)
    spans = [(jump.start_gps_s, jump.end_gps_s) for jump in parted]
    sound = np.flatnonzero(~_in_any(seen.t, spans))
    usual: dict[int, float] = {}
    led = [_off(span, sound, usual, seen, misses, start_gps_s + age_s) for span in spans]
    if not any(math.isfinite(m) for m in led):
        return list(reasons)
    off = tuple(min(m, jump.metres) for m, jump in zip(led, parted, strict=True))
    worst = max(off)
    told = f"; by the way that the IMU shows the path is off there by no more than {worst:.1f} m"
    return [
        replace(
            reason,
            text=reason.text + told,
            error_m=worst,
            span_errors_m=off,
            state="good" if worst < math.sqrt(2.0) * sd_m else reason.state,
        )
        if reason.code == "positions_parted"
        else reason
        for reason in reasons
    ]


def outside(misses: Misses, spans: Sequence[Span]) -> Misses:
    """Those of the ``misses`` that are in none of the ``spans``."""
    keep = ~_in_any(misses.t, spans)
    return Misses(misses.t[keep], misses.miss[keep], misses.white_var[keep], misses.slow_var[keep])


def _in_any(t: FloatArray, spans: Sequence[Span]) -> BoolArray:
    """Which instants [n] lie within one of the ``spans``, which follow one another."""
    if not spans:
        return np.zeros(len(t), np.bool_)
    first, last = np.array(sorted(spans)).T
    at = np.searchsorted(first, t) - 1
    return np.asarray((at >= 0) & (t < last[at]))


def _off(
    span: Span,
    sound: IntArray,
    usual: dict[int, float],
    seen: Places,
    misses: Misses,
    zero: float,
) -> float:
    """How far, m, the path may be off in a stretch; endless where readings do not show it.
    ``misses`` are of tags ``zero`` s earlier, ``usual`` what curves over so many fixes lead astray
    by, as far as that is known."""
    gone = np.arange(*np.searchsorted(seen.t, [np.nextafter(span[0], np.inf), span[1]]))
    if not len(gone):
        return 0.0
    spacing = float(np.median(np.diff(seen.t)))
    half = max(round(limits.STEP_WINDOW_S / spacing), limits.STEP_FIXES)
    at = int(np.searchsorted(sound, gone[0]))
    before, after = sound[max(at - half, 0) : at], sound[at : at + half]
    reach = (len(gone) + 2 * half) * spacing
    if min(len(before), len(after)) < half or not _whole(seen, before, after, reach):
        return math.inf
    led = _led(seen, np.concatenate([before, after]), gone)
    tag = misses.t + zero
    near = np.clip(np.searchsorted(tag, seen.t[gone] - limits.SAME_FIX_S), 0, len(tag) - 1)
    known = np.abs(tag[near] - seen.t[gone]) < limits.SAME_FIX_S
    if not known.any():
        return math.inf
    # fixes less what they miss the path by are the path
    on_path = seen.at[gone[known]] - misses.miss[near[known], :2]
    apart = float(np.hypot(*(on_path - led[known]).T).max())
    if len(gone) not in usual:
        usual[len(gone)] = _usual(seen, sound, len(gone), half, reach)
    return float(np.hypot(apart, usual[len(gone)]))


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


def _usual(seen: Places, sound: IntArray, left_out: int, half: int, reach_s: float) -> float:
    """How far, m, such a curve leads astray over ``left_out`` sound fixes; endless where the drive
    does not show it."""
    astray = []
    starts = np.arange(0, len(sound) - 2 * half - left_out + 1, half)
    # of a long drive some tell it as well
    for first in starts[:: len(starts) // limits.MOST_USUAL + 1].tolist():
        part = sound[first : first + 2 * half + left_out]
        before, gone, after = np.split(part, [half, half + left_out])
        if _whole(seen, before, after, reach_s):
            led = _led(seen, np.concatenate([before, after]), gone)
            astray.append(float(np.hypot(*(seen.at[gone] - led).T).max()))
    if len(astray) < limits.LEAST_USUAL:
        return math.inf
    # the rms of a distance, normal in two axes, by its median
    return float(np.median(astray)) / math.sqrt(math.log(2.0))
