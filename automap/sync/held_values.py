"""Positions and velocities that a log repeats while the vehicle moves on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from automap.records import BoolArray, Fixes, FloatArray, IntArray
from automap.sync import limits
from automap.sync.receiver_path import (
    ComplexArray,
    ReceiverPath,
    Windows,
    plausible_sd,
    velocity_sd,
)


@dataclass(frozen=True)
class Stretch:
    """Rows ``first`` to ``last`` of a path, and by how much, m, the two paths part in them."""

    first: int
    last: int
    metres: float


def repeated(same: BoolArray) -> list[tuple[int, int]]:
    """First and last row of each run of rows that are the ``same`` [n - 1] as the one before."""
    edges = np.diff(np.concatenate([[0], same.astype(np.int8), [0]]))
    first, last = np.flatnonzero(edges > 0), np.flatnonzero(edges < 0)
    return list(zip(first.tolist(), last.tolist(), strict=True))


def in_long_repeats(path: ReceiverPath) -> BoolArray:
    """Rows [n] that repeat a position or a velocity for long, beyond the first of each run."""
    held = np.zeros(len(path), np.bool_)
    for values in (path.place, path.velocity):
        for first, last in repeated(np.diff(values) == 0.0):
            if last - first >= limits.LEAST_REPEATS:
                held[first + 1 : last + 1] = True
    return held


def held_heights(path: ReceiverPath) -> list[Stretch]:
    """Where heights repeat while the vehicle drives far: a receiver that sees three satellites, or
    none, keeps the last one. Heights told to whole metres may stay on a level road."""
    told = path.height[np.isfinite(path.height)]
    if not len(told) or np.all(told == np.rint(told)):
        return []
    way = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(path.place)))])
    return [
        Stretch(first, last, float(way[last] - way[first]))
        for first, last in repeated(np.diff(path.height) == 0.0)
        if path.t[last] - path.t[first] >= limits.HEIGHT_HELD_S
        and way[last] - way[first] >= limits.HEIGHT_HELD_M
    ]


def frozen_positions(
    path: ReceiverPath, right: ComplexArray, velocity: ComplexArray, worse: float
) -> tuple[list[Stretch], list[Stretch]]:
    """Where positions repeat though the velocities [n], put right and as the path ``right`` [n], go
    on: with velocities that change, and with ones that repeat as well, so that whole rows do.

    No position repeats to the last digit while a receiver moves, so that only what velocities may
    err by counts. Rows that repeat at no speed are those of a standstill, unless they are entered
    or left by a change of speed that no brake can do, or left by a jump that is more than the
    positions of a receiver ``worse`` than most wander by.
    """
    same_place, same_velocity = np.diff(path.place) == 0.0, np.diff(path.velocity) == 0.0
    digit = _digit_m(path)
    positions: list[Stretch] = []
    both: list[Stretch] = []
    for first, last in repeated(same_place):
        rows = np.arange(first + 1, last + 1)
        over = Windows(np.full(len(rows), first), rows)
        way = np.abs(over.change(right))
        variance = velocity_sd(path, over) ** 2 + digit**2
        frozen = bool(np.any(0.5 * way**2 / variance > limits.CERTAIN_LEAD_NATS))
        # what is repeated may also be that there is no velocity: then the first row has one
        whole = bool(np.all(same_velocity[min(first + 1, last - 1) : last]))
        jump, sd = _jump_after(path, right, first, last)
        if whole and not frozen:
            edges = (first - 1, first, last)
            frozen = any(_too_hard(path.t, velocity, row) for row in edges)
            frozen |= 0.5 * (jump / (worse * sd)) ** 2 > limits.CERTAIN_LEAD_NATS
        if frozen:
            most = max(float(way.max()), jump)
            (both if whole else positions).append(Stretch(first, last, most))
    return positions, both


def _digit_m(path: ReceiverPath) -> float:
    """The last digit of the positions, m: the least step of a coordinate."""
    steps = np.diff(path.place)
    sizes = np.abs(np.concatenate([steps.real, steps.imag]))
    sizes = sizes[sizes > 0.0]
    return float(sizes.min()) * np.sqrt(2.0) if len(sizes) else 0.0


def _jump_after(
    path: ReceiverPath, right: ComplexArray, first: int, last: int
) -> tuple[float, float]:
    """By how much, m, the positions part from the path ``right`` from ``first`` to the row after
    ``last``, and one sigma of that."""
    after = min(last + 1, len(path) - 1)
    over = Windows(np.array([first]), np.array([after]))
    sd = np.hypot(plausible_sd(path, over), limits.STEP_SD_M)
    return float(np.abs(over.change(path.place - right))[0]), float(sd[0])


def _too_hard(t: FloatArray, velocity: ComplexArray, row: int) -> bool:
    """Whether the velocity changes by more than brakes do from ``row`` to the next."""
    if row < 0 or row + 1 >= len(t):
        return False
    change = abs(velocity[row + 1] - velocity[row])
    beyond = change - limits.HARD_BRAKING * (t[row + 1] - t[row])
    square = beyond**2 / (2.0 * limits.VELOCITY_ERROR_SD**2)
    return bool(beyond > 0.0 and 0.5 * square > limits.CERTAIN_LEAD_NATS)


def stuck_velocities(
    path: ReceiverPath, right: ComplexArray, frozen: BoolArray, worse: float
) -> list[Stretch]:
    """Where velocities repeat though the positions, those that are not ``frozen`` [n], move
    otherwise than the path ``right`` [n].

    The positions must do so over many steps: the largest ones of a stretch are left out, for
    positions jump. ``worse`` is how much more this receiver errs than most.
    """
    found = []
    for first, last in repeated(np.diff(path.velocity) == 0.0):
        rows = np.arange(first, last + 1)
        rows = rows[~frozen[rows]]
        step = np.diff((path.place - right)[rows])
        jumps = 1 + int((path.t[last] - path.t[first]) / limits.JUMP_EVERY_S)
        if len(rows) <= limits.LEAST_REPEATS or len(step) <= jumps:
            continue
        step[np.argsort(np.abs(step))[-jumps:]] = 0.0
        over = Windows(np.full(len(step), rows[0]), rows[1:])
        apart, sd = np.abs(np.cumsum(step)), worse * plausible_sd(path, over)
        if np.any(0.5 * (apart / sd) ** 2 > limits.CERTAIN_LEAD_NATS):
            if abs(path.velocity[first]) < limits.VELOCITY_ERROR_SD:
                first, last = _moving_part(rows, step, sd)
            found.append(Stretch(first, last, float(apart.max())))
    return found


def _moving_part(rows: IntArray, step: ComplexArray, sd: FloatArray) -> tuple[int, int]:
    """First and last of ``rows`` [n] between which the paths part, by a ``step`` [n - 1] each: a
    stretch without speed may begin and end with standing."""
    ahead, behind = np.abs(np.cumsum(step)), np.abs(np.cumsum(step[::-1]))
    begin = int(np.argmax(ahead > sd))
    end = len(step) - int(np.argmax(behind > sd))
    return (int(rows[begin]), int(rows[end])) if begin < end else (int(rows[0]), int(rows[-1]))


def told_again(fixes: Fixes) -> BoolArray:
    """Rows [n] that say again, to the digit, what a row before said, where a log is written faster
    than its receiver measures, as rows that repeat while the vehicle drives on show; else none.

    At rest a receiver may find the same anew, once in the time from one of its rows to the next."""
    said = np.column_stack([fixes.lat_rad, fixes.lon_rad, fixes.vel_ned[:, :2]])
    same = np.zeros(len(fixes), np.bool_)
    same[1:] = np.all(said[1:] == said[:-1], axis=1)
    if not same.any():
        return same
    first = np.maximum.accumulate(np.where(same, 0, np.arange(len(fixes))))
    late = fixes.gps_s - fixes.gps_s[first]
    way = late * np.hypot(said[:, 2], said[:, 3])
    # the whole of a run, once its last row has left the place
    longest = np.zeros(len(fixes))
    np.maximum.at(longest, first, np.abs(np.nan_to_num(way)))
    moves = longest[first] > limits.TOLD_AGAIN_M
    again = same & moves
    if np.count_nonzero(again) <= limits.TOLD_AGAIN_SHARE * np.count_nonzero(moves | ~same):
        return np.zeros_like(same)
    step_s, own_s = (float(np.nanmedian(np.diff(t))) for t in (fixes.gps_s, fixes.gps_s[~same]))
    measured = np.diff(np.floor((late + 0.5 * step_s) / own_s), prepend=0.0) > 0.0
    return np.asarray(same & (moves | ~measured))


def held_at_rest(fixes: Fixes) -> BoolArray:
    """Rows [n] that repeat the position of the row before, to the digit and for long, where no
    speed is told; none of a log that never tells one.

    A receiver that holds still measures nothing there, and is still held while a vehicle begins to
    move; with these rows the noise of its positions would seem as small.
    """
    held = np.zeros(len(fixes), np.bool_)
    if not np.any(np.abs(fixes.vel_ned[:, :2]) > 0.0):
        return held
    place = np.column_stack([fixes.lat_rad, fixes.lon_rad])
    same = np.all(place[1:] == place[:-1], axis=1) & np.all(fixes.vel_ned[1:, :2] == 0.0, axis=1)
    for first, last in repeated(same):
        if last - first >= limits.LEAST_REPEATS:
            held[first + 1 : last + 1] = True
    return held
