"""What the filter itself says: how it began, what it refused, how sure it ends."""

from __future__ import annotations

import math

import numpy as np

from automap.fusion.doubts import limits
from automap.fusion.doubts.reason import Reason
from automap.fusion.limits import (
    DRIVING_SPEED,
    LEAST_JUDGED,
    N_HEADINGS,
    ROAD_ROLL_SD,
    SURE_MARGIN_NATS,
    UNKNOWN_HEADING_SD,
)
from automap.fusion.output import Innovations
from automap.gates import sigmas
from automap.records import FloatArray, Trajectory

_KINDS = {
    "position": ("positions of the fixes", "look for wrong fixes in the receiver's log"),
    "velocity": ("velocities of the fixes", "look for wrong velocities in the receiver's log"),
    "nhc": ("times at which a vehicle does not slide", "check the axes of the IMU"),
    "odometer": ("wheel speeds", "check their unit and their stamps"),
}


def weak_heading(margin: float, off_course: float = math.inf) -> list[Reason]:
    """The start's heading is not much likelier than another; ``margin`` in nats, ``off_course`` rad
    how far headings are off the courses of the fixes by themselves while the vehicle drives.

    What is nearer to the course than to the next heading that was tried is the right one.
    """
    if margin >= SURE_MARGIN_NATS or off_course < math.pi / N_HEADINGS:
        return []
    return [
        Reason(
            "heading_weak",
            f"the heading at the start is weakly determined (likelihood margin {margin:.1f} nats, "
            f"{SURE_MARGIN_NATS:g} are enough): headings and sideways positions of signs "
            "may be off; record with more change of speed and direction",
            heading=min(off_course, UNKNOWN_HEADING_SD),
        )
    ]


def leaning(path: Trajectory) -> list[Reason]:
    """Minutes of driving through which the vehicle would lean or climb as no road does."""
    t = path.gps_s - path.gps_s[0]
    moving = np.hypot(path.vel_ned[:, 0], path.vel_ned[:, 1]) > DRIVING_SPEED
    if not moving.any():
        return []
    block = np.floor(t[moving] / limits.LEAN_S).astype(np.int64)
    tilt = np.abs(path.rpy[moving, :2])
    worst, spans = 0.0, []
    starts = np.flatnonzero(np.diff(block, prepend=-1))
    for first, rows in zip(starts, np.split(tilt, starts[1:]), strict=True):
        k = block[first]
        # a block that was mostly stood through says little of a road
        if len(rows) < limits.FILLED_STRETCH * np.count_nonzero(np.floor(t / limits.LEAN_S) == k):
            continue
        roll, pitch = np.median(rows, axis=0)
        if roll > limits.MOST_LEAN or pitch > limits.MOST_CLIMB:
            worst = max(worst, float(roll), float(pitch))
            spans.append((k * limits.LEAN_S, (k + 1) * limits.LEAN_S))
    if not spans:
        return []
    return [
        Reason(
            "path_leans",
            f"the vehicle would lean or climb by {np.degrees(worst):.0f} deg for minutes, which no "
            "road does: the IMU was turned in the vehicle while it drove, or its axes are not as "
            "stated; fasten it, and leave out what was recorded after it had moved",
            tuple(spans),
            inertial=True,
        )
    ]


def mounted_askew(path: Trajectory, sd_roll: FloatArray) -> tuple[list[Reason], float]:
    """The reason that a drive gives whose vehicle leans to one side in the mean, more than roads
    fall and the roll is unsure by, ``sd_roll`` [n] rad; and that mean lean, rad, 0 where it says
    nothing."""
    t = path.gps_s
    moving = np.hypot(path.vel_ned[:, 0], path.vel_ned[:, 1]) > DRIVING_SPEED
    if len(t) < 2 or np.count_nonzero(moving) * float(np.median(np.diff(t))) < limits.LEAN_S:
        return [], 0.0
    lean = float(np.mean(path.rpy[moving, 0]))
    usual = float(np.hypot(ROAD_ROLL_SD, np.median(sd_roll[moving])))
    if abs(lean) < sigmas(limits.ASKEW_PROBABILITY) * usual:
        return [], 0.0
    side = "right" if lean > 0.0 else "left"
    return [
        Reason(
            "mounted_askew",
            f"the vehicle would lean by {np.degrees(abs(lean)):.0f} deg to the {side} in the mean "
            "of the drive: the IMU is not mounted as its axes say, and the roll is unsure by as "
            'much; write axes = "unknown" in [imu] to have its mounting estimated',
            handled=True,
        )
    ], abs(lean)


def refused(table: Innovations) -> list[Reason]:
    """Kinds of measurements of which many were refused."""
    kinds = np.array([str(name).partition("_")[0] for name in table.channel], dtype=object)
    reasons = []
    for kind, (what, advice) in _KINDS.items():
        rows = kinds == kind
        if int(rows.sum()) < LEAST_JUDGED:
            continue
        share = 1.0 - float(table.accepted[rows].mean())
        if share > limits.REFUSED_SHARE:
            reasons.append(
                Reason(
                    f"{kind}_refused",
                    f"{share:.0%} of the {what} contradict the other measurements and were "
                    f"trusted less: {advice}",
                )
            )
    return reasons


def unsure_path(sd: float, overstated: bool = False) -> list[Reason]:
    """A path too unsure to be of use; ``sd`` m the median of its horizontal sigmas, ``overstated``:
    the fixes agree with it far better than they state."""
    if np.isfinite(sd) and sd <= limits.USELESS_SD_M:
        return []
    return [
        Reason(
            "path_unsure",
            f"the path is known to {sd:.0f} m only (horizontal sigma, median; signs are on the "
            f"right street up to {limits.USELESS_SD_M:g} m): "
            + (
                "its receiver states no better, though the fixes agree far better; check the unit "
                "of its accuracy"
                if overstated
                else "record again with a free view of the sky, or check the receiver's log"
            ),
            state="unusable",
        )
    ]


def inertial_worse(share: float) -> Reason:
    """The reason that fixes which agree contradict the IMU over a ``share`` of the drive."""
    return Reason(
        "inertial_worse",
        f"the IMU contradicts good fixes over {share:.0%} of the drive, so the path is "
        "that of the fixes alone, with the course for a heading: check the axes, signs, units and "
        "stamps of the IMU",
    )
