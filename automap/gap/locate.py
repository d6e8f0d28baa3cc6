"""Where a gap is: channel by manoeuvre, and slow or fast."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from automap.fusion.layout import CHANNELS
from automap.gap.fit import Fit, at_times, motion_of, whitened_innovations
from automap.records import FloatArray

MANOEUVRES = ("standing", "turning", "accelerating", "braking", "cruising")
STANDING_SPEED = 0.5
TURN_RATE = 0.08
ACCELERATION = 0.6
LEAST = 15
SHOWN = 8


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
    out[along > ACCELERATION] = "accelerating"
    out[along < -ACCELERATION] = "braking"
    out[rate > TURN_RATE] = "turning"
    out[speed < STANDING_SPEED] = "standing"
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
                    if len(w) >= LEAST:
                        entry = sums.setdefault((c, name), [np.zeros(2), np.zeros(2)])
                        entry[side] += np.array([len(w), float(np.sum(w**2))])
    out = [
        Place(
            CHANNELS[c],
            name,
            int(a[0]),
            float(a[1] / a[0]),
            float(b[1] / max(b[0], 1.0)),
        )
        for (c, name), (a, b) in sums.items()
        if a[0] > 0
    ]
    return sorted(out, key=lambda p: -p.before)


def worst_by_channel(found: Sequence[Place]) -> dict[int, str]:
    """The manoeuvre with the largest innovations of each channel."""
    out: dict[int, str] = {}
    for place in found:
        out.setdefault(CHANNELS.index(place.channel), place.manoeuvre)
    return out
