"""What changes with time alone: periods, transients, steps of a bias or a gain, through boxes.

A bias in boxes of some seconds along each inertial axis has a column a box. Every slow course of
time is a sum of boxes, so thousands of periods, time constants and instants cost no column more.
So is a gain that changes: what an axis measures, times a course of time. And so is what the unit
sits and keeps time by: its mounting may slip, creep or sway, its clock step or change its rate.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from automap.effects.formula_text import parse_formula
from automap.effects.signals import FIELDS, Signals
from automap.effects.user import INERTIAL
from automap.gap import limits
from automap.gap.candidates import follows_time, is_course
from automap.gap.columns import signal_column, size_of, usual_sds
from automap.gap.limits import LEAST_BOXES, PLATEAUS
from automap.gap.linear import Column, Inertial, Linear
from automap.gap.mixing import Group, Mixing
from automap.gap.nodes import NodeMotion
from automap.gap.result import coefficient_names, equation
from automap.records import FloatArray

BOX = "box"
STEP, RAMP = "step(time - {:.4g})", "max(time - {:.4g}, 0)"
PLATEAU = "(step(time - {:.5g}) - step(time - {:.5g}))"
SWITCH = "step(cos(2 * pi * (time - {:.5g}) / {:.5g}) - {:.4f})"
"""What is on about an instant in each period, for as long as the cosine is above the last number: a
heater, a pump, a fan."""
OVERSAMPLED = 2.0
"""Frequencies stand closer than the inverse length of the drive by this factor: in between a
period loses no more than a fifth of its evidence, sinc^2(1 / 4)."""
DECAYS = 12
GAINS = {**{f"gyro_{a}": "rate_z" for a in "xyz"}, "accel_x": "force_x", "accel_y": "force_y"}
"""What an axis mostly measures in a vehicle. Upwards that is its weight, and a gain is a bias."""
SEAT = ("imu_pitch", "imu_yaw", "imu_time", "antenna_x", "antenna_y")
"""How unit and antenna sit, and keep time. What the unit leans by its weight tells no better than
its drift, how high the antenna sits no better than heights."""
GAIN_PERIODS = 32
"""So many periods of a gain or a seat a drive at most, and steps: these show in bends and changes
of speed alone, and between two of them nobody sees them."""
GAIN_DECAYS = 4
REFINED = 21
"""Steps of a refinement: a tenth of the distance of those first tried."""
NUMBER = re.compile(r"(?<=[-/] )[\d.e+-]+(?=[,)])")
"""The instants, the time constant or the period of a course of time in its text."""
PERIODIC = re.compile(r"(.*?)(sin|step\(cos)\(2 \* pi \* (.*)")
"""A course of time that comes again: what it is a gain of, its wave, and the rest."""


def box_s(length_s: float) -> float:
    """Length of the boxes of a drive, s."""
    return max(limits.BOX_S, length_s / limits.MOST_BOXES)


def gain_step_s(length_s: float) -> float:
    """Time between steps of a gain, or of a seat, and the length of the boxes of these, s."""
    return max(limits.BLOCKS_S[0], length_s / GAIN_PERIODS)


def box_columns(at: NodeMotion) -> list[Column]:
    """A column a box for each inertial axis along one drive, and for each of its ``SEAT``."""
    fit, motion = at.fit, at.motion
    time = motion.t + fit.opened.drive.begin_s
    length = float(motion.t[-1] - motion.t[0])
    name = f"{BOX} {fit.opened.drive.name}"
    count = max(round(length / gain_step_s(length)), 1)
    middles = time[0] + (np.arange(count) + 0.5) * length / count
    out = []
    for own, middle in zip(np.eye(count), middles, strict=True):
        # linear in between: what swings slowly is no stair
        share = np.interp(time, middles, own)
        for channel in SEAT:
            term = (channel, f"{middle:.3f}")
            out.append(signal_column(term, share, at, name, " ".join(term)))
    number = ((motion.t - motion.t[0]) / box_s(length)).astype(np.int64)
    for i in range(int(number[-1]) + 1):
        inside = number == i
        if not inside.any():
            continue
        middle = float(time[inside].mean())
        for channel in INERTIAL:
            acts = (Inertial.on(channel, inside),)
            key = f"{channel} {middle:.3f}"
            sensor, axis = divmod(INERTIAL.index(channel), 3)
            # of a gyro the turn rate, whatever its axis
            read = motion.force[inside, axis] if sensor else motion.rate[inside, 2]
            term, mean = (channel, f"{middle:.3f}"), float(read.mean())
            out.append(Column(name, key, size_of(channel), acts, term=term, mean_input=mean))
    return out


@dataclass(frozen=True)
class Shape:
    """A course of time: the texts of its terms, and of how many it is the likeliest."""

    texts: tuple[str, ...]
    choices: float = 1.0


def shapes(begin_s: float, end_s: float) -> list[Shape]:
    """Periods, decays and steps that a drive between two instants may show."""
    length = end_s - begin_s
    width = box_s(length)
    # between two boxes
    instants = np.arange(begin_s + 2.5 * width, end_s - 2.0 * width, width)
    return _courses(length, LEAST_BOXES * width, (2.0 * width, DECAYS), instants, (STEP,))


def gain_shapes(begin_s: float, end_s: float) -> list[Shape]:
    """Courses of a gain or a seat: slower than those of a bias, and some that begin to grow."""
    length = end_s - begin_s
    shortest, step = max(limits.BLOCKS_S[-1], length / GAIN_PERIODS), gain_step_s(length)
    instants = np.arange(begin_s + step, end_s - 0.5 * step, step)
    decays = limits.BLOCKS_S[0], GAIN_DECAYS
    return _courses(length, shortest, decays, instants, (STEP, RAMP))


def _courses(
    length_s: float,
    shortest_s: float,
    decays: tuple[float, int],
    instants: FloatArray,
    begins: Sequence[str],
) -> list[Shape]:
    """Periods of ``shortest_s`` and more, so many ``decays`` from a time constant on, and what
    ``begins`` at ``instants``."""
    out = []
    for i in range(2, int(OVERSAMPLED * length_s / shortest_s) + 1):
        turn = f"2 * pi * time / {OVERSAMPLED * length_s / i:.4g}"
        out.append(Shape((f"sin({turn})", f"cos({turn})")))
    for tau in np.geomspace(decays[0], 0.5 * length_s, decays[1]):
        out.append(Shape((f"exp(-time / {tau:.3g})",)))
    return out + [Shape((text.format(at),)) for at in instants for text in begins]


def plateaus(times: FloatArray, score: FloatArray, info: FloatArray) -> list[Shape]:
    """What lasts from one box to another: the likeliest of all pairs of instants for boxes at
    ``times`` [n] with score [n] and information [n, n] of a channel, in drives of one clock."""
    order = np.argsort(times, kind="stable")
    times, score = times[order], score[order]
    n = len(times)
    if n < 4:
        return []
    sums = np.concatenate([[0.0], np.cumsum(score)])
    corner: FloatArray = np.zeros((n + 1, n + 1))
    corner[1:, 1:] = np.cumsum(np.cumsum(info[np.ix_(order, order)], axis=0), axis=1)
    first, last = np.triu_indices(n - 1, LEAST_BOXES)
    # not those that begin or end with the drive: steps say them
    first, last = first[first > 0], last[first > 0]
    gain = (sums[last] - sums[first]) ** 2
    own = np.diag(corner)
    size = own[last] + own[first] - 2.0 * corner[first, last]
    worth = gain / np.maximum(size, 1e-12)
    out: list[Shape] = []
    taken: list[tuple[float, float]] = []
    for i in np.argsort(-worth):
        a, b = (0.5 * float(times[k - 1] + times[k]) for k in (first[i], last[i]))
        apart = all(abs(a - c) + abs(b - d) > 0.5 * (b - a) for c, d in taken)
        if apart:
            taken.append((a, b))
            out.append(Shape((PLATEAU.format(a, b),), len(first) / PLATEAUS))
        if len(out) == PLATEAUS:
            break
    return out


def with_shapes(linear: Linear) -> Linear:
    """The linear model with courses of time in place of its boxes."""
    boxes = [i for i, c in enumerate(linear.layout) if c.effect.startswith(BOX)]
    plain = [i for i, c in enumerate(linear.layout) if not c.effect.startswith(BOX)]
    if not boxes:
        return linear
    times = np.array([float(linear.layout[i].term[1]) for i in boxes])
    channels = [linear.layout[i].term[0] for i in boxes]
    layout: list[Column] = [linear.layout[i] for i in plain]
    known = {c.effect for c in layout}
    courses: list[FloatArray] = []
    left = linear.score - linear.info @ linear.values
    signals, inputs = _time_signals(times), np.array([linear.layout[i].mean_input for i in boxes])
    ends = float(times.min()), float(times.max())
    axes = [(channel, "") for channel in INERTIAL]
    every = [(shape, axes) for shape in shapes(*ends)]
    of_channel = {c: np.flatnonzero(np.array(channels) == c) for c in (*INERTIAL, *SEAT)}
    for channel in INERTIAL:
        mine = of_channel[channel]
        at = np.array(boxes)[mine]
        inner = linear.info[np.ix_(at, at)]
        every += [(s, [(channel, "")]) for s in plateaus(times[mine], left[at], inner)]
    slower = [*GAINS.items(), *((channel, "") for channel in SEAT)]
    for shape in gain_shapes(*ends):
        # a clock that warms settles to a rate, not to an offset
        settles = shape.texts[0].startswith("exp")
        every.append((shape, [on for on in slower if on[0] != "imu_time" or not settles]))
    for shape, on_channels in every:
        values = [parse_formula(text)(signals) for text in shape.texts]
        usual = [usual_sds([c for c, gain in on_channels if not gain], v) for v in values]
        for channel, gain in on_channels:
            mine = of_channel[channel]
            if not len(mine) or (gain and not np.ptp(inputs[mine]) > 0.0):
                continue
            terms = [(channel, f"{gain} * {text}" if gain else text) for text in shape.texts]
            name = equation(terms)
            if name in known:
                continue
            names = coefficient_names(len(terms))
            for parameter, value, term, known_sd in zip(names, values, terms, usual, strict=True):
                course = value[mine] * inputs[mine] if gain else value[mine]
                sd = usual_sds((channel,), course)[channel] if gain else known_sd[channel]
                courses.append(course)
                layout.append(Column(name, parameter, sd, term=term, choices=shape.choices))
    groups = [Group(np.array(plain, np.int64), np.arange(len(plain)), np.eye(len(plain)))]
    for channel, mine in of_channel.items():
        own = [i for i in range(len(plain), len(layout)) if layout[i].term[0] == channel]
        if own:
            by = np.stack([courses[i - len(plain)] for i in own], axis=1)
            groups.append(Group(np.array(boxes)[mine], np.array(own, np.int64), by))
    mixing = Mixing(tuple(groups), len(layout))
    return replace(
        linear,
        layout=tuple(layout),
        mixing=mixing,
        score=mixing.of(linear.score),
        prior_sd=np.array([c.prior_sd for c in layout]),
        values=np.concatenate([linear.values[plain], np.zeros(len(layout) - len(plain))]),
    )


def _time_signals(time: FloatArray) -> Signals:
    nothing = np.zeros(len(time))
    return Signals(*(time if name == "time" else nothing for name in FIELDS))


def lasts(terms: Sequence[tuple[str, str]], length_s: float) -> bool:
    """Whether a course of time is no plateau of fewer boxes than one is seen by: for so short a
    time vehicles sway, and receivers err, by themselves."""
    ends = [float(n) for n in NUMBER.findall(terms[0][1])]
    brief = len(ends) == 2 and ends[1] - ends[0] < LEAST_BOXES * box_s(length_s)
    return not (brief and is_course(terms))


def switched(terms: Sequence[tuple[str, str]]) -> list[tuple[tuple[str, str], ...]]:
    """What is on for a part of each period of one that swings: about every sixteenth of the period,
    for an eighth of it to a half; and of one that is on so what is near it, in steps a quarter as
    long. Nothing for other formulas."""
    on, text = terms[0]
    found = PERIODIC.match(text) if follows_time(terms) else None
    if found is None:
        return []
    gain, wave, rest = found.groups()
    ends = [float(n) for n in NUMBER.findall(rest)]
    middles, shares, periods = [i / 16 for i in range(16)], [i / 8 for i in range(1, 5)], ends
    if wave.startswith("step"):
        near = np.linspace(-0.5, 0.5, 5)
        middles = list(ends[0] / ends[1] + near / 16)
        shares = [s for s in math.acos(ends[2]) / math.pi + near / 8 if 0.0 < s < 1.0]
        periods = list(ends[1] * (1.0 + 0.02 * near))
    return [
        ((on, gain + SWITCH.format(m % 1.0 * p, p, math.cos(math.pi * s))),)
        for p in periods
        for m in middles
        for s in shares
    ]


def variants(
    terms: Sequence[tuple[str, str]], length_s: float
) -> list[tuple[tuple[str, str], ...]]:
    """A course of time with its period, time constant or instant moved in small steps, as far as
    those that were tried lie apart; nothing for other formulas."""
    if not follows_time(terms):
        return []
    on, text = terms[0]
    gain = "" if is_course(terms) else "".join(text.partition(" * ")[:2])
    width, decays = box_s(length_s), DECAYS
    if gain or on in SEAT:
        width, decays = gain_step_s(length_s), GAIN_DECAYS
    text = text.removeprefix(gain)
    ends = [float(n) for n in NUMBER.findall(text)]
    value = ends[-1]
    if len(ends) == 2:
        around = width * np.linspace(-1.0, 1.0, REFINED // 2)
        pairs = [(ends[0] + x, ends[1] + y) for x in around for y in around]
        return [((on, PLATEAU.format(*pair)),) for pair in pairs]
    if text.startswith(("step", "max")):
        moved = value + width * np.linspace(-1.0, 1.0, REFINED)
    elif text.startswith("exp"):
        ratio = (0.25 * length_s / width) ** (1.0 / (decays - 1))
        moved = value * np.geomspace(1.0 / ratio, ratio, REFINED)
    else:
        moved = 1.0 / (1.0 / value + np.linspace(-1.0, 1.0, REFINED) / (OVERSAMPLED * length_s))
    return [tuple((on, NUMBER.sub(f"{v:.5g}", t)) for on, t in terms) for v in moved if v > 0.0]
