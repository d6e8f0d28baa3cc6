"""Estimates that cannot be: delays, scales, biases, noise levels that ran to their bounds."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from automap.fusion.adapt import COARSE, FINE
from automap.fusion.delay_states import (
    COURSE_STATE,
    DELAY_STATE,
    LATENCY_STATE,
    SKEW_STATE,
    VEL_LAG_STATE,
    VEL_LATENCY_STATE,
)
from automap.fusion.doubts import limits
from automap.fusion.doubts.reason import Reason
from automap.fusion.limits import (
    DOUBT_PROBABILITY,
    HELD_ARM_SD_M,
    MAX_DELAY_S,
    MAX_SKEW,
    MOST_ARM_M,
)
from automap.fusion.result import FusionResult
from automap.gates import OUTSIDE_95, sigmas
from automap.records import FloatArray, Trajectory

Estimates = Mapping[str, tuple[float, float]]
"""Value and sd by the parameter's name, at the end of the drive."""

_LEVELS = {
    "accel": "noise of the accelerometer",
    "gyro": "noise of the gyro",
    "position_h": "horizontal noise of the fixes' positions",
    "position_v": "vertical noise of the fixes' positions",
    "velocity_h": "horizontal noise of the fixes' velocities",
    "velocity_v": "vertical noise of the fixes' velocities",
}
_SCALE_STATE = "gnss_velocity_scale_relative"
INERTIAL_LEVELS = ("accel", "gyro")


def final_estimates(result: FusionResult) -> dict[str, tuple[float, float]]:
    """The parameters of a fused drive as they are at its end."""
    history = result.parameters
    rows = zip(history.names, history.values[-1], history.sd[-1], strict=True)
    return {name: (float(value), float(sd)) for name, value, sd in rows}


def impossible_ages(found: Estimates, dated_by_arrival: bool) -> list[Reason]:
    """Fixes and velocities from the future, delays and skews that ran to their bounds.

    ``dated_by_arrival``: the delay of the IMU's stamps is minus the age of the fixes on arrival. A
    clock that was found by the motions has the age of the receiver's velocities in it, and says
    nothing of what came first.
    """
    reasons = []
    beyond = sigmas(DOUBT_PROBABILITY)
    ages: list[tuple[str, tuple[str, ...], float]] = [
        ("velocities", (VEL_LATENCY_STATE, VEL_LAG_STATE), 1.0)
    ]
    if dated_by_arrival:
        ages.append(("positions", (DELAY_STATE,), -1.0))
    for what, names, sign in ages:
        known = [found[name] for name in names if name in found]
        age = sign * sum(value for value, _ in known)
        sd = math.sqrt(sum(s**2 for _, s in known))
        if age < -limits.LEAST_AGE_S - beyond * sd:
            reasons.append(
                Reason(
                    "negative_delay",
                    f"the receiver's {what} seem to be {-age:.2f} s ahead of what the IMU feels, "
                    "which cannot be: check the stamps of both, and the IMU's axes",
                    inertial=True,
                )
            )
    bounds = (
        (DELAY_STATE, MAX_DELAY_S, "the delay between IMU and fixes"),
        (LATENCY_STATE, MAX_DELAY_S, "the age of the positions"),
        (VEL_LATENCY_STATE, MAX_DELAY_S, "the age of the velocities"),
        (VEL_LAG_STATE, MAX_DELAY_S, "the low-pass of the velocities"),
        (SKEW_STATE, MAX_SKEW, "the skew of the IMU's clock"),
    )
    for name, bound, what in bounds:
        value = found.get(name, (0.0, 0.0))[0]
        if abs(value) > limits.AT_BOUND * bound:
            unit = "" if name == SKEW_STATE else " s"
            why = "the clocks do not belong together; check the stamps with 'automap check'"
            if name in (VEL_LATENCY_STATE, VEL_LAG_STATE):
                why = "the receiver smooths them, or those clocks are two; log those of an instant"
            reasons.append(
                Reason(
                    "delay_at_bound",
                    f"{what} ran to {value:.3g}{unit}, the most that is searched: {why}",
                    inertial=True,
                )
            )
    return reasons


def unexpected_delay(
    found: Estimates, mean: float, sd: float, speed: float, age_sd: float = math.inf
) -> list[Reason]:
    """A delay between IMU and fixes that is none of those expected, ``mean`` and ``sd`` s; the
    vehicle's usual ``speed`` m/s makes a distance of it. One that chance may make still once in
    twenty drives is no doubt, but as unsure as it is off.

    ``age_sd`` s is how far fixes may be from the instant of their tag. Nothing is stamped before it
    is read: a delay below zero is the fixes' age, and more than that where the IMU is late too.
    """
    value, own = found.get(DELAY_STATE, (mean, 0.0))
    off = abs(value - mean)
    early = -value > sigmas(OUTSIDE_95) * math.hypot(age_sd, own)
    if off <= sigmas(OUTSIDE_95) * sd and not early:
        return []
    if early:
        # mean square of the age: the IMU is late by the positive half of a normal distribution
        off = math.sqrt(value**2 + 2.0 * abs(value) * sd * math.sqrt(2.0 / math.pi) + sd**2)
        what = f"the IMU's stamps seem to be {-value:.2f} s before its readings, or the fixes older"
    else:
        # stamps that are late and fixes that are old look alike
        what = f"the IMU's stamps seem to be {value:.2f} s late against the fixes"
    text = (
        f"{what}, where {mean:.2f} s with a sigma of {sd:.2f} s was expected, so the path may be "
        f"{off * speed:.0f} m off along the road: check the clocks of both"
    )
    if abs(value - mean) <= sigmas(DOUBT_PROBABILITY) * sd:
        return [Reason("delay_unexpected", text, late_s=off, state="good")]
    return [Reason("delay_unexpected", text, error_m=off * speed, late_s=off)]


def early_velocities(found: Estimates) -> list[Reason]:
    """Velocities ahead of the positions beside them, which no receiver's are: positions are later
    than they say, or not of a filter that bends as the road does."""
    known = [found[name] for name in (VEL_LATENCY_STATE, VEL_LAG_STATE) if name in found]
    early = -sum(value for value, _ in known)
    if early <= sigmas(OUTSIDE_95) * math.sqrt(sum(sd**2 for _, sd in known)):
        return []
    return [
        Reason(
            "velocities_early",
            f"the receiver's velocities seem to be {early:.2f} s ahead of its positions, as where "
            "its filter overshoots bends, or its antenna is behind where it was stated: the path "
            "is as unsure along the road; turn the receiver's smoothing off, measure its antenna",
            late_s=early,
            state="good",
        )
    ]


def impossible_errors(found: Estimates) -> list[Reason]:
    """Sensor errors larger than any sensor has."""
    reasons = []
    for effect, (most, unit, what) in limits.MOST_SENSOR_ERROR.items():
        size, axis = max(
            ((abs(found[f"{effect}_{a}"][0]), a) for a in "xyz" if f"{effect}_{a}" in found),
            default=(0.0, ""),
        )
        if size > most:
            reasons.append(
                Reason(
                    "sensor_error",
                    f"{what}, axis {axis}, would be {size:.3g}{unit}, more than such a sensor has "
                    f"({most:g}{unit}): check units, axes and signs of the IMU",
                    inertial=True,
                )
            )
    return reasons


def beside_scale(path: Trajectory, found: Estimates) -> Trajectory:
    """The path with velocities as unsure as the scale of the receiver's against them.

    Doppler shifts have no scale. Where one shows, speeds are not of Doppler shifts, or the ways of
    the positions are too short or long: corners that were cut or overshot. Nothing tells which.
    """
    scale = found.get(_SCALE_STATE, (0.0, 0.0))[0]
    return replace(path, sd_vel_ned=np.hypot(path.sd_vel_ned, scale * path.vel_ned))


def levels_at_bound(factors: Mapping[str, float], tuned: bool) -> list[Reason]:
    """Noise levels as large as they may become."""
    most = (FINE if tuned else COARSE).limit
    reasons = []
    for level, what in _LEVELS.items():
        if factors.get(level, 1.0) > limits.AT_BOUND * most:
            reasons.append(
                Reason(
                    "noise_at_bound",
                    f"the {what} is {factors[level]:.0f} times what was assumed, the most that is "
                    "tried: something else is wrong with that sensor; check its units, axes and "
                    "stamps",
                    inertial=level in INERTIAL_LEVELS,
                )
            )
    return reasons


def bend_speed(t: FloatArray, yaw: FloatArray, speed: FloatArray) -> float:
    """The speed, m/s, of the bends that tell an arm: of speeds [n] m/s at ``t`` [n] s, by the
    squared turn rate of the heading ``yaw`` [n] rad, as least squares weigh them."""
    weight = np.gradient(np.unwrap(yaw), t) ** 2 if len(t) > 1 else np.zeros(len(t))
    total = float(weight.sum())
    return float((weight * speed).sum()) / total if total > 0.0 else float(speed.max(initial=0.0))


def arm_by_drive(
    found: Estimates, stated: FloatArray | None, stated_sd: float, speed: float
) -> FloatArray | None:
    """The arm [3] m of the antenna by the drive itself where it contradicts that ``stated`` [3] m
    with a sigma of each; None where it does not.

    A right statement and what the drive makes of it differ by no more than the sigma that the drive
    took from it. The drive by itself has it as much further as the statement held it back. In bends
    at ``speed`` m/s an arm looks like a course that is late by the arm over the speed, and
    receivers that are late are so by differing times: an arm is told beyond all of their age.
    """
    if stated is None:
        return None
    own = np.array(stated, np.float64)
    for k, axis in enumerate("xyz"):
        estimate, sd = found.get(f"gnss_lever_arm_{axis}", (float(stated[k]), stated_sd))
        off = estimate - float(stated[k])
        # of a prior that is looser than the tape the estimate is the drive's own
        taken = stated_sd**2 - sd**2 if sd < stated_sd else stated_sd**2
        if abs(off) > sigmas(DOUBT_PROBABILITY) * math.sqrt(taken):
            own[k] += float(np.clip(off * stated_sd**2 / taken, -MOST_ARM_M, MOST_ARM_M))
    # bends tell the level arm; the upright one moves with whatever a receiver's filter does
    far = float(np.hypot(*(own - stated)[:2]))
    return own if far > limits.ARM_OFF_M + _velocity_lag(found) * speed else None


def _velocity_lag(found: Estimates, *more: str) -> float:
    """How late velocities are, s, and by the states ``more``."""
    names = (VEL_LATENCY_STATE, VEL_LAG_STATE, *more)
    return abs(sum(found.get(name, (0.0, 0.0))[0] for name in names))


def contradicted_arm(
    found: Estimates, stated: FloatArray | None, stated_sd: float, speed: float
) -> list[Reason]:
    """An arm of the antenna, as in ``arm_by_drive``, that the drive moves away from."""
    own = arm_by_drive(found, stated, stated_sd, speed)
    if own is None or stated is None:
        return []
    off = float(np.linalg.norm(own - stated))
    return [
        Reason(
            "lever_arm",
            f"the drive puts the antenna {off:.1f} m or more from lever_arm_m of [gnss], near "
            f"[{', '.join(f'{value:.1f}' for value in own)}]: measure again from the IMU forward, "
            "right and down (an antenna on the roof has a negative third number), or take the "
            "line out",
            error_m=off,
        )
    ]


def overturned_arm(found: Estimates, stated: FloatArray | None, stated_sd: float) -> list[Reason]:
    """The height of an antenna that was ``stated`` [3] m with the wrong sign, by how it sways.

    The filter holds it, and only asks how far the drive would move it. Receivers' filters take from
    the sway: the drive alone has the antenna between where it is and the IMU, or a bit beyond that
    where they lag, and phones' errors put it metres off (4 m, six sigmas, on a recorded one). So it
    is told where it is found nearer to the other sign than to the IMU, or to twice as far.
    """
    value, sd = found.get("gnss_lever_arm_z", (0.0, math.inf))
    held = stated_sd <= sd < math.inf
    before = HELD_ARM_SD_M if held else stated_sd
    taken = before**2 - sd**2 + (stated_sd**2 if held else 0.0)
    if stated is None or taken <= 0.0 or 2.0 * abs(stated[2]) < limits.ARM_OFF_M:
        return []
    size = abs(float(stated[2]))
    # of the drive alone, how far on the other side
    own = (stated[2] - value) * np.sign(stated[2]) * before**2 / taken - size
    sure = sigmas(DOUBT_PROBABILITY) * before**2 / math.sqrt(taken)
    if not max(sure, 0.5 * size) < own < 1.5 * size:
        return []
    return [
        Reason(
            "lever_arm",
            f"lever_arm_m of [gnss] has the antenna {size:.1f} m "
            f"{'below' if stated[2] > 0.0 else 'above'} the IMU, and it sways as one on the other "
            "side of it does: its third number has the wrong sign (down is positive, an antenna on "
            f"the roof has a negative one), and path and signs are {2.0 * size:.1f} m too "
            f"{'high' if stated[2] > 0.0 else 'low'}",
            height_m=2.0 * size,
        )
    ]


def unproven_arm(
    found: Estimates, stated: FloatArray | None, stated_sd: float, speed: float, sd_m: float
) -> list[Reason]:
    """A level arm, as in ``arm_by_drive``, that with the wrong sign would not be told, where that
    is more than what the path is good to anyway, ``sd_m`` m an axis."""
    if stated is None:
        return []
    twice = 2.0 * np.abs(stated[:2])
    sd = np.array([found.get(f"gnss_lever_arm_{a}", (0.0, stated_sd))[1] for a in "xy"])
    taken = np.maximum(stated_sd**2 - sd**2, 0.0)
    seen = twice * np.sqrt(taken) > sigmas(DOUBT_PROBABILITY) * stated_sd**2
    # an arm looks like an age of the course, which may be another than the speed's
    lag = max(_velocity_lag(found), _velocity_lag(found, COURSE_STATE))
    seen &= twice > limits.ARM_OFF_M + lag * speed
    hidden = twice[~seen & (twice > max(limits.ARM_OFF_M, sd_m))]
    if not len(hidden):
        return []
    return [
        Reason(
            "lever_arm_unproven",
            "nothing in the drive shows whether lever_arm_m of [gnss] has the right signs: with a "
            f"wrong one path and signs would be {hidden.max():.1f} m off. In its bends, at "
            f"{speed:.0f} m/s, an arm looks like a receiver's delay; turn once at walking pace, or "
            "measure again from the IMU forward, right and down",
            state="good",
            handled=True,
        )
    ]
