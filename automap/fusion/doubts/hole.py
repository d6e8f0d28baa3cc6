"""Positions that go on elsewhere behind a hole in the fixes: a receiver that restarted, with
another latency, another antenna or reflections.

Fixes alone wander by metres in seconds without any, but an IMU bridges them. How far positions and
IMU part over so long the drive itself shows where there is no hole: fixes are left out there.
Fixed carrier phases behind others, or none, lie where the filter leads, to what it knows of that.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from automap.fusion import limits as fusion_limits
from automap.fusion.doubts import limits
from automap.fusion.doubts.position_jump import Jump, Places
from automap.fusion.doubts.reason import Reason
from automap.fusion.doubts.velocity_step import last_term
from automap.fusion.layout import HAS_POS_H
from automap.fusion.nodes import FixModel
from automap.fusion.output import Innovations
from automap.gates import OUTSIDE_95, exceeds, exceeds_ratio, gate, sd_by_median
from automap.records import FloatArray, IntArray, Trajectory


def hole_doubts(seen: Places, path: Trajectory, age_s: float, sd_m: float) -> Iterator[Reason]:
    """The reason that the likeliest jump over a hole gives; ``seen`` positions with the way that
    readings tell, ``age_s`` theirs, ``sd_m`` what the ``path`` is good to, m an axis."""
    step = np.diff(seen.t)
    if len(step) < fusion_limits.LEAST_JUDGED:
        return
    spacing = float(np.median(step))
    holes = np.flatnonzero(step > limits.GAP_STEPS * spacing)
    row = np.clip(np.searchsorted(path.gps_s, seen.t - age_s), 0, len(path.gps_s) - 1)
    velocity = path.vel_ned[row, :2]
    usual: dict[int, FloatArray] = {}
    found = []
    for before in holes.tolist():
        left_out = max(round(step[before] / spacing) - 1, 1)
        half = max(left_out, round(limits.STEP_WINDOW_S / spacing), limits.STEP_FIXES)
        told = _jumps(seen, np.array([before]), half, 0, spacing, velocity)
        if not len(told):
            continue
        if left_out not in usual:
            ends = np.arange(half - 1, len(seen.t), half)
            usual[left_out] = _jumps(seen, ends, half, left_out, spacing, velocity)
        others = usual[left_out]
        if len(others) >= limits.LEAST_USUAL:
            sd = np.array([sd_by_median(others[:, k]) for k in (0, 1)])
            sd = np.hypot(sd, np.sqrt(2.0) * told[0, 3])
            # windows share half of their fixes with the next
            freedom = 0.5 * len(others)
            square = (told[0, :2] / sd) ** 2
            # what is older lies behind, and aside by no more than chance makes
            older = bool(square[1] < gate(OUTSIDE_95, 1))
            ratio, terms = (square[0], 1) if older else (0.5 * float(square.sum()), 2)
            chance = exceeds_ratio(float(ratio), terms, freedom) * len(holes)
            found.append((chance, before, older, told[0]))
    if not found:
        return
    chance, before, older, (ahead, right, speed, _) = min(found, key=lambda one: one[0])
    if chance > limits.OVER_HOLE_PROBABILITY:
        return
    at_s = float(seen.t[before + 1] - path.gps_s[0])
    size = abs(ahead) if older else float(np.hypot(ahead, right))
    age = abs(ahead) / speed if older else 0.0
    whose = (
        f"as if they were {age:.2f} s {'older' if ahead < 0.0 else 'younger'}"
        if older
        else "another antenna's or receiver's, or reflections"
    )
    steady = chance > fusion_limits.DOUBT_PROBABILITY or size < sd_m
    yield Reason(
        "age_changes" if older else "positions_shift",
        f"behind the hole in the fixes until {at_s:.0f} s of the drive positions lie {size:.1f} m "
        f"off where the readings lead from those before, {whose}: "
        + (
            "that may be chance, and the stated uncertainty includes it"
            if steady
            else "nothing says which are right, cut the drive there"
        ),
        error_m=0.0 if older else size,
        late_s=age,
        state="good" if steady else "doubtful",
    )


def regained_jumps(
    model: FixModel, told: Innovations, path: Trajectory, late_s: float
) -> list[Jump]:
    """Jumps of positions that are good to decimetres behind those that are twice as unsure, or
    none, against where the filter led: fixes that are tagged ``late_s`` after the rows of the
    ``path`` that their innovations ``told`` are stamped as."""
    rows = np.flatnonzero((model.flags & HAS_POS_H) > 0)
    if len(rows) < fusion_limits.LEAST_JUDGED:
        return []
    t, sd = model.t[rows], model.stated_sd[rows, :2].max(axis=1)
    spacing = float(np.median(np.diff(t)))
    # of another kind than the one before, or behind none
    anew = np.diff(t, prepend=-np.inf) > limits.GAP_STEPS * spacing
    anew[1:] |= np.log(sd[:-1] / sd[1:]) > fusion_limits.MOST_JITTER
    first = np.flatnonzero(anew & (sd < fusion_limits.ARM_TOLD_SD_M))
    # one alone may be wild
    first = first[first + limits.STEP_FIXES <= len(t)]
    first = first[[not anew[k + 1 : k + limits.STEP_FIXES].any() for k in first]]
    found: list[Jump] = []
    for when in t[first].tolist():
        row, by = _led_off(told, path, when - late_s, 0.5 * spacing)
        if row < 0:
            continue
        square, nis = float(by @ by), float(told.nis[row])
        nis *= square / (square + nis * limits.REGAINED_SD_M**2)
        chance = exceeds(nis, int(np.count_nonzero(by))) * len(first)
        if chance < limits.OVER_HOLE_PROBABILITY:
            found.append(Jump(when, by, chance))
    return found


def _led_off(
    told: Innovations, path: Trajectory, gps_s: float, reach_s: float
) -> tuple[int, FloatArray]:
    """The row of the position's innovation nearest to ``gps_s``, -1 where none is within
    ``reach_s``, and the innovation [3] m north, east and up."""
    north, east, down = (np.flatnonzero(told.channel == f"position_{axis}") for axis in "ned")
    at = np.interp(told.t_ns[north], path.t_ns, path.gps_s, -np.inf, np.inf)
    near = int(np.argmin(np.abs(at - gps_s))) if len(at) else -1
    by = np.zeros(3)
    if near < 0 or not abs(at[near] - gps_s) < reach_s:
        return -1, by
    row = int(north[near])
    for axis, (of, up) in enumerate(((north, 1.0), (east, 1.0), (down, -1.0))):
        by[axis] = up * told.innovation[of[told.t_ns[of] == told.t_ns[row]]].sum()
    return row, by


def _jumps(
    seen: Places,
    before: IntArray,
    half: int,
    left_out: int,
    spacing: float,
    velocity: FloatArray,
) -> FloatArray:
    """Jumps [k, 4] of positions beside the readings, from ``half`` fixes until ``before`` [m] to as
    many behind it, without the ``left_out`` first of them: m ahead and to the right of
    ``velocity`` [n, 2], its size, and what positions there are stated to be good to, m; of those
    that have no hole but behind ``before``, nor one in the readings, and drive."""
    side = np.arange(half)
    rows = before[:, None] + np.concatenate([side - half + 1, side + 1 + left_out])
    rows = rows[(rows[:, 0] >= 0) & (rows[:, -1] < len(seen.t))]
    holes = np.cumsum(np.diff(seen.t, prepend=seen.t[:1]) > limits.GAP_STEPS * spacing)[rows]
    lost = seen.lost_s[rows]
    most = 0 if left_out else 1
    whole = (holes[:, half - 1] == holes[:, 0]) & (holes[:, -1] == holes[:, half])
    whole &= (holes[:, -1] - holes[:, 0] == most) & (lost[:, -1] == lost[:, 0])
    speed = np.hypot(*velocity[rows[:, half - 1]].T)
    rows = rows[whole & (speed > fusion_limits.DRIVING_SPEED)]
    if not len(rows):
        return np.zeros((0, 4))
    at = rows[:, half - 1]
    t = seen.t[rows] - 0.5 * (seen.t[at] + seen.t[rows[:, half]])[:, None]
    felt = seen.felt[rows] - seen.felt[at, None]
    y = seen.at[rows] - seen.at[at, None] - np.einsum("kij,knj->kni", seen.turn[at], felt)
    after = np.broadcast_to(np.arange(2 * half) >= half, t.shape)
    jump, _ = last_term(np.stack([np.ones_like(t), t, t**2, after], axis=-1), y)
    v = velocity[at]
    speed = np.hypot(v[:, 0], v[:, 1])
    ahead = (jump * v).sum(axis=1) / speed
    right = (jump[:, 1] * v[:, 0] - jump[:, 0] * v[:, 1]) / speed
    return np.column_stack([ahead, right, speed, seen.sd[rows].max(axis=1)])
