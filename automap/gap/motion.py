"""The smoothed motion of a drive, and what delays and lags of the fixes do along it.

A filter that takes delays as states sees a position as late by delay times velocity, a velocity
by delay times acceleration. What is more to it is taken from the smoothed motion and out of the
fixes, so models with other delays are compared at the same nodes.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from automap.columns_between import interpolate
from automap.earth import gravity, metres_per_radian
from automap.effects.courses import size_of_course, turns_of, with_courses
from automap.effects.gnss import low_pass
from automap.frames import quat_to_matrix
from automap.fusion.delay_states import (
    COURSE_DISTANCE_STATE,
    COURSE_STATE,
    LATENCY_STATE,
    SKEW_STATE,
    VEL_LAG_STATE,
    VEL_LATENCY_STATE,
)
from automap.fusion.kernel_runs import run_dense
from automap.fusion.nodes import FixModel
from automap.fusion.passes import Pass
from automap.fusion.problem import LateChange
from automap.records import FloatArray

LEAST_S = 5e-4
LEAST_M = 0.02
"""An arm that much longer moves velocities by some millimetres a second in a bend."""
STREET_SPEED = 10.0
"""At which a distance is so many seconds, m/s."""
CHANGE = 5e-4
"""Ages that moved by less, in s or as a share, change nothing of the remainder."""


@dataclass(frozen=True)
class Motion:
    """The smoothed motion at the IMU's epochs.

    ``t`` [n] s, ``pos`` [n, 3] rad, rad, m, ``vel`` [n, 3] NED, ``dcm`` [n, 3, 3] body to NED,
    ``rate`` and ``force`` [n, 3] corrected readings, ``acc`` [n, 3] NED over ground, ``calm``
    [n, 3] rates without the noise of single readings, as the filter swings an antenna with: on
    rough roads an arm would turn that noise into velocities.
    """

    t: FloatArray
    pos: FloatArray
    vel: FloatArray
    dcm: FloatArray
    rate: FloatArray
    force: FloatArray
    acc: FloatArray
    calm: FloatArray


def motion_of(last: Pass) -> Motion:
    """The smoothed motion of a pass at the IMU's epochs."""
    dense, readings = run_dense(
        last.problem, last.nodes, last.smooth.nominal, last.smooth.params, True, with_rates=True
    )
    bad = ~(np.isfinite(dense).all(axis=1) & np.isfinite(readings).all(axis=1))
    if bad.any():
        good = np.flatnonzero(~bad)
        nearest = good[np.clip(np.searchsorted(good, np.flatnonzero(bad)), 0, len(good) - 1)]
        dense[bad], readings[bad] = dense[nearest], readings[nearest]
    t = last.problem.t
    dcm = quat_to_matrix(dense[:, 6:10])
    step = max(float(np.median(np.diff(t))), 1e-4)
    from scipy.ndimage import uniform_filter1d

    width = max(2 * round(0.05 / step) + 1, 1)
    force = uniform_filter1d(readings[:, 3:], width, axis=0, mode="nearest")
    acc = np.einsum("nij,nj->ni", dcm, force)
    acc[:, 2] += float(gravity(float(dense[0, 0]), float(dense[0, 2])))
    rate = readings[:, :3]
    calm = rate + last.problem.samples.calm[:, :3]
    return Motion(t, dense[:, :3], dense[:, 3:6], dcm, rate, readings[:, 3:], acc, calm)


def at_times(motion: Motion, signal: FloatArray, t: FloatArray) -> FloatArray:
    """A signal [n, k] of the motion at instants [m], linear between epochs."""
    flat = signal.reshape(len(motion.t), -1)
    out = np.empty((len(t), flat.shape[1]))
    interpolate(t, motion.t, flat, out)
    return out.reshape((len(t), *signal.shape[1:]))


def lagged(motion: Motion, signal: FloatArray, tau_s: float) -> FloatArray:
    """A ``signal`` [n, 3] of the motion after a first-order low-pass of time constant ``tau_s``."""
    step = max(float(np.median(np.diff(motion.t))), 1e-4)
    grid = np.arange(motion.t[0], motion.t[-1] + step, step)
    even, out = np.empty((len(grid), signal.shape[1])), np.empty(signal.shape)
    interpolate(grid, motion.t, signal, even)
    interpolate(motion.t, grid, low_pass(even, step, tau_s), out)
    return out


@dataclass(frozen=True)
class Delays:
    """By how much fixes are older than their tags in s: ``all_s`` of them at the start of the
    drive, growing by ``skew`` s/s; velocities by ``velocity_s`` more, and by a low-pass of time
    constant ``lag_s``, their courses by ``course_s`` and by the time for ``course_m`` more than
    their sizes; ``arm`` m to an antenna, where fixes are older than their tags: it swung then."""

    all_s: float = 0.0
    skew: float = 0.0
    velocity_s: float = 0.0
    lag_s: float = 0.0
    course_s: float = 0.0
    course_m: float = 0.0
    arm: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def told(self, t: FloatArray) -> FloatArray:
        """Instants [n] that velocities with tags ``t`` [n] are of."""
        return t - self.all_s - self.skew * t - self.velocity_s

    def close_to(self, other: Delays, length_s: float) -> bool:
        """Whether two differ by no more than matters over a drive of ``length_s``."""
        mine, others = self._in_s(length_s), other._in_s(length_s)
        pairs = zip(mine, others, strict=True)
        moved = max(abs(a - b) for a, b in zip(self.arm, other.arm, strict=True))
        return moved <= LEAST_M and all(
            abs(a - b) <= max(LEAST_S, CHANGE * abs(a)) for a, b in pairs
        )

    def _in_s(self, length_s: float) -> tuple[float, ...]:
        ages = self.all_s, self.skew * length_s, self.velocity_s, self.lag_s, self.course_s
        return *ages, self.course_m / STREET_SPEED


def has_delays(effects: Collection[str]) -> bool:
    """Whether a model that estimates these effects has ages of the fixes at all."""
    ages = (LATENCY_STATE, SKEW_STATE, VEL_LAG_STATE, VEL_LATENCY_STATE, COURSE_STATE)
    return any(age.rpartition("_")[0] in effects for age in (*ages, COURSE_DISTANCE_STATE))


def delays_of(last: Pass, where: Mapping[str, Mapping[str, tuple[str, float]]]) -> Delays:
    """The ages that the states of a pass have found; ``where`` the effects' states."""
    found = last.totals()
    lag = found.get(VEL_LAG_STATE, 0.0)
    age = found.get(VEL_LATENCY_STATE, 0.0)
    if "gnss_velocity_lag" not in where or "gnss_velocity_latency" in where:
        # the state stands for a latency
        lag, age = 0.0, age + lag
    course = found.get(COURSE_STATE, 0.0)
    late, skew = found.get(LATENCY_STATE, 0.0), -found.get(SKEW_STATE, 0.0)
    # negative ones are none, but what a first order takes up for something else
    behind = max(found.get(COURSE_DISTANCE_STATE, 0.0), 0.0)
    delays = Delays(late, skew, age, max(lag, 0.0), course, behind)
    return (
        delays if delays.close_to(Delays(), last.nodes.t[-1]) else replace(delays, arm=_arm(last))
    )


def _arm(last: Pass) -> tuple[float, float, float]:
    """Where a pass has the antenna, m."""
    x, y, z = (last.totals().get(f"gnss_lever_arm_{a}", 0.0) for a in "xyz")
    return x, y, z


def linear_in_delays(
    fixes: FixModel, last: Pass, motion: Motion, delays: Delays, arm_unknown: bool = False
) -> tuple[FixModel, LateChange | None]:
    """Fixes less what their ages do to them beyond the first order about ``delays``, and what
    velocities change by as they grow later, and with an arm where nobody knows it.

    A velocity that is late by a time constant or more changes by what happened then: the
    acceleration at its tag may have the other sign, and would lead away from the right delay.
    """
    arm = np.array(_arm(last))
    turning = np.cross(motion.calm, arm)
    swing = np.einsum("nij,nj->ni", motion.dcm, turning)
    inward = np.einsum("nij,nj->ni", motion.dcm, np.cross(motion.calm, turning))
    antenna = replace(motion, vel=motion.vel + swing)
    t = last.shift.position_times(fixes.t)
    late = delays.all_s + delays.skew * t
    values = fixes.values.copy()
    path, vel = _path(antenna), at_times(motion, antenna.vel, t)
    moved = at_times(motion, path, t - late) - at_times(motion, path, t) + late[:, None] * vel
    north, east = metres_per_radian(values[:, 0], values[:, 2])
    values[:, 0] -= moved[:, 0] / north
    values[:, 1] -= moved[:, 1] / east
    values[:, 2] += moved[:, 2]
    passed = lagged(motion, antenna.vel, delays.lag_s) if delays.lag_s > 0.0 else antenna.vel
    told = delays.told(t)
    seen = at_times(motion, passed, told)
    # metres a second of a clock that runs fast
    seen *= 1.0 - delays.skew
    old = (late + delays.velocity_s + delays.lag_s)[:, None]
    changing = _steady(last, motion) + inward
    acc = at_times(motion, changing, t)
    first_order = vel - old * acc
    change = late_change(antenna, changing, delays, arm_unknown)
    if change is not None:
        for metres, swung in zip(arm, change.swung, strict=False):
            first_order += metres * at_times(motion, swung, t)
        first_order -= old * at_times(motion, change.whole, t)
        first_order -= delays.course_s * at_times(motion, change.course, t)
        first_order -= delays.course_m * at_times(motion, change.behind, t)
    if delays.course_s != 0.0 or delays.course_m != 0.0:
        behind = delays.course_s + delays.course_m / size_of_course(seen)
        seen = with_courses(seen, at_times(motion, passed, told - behind))
        first_order -= delays.course_s * turns_of(vel, acc)
        first_order -= delays.course_m * at_times(motion, swings(motion), t)
    values[:, 3:6] -= seen - first_order
    return replace(fixes, values=values), change


def late_change(
    motion: Motion, acc: FloatArray, delays: Delays, arm_unknown: bool = False
) -> LateChange | None:
    """By how much the changes of late velocities differ from those at their tag, of which ``acc``
    [n, 3] is the acceleration, with an arm where nobody knows it; None where they are not late.
    A low-pass changes with its time constant by the acceleration passed through it twice:
    y = v / (1 + s tau), dy / dtau = -s v / (1 + s tau)^2. A course is of its own instant, and so is
    what turns it."""
    late = delays.all_s + delays.velocity_s
    grown = abs(delays.skew) * float(motion.t[-1])
    if max(abs(late), delays.lag_s, grown, abs(delays.course_s), abs(delays.course_m)) < LEAST_S:
        return None
    once = lagged(motion, acc, delays.lag_s) if delays.lag_s > 0.0 else acc
    then = then_of(motion, delays)
    size, its_size = size_of_course(then.seen), size_of_course(then.course)
    turned = (size / its_size)[:, None] * turns_of(then.course, at_times(motion, once, then.before))
    return LateChange(
        as_told(motion, once, delays, then) - acc,
        turned - turns_of(motion.vel, acc),
        turned / size[:, None] - swings(motion),
        tuple(swung(motion, axis, delays, then) for axis in range(3)) if arm_unknown else (),
    )


def swung(motion: Motion, axis: int, delays: Delays, then: Then) -> FloatArray:
    """By how much more than at their tag a metre along a vehicle axis swings late velocities
    [n, 3] NED, 1/s: an antenna swung as the car turned then."""
    swing = swings(motion, axis)
    return as_told(motion, swing, delays, then) - swing


def as_told(motion: Motion, change: FloatArray, delays: Delays, then: Then) -> FloatArray:
    """What a ``change`` [n, 3] NED of the velocities along a drive makes of those that are told
    [n, 3], which are of instants ``then``: their sizes and their courses each of its own."""
    if delays.lag_s > 0.0:
        change = lagged(motion, change, delays.lag_s)
    out, before = (at_times(motion, change, t) for t in (then.told, then.before))
    size, its_size = size_of_course(then.seen)[:, None], size_of_course(then.course)[:, None]
    turned = size / its_size * turns_of(then.course, before) - turns_of(then.seen, out)
    # what makes it faster points where the course does
    faster = np.sum(out[:, :2] * then.seen[:, :2], axis=1)[:, None] / size
    out[:, :2] += faster * (then.course[:, :2] / its_size - then.seen[:, :2] / size)
    return out + turned


class Then(NamedTuple):
    """The instants that sizes, ``told`` [n], and courses, ``before`` [n], of velocities are of that
    have a tag at each epoch, and the velocities [n, 3] then, ``seen`` and ``course``."""

    told: FloatArray
    before: FloatArray
    seen: FloatArray
    course: FloatArray


def then_of(motion: Motion, delays: Delays) -> Then:
    """Those of velocities that are late by ``delays``."""
    passed = lagged(motion, motion.vel, delays.lag_s) if delays.lag_s > 0.0 else motion.vel
    told = delays.told(motion.t)
    seen = at_times(motion, passed, told)
    before = told - delays.course_s - delays.course_m / size_of_course(seen)
    return Then(told, before, seen, at_times(motion, passed, before))


def swings(motion: Motion, axis: int = 0) -> FloatArray:
    """What a metre along a vehicle axis swings NED [n, 3], m/s."""
    turning = np.cross(motion.calm, np.eye(3)[axis])
    return np.asarray(np.einsum("nij,nj->ni", motion.dcm, turning))


def _path(motion: Motion) -> FloatArray:
    """The way [n, 3] NED in m since the first epoch."""
    steps = 0.5 * (motion.vel[1:] + motion.vel[:-1]) * np.diff(motion.t)[:, None]
    return np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])


def _steady(last: Pass, motion: Motion) -> FloatArray:
    """The acceleration [n, 3] NED over ground that the filter multiplies delays with."""
    samples = last.problem.samples
    force = motion.force + samples.calm[:, 3:]
    acc = np.einsum("nij,nj->ni", motion.dcm, force)
    acc[:, 2] += float(gravity(float(motion.pos[0, 0]), float(motion.pos[0, 2])))
    return np.asarray(acc)
