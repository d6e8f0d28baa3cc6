"""Estimates of what is one number all through a drive, and yet is another in a later part of it.

A filter's estimates of a constant tell what each piece of a drive by itself makes of it, and to
what variance; these are independent where the filter's model is the receiver's. A real one errs
alike for seconds, and in towns by a multiple of what it errs by on motorways, while bends and stops
there tell most. So a mean of pieces is as unsure as they scatter, each as it is (White,
Econometrica 48, 1980), and two means are compared by Student's distribution (Welch, Biometrika 34,
1947).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from automap.fusion.delay_states import DELAY_STATE, LATENCY_STATE, VEL_LATENCY_STATE
from automap.fusion.doubts import limits
from automap.fusion.doubts.reason import Reason
from automap.fusion.limits import DOUBT_PROBABILITY
from automap.fusion.output import ParameterHistory
from automap.gates import OUTSIDE_95, exceeds_ratio
from automap.records import FloatArray, IntArray

_AGES = (DELAY_STATE, LATENCY_STATE, VEL_LATENCY_STATE)
_OF_PLACES = (DELAY_STATE, LATENCY_STATE)
_ARM = ("gnss_lever_arm_x", "gnss_lever_arm_y")
"""Bends tell the level arm; the upright one moves with whatever a receiver's filter does."""
_MOUNTING = ("imu_mounting_pitch", "imu_mounting_yaw")


@dataclass(frozen=True)
class Move:
    """By how much an estimate is another after ``at_s`` s than before, and how likely chance makes
    so much of a number that stays."""

    size: float
    chance: float
    at_s: float


@dataclass(frozen=True)
class _Part:
    """What a part of the drive by itself makes of a number, its variance, and by how many
    independent pieces that variance is known, less one."""

    value: float
    var: float
    freedom: float


def move_of(filtered: ParameterHistory, name: str) -> Move | None:
    """The least likely move of a constant, by its ``filtered`` estimates; None where none can be
    told: the first part has to tell more than was known before, and the rest has to add to it."""
    if name not in filtered.names or len(filtered.t_ns) < 2:
        return None
    k = filtered.names.index(name)
    t = (filtered.t_ns - filtered.t_ns[0]) * 1e-9
    ends = np.searchsorted(t, np.arange(0.0, t[-1], limits.PIECE_S))
    ends = np.unique(np.append(ends, len(t) - 1))
    value, var = filtered.values[ends, k], filtered.sd[ends, k] ** 2
    told = (var < limits.TOLD_SHARE * var[0]) & (var - var[-1] > limits.ADDED_SHARE * var[-1])
    # what each piece tells by itself
    weight = np.diff(1.0 / var)
    tells = weight > 0.0
    piece = np.where(tells, np.diff(value / var) / np.where(tells, weight, 1.0), 0.0)
    weight = np.where(tells, weight, 0.0)
    found = []
    for i in _apart(np.flatnonzero(told), weight):
        before, after = _part(piece[:i], weight[:i]), _part(piece[i:], weight[i:])
        size, spread = after.value - before.value, before.var + after.var
        # Welch's degrees of freedom
        freedom = spread**2 / (before.var**2 / before.freedom + after.var**2 / after.freedom)
        chance = exceeds_ratio(size**2 / spread, 1, freedom)
        found.append(Move(size, chance, float(t[ends[i]])))
    if not found:
        return None
    move = min(found, key=lambda move: move.chance)
    # one of as many as were tried
    return replace(move, chance=min(move.chance * len(found), 1.0))


def _apart(rows: IntArray, weight: FloatArray) -> IntArray:
    """Those of the ends ``rows`` of pieces before which the odds of what was told, ``weight`` [m],
    against what is still to come grew enough: between them a change is told nearly as well."""
    before = np.cumsum(weight)[rows - 1]
    step = np.floor(np.log(before / (weight.sum() - before)) / limits.ODDS_STEP)
    return np.asarray(rows[np.diff(step, prepend=-np.inf) > 0.0])


def _part(piece: FloatArray, weight: FloatArray) -> _Part:
    """The mean of what pieces [m] tell, of which the filter knows the inverse variances ``weight``
    [m]; as unsure as they scatter, where that is more than the filter says."""
    total = float(weight.sum())
    mean = float(weight @ piece) / total
    # a piece that tells most pulls the mean to itself (MacKinnon and White 1985, HC2)
    own = np.maximum(1.0 - weight / total, limits.LEAST_OWN)
    scatter = float((weight**2) @ ((piece - mean) ** 2 / own)) / total
    freedom = max(_pieces(weight) - 1.0, limits.LEAST_FREEDOM)
    return _Part(mean, max(scatter, 1.0) / total, freedom)


def _pieces(weight: FloatArray) -> float:
    """As how many pieces of one weight those of ``weight`` [m] count (Kish)."""
    return float(weight.sum() ** 2 / (weight**2).sum())


def _changed(chance: float) -> float:
    """The probability that a number moved which chance moves so far with that probability: at most
    by the bound of Sellke, Bayarri and Berger (The American Statistician 55, 2001), for the
    ``chance`` below 1/e."""
    odds = limits.CHANGE_PROBABILITY / (1.0 - limits.CHANGE_PROBABILITY)
    odds /= -math.e * chance * math.log(chance)
    return odds / (1.0 + odds)


def _moves(filtered: ParameterHistory, names: tuple[str, ...]) -> dict[str, Move]:
    moves = {name: move_of(filtered, name) for name in names}
    return {name: move for name, move in moves.items() if move is not None}


def constancy_doubts(filtered: ParameterHistory, dated: bool = False) -> Iterator[Reason]:
    """Ages and mountings that are others in one part of the drive; ``dated``: positions are of the
    instant of their tag, by carrier phase.

    What chance may make still once in twenty drives is no doubt, but as unsure as it moved, by the
    probability that it did; positions that are dated then move by nothing, for it is the IMU's
    stamps that do.
    """
    ages = _moves(filtered, _AGES)
    age = min(ages.values(), key=lambda move: move.chance, default=None)
    rare = {n: move for n, move in ages.items() if move.chance < OUTSIDE_95 / len(ages)}
    if age is not None and rare:
        size = max(abs(move.size) for move in rare.values())
        steady = age.chance > DOUBT_PROBABILITY
        # the mean square of what is there by that probability, and else is not
        share = math.sqrt(_changed(age.chance)) if steady else 1.0
        # velocities that become older by so little leave positions where they are
        places = max((abs(rare[n].size) for n in _OF_PLACES if n in rare), default=0.0)
        yield Reason(
            "age_changes",
            f"the delays between IMU, positions and velocities change by {size:.2f} s at "
            f"{age.at_s:.0f} s of the drive: "
            + (
                "that may be chance, and the stated uncertainty includes it"
                if steady
                else "a clock was set, or fixes are another receiver's or antenna's from there on; "
                "cut the drive there"
            ),
            late_s=(0.0 if dated else share * places) if steady else size,
            moved_s=share * size,
            state="good" if steady else "doubtful",
        )
    arms = _moves(filtered, _ARM).values()
    arm = min(arms, key=lambda move: move.chance, default=None)
    if arm is not None and arm.chance < DOUBT_PROBABILITY:
        size = math.hypot(*(move.size for move in arms))
        yield Reason(
            "arm_changes",
            f"the antenna sits otherwise by {size:.1f} m after {arm.at_s:.0f} s of the drive than "
            "before: fixes are another antenna's from there on; cut the drive there",
            error_m=size,
        )
    turns = _moves(filtered, _MOUNTING).values()
    turn = min(turns, key=lambda move: move.chance, default=None)
    if turn is not None and turn.chance < DOUBT_PROBABILITY:
        yield Reason(
            "mounting_changes",
            f"the IMU sits otherwise by {math.degrees(abs(turn.size)):.0f} deg after "
            f"{turn.at_s:.0f} s of the drive than before: it was turned in the vehicle while it "
            "drove; fasten it, and cut the drive there",
        )
