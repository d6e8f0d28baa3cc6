"""Jumps of the receiver's velocity that the IMU does not feel and that the positions go along with.

A receiver that is led away, or whose solution jumps, agrees with itself: positions and velocities
tell the same motion, and a filter that sizes its sensors' noise by the drive takes the IMU for a
poor one. But where the motion that is told begins to be another, velocity changes at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from automap.earth import local_ned
from automap.frames import quat_to_matrix, rpy_to_matrix
from automap.fusion.delay_states import LATENCY_STATE, VEL_LAG_STATE, VEL_LATENCY_STATE
from automap.fusion.doubts import limits
from automap.fusion.doubts.estimates import Estimates
from automap.fusion.doubts.reason import Reason, Span
from automap.fusion.free_inertial import FreeInertial
from automap.fusion.limits import DOUBT_PROBABILITY, LEAST_JUDGED
from automap.gates import OUTSIDE_95, gate, sd_by_median
from automap.records import Fixes, FloatArray, IntArray, Trajectory
from automap.timebase import gps_to_iso


@dataclass(frozen=True)
class Compared:
    """What the receiver and the IMU tell at fixes ``t`` [m] s from the path's first row.

    ``velocity`` [m, 2] m/s and ``position`` [m, 2] m, north and east, of the receiver; ``felt``
    and ``felt_position`` [m, 3] the IMU's, in its free axes, which ``turn`` [m, 3, 3] takes to
    NED; ``lost_s`` [m] seconds that the IMU had lost until then.
    """

    t: FloatArray
    velocity: FloatArray
    position: FloatArray
    felt: FloatArray
    felt_position: FloatArray
    turn: FloatArray
    lost_s: FloatArray


@dataclass(frozen=True)
class Step:
    """A jump of velocity [2] m/s, north and east, at ``t`` s from the path's first row; for
    ``lasts_s`` at least the velocity after it, or the one before, is seen to be another."""

    t: float
    jump: FloatArray
    lasts_s: float

    @property
    def size(self) -> float:
        """Its size, m/s."""
        return float(np.hypot(*self.jump))


def compare(
    free: FreeInertial, fixes: Fixes, path: Trajectory, found: Estimates, arm: FloatArray
) -> Compared:
    """The fixes that tell position and velocity beside the readings ``free`` of the same vehicle,
    both timed in s from the path's first row; ``arm`` [3] m to the antenna.

    The path gives the heading, and nothing else that matters: a tilt is a slope of velocity.
    """
    start, rows = float(path.gps_s[0]), _told_rows(fixes)
    t, placed = told_times(fixes, path, found)
    inside = np.isfinite(free.lost_between(np.minimum(t, placed), np.maximum(t, placed)))
    rows, t, placed = rows[inside], t[inside], placed[inside]
    if not len(rows):
        two, three = np.zeros((0, 2)), np.zeros((0, 3))
        return Compared(t, two, two, three, three, np.zeros((0, 3, 3)), t)
    ref = (float(fixes.lat_rad[rows[0]]), float(fixes.lon_rad[rows[0]]), 0.0)
    place = local_ned(fixes.lat_rad[rows], fixes.lon_rad[rows], np.zeros(len(rows)), ref)
    at = np.clip(np.searchsorted(path.gps_s - start, t), 0, len(path.gps_s) - 1)
    back = np.swapaxes(quat_to_matrix(free.quat[free.nearest(t)]), 1, 2)
    return Compared(
        t,
        fixes.vel_ned[rows, :2],
        place.reshape(-1, 3)[:, :2],
        free.of_point(t, arm)[0],
        free.of_point(placed, arm)[1],
        rpy_to_matrix(path.rpy[at]) @ back,
        np.interp(t, free.t, free.lost_s),
    )


def _told_rows(fixes: Fixes) -> IntArray:
    """The fixes that tell position and velocity, in the order of time."""
    told = np.isfinite(fixes.vel_ned[:, :2]).all(axis=1) & np.isfinite(fixes.gps_s + fixes.lat_rad)
    rows = np.flatnonzero(told)
    rows = rows[np.argsort(fixes.gps_s[rows], kind="stable")]
    return rows[np.diff(fixes.gps_s[rows], prepend=-np.inf) > limits.SAME_FIX_S]


def told_times(fixes: Fixes, path: Trajectory, found: Estimates) -> tuple[FloatArray, FloatArray]:
    """Of which instants [m], s from the path's first row, velocities and positions of the fixes
    that tell both are."""
    tag = fixes.gps_s[_told_rows(fixes)] - float(path.gps_s[0])
    age = sum(found.get(name, (0.0, 0.0))[0] for name in (VEL_LATENCY_STATE, VEL_LAG_STATE))
    return tag - age, tag - found.get(LATENCY_STATE, (0.0, 0.0))[0]


def velocity_steps(seen: Compared, lasting_sd: float) -> list[Step]:
    """Steps beyond what a receiver's velocity does, in the order of time; ``lasting_sd`` m/s the
    velocity errors that come and go.

    A step is the jump in a line through the differences between receiver and IMU some seconds
    before and after. The least that is left of it without any one fix counts.
    """
    t = seen.t
    spacing = float(np.median(np.diff(t))) if len(t) > 1 else np.inf
    half = round(limits.STEP_WINDOW_S / spacing)
    if half < limits.STEP_FIXES:
        return []
    before = filled(t, seen.lost_s, np.arange(half - 1, len(t) - half), half, spacing)
    if len(before) < LEAST_JUDGED:
        return []
    parts = np.array_split(before, len(before) // limits.STEP_BATCH + 1)
    jump, least = (
        np.concatenate(values)
        for values in zip(*(_velocity_jumps(seen, part, half) for part in parts), strict=True)
    )
    sd = sd_by_median(jump.ravel())
    # two errors, before and after
    beyond = np.sqrt(gate(DOUBT_PROBABILITY, 2) * (sd**2 + 2.0 * lasting_sd**2))
    steps: list[Step] = []
    for k in np.argsort(-least):
        if least[k] <= beyond:
            break
        at = before[k]
        when = 0.5 * float(t[at] + t[at + 1])
        apart = all(abs(step.t - when) > limits.STEP_WINDOW_S for step in steps)
        if apart and _goes_along(seen, int(at), jump[k], spacing):
            steps.append(Step(when, jump[k], _lasts(seen, int(at), jump[k])))
    return sorted(steps, key=lambda step: step.t)


def filled(
    t: FloatArray, lost_s: FloatArray, before: IntArray, half: int, spacing: float
) -> IntArray:
    """Of the fixes at ``t`` [m] s those ``before`` a jump whose ``half`` before and after have no
    gap between, nor between readings, which ``lost_s`` [m] s until then."""
    first, last = before - half + 1, before + half
    gaps = np.cumsum(np.diff(t, prepend=t[0]) > limits.GAP_STEPS * spacing)
    whole = (gaps[last] == gaps[first]) & (lost_s[last] == lost_s[first])
    return np.asarray(before[whole])


def _velocity_jumps(seen: Compared, before: IntArray, half: int) -> tuple[FloatArray, FloatArray]:
    """Jumps [k, 2] m/s behind the fixes ``before`` [k], and how much of each is left at least
    without any one fix [k]."""
    rows = before[:, None] + np.arange(1 - half, half + 1)
    t = seen.t[rows] - seen.t[before, None]
    felt = seen.felt[rows] - seen.felt[before, None]
    y = seen.velocity[rows] - np.einsum("kij,knj->kni", seen.turn[before, :2], felt)
    after = np.broadcast_to(np.arange(2 * half) >= half, t.shape)
    jump, left = last_term(np.stack([np.ones_like(t), t, after], axis=-1), y)
    return jump, least_along(jump, left)


def _goes_along(seen: Compared, at: int, jump: FloatArray, spacing: float) -> bool:
    """Whether the positions about the fix ``at`` gain a ``jump`` [2] m/s too, rather than none:
    those of twice the time, for a position is the blunter witness."""
    half = round(2.0 * limits.STEP_WINDOW_S / spacing)
    rows = np.arange(max(at - half + 1, 0), min(at + half + 1, len(seen.t)))
    rows = rows[seen.lost_s[rows] == seen.lost_s[at]]
    if len(rows) < half:
        return False
    t = seen.t[rows] - 0.5 * (seen.t[at] + seen.t[at + 1])
    felt = seen.felt_position[rows] - seen.felt_position[at]
    y = seen.position[rows] - seen.position[at] - felt @ seen.turn[at, :2].T
    design = np.stack([np.ones_like(t), t, t**2, np.maximum(t, 0.0)], axis=-1)
    _, left = last_term(design[None], y[None])
    return bool(least_along(jump[None], left)[0] > 0.5 * np.hypot(*jump))


def _lasts(seen: Compared, at: int, jump: FloatArray) -> float:
    """Seconds that the differences behind the fix ``at`` are nearer to a ``jump`` [2] m/s than to
    none, on the line of those before it, or before it on the line of those behind it."""
    t = seen.t - 0.5 * (seen.t[at] + seen.t[at + 1])
    near = np.flatnonzero((np.abs(t) <= limits.LED_S) & (seen.lost_s == seen.lost_s[at]))
    t = t[near]
    felt = (seen.felt[near] - seen.felt[at]) @ seen.turn[at, :2].T
    along = (seen.velocity[near] - felt) @ jump / np.hypot(*jump)
    seconds = []
    for side in (1.0, -1.0):
        known = (side * t < 0.0) & (side * t > -2.0 * limits.STEP_WINDOW_S)
        there = np.flatnonzero(side * t > 0.0)[:: int(side)]
        told, sd = _line(t[known], along[known], t[there])
        # it tells nothing where it may be off by as much
        half = 0.5 * np.hypot(*jump)
        other = (side * (along[there] - told) > half) & (sd < half)
        # one fix may be wild
        again = np.flatnonzero(~other[:-1] & ~other[1:])
        last = there[again[0]] if len(again) else there[-1]
        seconds.append(abs(float(t[last])))
    return max(min(seconds), limits.STEP_WINDOW_S)


def _line(t: FloatArray, y: FloatArray, at: FloatArray) -> tuple[FloatArray, FloatArray]:
    """A line through ``y`` [n] at ``t`` [n], at instants [m], and how far it may be off there: half
    of its interval of 95 %, by Student's distribution."""
    from scipy.special import stdtrit

    mean, freedom = t.mean(), max(len(t) - 2, 1)
    line = np.polyfit(t - mean, y, 1)
    rest = y - np.polyval(line, t - mean)
    spread = 1.0 / len(t) + (at - mean) ** 2 / ((t - mean) @ (t - mean))
    wide = stdtrit(freedom, 1.0 - 0.5 * OUTSIDE_95)
    return np.polyval(line, at - mean), wide * np.sqrt(spread * (rest @ rest) / freedom)


def last_term(design: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Last coefficient [k, 2] of least squares of ``y`` [k, n, 2] on ``design`` [k, n, p], and what
    it is without each one row [k, n, 2] (Cook and Weisberg, Residuals and Influence in
    Regression, section 2.2)."""
    across = np.swapaxes(design, 1, 2)
    solve = np.linalg.solve(across @ design, across)
    found = solve @ y
    leverage = np.einsum("kni,kin->kn", design, solve)
    rest = (y - design @ found) / np.maximum(1.0 - leverage, 1e-6)[..., None]
    last = solve[:, -1, :, None]
    return found[:, -1], np.asarray(found[:, -1][:, None] - last * rest)


def least_along(jump: FloatArray, left: FloatArray) -> FloatArray:
    """The least [k] of ``left`` [k, n, c] in the direction of ``jump`` [k, c]."""
    size = np.linalg.norm(jump, axis=1)
    along = np.einsum("kni,ki->kn", left, jump) / np.maximum(size, 1e-9)[:, None]
    return np.asarray(np.minimum(along.min(axis=1), size))


@dataclass(frozen=True)
class Led:
    """Where a receiver was led: ``spans`` in which its velocity was another, how far it came at
    most, and how far from where it began it was in the end, m."""

    spans: tuple[Span, ...]
    most_m: float
    left_m: float


def led_away(steps: Sequence[Step], end: float) -> Led:
    """What ``steps`` of velocity make of the positions until ``end`` s.

    The velocity is another until steps have taken it back, or it is seen to have come back
    otherwise; then it may as well have been another before.
    """
    spans: list[Span] = []
    velocity, place, most = np.zeros(2), np.zeros(2), 0.0
    since = steps[0].t
    for step, after in zip(steps, [*steps[1:], None], strict=True):
        since = since if velocity.any() else step.t
        before, velocity = velocity, velocity + step.jump
        # nearer to none than to what it was
        if np.hypot(*velocity) < 0.5 * np.hypot(*before):
            spans.append((since, step.t))
            velocity = np.zeros(2)
            continue
        left = (end if after is None else after.t) - step.t
        goes_on = after is not None and velocity @ after.jump < 0.0 and left < limits.LED_S
        lasts = left if goes_on else min(left, step.lasts_s)
        moved = place + velocity * lasts
        most = max(most, float(np.hypot(*moved)))
        # a receiver that errs for seconds and finds back by a jump is not led anywhere; seen is
        # what lasts longer than the line that it is seen against
        if goes_on or step.lasts_s > 2.0 * limits.STEP_WINDOW_S:
            place = moved
        if not goes_on:
            spans.append((min(since, step.t - lasts), step.t + lasts))
            velocity = np.zeros(2)
    return Led(tuple(spans), most, float(np.hypot(*place)))


def step_doubts(steps: Sequence[Step], path: Trajectory) -> list[Reason]:
    """The reasons that ``steps`` of velocity give: where the receiver was led, and that nothing
    tells the place before from the one after."""
    if not steps:
        return []
    start = float(path.gps_s[0])
    led = led_away(steps, float(path.gps_s[-1]) - start)
    size, first = max(step.size for step in steps), gps_to_iso(start + steps[0].t)
    jumps = f"by {size:.1f} m/s at {first}"
    if len(steps) > 1:
        last = gps_to_iso(start + steps[-1].t)
        jumps = f"{len(steps)} times, by up to {size:.1f} m/s, from {first} to {last}"
    text = (
        f"the receiver's velocity jumps {jumps}, its positions go along, and the IMU feels nothing "
        "of it: its solution jumped, or its signals are not the satellites'; the positions there "
        f"may be {led.most_m:.0f} m off, do not rely on what was mapped"
    )
    reasons = [Reason("velocity_step", text, led.spans, error_m=led.most_m)]
    if led.left_m > 0.0:
        text = (
            f"where the receiver's velocity jumped its positions moved by {led.left_m:.0f} m that "
            "they did not come back by: nothing says whether they are right before or after; "
            "compare them with what is known of the place"
        )
        reasons.append(Reason("velocity_step", text, error_m=led.left_m))
    return reasons
