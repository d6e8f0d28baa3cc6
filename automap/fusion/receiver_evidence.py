"""What a receiver's fixes say of each other, and beside the readings of a sound IMU."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from automap.fusion.doubts.astray import CODES, beside_imu
from automap.fusion.doubts.bridged import in_any
from automap.fusion.doubts.heights import separation_doubts
from automap.fusion.doubts.hole import hole_doubts, regained_jumps
from automap.fusion.doubts.limits import STEP_WINDOW_S
from automap.fusion.doubts.own_velocities import smoothed_doubts
from automap.fusion.doubts.path import fix_misses
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
from automap.fusion.doubts.receiver import accuracy_doubts, receiver_doubts
from automap.fusion.doubts.velocity_step import compare, step_doubts, velocity_steps
from automap.fusion.free_inertial import FreeInertial
from automap.fusion.judged import Judged
from automap.fusion.levels import VELOCITY_WANDER
from automap.records import Fixes, FloatArray, Trajectory


@dataclass(frozen=True)
class ReceiverEvidence:
    """``reasons`` that fixes give, of which ``contradictions`` are as they give them by themselves;
    those of ``jumps`` of positions and heights, and of ``steps`` of velocities. In stretches the
    IMU leads ``over`` them; ``witnesses`` are the fixes without what they tell there."""

    reasons: list[Reason]
    contradictions: list[Reason]
    jumps: list[Reason]
    steps: list[Reason]
    over: list[Span]
    witnesses: Fixes


def of_fixes(
    drive: Judged,
    path: Trajectory,
    free: FreeInertial | None,
    arm: FloatArray,
    felt: bool,
    sd_m: float,
) -> ReceiverEvidence:
    """The evidence of the fixes of a ``path`` that is good to ``sd_m`` m an axis, beside the
    readings ``free`` by themselves, with the antenna at ``arm`` [3] m; ``felt``: nothing speaks
    against these."""
    start = float(path.gps_s[0])
    reasons = receiver_doubts(drive.receiver, start, felt, drive.velocity_late_s)
    reasons += smoothed_doubts(drive.fixes, drive.receiver)
    reasons += accuracy_doubts(drive.fixes, drive.options)
    reasons += separation_doubts(drive.fixes, reasons)
    contradictions = [reason for reason in reasons if reason.code in CODES]
    places, heights = places_of(drive.stated), height_jumps(drive.stated, path)
    unheld = drive.larger.unheld
    if free is None:
        jumps = [*jump_doubts(unheld(position_jumps(places)), path)]
        jumps += jump_doubts(unheld(heights), path)
        return ReceiverEvidence(reasons, contradictions, jumps, [], [], drive.fixes)
    age = drive.age_s
    places, high = (
        beside_readings(seen, free, path, arm, age) for seen in (places, heights_of(drive.stated))
    )
    misses = fix_misses(path, drive.stated, arm, age)
    ends = start, float(path.gps_s[-1])
    parted = drive.receiver.parted
    reasons = beside_imu(reasons, parted, places, high, misses, ends, age, sd_m)
    over = [span for reason in reasons if reason.led for span in reason.spans]
    reasons += hole_doubts(places, path, age, sd_m)
    # readings of an instant are stamped later by the delay
    late = age - (0.0 if drive.delay_is_clock else drive.result.delay.mean)
    regained = regained_jumps(drive.stated, drive.result.innovations, path, late)
    level = [*_elsewhere(position_jumps(places), over, start), *regained]
    jumps = [*jump_doubts(unheld(level), path)]
    jumps += jump_doubts(unheld(_elsewhere([*heights, *position_jumps(high)], over, start)), path)
    steps = _steps(drive, path, free, arm, over)
    witnesses = _without(drive.fixes, over, start + age)
    return ReceiverEvidence(reasons, contradictions, jumps, steps, over, witnesses)


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
    reach = STEP_WINDOW_S
    wide = [(start_gps_s + a - reach, start_gps_s + b + reach) for a, b in over]
    at = np.array([jump.gps_s for jump in jumps])
    return [jump for jump, there in zip(jumps, in_any(at, wide), strict=True) if not there]


def _steps(
    drive: Judged, path: Trajectory, free: FreeInertial, arm: FloatArray, over: Sequence[Span]
) -> list[Reason]:
    """The reason that jumps of the receiver's velocity give, at ``arm`` [3] m from the IMU, but in
    stretches that the IMU leads ``over``."""
    seen = compare(free, drive.fixes, path, drive.found, arm)
    # the less a drive seems to show of what comes and goes, the less it is believed
    shown = max(drive.result.noise_factors.get(VELOCITY_WANDER, 1.0), 1.0)
    steps = velocity_steps(seen, drive.options.velocity_wander_sd * shown)
    steps = [step for step in steps if not any(a <= step.t <= b for a, b in over)]
    return step_doubts(steps, path)
