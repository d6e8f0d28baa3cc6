"""Positions that jump where the vehicle did not: ambiguities of the carrier phase that were fixed
wrongly, reflections, another receiver or antenna.

A filter follows a jump within a few fixes, and nothing shows it afterwards. But a position that is
good to centimetres cannot leave the way that an IMU feels, and without one it cannot gain speed
faster than tyres hold. (Velocities are no such witness: they are late, by how much nobody says.)
Which side of a jump is right is not told: each place is so as probably as it lasted.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from automap.earth import local_ned
from automap.frames import quat_to_matrix, rpy_to_matrix
from automap.fusion.doubts import limits
from automap.fusion.doubts.reason import Reason, Span
from automap.fusion.doubts.velocity_step import filled, last_term, least_along
from automap.fusion.free_inertial import FreeInertial
from automap.fusion.layout import HAS_POS_H, HAS_POS_V
from automap.fusion.limits import (
    ARM_TOLD_SD_M,
    DOUBT_PROBABILITY,
    LEAST_JUDGED,
    STEADY_GAP_STEPS,
)
from automap.fusion.nodes import FixModel
from automap.gates import OUTSIDE_95, gate, sd_by_median
from automap.records import BoolArray, FloatArray, IntArray, Trajectory
from automap.sync.limits import STEP_SD_M
from automap.timebase import gps_to_iso


@dataclass(frozen=True)
class Places:
    """Positions ``at`` [m, c] m, north and east, or up alone, good to ``sd`` [m] m, at ``t`` [m]
    GPS s, and the way ``felt`` [m, d] m of another witness, in axes that ``turn`` [m, c, d] takes
    to those, without one ``d`` is 0; ``lost_s`` [m] seconds that it had lost until then, ``slack``
    [m] m what of a jump is its own."""

    t: FloatArray
    at: FloatArray
    sd: FloatArray
    felt: FloatArray
    turn: FloatArray
    lost_s: FloatArray
    slack: FloatArray


@dataclass(frozen=True)
class Jump:
    """By how much [3] m, north, east and up, positions jump at ``gps_s`` s, which chance makes once
    in so many drives: ``chance``."""

    gps_s: float
    by: FloatArray
    chance: float = 0.0


def places_of(model: FixModel) -> Places:
    """Positions of fixes, timed in GPS seconds, without a witness."""
    rows = np.flatnonzero((model.flags & HAS_POS_H) > 0)
    rows = rows[np.diff(model.t[rows], prepend=-np.inf) > limits.SAME_FIX_S]
    n, values = len(rows), model.values[rows]
    ref = (*values[0, :2], 0.0) if n else (0.0, 0.0, 0.0)
    at = local_ned(values[:, 0], values[:, 1], np.zeros(n), ref).reshape(-1, 3)[:, :2]
    sd = model.stated_sd[rows, :2].max(axis=1, initial=0.0)
    return Places(model.t[rows], at, sd, *_without_witness(n, 2))


def heights_of(model: FixModel) -> Places:
    """Heights of fixes, timed in GPS seconds, without a witness."""
    rows = np.flatnonzero((model.flags & HAS_POS_V) > 0)
    rows = rows[np.diff(model.t[rows], prepend=-np.inf) > limits.SAME_FIX_S]
    at, sd = model.values[rows, 2:3], model.stated_sd[rows, 2]
    return Places(model.t[rows], at, sd, *_without_witness(len(rows), 1))


def _without_witness(n: int, c: int) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """``felt``, ``turn``, ``lost_s`` and ``slack`` of ``n`` places in ``c`` axes without one."""
    return np.zeros((n, 0)), np.zeros((n, c, 0)), np.zeros(n), np.zeros(n)


def beside_readings(
    places: Places, free: FreeInertial, path: Trajectory, arm: FloatArray, age_s: float
) -> Places:
    """The places with the way that the readings ``free`` tell, timed in s from the first row of the
    ``path``, which gives the heading; ``arm`` [3] m to the antenna, ``age_s`` the fixes' age.

    Two readings may be lost without a gap that shows.
    """
    since = places.t - float(path.gps_s[0]) - age_s
    inside = np.isfinite(free.lost_between(since, since))
    since, t = since[inside], places.t[inside]
    row = np.clip(np.searchsorted(path.gps_s, t - age_s), 0, len(path.gps_s) - 1)
    back = np.swapaxes(quat_to_matrix(free.quat[free.nearest(since)]), 1, 2)
    turn, speed = rpy_to_matrix(path.rpy[row]) @ back, path.vel_ned[row]
    level = places.at.shape[1] > 1
    turn, speed = (turn[:, :2], speed[:, :2]) if level else (-turn[:, 2:], speed[:, 2:])
    felt, lost = free.of_point(since, arm)[1], np.interp(since, free.t, free.lost_s)
    lacks = (STEADY_GAP_STEPS - 1.0) * float(np.median(np.diff(path.gps_s)))
    slack = lacks * np.linalg.norm(speed, axis=1)
    return Places(t, places.at[inside], places.sd[inside], felt, turn, lost, slack)


def position_jumps(places: Places) -> list[Jump]:
    """Jumps, in the order of time, of positions, or of heights beside a witness, that are good to
    decimetres; of other positions beside a witness those beyond what sound ones step by and these
    do. Else they jump by as much as they err, which their sigmas hold."""
    exact = places.sd < ARM_TOLD_SD_M
    found = _jumps_among(places, exact, 0.0)
    if places.at.shape[1] > 1 and places.felt.shape[1]:
        told_by_itself = replace(places, sd=np.zeros(len(places.sd)))
        steps = STEP_SD_M * float(np.sqrt(gate(OUTSIDE_95, 2)))
        found += _jumps_among(told_by_itself, ~exact, steps)
    return sorted(found, key=lambda jump: jump.gps_s)


def _jumps_among(places: Places, kind: BoolArray, steps_m: float) -> list[Jump]:
    """The jumps of positions of a ``kind`` [m] beyond ``steps_m``."""
    seen = Places(*(getattr(places, field.name)[kind] for field in fields(Places)))
    if len(seen.t) < LEAST_JUDGED:
        return []
    before, jump, least, slack, sd = (
        _beside_witness(seen) if seen.felt.shape[1] else _by_themselves(seen)
    )
    if len(before) < LEAST_JUDGED:
        return []
    # one of as many as there are fixes
    axes = seen.at.shape[1]
    beyond = slack + np.hypot(steps_m, np.sqrt(gate(DOUBT_PROBABILITY / len(before), axes)) * sd)
    by = np.pad(jump, ((0, 0), (0, 1) if axes > 1 else (2, 0)))
    return _apart(0.5 * (seen.t[before] + seen.t[before + 1]), by, least / beyond)


def height_jumps(model: FixModel, path: Trajectory) -> list[Jump]:
    """Jumps of the fixes' heights beyond what the vehicle climbs by its pitch on the
    ``path``: ones that these heights do not make and the errors stated of them do not hold."""
    heights = heights_of(model)
    t, sd = heights.t, heights.sd
    if len(t) < LEAST_JUDGED:
        return []
    way = np.hypot(path.vel_ned[:, 0], path.vel_ned[:, 1]) * np.gradient(path.gps_s)
    climbed, driven = (
        np.interp(t, path.gps_s, np.cumsum(part)) for part in (way * np.tan(path.rpy[:, 1]), way)
    )
    high = heights.at[:, 0] - climbed
    held = ~_wild(high, driven, sd, max(round(limits.STEP_WINDOW_S / np.median(np.diff(t))), 1))
    t, sd, high, driven = t[held], sd[held], high[held], driven[held]
    if len(t) < LEAST_JUDGED:
        return []
    seen = Places(t, high[:, None], sd, *_without_witness(len(t), 1))
    # carrier phases need no mean over seconds, in which a body pitches and drives far
    exact = float(np.median(sd)) < ARM_TOLD_SD_M
    before, half = _between(seen, 0.0 if exact else limits.STEP_WINDOW_S)
    if len(before) < LEAST_JUDGED:
        return []
    jump, least, beside = _jumps(seen, before, half, 1)
    usual = np.sqrt(gate(DOUBT_PROBABILITY / len(before), 1)) * sd_by_median(jump[:, 0])
    beyond = np.maximum(usual, np.sqrt(gate(limits.UNHELD_PROBABILITY, 1)) * beside)
    # from the middle of what is before to that of what is after
    beyond += limits.BODY_PITCH_RAD * 0.5 * (driven[before + half] - driven[before - half + 1])
    up = np.pad(jump, ((0, 0), (2, 0)))
    return _apart(0.5 * (t[before] + t[before + 1]), up, least / beyond)


def _wild(high: FloatArray, driven: FloatArray, sd: FloatArray, half: int) -> BoolArray:
    """Which of heights [m] m, where so much is ``driven`` [m] m, lie off most of the ``half``
    before and after by more than they err: a few in a row come back, and are no jump."""
    around = np.lib.stride_tricks.sliding_window_view(np.pad(high, half, mode="edge"), 2 * half + 1)
    off = np.abs(high - np.median(around, axis=1))
    ends = np.pad(driven, half, mode="edge")
    slope = limits.BODY_PITCH_RAD * 0.5 * (ends[2 * half :] - ends[: -2 * half])
    least = np.sqrt(gate(limits.UNHELD_PROBABILITY, 1))
    return np.asarray(off > slope + least * np.maximum(sd, sd_by_median(off)))


def _apart(when: FloatArray, jump: FloatArray, ratio: FloatArray) -> list[Jump]:
    """In the order of time the jumps at ``when`` [k] s whose ``ratio`` [k] to what is usual is
    beyond one, the largest of those near each other."""
    found: list[Jump] = []
    for k in np.argsort(-ratio):
        if ratio[k] <= 1.0:
            break
        at = float(when[k])
        if all(abs(other.gps_s - at) > limits.STEP_WINDOW_S for other in found):
            found.append(Jump(at, jump[k]))
    return sorted(found, key=lambda item: item.gps_s)


_Found = tuple[IntArray, FloatArray, FloatArray, FloatArray, FloatArray]
"""Fixes before what may be a jump [k], jumps [k, c] and how much of each is left at least without
any one fix [k], how much is none of theirs [k], m, and what they err by [k], m an axis."""


def _beside_witness(seen: Places) -> _Found:
    """By a parabola, of attitudes and starts that nobody knows, through the differences between
    positions and witness some seconds before and after."""
    before, half = _between(seen)
    jump, least, sd = _jumps(seen, before, half, 2)
    usual = sd_by_median(jump.ravel()) if len(jump) else 0.0
    return before, jump, least, seen.slack[before], np.hypot(usual, sd)


def _between(seen: Places, window_s: float = limits.STEP_WINDOW_S) -> tuple[IntArray, int]:
    """The fixes [k] with a window of fixes on either side, and how many such a window has."""
    spacing = float(np.median(np.diff(seen.t)))
    half = max(round(window_s / spacing), limits.STEP_FIXES)
    before = np.arange(half - 1, len(seen.t) - half)
    return filled(seen.t, seen.lost_s, before, half, spacing), half


def _by_themselves(seen: Places) -> _Found:
    """By a line through two fixes before and after. An acceleration of any course that is nowhere
    more than ``MOST_ACCELERATION`` seems to jump by three quarters of it and the squared step."""
    step = np.diff(seen.t)
    before = np.arange(1, len(seen.t) - 2)
    before = filled(seen.t, seen.lost_s, before, 2, float(np.median(step)))
    jump, least, sd = _jumps(seen, before, 2, 1)
    longest = np.max([step[before + k] for k in (-1, 0, 1)], axis=0)
    return before, jump, least, 0.75 * limits.MOST_ACCELERATION * longest**2, sd


def _jumps(
    seen: Places, before: IntArray, half: int, power: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Jumps [k, c] m behind the fixes ``before`` [k] in a curve of ``power`` through ``half`` fixes
    before and after, how much of each is left at least without any one fix [k], and the sigma of
    either side against the other, by the worst fix [k]."""
    parts = np.array_split(before, len(before) // limits.STEP_BATCH + 1)
    found = [_jumps_of(seen, part, half, power) for part in parts]
    jump, least, sd = (np.concatenate(values) for values in zip(*found, strict=True))
    return jump, least, sd


def _jumps_of(
    seen: Places, before: IntArray, half: int, power: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """As ``_jumps``, of all at once."""
    rows = before[:, None] + np.arange(1 - half, half + 1)
    t = seen.t[rows] - 0.5 * (seen.t[before] + seen.t[before + 1])[:, None]
    felt = seen.felt[rows] - seen.felt[before, None]
    y = seen.at[rows] - seen.at[before, None] - np.einsum("kij,knj->kni", seen.turn[before], felt)
    after = np.broadcast_to(np.arange(2 * half) >= half, t.shape)
    curve = [t**k for k in range(power + 1)]
    jump, left = last_term(np.stack([*curve, after], axis=-1), y)
    return jump, least_along(jump, left), np.sqrt(2.0) * seen.sd[rows].max(axis=1)


def jump_doubts(jumps: Sequence[Jump], path: Trajectory) -> Iterator[Reason]:
    """The reason that ``jumps``, of positions or of heights, give somewhere on the ``path``."""
    if not jumps:
        return
    # what two witnesses tell of one is told once, by the first
    told_once: list[Jump] = []
    for jump in jumps:
        if all(abs(other.gps_s - jump.gps_s) > limits.STEP_WINDOW_S for other in told_once):
            told_once.append(jump)
    jumps = sorted(told_once, key=lambda jump: jump.gps_s)
    start, end = float(path.gps_s[0]), float(path.gps_s[-1])
    bounds = np.clip([start, *(jump.gps_s for jump in jumps), end], start, end) - start
    place = np.cumsum([np.zeros(3), *(jump.by for jump in jumps)], axis=0)
    share = np.diff(bounds) / max(end - start, 1e-9)
    apart = (place[:, None] - place) ** 2
    # the square of what a place is off, level and up
    off = np.stack([apart[..., :2].sum(axis=2) @ share, apart[..., 2] @ share], axis=1)
    size = max(float(np.linalg.norm(jump.by)) for jump in jumps)
    likeliest = np.argmin(off.sum(axis=1))
    other = np.sqrt(apart[likeliest].sum(axis=1)) > 0.5 * size
    spans: tuple[Span, ...] = ()
    # an ellipse of 95 % holds a place that is right as surely as that; a path follows in seconds.
    # Where nothing comes back the way there may have been missed as well
    if not (other[0] or other[-1]) and share[other].sum() < OUTSIDE_95:
        edges = np.stack([bounds[:-1] - limits.STEP_WINDOW_S, bounds[1:] + limits.STEP_WINDOW_S], 1)
        spans = tuple((float(a), float(b)) for a, b in edges[other])
    told = f"by {size:.1f} m at {gps_to_iso(jumps[0].gps_s)}"
    if len(jumps) > 1:
        told = (
            f"{len(jumps)} times, by up to {size:.1f} m, from {gps_to_iso(jumps[0].gps_s)} to "
            f"{gps_to_iso(jumps[-1].gps_s)}"
        )
    level, high = np.sqrt(off.max(axis=0))
    sure = min(jump.chance for jump in jumps) < DOUBT_PROBABILITY
    why = (
        "nothing says on which side they are right, compare them with what is known of the place"
        if sure
        else "that may be chance, and the stated uncertainty includes it"
    )
    code = "positions_jump" if level > 0.0 else "heights_jump"
    whose = (
        "positions jump {}, which no vehicle did: ambiguities that were fixed wrongly, or another "
        "antenna, base or receiver"
        if level > 0.0
        else "heights jump {}, which no road does: a model of sea level or a barometer that was "
        "switched, ambiguities that were fixed wrongly, or another receiver"
    )
    yield Reason(
        code,
        f"the receiver's {whose.format(told)}; {why}",
        spans,
        error_m=float(level),
        height_m=float(high),
        state="doubtful" if sure else "good",
    )
