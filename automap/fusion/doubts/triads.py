"""Gyro and accelerometer against each other: do both feel a bend at once?"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from scipy.ndimage import uniform_filter1d

from automap.fusion.doubts import limits
from automap.fusion.doubts.reason import Reason
from automap.fusion.gnss_only import TO_AXLE_SD
from automap.fusion.limits import DOUBT_PROBABILITY, DRIVING_SPEED, LEAST_JUDGED, MAX_DELAY_S
from automap.gates import OUTSIDE_95, sd_by_median, sigmas
from automap.records import BoolArray, FloatArray, ImuData
from automap.robust import cauchy_weight


class _Bends(NamedTuple):
    """On a grid of ``BEND_STEP_S``: sideways ``force`` [n] m/s^2, ``rate`` [n] rad/s of turn,
    ``speed`` [n] m/s, and where the vehicle was read while it ``drives`` [n]."""

    t: FloatArray
    force: FloatArray
    rate: FloatArray
    speed: FloatArray
    drives: BoolArray


def triad_doubts(imu: ImuData, turn: FloatArray, speed: FloatArray) -> Iterator[Reason]:
    """Whether the accelerometer of ``imu``, ``turn`` [3, 3] to vehicle axes, feels bends when the
    gyro does; ``speed`` [n] m/s of the vehicle at each reading.

    What chance and tyres may make still once in twenty drives is no doubt of the readings, but
    headings in bends are as unsure.
    """
    rare = sigmas(DOUBT_PROBABILITY)
    found = lateness(imu, turn, speed)
    if found is not None and abs(found[0]) > limits.TRIADS_APART_S + rare * found[1]:
        usual = float(np.median(speed[speed > DRIVING_SPEED]))
        # nothing says which of the two is right
        yield _apart(*found, doubtful=True, error_m=abs(found[0]) * usual)
        return
    found = following(imu, turn, speed)
    if found is None:
        return
    late, sd = found
    # tyres that slip and bodies that lean make the accelerometer late, never the gyro
    beyond = abs(late) - (limits.TRIADS_APART_S if late > 0.0 else limits.BEND_STEP_S)
    if beyond > sigmas(OUTSIDE_95) * sd:
        yield _apart(late, sd, doubtful=beyond > rare * sd)


def _apart(late: float, sd: float, doubtful: bool, error_m: float = 0.0) -> Reason:
    first, other = ("gyro", "accelerometer") if late > 0.0 else ("accelerometer", "gyro")
    return Reason(
        "triads_apart",
        f"the IMU's {other} feels bends {abs(late):.2f} s after its {first} (sigma {sd:.2f} s), so "
        f"headings and tilts in bends {'are' if doubtful else 'may be'} wrong: stamp both when "
        f"they are read, or take the delay or filter out of the columns of the {other}",
        error_m=error_m,
        moved_s=abs(late),
        state="doubtful" if doubtful else "good",
        inertial=doubtful,
    )


def _bends(imu: ImuData, turn: FloatArray, speed: FloatArray) -> _Bends | None:
    stamps = np.asarray((imu.t_ns - imu.t_ns[0]) * 1e-9)
    t = np.arange(0.0, stamps[-1], limits.BEND_STEP_S)
    between = np.diff(stamps)
    if len(t) < LEAST_JUDGED or not (between > 0.0).all():
        return None
    spacing = float(np.median(between))
    force, rate, v = (
        np.interp(t, stamps, uniform_filter1d(v, max(round(2.0 * limits.BEND_STEP_S / spacing), 1)))
        for v in (imu.accel @ turn[1], imu.gyro @ turn[2], speed)
    )
    # no reading within a gap tells when
    apart = np.abs(stamps[np.clip(np.searchsorted(stamps, t), 0, len(stamps) - 1)] - t)
    drives = (v > DRIVING_SPEED) & (apart < limits.BEND_STEP_S)
    if np.count_nonzero(drives) < LEAST_JUDGED:
        return None
    return _Bends(t, force, rate, v, drives)


def _calm(values: FloatArray) -> FloatArray:
    """A rate's change is small beside its noise, and what is lost of it would look like a delay."""
    return np.asarray(uniform_filter1d(values, max(round(limits.BEND_S / limits.BEND_STEP_S), 1)))


def following(imu: ImuData, turn: FloatArray, speed: FloatArray) -> tuple[float, float] | None:
    """The time constant, s, behind which the accelerometer follows bends against the gyro, below
    zero where the gyro does, and its sigma; None without bends.

    A low-pass takes off speed times change of rate, however fast the vehicle is; an IMU ahead of
    the axle feels the arm times it, and no arm is longer than a vehicle.
    """
    bends = _bends(imu, turn, speed)
    if bends is None:
        return None
    rows, change = bends.drives, np.gradient(_calm(bends.rate), limits.BEND_STEP_S)
    force = _calm(bends.force)[rows]
    columns = [np.ones_like(change), _calm(bends.speed * bends.rate), change, bends.speed * change]
    design = np.column_stack(columns)[rows]
    # neighbouring rests resemble each other for as long as the road does
    many = max(limits.ROAD_FORCE_S / limits.BEND_STEP_S, 1.0)
    prior = np.array([0.0, 0.0, 1.0 / TO_AXLE_SD**2, 0.0])
    scale, weight = float(np.std(force)), np.ones(len(force))
    for _ in range(limits.SLOPE_ROUNDS):
        normal = (design * weight[:, None]).T @ design / (many * scale**2) + np.diag(prior)
        cov = np.linalg.pinv(normal)
        slopes = cov @ ((design * weight[:, None]).T @ force) / (many * scale**2)
        rest = force - design @ slopes
        scale = sd_by_median(rest) + 1e-9
        weight = cauchy_weight((rest / scale) ** 2)
    told = 1.0 - (float(np.std(rest)) / max(float(np.std(force)), 1e-9)) ** 2
    if told < limits.SLOPE_CORRELATION**2 or slopes[1] <= 0.0:
        return None
    return float(-slopes[3] / slopes[1]), float(np.sqrt(cov[3, 3]) / slopes[1])


def lateness(imu: ImuData, turn: FloatArray, speed: FloatArray) -> tuple[float, float] | None:
    """How much later, s, the accelerometer feels bends than the gyro, and its sigma; None without
    bends.

    The sideways force is speed times rate, of the instant or, were it late, of before. An IMU ahead
    of the axle that does not slide feels besides by how much the rate changes, and one in a body
    that leans more of both.
    """
    bends = _bends(imu, turn, speed)
    if bends is None:
        return None
    t, force, rate, v, driving = bends
    calm = _calm(rate)
    spread = float(np.std(force[driving]))
    best: tuple[float, float, float, float] | None = None
    for lag in np.arange(-MAX_DELAY_S, MAX_DELAY_S + 1e-9, limits.BEND_STEP_S):
        bend = np.interp(t - lag, t, v * rate)
        change = np.gradient(np.interp(t - lag, t, calm), limits.BEND_STEP_S)
        rest, late_power = _left(force[driving], bend[driving], change[driving])
        scale = 1.4826 * float(np.median(np.abs(rest))) + 1e-9
        cost = float(np.log1p((rest / scale) ** 2).sum()) + len(rest) * np.log(scale)
        if best is None or cost < best[0]:
            # neighbouring rests resemble each other for as long as the road does
            many = max(limits.ROAD_FORCE_S / limits.BEND_STEP_S, 1.0)
            sd = float(scale * np.sqrt(many / max(late_power, 1e-12)))
            best = cost, float(lag), sd, 1.0 - (float(np.std(rest)) / max(spread, 1e-9)) ** 2
    assert best is not None
    if best[3] < limits.SLOPE_CORRELATION**2:
        return None
    # anywhere within a step
    return best[1], float(np.hypot(best[2], limits.BEND_STEP_S / np.sqrt(12.0)))


def _left(force: FloatArray, bend: FloatArray, change: FloatArray) -> tuple[FloatArray, float]:
    """What no bias, bend or change of rate explains of ``force`` [n], and the sum of squares that a
    delay of a second would bring, beside what these explain of it."""
    design = np.column_stack([np.ones_like(bend), bend, change])
    weight = np.ones(len(force))
    rest = force
    for _ in range(limits.SLOPE_ROUNDS):
        normal = (design * weight[:, None]).T @ design
        rest = force - design @ np.linalg.lstsq(normal, (design * weight[:, None]).T @ force)[0]
        weight = cauchy_weight((rest / (1.4826 * float(np.median(np.abs(rest))) + 1e-9)) ** 2)
    slope = np.gradient(bend, limits.BEND_STEP_S)
    left = slope - design @ np.linalg.lstsq(design, slope)[0]
    return rest, float(weight @ left**2)
