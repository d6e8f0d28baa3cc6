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
from automap.fusion.doubts.bridged import outside
from automap.fusion.doubts.constancy import constancy_doubts
from automap.fusion.doubts.difference import off_course
from automap.fusion.doubts.estimates import early_velocities, of_axes, unexpected_delay
from automap.fusion.doubts.heights import height_doubts
from automap.fusion.doubts.path import fix_misses, off_the_fixes
from automap.fusion.doubts.reason import Reason
from automap.fusion.doubts.receiver import overstated, told_late
from automap.fusion.doubts.sideways import sideways
from automap.fusion.doubts.slow_drift import drifting
from automap.fusion.fixes_beside import between_readings, fixes_alone, in_its_place
from automap.fusion.inertial_evidence import of_readings
from automap.fusion.judged import Judged
from automap.fusion.limits import STATED_ARM_SD_M
from automap.fusion.measurements.position import age_sd_of, by_carrier
from automap.fusion.nodes import as_shown
from automap.fusion.receiver_evidence import of_fixes
from automap.fusion.unread import driven_m, unread
from automap.fusion.verdict_alone import seen_at_sensor
from automap.fusion.weighed import Weighed, weighed_path
from automap.fusion.widening import widening
from automap.records import ImuData, Trajectory


def weigh(
    drive: Judged, read_imu: Callable[[], ImuData], as_read: Callable[[ImuData], ImuData]
) -> Weighed:
    """Judge a fused path, put aside, by what it was made of.

    ``read_imu`` reads the readings, ``as_read`` gives them in the sensor's own axes.
    """
    result, fused, options, lever_arm = drive.result, drive.fused, drive.options, drive.lever_arm
    found, innovations = drive.found, result.innovations
    parting = innovation_doubts(channel_consistency(innovations))
    inertial = of_readings(drive, read_imu, as_read, bool(parting))
    path = fused.motion()
    askew, lean = outcome.mounted_askew(path, fused.sd_roll())
    if any(reason.code == "path_leans" for reason in inertial.reasons):
        askew = []  # the same, and worse
    sd_m = drive.sd_m(lean)
    speed = np.hypot(path.vel_ned[:, 0], path.vel_ned[:, 1])
    # an arm that is wrong makes jumps of velocity in bends
    bends = bend_speed(path.gps_s - path.gps_s[0], path.rpy[:, 2], speed)
    arm = arm_by_drive(found, lever_arm, STATED_ARM_SD_M, bends)
    arm = drive.arm if arm is None else arm
    believed = inertial.free is not None
    beside = of_fixes(drive, path, inertial.free, arm, not inertial.blamed, sd_m)
    inertial = replace(inertial, free=None)  # of ten hours a hundred megabytes
    alone = fixes_alone(drive, beside, sd_m, path if believed else None)
    of_receiver = [*beside.reasons, *(alone.reasons if alone else ())]
    late = told_late(drive.receiver.match.course_lag_s)
    straight = on_straights(innovations, path, late) if late else innovations
    sliding = slides(channel_consistency(straight))
    reasons = [
        *of_receiver,
        *beside.jumps,
        *beside.steps,
        *inertial.reasons,
        *_of_instants(drive, bends, float(np.median(speed))),
        *(_of_installation(drive, path, bends, sd_m, of_receiver) if believed else ()),
        *askew,
        *outcome.weak_heading(
            result.align_margin, off_course(path, alone.path) if alone else math.inf
        ),
        *inertial.at_bound,
        *sideways(
            (part for _, part in fused.stretches()), options, of_axes(found, "nhc_lever_arm")
        ),
        *outcome.refused(innovations),
        *parting,
        *sliding,
    ]
    model = as_shown(drive.stated, options, result.noise_factors)
    misses = outside(fix_misses(path, model, drive.arm, drive.age_s), beside.over)
    reasons += overstated(fix_misses(path, drive.stated, drive.arm, drive.age_s))
    far, share = off_the_fixes(misses, options.wander_tau_s)
    reasons += far
    blamed = any(reason.inertial for reason in reasons)
    most = limits.BLAMED_SHARE if blamed else limits.WORSE_SHARE
    # where the receiver jumps its fixes are no better
    if alone is not None and not beside.steps and share > most:
        instead = in_its_place(drive, beside, alone, model, share, path, reasons, sliding)
        if instead is not None:
            return instead
    near = None if alone is None else seen_at_sensor(alone.path, drive.arm, drive.age_s)
    widened = widening(path, reasons, misses, near)

    def run() -> Iterator[Trajectory]:
        for rows, stretch in drive.known(lean):
            yield drifting(widened(stretch, rows), alone.drifts if alone else [])

    if alone is None:
        return weighed_path(run, reasons, False)
    weighed = between_readings(drive, beside, alone, model, arm, path, run, reasons)
    return replace(weighed, unread_m=driven_m(unread(alone.path, inertial.t_ns)))


def _of_instants(drive: Judged, bends: float, usual_speed: float) -> list[Reason]:
    """What speaks against how fixes, velocities and readings were dated, at a ``usual_speed`` and
    with ``bends`` m/s; what comes later to bends looks older than it is, too."""
    misplaced = misplaced_antenna(drive.found, drive.receiver.match, bends)
    if misplaced:
        return list(misplaced)
    # a delay that is the clock's is minus the receiver's, and of any sign
    clock_only = drive.delay_is_clock or LATENCY_STATE in drive.found
    age_sd = math.inf if clock_only else age_sd_of(drive.fixes, drive.clock, drive.options)
    expected = drive.delay.mean, drive.delay.sd
    late = unexpected_delay(drive.found, *expected, usual_speed, age_sd)
    return [*late, *early_velocities(drive.found)]


def _of_installation(
    drive: Judged, path: Trajectory, bends: float, sd_m: float, of_receiver: Sequence[Reason]
) -> list[Reason]:
    """What a sound IMU says of what it does not stay by, of the arm to the antenna in ``bends``
    m/s, on a path good to ``sd_m`` m an axis, and of heights that ``of_receiver`` says nothing of
    already."""
    found, stated = drive.found, drive.lever_arm
    constancy = constancy_doubts(drive.result.filtered_parameters, by_carrier(drive.fixes))
    overturned = overturned_arm(found, stated, STATED_ARM_SD_M)
    at = found, stated, STATED_ARM_SD_M, bends
    of_arm = [*overturned, *(contradicted_arm(*at) or unproven_arm(*at, sd_m))]
    if any(reason.code == "height_scale" for reason in of_receiver):
        return [*constancy, *of_arm]
    lifts = found.get("vehicle_pitch_coefficient", (0.0, 0.0))[0]
    return [*constancy, *of_arm, *height_doubts(path, drive.fixes, lifts)]
