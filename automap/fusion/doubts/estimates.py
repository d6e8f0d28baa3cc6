"""Estimates that cannot be: delays, scales, biases, noise levels that ran to their bounds."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from automap.fusion.adapt import COARSE, FINE
from automap.fusion.delay_states import (
    DELAY_STATE,
    LATENCY_STATE,
    SKEW_STATE,
    VEL_LAG_STATE,
    VEL_LATENCY_STATE,
)
from automap.fusion.doubts import limits
from automap.fusion.doubts.reason import Reason, State
from automap.fusion.limits import (
    DOUBT_PROBABILITY,
    MAX_DELAY_S,
    MAX_SKEW,
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


def of_axes(found: Estimates, effect: str) -> FloatArray:
    """An estimate's three axes, zero where it was not estimated."""
    return np.array([found.get(f"{effect}_{axis}", (0.0, 0.0))[0] for axis in "xyz"])


def impossible_ages(
    found: Estimates, dated_by_arrival: bool, expected_s: float = 0.0
) -> list[Reason]:
    """Fixes and velocities from the future, delays and skews that ran to their bounds.

    ``dated_by_arrival``: the delay of the IMU's stamps is minus the age of the fixes on arrival. A
    clock that was found by the motions has the age of the receiver's velocities in it, and says
    nothing of what came first. What is ahead of positions that are themselves old is of its own
    time. ``expected_s`` the delay about which it was looked for.
    """
    reasons = []
    beyond = sigmas(DOUBT_PROBABILITY)
    lead, lead_sd = velocity_lead(found)
    late, late_sd = found.get(DELAY_STATE, (0.0, 0.0))
    ages = [("velocities", lead + min(late, 0.0), math.hypot(lead_sd, late_sd))]
    if dated_by_arrival:
        ages.append(("positions", late, late_sd))
    for what, ahead, sd in ages:
        if ahead > limits.LEAST_AGE_S + beyond * sd:
            reasons.append(
                Reason(
                    "negative_delay",
                    f"the receiver's {what} seem to be {ahead:.2f} s ahead of what the IMU feels, "
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
        about = expected_s if name == DELAY_STATE else 0.0
        if abs(value - about) > limits.AT_BOUND * bound:
            unit = "" if name == SKEW_STATE else " s"
            why = "the clocks do not belong together; check the stamps with 'automap check'"
            of_velocities = name in (VEL_LATENCY_STATE, VEL_LAG_STATE)
            if of_velocities:
                why = "the receiver smooths them, or those clocks are two; log those of an instant"
            reasons.append(
                Reason(
                    "delay_at_bound",
                    f"{what} ran to {value:.3g}{unit}, the most that is searched: {why}",
                    # a receiver smooths its velocities whatever the IMU does
                    inertial=not of_velocities,
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


def velocity_lead(found: Estimates) -> tuple[float, float]:
    """By how much velocities are ahead of the positions beside them, and its sigma, s."""
    known = [found[name] for name in (VEL_LATENCY_STATE, VEL_LAG_STATE) if name in found]
    return -math.fsum(value for value, _ in known), math.hypot(*(sd for _, sd in known))


def early_velocities(found: Estimates) -> list[Reason]:
    """Velocities ahead of the positions beside them, which no receiver's are: positions are later
    than they say, or not of a filter that bends as the road does."""
    early, sd = velocity_lead(found)
    if early <= sigmas(OUTSIDE_95) * sd:
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


def impossible_errors(found: Estimates, fixes_part: bool = False) -> list[Reason]:
    """Sensor errors larger than any sensor has; ``fixes_part``: innovations of the fixes are as
    wrong, and a filter in the receiver is as likely the cause."""
    why = "check units, axes and signs of the IMU"
    if fixes_part:
        why += ", or what the receiver smooths: its fixes contradict the path for long, too"
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
                    f"({most:g}{unit}): {why}",
                    inertial=not fixes_part,
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


def levels_at_bound(
    factors: Mapping[str, float], tuned: bool, shaken: Mapping[str, float] = MappingProxyType({})
) -> list[Reason]:
    """Noise levels as large as they may become, and those that are larger since the readings of an
    IMU are ``shaken`` by as much from one to the next."""
    search = FINE if tuned else COARSE
    reasons = []
    for level, what in _LEVELS.items():
        factor = factors.get(level, 1.0)
        if factor <= limits.AT_BOUND * search.limit:
            continue
        _, most = search.bounds(level, {}, shaken)
        at_end = factor > limits.AT_BOUND * most
        folds = search.limit <= search.factor * shaken.get(level, 0.0)
        why = (
            "its readings differ by as much from one to the next, as what shakes a sensor faster "
            "than it is read makes them: record at 50 Hz or more, and name the sensor in [imu]"
            if folds
            else "something else is wrong with that sensor; check its units, axes and stamps"
        )
        tried = ", the most that is tried" if at_end else ", which the stated uncertainty includes"
        text = f"the {what} is {factor:.0f} times what was assumed{tried}: {why}"
        inertial = level in INERTIAL_LEVELS and not folds
        state: State = "doubtful" if at_end else "good"
        reasons.append(Reason("noise_at_bound", text, inertial=inertial, state=state))
    return reasons
