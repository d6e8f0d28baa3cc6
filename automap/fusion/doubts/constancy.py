"""Estimates of what is one number all through a drive, and yet is another in a later part of it.

A filter's later estimate of a constant differs from its earlier one by as much as its variance has
shrunk: what the later one errs by has nothing to do with the difference (Maybeck, Stochastic
Models, Estimation and Control, volume 1, section 5.4).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from automap.fusion.delay_states import DELAY_STATE, LATENCY_STATE, VEL_LATENCY_STATE
from automap.fusion.doubts import limits
from automap.fusion.doubts.reason import Reason
from automap.fusion.limits import DOUBT_PROBABILITY
from automap.fusion.output import ParameterHistory
from automap.gates import sigmas

_AGES = (DELAY_STATE, LATENCY_STATE, VEL_LATENCY_STATE)
_ARM = ("gnss_lever_arm_x", "gnss_lever_arm_y")
"""Bends tell the level arm; the upright one moves with whatever a receiver's filter does."""
_MOUNTING = ("imu_mounting_pitch", "imu_mounting_yaw")


@dataclass(frozen=True)
class Move:
    """By how much an estimate is another after ``at_s`` s than before, and in how many sigmas."""

    size: float
    sigmas: float
    at_s: float


def move_of(filtered: ParameterHistory, name: str) -> Move | None:
    """The surest move of a constant, by its ``filtered`` estimates; None where none can be told:
    the first part has to tell more than was known before, and the rest has to add to it."""
    if name not in filtered.names or len(filtered.t_ns) < 2:
        return None
    k = filtered.names.index(name)
    value, var = filtered.values[:, k], filtered.sd[:, k] ** 2
    gained = var - var[-1]
    told = var < limits.TOLD_SHARE * var[0]
    rows = np.flatnonzero(told & (gained > limits.ADDED_SHARE * var[-1]))
    if not len(rows):
        return None
    ratio = (value[-1] - value[rows]) / np.sqrt(gained[rows])
    best = int(np.argmax(np.abs(ratio)))
    row = rows[best]
    # what the rest tells by itself is further off than the two together
    size = (value[-1] - value[row]) * var[row] / gained[row]
    at_s = float(filtered.t_ns[row] - filtered.t_ns[0]) * 1e-9
    return Move(float(size), float(abs(ratio[best])), at_s)


def constancy_doubts(filtered: ParameterHistory, dated: bool = False) -> Iterator[Reason]:
    """Ages and mountings that are others in one part of the drive; ``dated``: positions are of the
    instant of their tag, by carrier phase.

    Lags of recorded receivers vary by more than their sigmas. What that explains is no doubt, but
    as unsure as it moved; positions that are dated then move by nothing, for it is the IMU's stamps
    that do.
    """
    beyond = sigmas(DOUBT_PROBABILITY)
    ages = [move for name in _AGES if (move := move_of(filtered, name)) is not None]
    age = max(ages, key=lambda move: move.sigmas, default=None)
    if age is not None and age.sigmas > beyond:
        size = max(abs(move.size) for move in ages if move.sigmas > beyond)
        steady = age.sigmas < limits.AGE_SCATTER * beyond
        yield Reason(
            "age_changes",
            f"delays between IMU, positions and velocities are others by {size:.2f} s after "
            f"{age.at_s:.0f} s of the drive than before: "
            + (
                "no more than receivers' delays vary by, and the sigmas hold it"
                if steady
                else "a clock was set, or fixes are another receiver's or antenna's from there on; "
                "cut the drive there"
            ),
            late_s=0.0 if steady and dated else size,
            moved_s=size,
            state="good" if steady else "doubtful",
        )
    arms = [move for name in _ARM if (move := move_of(filtered, name)) is not None]
    arm = max(arms, key=lambda move: move.sigmas, default=None)
    if arm is not None and arm.sigmas > limits.AGE_SCATTER * beyond:
        size = math.hypot(*(move.size for move in arms))
        yield Reason(
            "arm_changes",
            f"the antenna sits otherwise by {size:.1f} m after {arm.at_s:.0f} s of the drive than "
            "before: fixes are another antenna's from there on; cut the drive there",
            error_m=size,
        )
    turns = [move for name in _MOUNTING if (move := move_of(filtered, name)) is not None]
    turn = max(turns, key=lambda move: move.sigmas, default=None)
    if turn is not None and turn.sigmas > limits.AGE_SCATTER * beyond:
        yield Reason(
            "mounting_changes",
            f"the IMU sits otherwise by {math.degrees(abs(turn.size)):.0f} deg after "
            f"{turn.at_s:.0f} s of the drive than before: it was turned in the vehicle while it "
            "drove; fasten it, and cut the drive there",
        )
