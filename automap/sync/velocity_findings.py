"""What is found of a receiver's velocities beside its positions: what may be used, and why.

Each verdict is by how much likelier the damage makes the recording than the errors that sound
receivers have.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from automap.records import BoolArray, Fixes, ReceiverFilter
from automap.sync import limits
from automap.sync.climb_match import Vertical
from automap.sync.epoch_means import EpochMeans
from automap.sync.path_match import Match
from automap.sync.unit_mistakes import UnitMistake, by_minutes
from automap.timebase import gps_to_iso


@dataclass(frozen=True)
class Interval:
    """GPS time from ``start_gps_s`` to ``end_gps_s``, with how far, m, positions and velocities
    part in it."""

    start_gps_s: float
    end_gps_s: float
    metres: float

    @property
    def seconds(self) -> float:
        """Its length."""
        return self.end_gps_s - self.start_gps_s


@dataclass(frozen=True)
class Reason:
    """Why values are not to be used: a ``code`` for programs and a ``text`` for people."""

    code: str
    text: str


@dataclass(frozen=True)
class VelocityConsistency:
    """What comparing velocities with positions of ``compared_s`` seconds tells.

    ``match`` has scale, turn and lags; ``scale_wrong``: its scale is none that a sound receiver
    has, and ``unit`` is the mistake that explains it, if one does; ``unrelated``: over
    longer stretches the two usually part by so much as a sound receiver's do not once. Intervals:
    velocities that do not change while positions move (``velocity_stuck``), positions that repeat
    while velocities tell of motion (``position_frozen``), whole rows that do (``rows_frozen``), and
    those in which positions and velocities contradict each other otherwise (``parted``), whichever
    is wrong, and those before, between and after them in which positions lie aside of most
    (``aside``). ``worse`` is how many times what is plausible they usually part by, one at least.
    ``means``: the velocities are right, and the ways between positions; None where they tell more
    than that. ``height_stuck``: the height is one number throughout: no receiver measures that.
    ``height_held``: where heights repeat while the vehicle drives far. ``between``:
    so many positions lie on the lines between others and were not measured; ``straight_m``: they
    go straight through bends, and lie as far aside of the velocities' path there. ``course_step``
    rad: courses come in such steps, too coarse to compare with anything; ``course_held``: they stay
    the same in bends. ``behind``: filters that were taken back beforehand.
    """

    compared_s: float
    match: Match
    scale_wrong: bool
    unit: UnitMistake | None
    unrelated: bool
    velocity_stuck: tuple[Interval, ...]
    position_frozen: tuple[Interval, ...]
    rows_frozen: tuple[Interval, ...]
    parted: tuple[Interval, ...]
    vertical: Vertical | None
    worse: float
    means: EpochMeans | None = None
    height_stuck: bool = False
    height_held: tuple[Interval, ...] = ()
    aside: tuple[Interval, ...] = ()
    between: int = 0
    straight_m: float = 0.0
    course_step: float = 0.0
    course_held: bool = False
    behind: ReceiverFilter | None = None

    @property
    def can_tell(self) -> bool:
        """Whether there is enough motion to compare scales."""
        return self.match.scale is not None

    @property
    def course_unknown(self) -> bool:
        """Whether courses are none that were measured."""
        return self.course_step > 0.0 or self.course_held

    @property
    def turned(self) -> bool:
        """Whether courses are mirrored or turned by quarters."""
        return self.match.mirrored or self.match.quarters != 0

    @property
    def sign_turned(self) -> bool:
        """Whether one axis has the wrong sign: of the velocities, or latitudes or longitudes have
        lost theirs. Nothing in the fixes says which."""
        return self.match.mirrored and self.match.quarters % 2 == 0

    @property
    def course_off(self) -> bool:
        """Whether courses are beyond doubt against another north than that of the positions, but
        for quarter turns."""
        turn = self.match.turn_rad
        if turn is None or self.turned or self.scale_wrong:
            return False
        sd = math.hypot(turn.sd, limits.SOUND_TURN_SD)
        return 0.5 * (turn.value / sd) ** 2 > limits.CERTAIN_LEAD_NATS

    @property
    def may_be_minutes(self) -> bool:
        """Whether minutes of arc that are none explain the scale as well: then velocities are
        right, and positions are off by kilometres."""
        scale = self.match.scale
        return self.unit is not None and scale is not None and bool(by_minutes(scale))

    @property
    def positions_late_s(self) -> float:
        """By how much positions are beyond doubt older than the velocities beside them, s, else 0:
        the least that speed and course tell."""
        told = (self.match.speed_lag_s, self.match.course_lag_s)
        lags = [lag for lag in told if lag is not None]
        # the ways between positions may be those to come
        if not lags or self.scale_wrong or self.means is not None:
            return 0.0
        surest, late = min(lags, key=lambda lag: lag.sd), -max(lag.value for lag in lags)
        beyond = max(-surest.value - limits.PREDICTED_S, 0.0) / surest.sd
        certain = 0.5 * beyond**2 > limits.CERTAIN_LEAD_NATS
        return late if certain and late > limits.PREDICTED_S else 0.0

    @property
    def lateness_apart_s(self) -> float:
        """By how much positions may be later in speed than in course, or the other way, s."""
        speed, course = self.match.speed_lag_s, self.match.course_lag_s
        if speed is None or course is None:
            return abs(self.positions_late_s)
        return math.hypot(speed.value - course.value, speed.sd, course.sd)

    @property
    def reasons(self) -> tuple[Reason, ...]:
        """What is beyond doubt, a sentence each: what is wrong throughout first."""
        return tuple(_reasons(self))

    def unusable_velocity(self, fixes: Fixes) -> BoolArray:
        """Rows [n] of ``fixes`` whose horizontal velocity is beyond doubt wrong."""
        bad = _within(fixes, (*self.velocity_stuck, *self.rows_frozen))
        bad |= self.scale_wrong or (self.turned and not self.sign_turned) or self.course_unknown
        return bad & np.isfinite(fixes.vel_ned[:, :2]).all(axis=1)

    def unusable_vertical_velocity(self, fixes: Fixes) -> BoolArray:
        """Rows [n] of ``fixes`` whose vertical velocity is beyond doubt wrong."""
        bad = _within(fixes, self.rows_frozen) | self.scale_wrong
        if self.vertical is not None:
            bad |= self.vertical.turned or self.vertical.stuck
        return bad & np.isfinite(fixes.vel_ned[:, 2])

    def held_height(self, fixes: Fixes) -> BoolArray:
        """Rows [n] of ``fixes`` whose height was kept from before."""
        return _within(fixes, self.height_held)

    def unusable_position(self, fixes: Fixes) -> BoolArray:
        """Rows [n] of ``fixes`` whose position is one that the vehicle had left."""
        bad = _within(fixes, (*self.position_frozen, *self.rows_frozen))
        return bad & np.isfinite(fixes.lat_rad)


def _within(fixes: Fixes, intervals: Sequence[Interval]) -> BoolArray:
    """Rows [n] of ``fixes`` in intervals, but for the first of each: it is what is repeated."""
    inside = np.zeros(len(fixes), np.bool_)
    for interval in intervals:
        inside |= (fixes.gps_s > interval.start_gps_s) & (fixes.gps_s <= interval.end_gps_s)
    return inside


TURNS = {
    (False, 1): "courses are told 90 deg too small",
    (False, 2): "courses are turned by 180 deg",
    (False, 3): "courses are told 90 deg too large",
    (True, 0): "east is told as west",
    (True, 1): "north and east are swapped",
    (True, 2): "north is told as south",
    (True, 3): "north and east are swapped, both with the wrong sign",
}
"""What a mirroring and quarter turns are in a log."""


def _reasons(found: VelocityConsistency) -> Iterator[Reason]:
    scale = found.match.scale
    if found.scale_wrong and scale is not None:
        text = f"velocities are {scale.value:.3g} times those of the positions (sd {scale.sd:.2g})"
        if found.unit is not None:
            minutes = by_minutes(scale)
            yield Reason(
                "velocity_unit",
                f"{text}, as {found.unit.logged} where {found.unit.expected} belong{minutes}",
            )
        else:
            yield Reason("velocity_scale", f"{text}, which no mistake of a unit explains")
    if found.turned:
        turn = TURNS[found.match.mirrored, found.match.quarters]
        odds = f"that is {_odds(found.match.turn_nats)} likelier than not"
        if found.sign_turned:
            yield Reason("sign_turned", f"{turn}, by the velocities or by the positions: {odds}")
        else:
            yield Reason("course_turned", f"{turn}: {odds}")
    turn_rad = found.match.turn_rad
    if found.course_off and turn_rad is not None:
        yield Reason(
            "course_off",
            f"courses are told {math.degrees(-turn_rad.value):+.1f} deg off (sd "
            f"{math.degrees(turn_rad.sd):.1g}), as against the compass or a map's grid",
        )
    if found.course_unknown:
        yield Reason(
            "course_coarse",
            f"courses come in steps of {math.degrees(found.course_step):.3g} deg"
            if found.course_step
            else "courses stay the same where its positions turn, as those of a map's roads",
        )
    if found.positions_late_s:
        yield Reason(
            "positions_late",
            f"positions are older than the velocities beside them by {found.positions_late_s:.2f} "
            "s, as a filter that follows slowly makes them",
        )
    if found.straight_m:
        yield Reason(
            "positions_straight",
            f"positions go straight through bends, {found.straight_m:.1f} m aside of where the "
            "velocities turn, as those that were put on a map's roads or between few of them",
        )
    for code, held, what in (
        ("velocity_stuck", found.velocity_stuck, "velocities repeat while the positions move on"),
        ("position_frozen", found.position_frozen, "positions repeat while velocities go on"),
        ("rows_frozen", found.rows_frozen, "positions and velocities repeat while moving"),
    ):
        if held:
            yield Reason(code, f"{what}: {told_intervals(held)}")
    vertical = found.vertical
    if vertical is not None and vertical.turned:
        odds = _odds(vertical.turned_nats)
        yield Reason("vertical_turned", f"up is told as down: that is {odds} likelier than not")
    if vertical is not None and vertical.feet != 1.0 and not vertical.turned:
        yield Reason(
            "height_scale",
            f"heights change {vertical.feet:.3g} times as fast as its vertical velocity tells, "
            f"as {'feet where metres' if vertical.feet > 1.0 else 'metres where feet'} belong",
        )
    if vertical is not None and vertical.stuck:
        yield Reason("vertical_stuck", "vertical velocity is one number throughout")
    if found.height_held and not found.height_stuck:
        told = told_intervals(found.height_held, "over")
        yield Reason("height_held", f"heights repeat while the vehicle drives on: {told}")
    if found.height_stuck:
        yield Reason("height_stuck", "height is one number throughout")


def told_intervals(intervals: Sequence[Interval], by: str = "by") -> str:
    """How many intervals there are, how long, the worst one and when it is; ``by`` or over how many
    metres."""
    worst = max(intervals, key=lambda interval: interval.metres)
    many = "once" if len(intervals) == 1 else f"{len(intervals)} times"
    return (
        f"{many}, {sum(interval.seconds for interval in intervals):.1f} s in all, most {by} "
        f"{worst.metres:.0f} m in {worst.seconds:.1f} s from {gps_to_iso(worst.start_gps_s)}"
    )


def _odds(nats: float) -> str:
    """Odds as a power of ten."""
    return f"10^{nats / math.log(10.0):.0f} times"
