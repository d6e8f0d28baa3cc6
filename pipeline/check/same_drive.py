"""Whether the IMU's readings are of the drive of the fixes, and what of these to compare with."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from automap.errors import InputError
from automap.evaluation.plausibility import Finding
from automap.fusion.doubts.receiver import usable_fixes
from automap.fusion.limits import DRIVING_SPEED
from automap.io.drive import Drive
from automap.io.recording import Recording, imu_time
from automap.records import ClockModel, Fixes, ImuData
from automap.sync.axes_evidence import AxesEvidence, together
from automap.sync.clock import has_arrival, rough_clock
from automap.sync.coarse import find_offset
from automap.sync.limits import (
    AXES_WINDOW_S,
    CERTAIN_LEAD_NATS,
    LEAST_INTERVALS,
    STATED_REACH_S,
)
from automap.sync.motion import imu_motion, velocity_motion
from automap.sync.motion_clock import gnss_motions, in_imu_time
from automap.sync.mount_pieces import MountPiece
from automap.sync.same_motion import likeness
from automap.sync.steadiness import clock_change, lags_by_piece
from automap.sync.velocity_consistency import velocity_consistency
from pipeline.check import limits
from pipeline.check.axes import seen_motion

UNKNOWN_CODE = "imu_clock_unknown"
"""Of a finding about stamps that nothing ties to the receiver's time."""
OTHER_CODE = "other_drive"
"""Of a finding about readings that are of another drive than the fixes."""


class UsableReceiver(NamedTuple):
    """``fixes`` without what is wrong with them by themselves, and the ``clock`` of the IMU's
    stamps, None where there is none; ``wrong`` says why where the motions do not tell it;
    ``worse`` by how much more than a sound receiver's its velocities and positions part;
    ``of_positions`` whether its velocities are ways between these, which do not part."""

    fixes: Fixes | None
    clock: ClockModel | None = None
    wrong: str | None = None
    worse: float = 1.0
    of_positions: bool = False


def usable_receiver(drive: Drive, recording: Recording) -> UsableReceiver:
    """What of a recording's receiver the IMU may be compared with."""
    imu, fixes = recording.imu, recording.fixes
    if imu is None or fixes is None or not len(fixes):
        return UsableReceiver(fixes)
    found = velocity_consistency(fixes)
    # velocities that are wrong themselves say nothing of the IMU, nor does a mirrored path, as one
    # of swapped coordinates is, nor one of which velocities and positions tell two
    fixes = usable_fixes(fixes, found)
    if found.match.mirrored or found.unrelated:
        return UsableReceiver(fixes)
    gnss = drive.gnss
    base = imu_time(drive, recording)
    try:
        clock = rough_clock(imu, fixes, base, gnss.arrival_time, gnss.output_delay_s)
    except InputError as error:
        # arrival times that are wrong are told of their own file
        of_motions = not (has_arrival(fixes) and gnss.arrival_time == base)
        return UsableReceiver(fixes, None, str(error).rstrip(".") if of_motions else None)
    return UsableReceiver(fixes, clock, None, found.worse, found.means is not None)


def driven_span(imu: ImuData, receiver: UsableReceiver) -> tuple[float, float]:
    """From when to when the vehicle drives by its fixes, s after the first reading; without them,
    or a clock, all the time."""
    fixes, clock = receiver.fixes, receiver.clock
    if fixes is None or clock is None:
        return -np.inf, np.inf
    with np.errstate(invalid="ignore"):
        drives = np.hypot(fixes.vel_ned[:, 0], fixes.vel_ned[:, 1]) > DRIVING_SPEED
    drives &= np.isfinite(fixes.gps_s)
    if not drives.any():
        return -np.inf, np.inf
    ends = clock.t_ns(np.array([fixes.gps_s[drives].min(), fixes.gps_s[drives].max()]))
    begin, end = ((ends - imu.t_ns[0]) * 1e-9).tolist()
    return begin, end


def other_drive(
    imu: ImuData,
    receiver: UsableReceiver,
    seen: AxesEvidence,
    pieces: Sequence[MountPiece],
    log: str,
) -> Finding | None:
    """A warning for readings that are of another drive than the fixes of the file ``log``, by what
    was ``seen`` of the motion, in all and in each of the ``pieces``; None where they may be of one,
    or are of one at other stamps."""
    fixes, clock, _, worse, of_positions = receiver
    if fixes is None or clock is None:
        return None
    seldom = seen.surge is None or not seen.surge.noise
    if len(velocity_motion(fixes, AXES_WINDOW_S).start) < LEAST_INTERVALS or (
        of_positions and seldom
    ):
        # ways between positions scatter by whatever a receiver's places do, which only fixes that
        # come often show
        return None
    whole = likeness(seen, worse)
    if not whole.short:
        return None
    where, strange, likely, there = "", seen, whole.log_odds, fixes
    stamps = (clock.t_ns(fixes.gps_s) - int(imu.t_ns[0])) * 1e-9
    for i in range(1, len(pieces)):
        sides = [together([p.seen for p in part]) for part in (pieces[:i], pieces[i:])]
        odds = [likeness(a, worse, b).log_odds for a, b in (sides, sides[::-1])]
        k = int(np.argmin(odds))
        if max(odds) > CERTAIN_LEAD_NATS and odds[k] < likely:
            at = f"{pieces[i].start_s:.0f} s after the first reading"
            where = f" from about {at} on" if k else f" until about {at}"
            strange, likely = sides[k], odds[k]
            part = (stamps >= pieces[i].start_s) == bool(k)
            there = replace(fixes, gps_s=np.where(part, fixes.gps_s, np.nan))
    if likely > np.log(limits.DOUBTED_AXES) or _elsewhere(imu, there, clock):
        return None
    shares = [
        f"{followed.share:.0%} of the {what}"
        for what, followed in (("turns", strange.turn), ("changes of speed", strange.surge))
        if followed is not None
    ]
    return Finding(
        "warning",
        f"the readings and {log} are of two drives{where}: they explain {' and '.join(shares)} of "
        "the fixes, no more than chance does",
        "the path is that of the fixes alone; put two files of one drive together, or fasten the "
        "IMU to the vehicle",
        OTHER_CODE,
    )


def _elsewhere(imu: ImuData, fixes: Fixes, clock: ClockModel) -> bool:
    """Whether readings and fixes are of one motion at other stamps, or ones that run off."""
    if clock_change(lags_by_piece(imu, fixes, clock)) is not None:
        return True
    motion = imu_motion(imu)
    for _, gnss in gnss_motions(fixes):
        near = find_offset(motion, in_imu_time(gnss, clock, imu), STATED_REACH_S)
        if near is not None and near.certain:
            moved = replace(clock, ref_gps_s=clock.ref_gps_s - near.offset_s)
            if likeness(seen_motion(imu, fixes, moved)).log_odds > CERTAIN_LEAD_NATS:
                return True
    return False
