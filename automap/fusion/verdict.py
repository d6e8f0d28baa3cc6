"""The verdict on a path: may it be relied on, and if not, why not and what to do.

Every kind of evidence (``doubts``) gives its reasons. A doubtful path is given sigmas as large as
the contradictions, in the stretches where they are. Where the IMU makes the path worse
than the fixes alone, the path is that of the fixes alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from automap.errors import InputError
from automap.fusion.aside import Aside
from automap.fusion.consistency import (
    channel_consistency,
    innovation_doubts,
    on_straights,
    slides,
)
from automap.fusion.delay_states import LATENCY_STATE
from automap.fusion.doubts import limits, outcome
from automap.fusion.doubts.antenna import (
    arm_by_drive,
    bend_speed,
    contradicted_arm,
    misplaced_antenna,
    overturned_arm,
    unproven_arm,
)
from automap.fusion.doubts.astray import CODES, beside_imu
from automap.fusion.doubts.bridged import in_any, outside
from automap.fusion.doubts.constancy import constancy_doubts
from automap.fusion.doubts.difference import off_course
from automap.fusion.doubts.estimates import (
    Estimates,
    beside_scale,
    early_velocities,
    final_estimates,
    impossible_ages,
    impossible_errors,
    levels_at_bound,
    of_axes,
    unexpected_delay,
)
from automap.fusion.doubts.heights import height_doubts, separation_doubts
from automap.fusion.doubts.hole import hole_doubts, regained_jumps
from automap.fusion.doubts.larger_errors import larger_errors
from automap.fusion.doubts.own_velocities import smoothed_doubts
from automap.fusion.doubts.path import fix_misses, off_the_fixes
from automap.fusion.doubts.position_jump import (
    Jump,
    beside_readings,
    height_jumps,
    heights_of,
    jump_doubts,
    places_of,
    position_jumps,
)
from automap.fusion.doubts.reason import Reason, Span
from automap.fusion.doubts.receiver import (
    accuracy_doubts,
    dated_velocities,
    overstated,
    receiver_doubts,
    told_late,
)
from automap.fusion.doubts.sideways import sideways
from automap.fusion.doubts.slow_drift import Drift, drifting, pattern_doubts
from automap.fusion.doubts.velocity_step import compare, step_doubts, told_times, velocity_steps
from automap.fusion.fix_levels import fix_levels
from automap.fusion.free_inertial import FreeInertial
from automap.fusion.gnss_only import as_old_as, as_sure_as_fixes, smooth_fixes, uncorrected
from automap.fusion.inertial_evidence import of_readings
from automap.fusion.levels import VELOCITY_WANDER
from automap.fusion.limits import STATED_ARM_SD_M, UNKNOWN_HEADING_SD
from automap.fusion.measurements.position import age_sd_of, by_carrier
from automap.fusion.nodes import as_shown, model_fixes
from automap.fusion.options import FusionOptions
from automap.fusion.rest_noise import shaken_levels
from automap.fusion.result import FusionResult, Prior
from automap.fusion.unread import driven_m, joined, later, unread
from automap.fusion.verdict_alone import at_sensor, seen_at_sensor
from automap.fusion.weighed import Weighed, level_sd, weighed_path
from automap.fusion.widening import widen, widening
from automap.records import ClockModel, Fixes, FloatArray, ImuData, Trajectory
from automap.sync.velocity_findings import VelocityConsistency


def weigh(
    result: FusionResult,
    fused: Aside,
    read_imu: Callable[[], ImuData],
    as_read: Callable[[ImuData], ImuData],
    fixes: Fixes,
    clock: ClockModel,
    options: FusionOptions,
    delay: Prior,
    delay_is_clock: bool,
    receiver: VelocityConsistency,
    lever_arm: FloatArray | None = None,
) -> Weighed:
    """Judge a fused path, put aside, by what it was made of.

    ``read_imu`` reads the readings, ``as_read`` gives them in the sensor's own axes; ``fixes`` as
    they were fused, ``delay`` and ``delay_is_clock`` as in ``fuse_imu_gnss``; ``receiver`` what the
    fixes as recorded say of each other; ``lever_arm`` [3] m to the antenna as it was stated.
    """
    found = final_estimates(result)
    path = fused.motion()
    speed = np.hypot(path.vel_ned[:, 0], path.vel_ned[:, 1])
    larger = larger_errors(fixes, result, options)
    fixes, receiver = larger.fixes, larger.unheld_of(receiver)
    stated = model_fixes(fixes, fixes.gps_s, options)
    places = places_of(stated)
    heights = heights_of(stated)
    fix_s = np.concatenate([places.t, heights.t]) - path.gps_s[0]
    wanted = np.concatenate([*told_times(fixes, path, found), fix_s])
    channels = channel_consistency(result.innovations)
    parting = innovation_doubts(channels)
    of_estimates = [
        *impossible_ages(found, delay_is_clock and clock.method == "arrival", delay.mean),
        *impossible_errors(found, bool(parting)),
        *outcome.leaning(path),
    ]
    gps_s = path.gps_s
    del path  # readings and path of ten hours are not looked at side by side
    readings = of_readings(
        *(read_imu, as_read, result, fused.t_ns, gps_s, speed, fixes, clock),
        *(found, wanted, delay_is_clock, of_estimates),
    )
    path = fused.motion()
    of_imu = [*readings.alone, *of_estimates]
    at_bound = levels_at_bound(result.noise_factors, options.tune)
    if any(reason.inertial for reason in at_bound):
        shaken = shaken_levels(read_imu(), options)
        at_bound = levels_at_bound(result.noise_factors, options.tune, shaken)
    felt = not any(reason.inertial for reason in (*of_imu, *at_bound))
    of_receiver = receiver_doubts(receiver, float(path.gps_s[0]), felt)
    of_receiver += [*smoothed_doubts(fixes, receiver), *accuracy_doubts(fixes, options)]
    of_receiver += separation_doubts(fixes, of_receiver)
    contradictions = [reason for reason in of_receiver if reason.code in CODES]
    askew, lean = outcome.mounted_askew(path, fused.sd_roll())

    def known() -> Iterator[tuple[slice, Trajectory]]:
        for rows, stretch in fused.stretches():
            leaning_too = np.hypot(stretch.sd_rpy, [lean, 0.0, 0.0])
            unsure = beside_scale(replace(stretch, sd_rpy=leaning_too), found)
            yield rows, uncorrected(unsure, fixes, options)

    of_imu += readings.triads
    free, t_read = readings.free, readings.t_ns
    believed = free is not None
    del readings
    if any(reason.code == "path_leans" for reason in of_imu):
        askew = []  # the same, and worse
    # an arm that is wrong makes jumps of velocity in bends
    bends = bend_speed(path.gps_s - path.gps_s[0], path.rpy[:, 2], speed)
    arm = arm_by_drive(found, lever_arm, STATED_ARM_SD_M, bends)
    arm = of_axes(found, "gnss_lever_arm") if arm is None else arm
    axle = of_axes(found, "nhc_lever_arm")
    lifts = found.get("vehicle_pitch_coefficient", (0.0, 0.0))[0]
    steps: list[Reason] = []
    over: list[Span] = []
    witnesses = fixes
    jumps: list[Jump] = []
    of_heights = height_jumps(stated, path)
    if free is not None:
        age = found.get(LATENCY_STATE, (0.0, 0.0))[0]
        places = beside_readings(places, free, path, arm, age)
        high = beside_readings(heights, free, path, arm, age)
        of_heights += position_jumps(high)
        # readings of an instant are stamped later by the delay
        late = age - (0.0 if delay_is_clock else result.delay.mean)
        jumps = regained_jumps(stated, result.innovations, path, late)
        beside = fix_misses(path, stated, arm, age)
        ends = float(path.gps_s[0]), float(path.gps_s[-1])
        good_to = age, level_sd(part for _, part in known())
        of_receiver = beside_imu(of_receiver, receiver.parted, places, high, beside, ends, *good_to)
        over = [span for reason in of_receiver if reason.led for span in reason.spans]
        of_heights = _elsewhere(of_heights, over, ends[0])
        witnesses = _without(fixes, over, ends[0] + age)
        of_receiver += hole_doubts(places, path, *good_to)
        steps = _steps(result, path, free, found, fixes, options, arm, over)
        free = None  # of ten hours a hundred megabytes
    drifts: list[Drift] = []

    def smoothed(dated: Fixes, levels: dict[str, float]) -> Trajectory:
        alone = smooth_fixes(dated, clock, options, levels)
        shift = round(result.delay.mean * 1e9) if delay_is_clock else 0
        return replace(alone, t_ns=alone.t_ns + shift)

    try:
        dated = dated_velocities(witnesses, receiver)
        levels = fix_levels(dated, options)
        alone = smoothed(dated, levels)
        sd = level_sd(stretch for _, stretch in known())
        by_imu = (path, result.noise_factors) if believed else ()
        more, drifts = pattern_doubts(dated, alone, options, levels, sd, of_receiver, *by_imu)
        of_receiver += more
        unread_m = driven_m(unread(alone, t_read))
    except InputError:
        alone, unread_m = None, 0.0
    scaled = any(reason.code == "height_scale" for reason in of_receiver)
    off = math.inf if alone is None else off_course(path, alone)
    # a delay that is the clock's is minus the receiver's, and of any sign
    clock_only = delay_is_clock or LATENCY_STATE in found
    age_sd = math.inf if clock_only else age_sd_of(fixes, clock, options)
    side = result.innovations
    if late := told_late(receiver.match.course_lag_s):
        side = on_straights(side, path, late)
    sliding = slides(channel_consistency(side))
    # what comes later to bends looks older than it is, too
    misplaced = misplaced_antenna(found, receiver.match, bends)
    usual_speed = float(np.median(speed))
    reasons = [
        *of_receiver,
        *jump_doubts(
            larger.unheld([*_elsewhere(position_jumps(places), over, path.gps_s[0]), *jumps]), path
        ),
        *jump_doubts(larger.unheld(of_heights), path),
        *steps,
        *of_imu,
        *(misplaced or unexpected_delay(found, delay.mean, delay.sd, usual_speed, age_sd)),
        *(() if misplaced else early_velocities(found)),
        *(constancy_doubts(result.filtered_parameters, by_carrier(fixes)) if believed else ()),
        *(
            _of_arm(found, lever_arm, bends, level_sd(part for _, part in known()))
            if believed
            else ()
        ),
        *(height_doubts(path, fixes, lifts) if believed and not scaled else ()),
        *askew,
        *outcome.weak_heading(result.align_margin, off),
        *at_bound,
        *sideways((part for _, part in fused.stretches()), options, axle),
        *outcome.refused(result.innovations),
        *parting,
        *sliding,
    ]
    model = as_shown(stated, options, result.noise_factors)
    at = of_axes(found, "gnss_lever_arm"), found.get(LATENCY_STATE, (0.0, 0.0))[0]
    misses = outside(fix_misses(path, model, *at), over)
    old = math.hypot(age_sd_of(fixes, clock, options), result.delay.sd)
    reasons += overstated(fix_misses(path, stated, *at))
    far, share = off_the_fixes(misses, options.wander_tau_s)
    reasons += far
    blamed = any(reason.inertial for reason in reasons)
    most = limits.BLAMED_SHARE if blamed else limits.WORSE_SHARE
    # where the receiver jumps its fixes are no better
    if alone is not None and not steps and share > most:
        beside = fix_misses(alone, model)
        own, left = off_the_fixes(beside, options.wander_tau_s)
        if left < limits.AGREEING_SHARE:
            if over:
                # what such an IMU leads over it tells nothing of
                alone = smoothed(dated_velocities(fixes, receiver), levels)
                beside = fix_misses(alone, model)
                of_receiver, reasons = (
                    [*contradictions, *(reason for reason in told if reason.code not in CODES)]
                    for told in (of_receiver, reasons)
                )
            # what speaks against the IMU's path leaves that of the fixes as it is
            earlier = float(path.gps_s[0] - alone.gps_s[0])
            of_fixes = [*later(of_receiver, earlier), *own]
            rest = as_sure_as_fixes(alone, fixes, options, levels)
            rest = as_old_as(rest, old)
            rest = _off_nose(widen(rest, of_fixes, beside, None), sliding)
            reasons = later([outcome.inertial_worse(share), *reasons], earlier)
            moved = at_sensor(drifting(rest, drifts), lever_arm)
            return weighed_path(lambda: iter([moved]), reasons, alone=True)
    near = None if alone is None else seen_at_sensor(alone, *at)
    widened = widening(path, reasons, misses, near)

    def run() -> Iterator[Trajectory]:
        for rows, stretch in known():
            yield drifting(widened(stretch, rows), drifts)

    if alone is None or not len(unread(alone, path.t_ns)):
        return replace(weighed_path(run, reasons, False), unread_m=unread_m)
    earlier = float(path.gps_s[0] - alone.gps_s[0])
    rest = as_old_as(as_sure_as_fixes(alone, fixes, options, levels), old)
    rest = widen(rest, later(of_receiver, earlier), fix_misses(alone, model), None)
    rest = unread(at_sensor(drifting(rest, drifts), arm), path.t_ns)
    reasons = later(reasons, max(float(path.gps_s[0] - rest.gps_s[0]), 0.0))
    weighed = weighed_path(lambda: joined(run(), rest), reasons, False)
    return replace(weighed, unread_m=unread_m)


def _off_nose(path: Trajectory, sliding: Sequence[Reason]) -> Trajectory:
    """A path with courses for headings, which are no better than the nose of one that slides."""
    factor = max((reason.factor for reason in sliding), default=1.0)
    return replace(path, sd_rpy=np.minimum(path.sd_rpy * factor, UNKNOWN_HEADING_SD))


def _of_arm(found: Estimates, stated: FloatArray | None, speed: float, sd_m: float) -> list[Reason]:
    """What the drive says of an arm of the antenna that was ``stated``, or that it says nothing."""
    at = found, stated, STATED_ARM_SD_M, speed
    overturned = overturned_arm(found, stated, STATED_ARM_SD_M)
    return [*overturned, *(contradicted_arm(*at) or unproven_arm(*at, sd_m))]


def _without(fixes: Fixes, over: Sequence[Span], zero: float) -> Fixes:
    """The fixes without what they tell in the stretches that the IMU leads ``over``, tagged
    ``zero`` s later."""
    there = in_any(fixes.gps_s - zero, over)
    return replace(
        fixes,
        lat_rad=np.where(there, np.nan, fixes.lat_rad),
        lon_rad=np.where(there, np.nan, fixes.lon_rad),
        vel_ned=np.where(there[:, None], np.nan, fixes.vel_ned),
    )


def _elsewhere(jumps: Sequence[Jump], over: Sequence[Span], start_gps_s: float) -> list[Jump]:
    """The ``jumps`` but those in stretches, or at their ends, that the IMU leads ``over``."""
    reach = limits.STEP_WINDOW_S
    wide = [(start_gps_s + a - reach, start_gps_s + b + reach) for a, b in over]
    at = np.array([jump.gps_s for jump in jumps])
    return [jump for jump, there in zip(jumps, in_any(at, wide), strict=True) if not there]


def _steps(
    result: FusionResult,
    path: Trajectory,
    free: FreeInertial,
    found: Estimates,
    fixes: Fixes,
    options: FusionOptions,
    arm: FloatArray,
    over: Sequence[Span],
) -> list[Reason]:
    """The reason that jumps of the receiver's velocity give, at ``arm`` [3] m from the IMU, but in
    stretches that the IMU leads ``over``."""
    seen = compare(free, fixes, path, found, arm)
    # the less a drive seems to show of what comes and goes, the less it is believed
    wander = options.velocity_wander_sd * max(result.noise_factors.get(VELOCITY_WANDER, 1.0), 1.0)
    steps = velocity_steps(seen, wander)
    steps = [step for step in steps if not any(a <= step.t <= b for a, b in over)]
    return step_doubts(steps, path)
