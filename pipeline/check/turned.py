"""Whether the IMU lay all the drive as it did at first, by the forces and turns of its motion."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from automap.evaluation.one_sensor import CHANGED_CODE
from automap.evaluation.plausibility import Finding
from automap.fusion.limits import DRIVING_SPEED
from automap.records import ClockModel, Fixes, ImuData
from automap.sync.axes_evidence import AxesEvidence
from automap.sync.mount_change import MountChange, mount_change
from automap.sync.mount_pieces import MountPiece, mount_pieces
from pipeline.check.axes import usable_readings, what_differs


def pieces_of(
    imu: ImuData, fixes: Fixes | None, clock: ClockModel | None, seen: AxesEvidence
) -> list[MountPiece]:
    """What the readings show beside ``fixes`` in each piece of the drive, ``seen`` in all of it;
    none where there is nothing to compare with."""
    if fixes is None or clock is None:
        return []
    return mount_pieces(usable_readings(imu), fixes, clock, seen)


def turned_meanwhile(
    imu: ImuData, fixes: Fixes | None, seen: AxesEvidence, pieces: Sequence[MountPiece]
) -> Finding | None:
    """An error for a sensor that lies otherwise, or has other signs, from some instant of the drive
    on; None where it does not, or the motion does not tell."""
    if fixes is None or not pieces:
        return None
    # who walks holds a sensor now so, now so
    if not (np.hypot(fixes.vel_ned[:, 0], fixes.vel_ned[:, 1]) > DRIVING_SPEED).any():
        return None
    found = mount_change(pieces, seen.up, imu.axes_known)
    if found is None:
        return None
    return Finding("error", f"{_when(found)} on {_what(found)}", _advice(found), CHANGED_CODE)


def _when(found: MountChange) -> str:
    if found.last_s > found.first_s:
        return f"from {found.first_s:.0f} to {found.last_s:.0f} s after its first reading"
    return f"from about {found.first_s:.0f} s after its first reading"


def _what(found: MountChange) -> str:
    if found.made is not None:
        others = dict.fromkeys(what_differs(other) for other in found.others)
        what = what_differs(found.made)
        others.pop(what, None)
        text = f"its axes are others than before: {what}"
        if others:
            text += f" or, as good by what was recorded, {' or '.join(list(others)[:2])}"
        return text
    angle, sd = math.degrees(found.angle), math.degrees(found.sd)
    felt = {
        "level": "gravity, less what the receiver shows of slopes and speed, is felt",
        "azimuth": "changes of speed and turns are felt",
    }[found.kind]
    return f"{felt} {angle:.0f} deg (sigma {sd:.1f}) from where it was before"


def _advice(found: MountChange) -> str:
    cause = "the sensor was turned in its mount, or two logs stand in one file"
    if found.made is not None and not found.made.rigid:
        cause = "two logs stand in one file, or its program was set otherwise meanwhile"
    return f"{cause}: find when, and cut the drive in two there"
