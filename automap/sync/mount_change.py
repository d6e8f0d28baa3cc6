"""Whether an IMU lay in its vehicle all the drive as it did at first, and read its axes so.

The pieces of the drive (``mount_pieces``) tell its level and its azimuth, and which signs and order
its axes have; of each the likeliest change from some piece on is found.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from automap.gates import exceeds_ratio
from automap.records import BoolArray, FloatArray, IntArray
from automap.sync import limits
from automap.sync.axes import (
    SIGNED_PERMUTATIONS,
    Hypothesis,
    mounting,
    prior_of_ways,
    scores,
)
from automap.sync.axes_evidence import together
from automap.sync.mount_pieces import MountPiece, level_axes


@dataclass(frozen=True)
class MountChange:
    """From some instant between ``first_s`` and ``last_s`` after the first reading on an IMU's
    readings are others: turned by ``angle`` rad, one sigma ``sd``, in its "level" or its
    "azimuth", or in other "axes", by ``made`` of those before or, as good by what was recorded, by
    one of ``others``. ``probability`` of the like of an IMU that stays as it is."""

    kind: Literal["level", "azimuth", "axes"]
    first_s: float
    last_s: float
    probability: float
    angle: float = 0.0
    sd: float = 0.0
    made: Hypothesis | None = None
    others: tuple[Hypothesis, ...] = ()


@dataclass(frozen=True)
class _Cut:
    """The pieces ``after`` [n] a change and those to ``use`` [n], and when it is."""

    after: BoolArray
    use: BoolArray
    first_s: float
    last_s: float


def mount_change(pieces: Sequence[MountPiece], up: FloatArray, known: bool) -> MountChange | None:
    """The likeliest change that chance makes more seldom than ``CHANGE_PROBABILITY``, in all places
    where it was looked for; None where there is none. ``up`` [3] is the direction of the median
    force in the readings, which are in vehicle axes if ``known``."""
    cuts = list(_cuts(pieces))
    if not cuts:
        return None
    changes = [_axes_changed(pieces, cuts, known), *_turned(pieces, cuts, up)]
    found = [c for c in changes if c.probability * len(cuts) < limits.CHANGE_PROBABILITY]
    # another sign shows in level and azimuth, too, and a turn by a right angle in the axes
    signs = [c for c in found if c.made is not None and not c.made.rigid]
    turns = [c for c in found if c.made is None]
    return min(signs or turns or found, key=lambda c: c.probability, default=None)


def _cuts(pieces: Sequence[MountPiece]) -> Iterator[_Cut]:
    count = len(pieces)
    side = min(limits.SIDE_PIECES, count // 2)
    number = np.arange(count)
    whole = np.ones(count, np.bool_)
    for i in range(max(side, 1), count - side + 1):
        yield _Cut(number >= i, whole, pieces[i - 1].end_s, pieces[i].start_s)
        if i + side < count:
            # the piece within which it changes is of neither side
            yield _Cut(number >= i, number != i, pieces[i].start_s, pieces[i].end_s)


def _turned(
    pieces: Sequence[MountPiece], cuts: Sequence[_Cut], up: FloatArray
) -> Iterator[MountChange]:
    """The likeliest turn of the level, and of the azimuth."""
    axes = level_axes(up)
    raw, level = (
        np.array([axes @ getattr(piece, name) for piece in pieces]) for name in ("raw", "level")
    )
    azimuth = np.array([piece.azimuth for piece in pieces])
    sd = np.array([piece.azimuth_sd for piece in pieces])
    of_level, of_azimuth = [], []
    for cut in cuts:
        # heights in feet would turn the level on hills: it turns without them as well
        tilts = [_level_change(cut, values) for values in (raw, level)]
        of_level.append(max(tilts, key=lambda c: c.probability))
        of_azimuth.append(_azimuth_change(cut, azimuth, sd))
    for found in (of_level, of_azimuth):
        best = min(found, key=lambda c: c.probability)
        # the place is known by now, so that nothing is tried any more
        mistaken = _mistaken(best, cuts[found.index(best)], raw, level, azimuth, sd) / len(cuts)
        yield replace(best, probability=max(best.probability, mistaken))


def _mistaken(
    best: MountChange,
    cut: _Cut,
    raw: FloatArray,
    level: FloatArray,
    azimuth: FloatArray,
    sd: FloatArray,
) -> float:
    """Probability that one piece was mistaken, as ``MISTAKEN_LAG`` of them are, and the change is
    chance in all others."""
    chance = 0.0
    for k in np.flatnonzero(cut.use).tolist():
        use = cut.use & (np.arange(len(cut.use)) != k)
        fewer = _Cut(cut.after, use, cut.first_s, cut.last_s)
        if best.kind == "level":
            chance += max(_level_change(fewer, values).probability for values in (raw, level))
        else:
            chance += _azimuth_change(fewer, azimuth, sd).probability
    return limits.MISTAKEN_LAG * chance


def _level_change(cut: _Cut, values: FloatArray) -> MountChange:
    """By Hotelling's T^2 of two means (H. Hotelling, Annals of Mathematical Statistics 2, 1931) of
    levels [n, 2] rad, whose scatter is the drive's own beside other drives'."""
    none = MountChange("level", cut.first_s, cut.last_s, 1.0)
    known = cut.use & np.isfinite(values).all(axis=1)
    sides = [values[known & ~cut.after], values[known & cut.after]]
    if not all(len(side) for side in sides):
        return none
    step = sides[1].mean(axis=0) - sides[0].mean(axis=0)
    angle = float(np.hypot(*step))
    if angle <= limits.LOADED_RAD:
        return none
    beyond = step * (1.0 - limits.LOADED_RAD / angle)
    rest = np.concatenate([side - side.mean(axis=0) for side in sides])
    worth = limits.MOUNT_SCATTER_PIECES
    dof = len(rest) - 2 + worth
    scatter = (worth * limits.MOUNT_SCATTER_RAD**2 * np.eye(2) + rest.T @ rest) / dof
    share = sum(1.0 / len(side) for side in sides)
    square = float(beyond @ np.linalg.solve(scatter, beyond)) / share
    chance = exceeds_ratio(square * (dof - 1) / (2.0 * dof), 2, dof - 1)
    sd = math.sqrt(float(step @ scatter @ step) * share) / angle
    return MountChange("level", cut.first_s, cut.last_s, chance, angle, sd)


def _azimuth_change(cut: _Cut, azimuth: FloatArray, sd: FloatArray) -> MountChange:
    """By Student's t of weighted means of azimuths [n] rad, which scatter by more than their
    sigmas ``sd`` [n] say."""
    none = MountChange("azimuth", cut.first_s, cut.last_s, 1.0)
    known = cut.use & np.isfinite(sd)
    parts = [known & ~cut.after, known & cut.after]
    if not all(part.any() for part in parts):
        return none
    means, variances, square = [], [], 0.0
    for part in parts:
        weight = 1.0 / sd[part] ** 2
        about = azimuth[part][int(np.argmax(weight))]
        off = np.angle(np.exp(1j * (azimuth[part] - about)))
        mean = float(weight @ off / weight.sum())
        means.append(float(about) + mean)
        variances.append(1.0 / float(weight.sum()))
        square += float(weight @ (off - mean) ** 2)
    angle = abs(math.remainder(means[1] - means[0], 2.0 * math.pi))
    worth = limits.MOUNT_SCATTER_PIECES
    dof = int(np.count_nonzero(known)) - 2 + worth
    scatter = (worth * limits.LAG_SCATTER**2 + square) / dof
    spread = math.sqrt(scatter * sum(variances))
    beyond = max(angle - limits.LOADED_RAD, 0.0) / spread
    chance = exceeds_ratio(beyond**2, 1, dof)
    return MountChange("azimuth", cut.first_s, cut.last_s, chance, angle, spread)


def _axes_changed(pieces: Sequence[MountPiece], cuts: Sequence[_Cut], known: bool) -> MountChange:
    """The likeliest change of the signs and the order of axes, whatever they are at first."""
    ways, prior = SIGNED_PERMUTATIONS, prior_of_ways()
    best = MountChange("axes", 0.0, 0.0, 1.0)
    for cut in cuts:
        sides = [
            together([pieces[k].seen for k in np.flatnonzero(cut.use & part).tolist()])
            for part in (~cut.after, cut.after)
        ]
        case = np.eye(3) if known else mounting(sides[0])
        before, after = (scores(side, case @ ways, case @ ways) for side in sides)
        same = float((before + after).max())
        if not known:
            # an IMU that stays as it is lies as all pieces together tell, not as the first do
            lies = mounting(together(sides)) @ ways
            alike = np.sum([scores(side, lies, lies) for side in sides], axis=0)
            same = max(same, float(alike.max()))
        # of those that are as good the one with the fewest mistakes
        i, j = np.unravel_index(int(np.argmax(before + prior)), before.shape)
        accel, gyro = (_index(np.einsum("ji,kjl->kil", ways[n], ways)) for n in (i, j))
        changed = after + prior[accel][:, gyro]
        k, m = np.unravel_index(int(np.argmax(changed)), changed.shape)
        odds = float(before[i, j] + changed[k, m]) - same + math.log(limits.MISTAKE)
        probability = float(np.exp(-max(odds, 0.0)))
        if (k, m) != (i, j) and probability < best.probability:
            made, *others = _as_good(np.exp(changed - changed[k, m]), ways[accel], ways[gyro])
            best = MountChange(
                "axes", cut.first_s, cut.last_s, probability, made=made, others=tuple(others)
            )
    return best


def _as_good(odds: FloatArray, accel: FloatArray, gyro: FloatArray) -> list[Hypothesis]:
    """The best of hypotheses by ``odds`` [m, k] over it, and those that are as good after it."""
    near = np.argwhere(odds > limits.AS_GOOD)
    near = near[np.argsort(-odds[tuple(near.T)], kind="stable")]
    return [Hypothesis(accel[i], gyro[j], float(odds[i, j] / odds.sum())) for i, j in near]


def _index(matrices: FloatArray) -> IntArray:
    """Which of ``SIGNED_PERMUTATIONS`` each of ``matrices`` [k, 3, 3] is."""
    return np.asarray(np.einsum("kij,nij->kn", matrices, SIGNED_PERMUTATIONS).argmax(axis=1))
