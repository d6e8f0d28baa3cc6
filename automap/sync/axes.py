"""Which way the axes of an IMU are, all ways tested together.

A hypothesis says how the readings of each triad become specific force and rate in vehicle axes:
48 signed permutations a triad, mirrored ones among them. Each is scored by the log likelihood of
the correlations that it predicts (``axes_evidence``); a mistake in a manifest is rare beforehand.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import permutations, product

import numpy as np

from automap.records import FloatArray
from automap.sync import limits
from automap.sync.axes_evidence import AxesEvidence, Followed, Tilts

SIGNED_PERMUTATIONS: FloatArray = np.array(
    [
        [[signs[i] * float(order[i] == j) for j in range(3)] for i in range(3)]
        for order in permutations(range(3))
        for signs in product((1.0, -1.0), repeat=3)
    ]
)
"""All 48 [48, 3, 3], that which changes nothing first."""
_NEGATED = int(np.argmin(np.einsum("kii->k", SIGNED_PERMUTATIONS)))

_FURTHEST_RAD = float(np.arccos(np.sqrt(1.0 / 3.0))) + 1e-6
"""So far a direction lies from the nearest of an IMU's axes at most: along a cube's diagonal."""


@dataclass(frozen=True)
class Hypothesis:
    """Readings become vehicle axes by ``accel`` and ``gyro`` [3, 3]; ``probability`` of that."""

    accel: FloatArray
    gyro: FloatArray
    probability: float

    @property
    def rigid(self) -> bool:
        """Whether both triads are right-handed and of one case."""
        return bool(np.allclose(self.accel, self.gyro) and np.linalg.det(self.accel) > 0.0)


@dataclass(frozen=True)
class AxesJudgement:
    """All hypotheses weighed.

    ``stated`` that of the manifest: readings are in vehicle axes, or, where their axes are
    unknown, both triads are of one right-handed case. ``best`` the most probable, ``others`` those
    that are as good. For unknown axes ``mounting`` [3, 3] takes the case of the best one to
    vehicle axes, as well as the moments tell.
    """

    stated: Hypothesis
    best: Hypothesis
    others: tuple[Hypothesis, ...] = ()
    mounting: FloatArray | None = None


def judge_stated(seen: AxesEvidence) -> AxesJudgement:
    """Judge readings that are said to be in vehicle axes."""
    ways = SIGNED_PERMUTATIONS
    return _judgement(scores(seen, ways, ways) + prior_of_ways(), ways, ways)


def prior_of_ways() -> FloatArray:
    """Log probability [48, 48] before the data that accelerometer and gyro are to be read by each
    two of ``SIGNED_PERMUTATIONS``."""
    ways = SIGNED_PERMUTATIONS
    mistakes = np.full((len(ways), len(ways)), 3)
    mistakes[0, :] = mistakes[:, 0] = 2
    turned = np.linalg.det(ways) > 0.0
    np.fill_diagonal(mistakes, np.where(turned, 1, 2))
    mistakes[0, _NEGATED] = mistakes[_NEGATED, 0] = 1
    mistakes[0, 0] = 0
    return _before(mistakes)


def judge_unknown(seen: AxesEvidence) -> AxesJudgement:
    """Judge readings of a case that is mounted in any way: are both triads right-handed and of one
    case, or what makes them so?"""
    ways = SIGNED_PERMUTATIONS
    signs = np.array([np.eye(3), -np.eye(3)])
    cases = [mounting(seen, sign) for sign in (1.0, -1.0)]
    both = zip((1.0, -1.0), cases, strict=True)
    likelihood = np.concatenate([scores(seen, s * case[None], case @ ways) for s, case in both])
    mistakes = np.array([np.full(len(ways), 2), np.full(len(ways), 3)])
    mistakes[0, 0] = 0
    mistakes[1, 0] = mistakes[0, _NEGATED] = 1
    mistakes[1, _NEGATED] = 2
    found = _judgement(likelihood + _before(mistakes), signs, ways)
    case = cases[0 if found.best.accel[0, 0] > 0.0 else 1]
    best, turn = _as_read(found.best)
    others = tuple(_as_read(other)[0] for other in found.others)
    return AxesJudgement(found.stated, best, others, case @ turn.T)


def _as_read(found: Hypothesis) -> tuple[Hypothesis, FloatArray]:
    """The same with a case of which most axes are those of the readings, and the turn [3, 3] to it:
    how a case lies in itself is free."""
    turns = SIGNED_PERMUTATIONS[np.linalg.det(SIGNED_PERMUTATIONS) > 0.0]
    kept = np.einsum("kij,ji->k", turns, found.accel + found.gyro)
    turn = turns[int(np.argmax(kept))]
    return replace(found, accel=turn @ found.accel, gyro=turn @ found.gyro), turn


def _before(mistakes: np.ndarray) -> FloatArray:
    """Log probability before the data of hypotheses by the ``mistakes`` that each needs.

    A case that is mounted otherwise is one mistake, as is a negated triad; any other disagreement
    of the triads counts as two.
    """
    log = mistakes * np.log(limits.MISTAKE)
    for count in np.unique(mistakes):
        log[mistakes == count] -= np.log(np.count_nonzero(mistakes == count))
    return np.asarray(log)


def _judgement(log: FloatArray, accel: FloatArray, gyro: FloatArray) -> AxesJudgement:
    weight = np.exp(log - log.max())
    probability = weight / weight.sum()
    order = np.argsort(-probability, axis=None)

    def hypothesis(flat: int) -> Hypothesis:
        i, j = divmod(flat, len(gyro))
        return Hypothesis(accel[i], gyro[j], float(probability[i, j]))

    best = hypothesis(int(order[0]))
    others = [hypothesis(int(k)) for k in order[1:10]]
    near = tuple(o for o in others if o.probability > limits.AS_GOOD * best.probability)
    return AxesJudgement(hypothesis(0), best, near)


def scores(seen: AxesEvidence, accel: FloatArray, gyro: FloatArray) -> FloatArray:
    """Log likelihood [m, k] of every pair of ``accel`` [m, 3, 3] and ``gyro`` [k, 3, 3].

    Of a right hypothesis all correlations are positive: a negative one explains nothing.
    """
    down = -np.einsum("mij,j->mi", accel, seen.up)[:, 2]
    tilt = np.arccos(np.clip(down, -1.0, 1.0))
    # no correlation outweighs gravity: some other way has it nearer to down
    of_accel = np.where(tilt > _FURTHEST_RAD, -np.inf, -0.5 * (tilt / limits.TILT_SD) ** 2)
    of_accel = of_accel + _followed(seen.surge, accel[:, 0]) + _followed(seen.lateral, accel[:, 1])
    total = of_accel[:, None] + _followed(seen.turn, gyro[:, 2])[None, :]
    for tilts in seen.tilts:
        # nose up, gravity is felt forward; right side down, to the left
        for a, w in ((accel[:, 0], gyro[:, 1]), (accel[:, 1], -gyro[:, 0])):
            count = (a**2 @ tilts.count)[:, None]
            total = total + _gain(count, *_beside_turns(tilts, a, w, gyro[:, 2]))
    return np.asarray(total)


def _beside_turns(
    tilts: Tilts, a: FloatArray, w: FloatArray, down: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Product and power [m, k] of changes of force along ``a`` [m, 3] and turns about ``w`` [k, 3]
    without what goes with turns about ``down`` [k, 3]: these tilt nothing, and of a case that leans
    all axes feel them (partial correlation)."""
    turns = np.maximum(np.einsum("ki,ij,kj->k", down, tilts.ww, down), 1e-300)
    with_force = a @ tilts.aw @ down.T
    with_tilt = np.einsum("ki,ij,kj->k", w, tilts.ww, down)
    product = a @ tilts.aw @ w.T - with_force * with_tilt / turns
    force = np.einsum("mi,ij,mj->m", a, tilts.aa, a)[:, None] - with_force**2 / turns
    tilt = np.einsum("ki,ij,kj->k", w, tilts.ww, w) - with_tilt**2 / turns
    return product, np.maximum(force, 0.0) * np.maximum(tilt, 0.0)


def _followed(seen: Followed | None, axis: FloatArray) -> FloatArray:
    """Log likelihood [m] that readings along ``axis`` [m, 3] go with what the receiver saw."""
    if seen is None:
        return np.zeros(len(axis))
    power = np.einsum("mi,ij,mj->m", axis, seen.xx, axis) * seen.yy
    return _gain(np.asarray(seen.count), axis @ seen.xy, power)


def _gain(count: FloatArray, product: FloatArray, power: FloatArray) -> FloatArray:
    """Log likelihood of normal samples over that of none related, by correlation where positive."""
    r = np.clip(product / np.sqrt(np.maximum(power, 1e-300)), 0.0, limits.MOST_CORRELATION)
    return np.asarray(-0.5 * count * np.log1p(-(r**2)))


def correlation(seen: Followed, axis: FloatArray) -> float:
    """Correlation of readings along ``axis`` [3] with what the receiver saw."""
    power = float(axis @ seen.xx @ axis) * seen.yy
    return float(axis @ seen.xy) / np.sqrt(power) if power > 0.0 else 0.0


def slope(seen: Followed, axis: FloatArray) -> tuple[float, float]:
    """How much the receiver saw for one that was read along ``axis`` [3], and its sigma."""
    power = float(axis @ seen.xx @ axis)
    if power <= 0.0 or seen.count <= 2.0:
        return 0.0, np.inf
    r = correlation(seen, axis)
    spread = np.sqrt(seen.yy / power)
    return r * spread, float(spread * np.sqrt(max(1.0 - r**2, 0.0) / (seen.count - 2.0)))


def mounting(seen: AxesEvidence, sign: float = 1.0) -> FloatArray:
    """C_vehicle_case [3, 3] of a case whose accelerometer reads ``sign`` times specific force."""
    down = -sign * seen.up
    helper = np.eye(3)[int(np.argmin(np.abs(down)))]
    level = np.cross(down, helper)
    level /= np.linalg.norm(level)
    angle = np.arange(0.0, 2.0 * np.pi, limits.AZIMUTH_STEP_RAD)
    forward = np.cos(angle)[:, None] * level + np.sin(angle)[:, None] * np.cross(down, level)
    cases = np.stack(
        [forward, np.cross(down, forward), np.broadcast_to(down, forward.shape)], axis=1
    )
    fit = _followed(seen.surge, sign * cases[:, 0]) + _followed(seen.lateral, sign * cases[:, 1])
    return np.asarray(cases[int(np.argmax(fit))])
