"""What a fusion run begins with: usable readings, screened fixes, and what is known beforehand."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from automap.errors import InputError
from automap.fusion import limits
from automap.fusion.delay_states import DELAY_STATE, LATENCY_STATE
from automap.fusion.gnss_only import smooth_fixes
from automap.fusion.layout import HAS_POS_H
from automap.fusion.measurements.position import age_sd_of
from automap.fusion.nodes import FixModel, model_fixes
from automap.fusion.options import FusionOptions
from automap.fusion.passes import Session
from automap.fusion.result import ARM_UP, Prior
from automap.fusion.screening import Screening, screen_fixes
from automap.fusion.standstill import find_standstill, rest_gyro_bias, shown_speed, unmoved
from automap.fusion.unread import longest_trip, over_holes
from automap.fusion.unusable_readings import bridge_noise, bridge_unusable
from automap.fusion.wheels import Wheels, prepare_wheels
from automap.interpolation import LONGEST_GAP_S
from automap.records import ClockModel, Fixes, FloatArray, ImuData, WheelSpeed

_OF_WHEELS = ("odometer_scale", "odometer_time_offset")
"""What is estimated where a drive has wheel speed."""


@dataclass(frozen=True)
class Beforehand:
    """What a run knows before its passes: fixes as ``stated`` and ``screened``, means and sds of
    states ``in_vehicle`` axes by name, ``arm_sd`` [3] m what of the antenna's arm was not told and
    ``age_sd`` s what dates all fixes wrong, neither being estimated; ``wheels`` None where the
    drive has no wheel speed, and ``warnings``."""

    stated: FixModel
    screened: Screening
    in_vehicle: tuple[Mapping[str, float], Mapping[str, float]]
    arm_sd: FloatArray
    age_sd: float
    wheels: Wheels | None
    warnings: list[str]


def prepare(
    imu: ImuData,
    fixes: Fixes,
    clock: ClockModel,
    options: FusionOptions,
    delay: Prior,
    lever_arm: FloatArray | None,
    lever_arm_sd: float,
    roll_sd: float,
    delay_is_clock: bool,
    odometer: WheelSpeed | None,
) -> tuple[Session, Beforehand]:
    """The session of a drive in the axes of its readings; the arguments as in ``fuse_imu_gnss``.

    Raises:
        InputError: fewer than two usable fixes within the IMU's span, or hardly any samples.
    """
    if len(imu) < 10:
        raise InputError(f"the IMU recording has only {len(imu)} usable samples; record longer")
    imu, made_noise, trips = _usable(imu, fixes, clock, options)
    base_ns = int(imu.t_ns[0])
    fix_t = (clock.t_ns(fixes.gps_s) - base_ns) * 1e-9
    stated = model_fixes(fixes, np.asarray(fix_t), options)
    screened = screen_fixes(stated, options.wander_tau_s)
    model = screened.fixes
    t_imu = np.asarray((imu.t_ns - base_ns) * 1e-9)
    span = (0.0, float(t_imu[-1]))
    near = (model.t > span[0] - limits.FIX_EDGE_S) & (model.t < span[1] + limits.FIX_EDGE_S)
    inside = near & ((model.flags & HAS_POS_H) > 0)
    if int(inside.sum()) < limits.LEAST_FIXES:
        raise InputError(
            f"only {int(inside.sum())} usable fixes fall within the IMU recording "
            f"({span[1]:.0f} s); check the clocks with 'automap check'"
        )
    standstill = find_standstill(t_imu - delay.mean, imu.gyro, imu.accel, *shown_speed(model))
    standstill = unmoved([(a + delay.mean, b + delay.mean) for a, b in standstill], model)
    means = {DELAY_STATE: delay.mean}
    sds = {DELAY_STATE: delay.sd}
    effects = tuple(options.effects)
    # a metre-grade receiver's own filter errs with every turn like an arm of its own, and all
    # filters smooth the sway away by which velocities would tell how high the antenna is
    arm_sd = np.zeros(3)
    if "gnss_lever_arm" not in effects:
        tells_arm = lever_arm is not None or _median_sd(model) < limits.ARM_TOLD_SD_M
        arm_sd[2 if tells_arm else 0 :] = (
            limits.UNKNOWN_ARM_SD_M if lever_arm is None else lever_arm_sd
        )
        effects = (*effects, "gnss_lever_arm") if tells_arm else effects
    age_sd = 0.0 if delay_is_clock else age_sd_of(fixes, clock, options)
    if delay.sd < limits.BETTER_KNOWN * age_sd and "gnss_latency" not in effects:
        # the stamps are known better than the age of the fixes, which looks like their delay
        effects = (*effects, "gnss_latency")
        sds[LATENCY_STATE] = age_sd
    if "gnss_latency" in effects:
        age_sd = 0.0
    rest_bias = rest_gyro_bias(t_imu, imu.gyro, standstill)
    if rest_bias is not None:
        for axis, value in zip("xyz", rest_bias, strict=True):
            means[f"gyro_bias_{axis}"] = float(value)
            sds[f"gyro_bias_{axis}"] = limits.REST_BIAS_SD
    wheels = prepare_wheels(odometer, base_ns, span, model, options)
    readings = None if wheels is None else wheels.odometer
    if readings is not None:
        effects = (*effects, *(e for e in _OF_WHEELS if e not in effects))
    options = replace(options, effects=effects)
    session = Session(imu, model, options, standstill, means, sds, span, readings)
    session = replace(session, made_noise=made_noise)
    known = _in_vehicle(lever_arm, lever_arm_sd, bool(arm_sd[2]), roll_sd)
    warnings = [*trips, *(wheels.warnings if wheels else ())]
    return session, Beforehand(stated, screened, known, arm_sd, age_sd, wheels, warnings)


def _usable(
    imu: ImuData, fixes: Fixes, clock: ClockModel, options: FusionOptions
) -> tuple[ImuData, FloatArray | None, list[str]]:
    """The readings with made-up ones where none can be used, the PSD [n, 2] of what these err by,
    None without any, and what is to be told of other trips."""
    made_noise: FloatArray | None = None
    trips: list[str] = []
    if np.diff(imu.t_ns).max() > LONGEST_GAP_S * 1e9:
        alone = smooth_fixes(fixes, clock, options)
        imu, trips = longest_trip(imu, alone)
        imu, made_noise = over_holes(imu, alone)
    bridged = bridge_unusable(imu)
    if bridged.stretch_s.any():
        gaps = options.gap_force_sd, options.gap_rate_sd
        noise = bridge_noise(bridged.stretch_s, *gaps)
        made_noise = noise if made_noise is None else made_noise + noise
    return bridged.imu, made_noise, trips


def _in_vehicle(
    lever_arm: FloatArray | None, lever_arm_sd: float, up_held: bool, roll_sd: float
) -> tuple[dict[str, float], dict[str, float]]:
    """Means and sds of what is stated in the vehicle's axes; ``up_held``: the arm's height is not
    estimated."""
    # level is what the IMU says it is: the constraint cannot tell the roll of the mounting
    sds = {"imu_mounting_roll": max(roll_sd, limits.KNOWN_ROLL_SD)}
    if lever_arm is None:
        return {}, sds
    means = {f"gnss_lever_arm_{a}": float(v) for a, v in zip("xyz", lever_arm, strict=True)}
    sds |= dict.fromkeys(means, lever_arm_sd)
    # one that is held at what is wrong by half a metre would bend delays and the arm's others
    if up_held:
        sds[ARM_UP] = limits.HELD_ARM_SD_M
    return means, sds


def _median_sd(model: FixModel) -> float:
    """The level accuracy that fixes state, m."""
    has = (model.flags & HAS_POS_H) > 0
    return float(np.median(model.stated_sd[has, :2])) if has.any() else np.inf
