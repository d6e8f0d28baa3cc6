"""What innovations still show: where a gap is, and what no candidate explains.

The innovations of a right model are white and of size one. Whatever the search has named, they are
looked at once more, by channel: by frequency, along the drive, and by what the vehicle does.
Ljung-Box and chi-squared tests as in Bar-Shalom, Li, Kirubarajan, section 5.4.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from automap.fusion.layout import CHANNELS
from automap.gap import limits
from automap.gap.fit import Fit, whitened_innovations
from automap.gap.motion import at_times, motion_of
from automap.gap.scoring import MEASURED, SHOWN
from automap.gates import exceeds
from automap.records import BoolArray, FloatArray

MANOEUVRES = ("standing", "turning", "accelerating", "braking", "cruising")
LIKE, AFTER = "like", "after"


@dataclass(frozen=True)
class Misfit:
    """Something that no candidate explains: ``channel``; ``kind`` "band", "time", "speed", "turn",
    "acceleration", "like" for what follows a candidate that is too weak to be named, "after" for
    what follows a manoeuvre in a way of its own; ``where`` in words, of "like" the candidate's
    name, of "after" channel and manoeuvre; ``size`` factor on the variance that the model expects;
    ``p_value`` of such a size by chance, all tests of the search counted."""

    channel: str
    kind: str
    where: str
    size: float
    p_value: float

    @property
    def suspected(self) -> bool:
        """Whether it is known by what it follows, not by its size."""
        return self.kind in (LIKE, AFTER)

    def __str__(self) -> str:
        channel = self.channel.replace("_", " ")
        if self.kind == AFTER:
            what, _, manoeuvre = self.where.partition(f" {AFTER} ")
            return (
                f"{channel} shows that {what.replace('_', ' ')} is off after {manoeuvre}, at once "
                "or up to a minute later, more than chance lets it"
            )
        if self.suspected:
            return (
                f"{channel} follows what {self.where} would do more than chance lets it, though "
                "not so surely that this is its name"
            )
        return f"{channel} scatters {self.size:.2g} times as much as modelled at {self.where}"


def misfits(fits: Sequence[Fit]) -> tuple[Misfit, ...]:
    """All that innovations of fits still show, the largest first."""
    found: list[Misfit] = []
    tests = 0
    for c in range(MEASURED):
        for one in (*_bands(fits, c), *_conditions(fits, c)):
            tests += 1
            found.append(one)
    told = [
        Misfit(m.channel, m.kind, m.where, m.size, min(1.0, tests * m.p_value))
        for m in found
        if m.size >= limits.WORTH
    ]
    told = [m for m in told if m.p_value <= np.exp(-limits.LEAST_ODDS)]
    return tuple(sorted(told, key=lambda m: -m.size))


def _rows(fit: Fit, channel: int) -> tuple[FloatArray, FloatArray]:
    whitened, t, channels = whitened_innovations(fit)
    at = channels == channel
    return np.clip(whitened[at], -limits.CLIP, limits.CLIP), t[at]


def _bands(fits: Sequence[Fit], channel: int) -> list[Misfit]:
    """Power by frequency."""
    power, frequency = [], []
    for fit in fits:
        w, t = _rows(fit, channel)
        if len(w) < limits.MISFIT_ROWS:
            continue
        step = float(np.median(np.diff(t)))
        if step <= 0.0:
            continue
        # of white rows of size one every ordinate has mean one
        power.append(np.asarray(np.abs(np.fft.rfft(w))[1:] ** 2 / len(w), np.float64))
        frequency.append(np.fft.rfftfreq(len(w), step)[1:])
    if not power:
        return []
    p, f = np.concatenate(power), np.concatenate(frequency)
    edges = np.geomspace(float(f.min()), float(f.max()) * 1.000001, limits.BANDS + 1)
    out = []
    for low, high in pairwise(edges):
        inside = (f >= low) & (f < high)
        count = int(inside.sum())
        if count < 2:
            continue
        size = float(p[inside].mean())
        words = f"periods of {1.0 / high:.3g} to {1.0 / low:.3g} s"
        chance = exceeds(2.0 * count * size, 2 * count)
        out.append(Misfit(CHANNELS[channel], "band", words, size, chance))
    return out


def _conditions(fits: Sequence[Fit], channel: int) -> list[Misfit]:
    """Size along the drive and by what the vehicle does."""
    ws, kinds = [], []
    for fit in fits:
        w, t = _rows(fit, channel)
        motion = motion_of(fit.last)
        speed = np.linalg.norm(at_times(motion, motion.vel, t), axis=1)
        rate = np.abs(at_times(motion, motion.rate, t)[:, 2])
        along = np.abs(
            np.interp(t, motion.t, np.einsum("ni,ni->n", motion.dcm[:, :, 0], motion.acc))
        )
        ws.append(w)
        kinds.append(np.stack([t + fit.opened.drive.begin_s, speed, rate, along], axis=1))
    w, conditions = np.concatenate(ws), np.concatenate(kinds)
    if len(w) < limits.MISFIT_ROWS:
        return []
    names = (
        ("time", "s after the start", 8),
        ("speed", "m/s", 4),
        ("turn", "rad/s of turn", 4),
        ("acceleration", "m/s^2 along", 4),
    )
    out = []
    for column, (kind, unit, pieces) in enumerate(names):
        x = conditions[:, column]
        edges = np.unique(np.quantile(x, np.linspace(0.0, 1.0, pieces + 1)))
        for low, high in pairwise(edges):
            inside: BoolArray = (x >= low) & (x <= high)
            out += _sized(w[inside], CHANNELS[channel], kind, f"{low:.3g} to {high:.3g} {unit}")
    return out


def _sized(w: FloatArray, channel: str, kind: str, words: str) -> list[Misfit]:
    if len(w) < limits.MIN_ROWS:
        return []
    size = float(np.mean(w**2))
    return [Misfit(channel, kind, words, size, exceeds(size * len(w), len(w)))]


@dataclass(frozen=True)
class Place:
    """A channel during a manoeuvre: how many measurements, and the mean squared normalised
    innovation before and after (1 is right)."""

    channel: str
    manoeuvre: str
    count: int
    before: float
    after: float


def manoeuvres(fit: Fit) -> npt.NDArray[np.object_]:
    """What the vehicle does at each node [k]."""
    motion = motion_of(fit.last)
    t = fit.last.nodes.t
    speed = np.linalg.norm(at_times(motion, motion.vel, t), axis=1)
    rate = np.abs(at_times(motion, motion.rate, t)[:, 2])
    forward = np.einsum("ni,ni->n", motion.dcm[:, :, 0], motion.acc)
    along = np.interp(t, motion.t, forward)
    out = np.full(len(t), "cruising", dtype=object)
    out[along > limits.ACCELERATION] = "accelerating"
    out[along < -limits.ACCELERATION] = "braking"
    out[rate > limits.TURN_RATE] = "turning"
    out[speed < limits.STANDING_SPEED] = "standing"
    return out


def places(before: Sequence[Fit], after: Sequence[Fit]) -> list[Place]:
    """Channels by manoeuvre, those whose innovations were largest first."""
    sums: dict[tuple[int, str], list[FloatArray]] = {}
    for old, new in zip(before, after, strict=True):
        doing = manoeuvres(new)
        for side, fit in enumerate((old, new)):
            whitened, _, channel = whitened_innovations(fit)
            node = fit.last.forward.store.info[:, 0]
            what = doing[np.minimum(node, len(doing) - 1)]
            for c in range(SHOWN):
                for name in MANOEUVRES:
                    w = np.clip(whitened[(channel == c) & (what == name)], -10.0, 10.0)
                    if len(w) >= limits.PLACE_ROWS:
                        entry = sums.setdefault((c, name), [np.zeros(2), np.zeros(2)])
                        entry[side] += np.array([len(w), float(np.sum(w**2))])
    out = [
        Place(CHANNELS[c], name, int(a[0]), float(a[1] / a[0]), float(b[1] / max(b[0], 1.0)))
        for (c, name), (a, b) in sums.items()
        if a[0] > 0
    ]
    return sorted(out, key=lambda p: -p.before)


def worst_by_channel(found: Sequence[Place]) -> dict[int, str]:
    """The manoeuvre with the largest innovations of each channel."""
    return {CHANNELS.index(p.channel): p.manoeuvre for p in reversed(found)}
