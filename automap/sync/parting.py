"""Where positions and velocities of a receiver contradict each other, whichever is wrong."""

from __future__ import annotations

import numpy as np

from automap.gates import sd_by_median
from automap.records import BoolArray
from automap.sync import limits
from automap.sync.held_values import Stretch, repeated
from automap.sync.receiver_path import ComplexArray, ReceiverPath, plausible_sd, windows


def excesses(
    path: ReceiverPath, right: ComplexArray, velocity: BoolArray, position: BoolArray
) -> list[float]:
    """How many times what is plausible the two paths usually part by, over short windows and longer
    ones that tell it.

    ``right`` [n] is the path of the velocities, ``velocity`` and ``position`` [n] say which rows'
    count. The longest windows do not: most of them may hold one and the same parting.
    """
    found = []
    for length in limits.PARTING_S[:-1]:
        over = windows(path, velocity, length, position)
        if len(over) >= limits.LEAST_WINDOWS:
            part = over.change(path.place - right) / plausible_sd(path, over)
            found.append(sd_by_median(np.concatenate([part.real, part.imag])))
    return found


def partings(
    path: ReceiverPath,
    right: ComplexArray,
    velocity: BoolArray,
    position: BoolArray,
    worse: float,
) -> list[Stretch]:
    """Stretches in which the two paths part by more than ``worse`` times what is plausible.

    Short windows go first, and what they find is taken out of the longer ones: a jump is one of
    the step in which it happens.
    """
    apart = (path.place - right).astype(complex)
    inside = np.zeros(max(len(path) - 1, 0), np.bool_)
    for length in limits.PARTING_S:
        over = windows(path, velocity, length, position)
        if not len(over):
            continue
        sd = worse * np.hypot(plausible_sd(path, over), limits.STEP_SD_M)
        beyond = over.part(0.5 * np.abs(over.change(apart) / sd) ** 2 > limits.CERTAIN_LEAD_NATS)
        new = np.zeros_like(inside)
        for first, last in zip(beyond.first.tolist(), beyond.last.tolist(), strict=True):
            new[first:last] = True
        inside |= new
        step = np.diff(apart)
        step[inside] = 0.0
        apart = np.concatenate([apart[:1], apart[0] + np.cumsum(step)])
    whole = path.place - right
    left = whole[:1].sum()
    for first, last in repeated(~inside):
        # nothing says of a place that it is right which is another than before, and lasts for less
        # than positions are compared over
        short = path.t[last] - path.t[first] < limits.PARTING_S[1]
        other = abs(whole[first] - left) > limits.STEP_SD_M
        if short and other and first > 0 and last < len(inside):
            inside[first:last] = True
        else:
            left = whole[last]
    return [
        Stretch(first, last, float(np.abs(whole[first : last + 1] - whole[first]).max()))
        for first, last in repeated(inside)
    ]


def asides(path: ReceiverPath, right: ComplexArray, parted: list[Stretch]) -> list[Stretch]:
    """Stretches before, between and after those in which the two paths part, in which positions lie
    aside of where they are for most of the drive; with how far, m.

    Where they are nowhere for most of it each stretch counts as aside of the furthest other one.
    """
    if not parted:
        return []
    whole = path.place - right
    steps = [whole[s.last] - whole[s.first] for s in parted]
    level = np.concatenate([[0.0], np.cumsum(steps)])
    first = np.array([0, *(s.last for s in parted)])
    last = np.array([*(s.first for s in parted), len(path) - 1])
    seconds = path.t[last] - path.t[first]
    apart = np.abs(level[:, None] - level[None, :])
    usual = int(np.argmin(apart @ seconds))
    near = apart[usual] < limits.STEP_SD_M
    sure = seconds[near].sum() >= limits.MOST_OF_DRIVE * seconds.sum()
    off = apart[usual] if sure else apart.max(axis=1)
    return [
        Stretch(a, b, metres)
        for a, b, metres in zip(first.tolist(), last.tolist(), off.tolist(), strict=True)
        if metres >= limits.STEP_SD_M and b > a
    ]
