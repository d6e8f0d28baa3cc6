"""How a receiver's velocities must be scaled, turned and dated to be those of its positions."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from automap.gates import sd_by_median
from automap.records import BoolArray, FloatArray
from automap.robust import cauchy_loss, cauchy_weight
from automap.sync import limits
from automap.sync.receiver_path import (
    ComplexArray,
    ReceiverPath,
    Windows,
    integrated,
    plausible_sd,
    windows,
)

PRIOR = np.array([limits.ANY_LOG_SCALE, limits.ANY_TURN_RAD, limits.ANY_LAG_S, limits.ANY_LAG_S])
"""One sigma of the logarithm of scale, of turn and lags before the data are seen."""


@dataclass(frozen=True)
class Estimate:
    """A number and its one-sigma uncertainty."""

    value: float
    sd: float


@dataclass(frozen=True)
class Match:
    """What makes told velocities those of the positions.

    ``mirrored``: east is told as west, or north and east are swapped. The velocity of the
    positions is ``factor`` times the told one (its conjugate where mirrored), ``factor`` complex:
    it contains scale and turn. ``scale`` is how many times the speed of the positions is told,
    ``turn_rad`` how far the told course must be turned clockwise beyond the quarter turns,
    ``quarters``; lags as in ``integrated``. ``turn_nats`` is by how much mirroring and quarters
    are likelier than that the courses are right. What is not known is None.
    """

    factor: complex = 1.0
    mirrored: bool = False
    quarters: int = 0
    turn_nats: float = 0.0
    scale: Estimate | None = None
    turn_rad: Estimate | None = None
    speed_lag_s: Estimate | None = None
    course_lag_s: Estimate | None = None

    def path(self, told: ReceiverPath, use: BoolArray) -> ComplexArray:
        """The path [n] that the velocities of the rows ``use`` show when they are put right."""
        lags = (0.0 if lag is None else lag.value for lag in (self.speed_lag_s, self.course_lag_s))
        sums = integrated(told, use, *lags)
        return np.asarray(self.factor * (np.conj(sums) if self.mirrored else sums))

    def velocity(self, told: ReceiverPath) -> ComplexArray:
        """The told velocities [n] put right, but for their lags."""
        turned = np.conj(told.velocity) if self.mirrored else told.velocity
        return np.asarray(self.factor * turned)


def match_paths(path: ReceiverPath, use_velocity: BoolArray, use_position: BoolArray) -> Match:
    """Compare the rows ``use_velocity`` [n] with the rows ``use_position`` [n] of ``path``."""
    seen = windows(path, use_velocity, limits.WINDOW_S, use_position)
    apart = windows(path, use_velocity, limits.WINDOW_S, use_position, apart=True)
    if len(apart) < limits.LEAST_WINDOWS:
        return Match()
    mirrored, quarters, nats = _orientation(path, use_velocity, apart)
    start = Match(1j**quarters, mirrored, quarters, nats)
    return _fit(path, use_velocity, seen, apart, start)


def _orientation(path: ReceiverPath, use: BoolArray, over: Windows) -> tuple[bool, int, float]:
    """Whether courses are mirrored, by how many quarters they are turned, and the evidence.

    Every orientation has the scale that suits it best. Courses are right unless that is less
    likely by odds of a million: on a straight road a mirroring cannot be told, and is none.
    """
    seen, told = over.change(path.place), over.change(integrated(path, use))
    sd = plausible_sd(path, over)
    kinds = [(mirrored, quarters) for mirrored in (False, True) for quarters in range(4)]
    matched = [_best_scale(seen, _oriented(told, *kind), sd) for kind in kinds]
    # errors beyond what is plausible count as errors do on this drive
    sd = sd * max(1.0, min(matched)[1])
    costs = np.array([_best_scale(seen, _oriented(told, *kind), sd)[0] for kind in kinds])
    best = int(np.argmin(costs))
    nats = float(costs[0] - costs[best])
    return (*kinds[best if nats > limits.CERTAIN_LEAD_NATS else 0], nats)


def _oriented(told: ComplexArray, mirrored: bool, quarters: int) -> ComplexArray:
    return np.asarray((np.conj(told) if mirrored else told) * 1j**quarters)


def _best_scale(
    seen: ComplexArray, told: ComplexArray, sd: FloatArray
) -> tuple[float, float, float]:
    """Least cost in nats over positive scales, the size of its residuals in ``sd``, the scale."""
    moves = np.abs(told) > sd
    factor = 0.0
    if np.any(moves):
        factor = float(np.median(np.abs(seen[moves])) / np.median(np.abs(told[moves])))
        for _ in range(limits.MATCH_ROUNDS):
            weight = cauchy_weight(np.abs((seen - factor * told) / sd)) / sd**2
            power = float(np.sum(weight * np.abs(told) ** 2))
            factor = max(0.0, float(np.sum(weight * (np.conj(told) * seen).real)) / power)
    residual = (seen - factor * told) / sd
    size = sd_by_median(np.concatenate([residual.real, residual.imag]))
    return 0.5 * float(cauchy_loss(np.abs(residual) ** 2).sum()), size, factor


def _fit(path: ReceiverPath, use: BoolArray, over: Windows, apart: Windows, start: Match) -> Match:
    """Scale, turn and the two lags by iteratively reweighted Gauss-Newton steps over the windows
    ``over``, from the lag that suits those ``apart`` from each other best.

    Uncertainty by the scores of stretches within which errors are correlated (Huber's sandwich
    with the stretches as clusters: Cameron and Miller, Journal of Human Resources 50(2), 2015).
    """
    seen = over.change(path.place)

    def told(among: Windows, lags: FloatArray) -> ComplexArray:
        sums = among.change(integrated(path, use, *lags.tolist()))
        return _oriented(sums, start.mirrored, start.quarters)

    steps = np.arange(-limits.MOST_LAG_S, limits.MOST_LAG_S + 1e-9, limits.LAG_GRID_S)
    few, least = apart.change(path.place), plausible_sd(path, apart)
    trials = [_best_scale(few, told(apart, np.full(2, lag)), least) for lag in steps.tolist()]
    best = int(np.argmin([cost for cost, _, _ in trials]))
    if trials[best][2] <= 0.0:
        return start
    log_factor, lags = complex(np.log(trials[best][2])), np.full(2, steps[best])

    for _ in range(limits.MATCH_ROUNDS):
        factor = np.exp(log_factor)
        shown = factor * told(over, lags)
        residual = seen - shown
        sd = max(sd_by_median(np.concatenate([residual.real, residual.imag])), limits.LEAST_PART_M)
        weight = cauchy_weight(np.abs(residual / sd)) / sd**2
        half = 0.5 * limits.LAG_GRID_S * np.eye(2)
        by_lag = [
            factor * (told(over, lags + h) - told(over, lags - h)) / limits.LAG_GRID_S for h in half
        ]
        design = np.column_stack([shown, 1j * shown, *by_lag])
        normal = (np.conj(design).T @ (design * weight[:, None])).real + np.diag(1.0 / PRIOR**2)
        score = (np.conj(design) * (weight * residual)[:, None]).real
        pull = np.array([0.0, 0.0, *lags]) / PRIOR**2
        step = np.linalg.solve(normal, score.sum(axis=0) - pull)
        log_factor += complex(step[0], step[1])
        lags = np.clip(lags + step[2:], -limits.MOST_LAG_S, limits.MOST_LAG_S)

    spread = _spread(path.t[over.first], score, np.linalg.inv(normal))
    if spread[0] > limits.KNOWN_LOG_SCALE_SD:
        return start
    known = spread < limits.KNOWN_SHARE * PRIOR
    factor = np.exp(log_factor)
    values = (1.0 / abs(factor), float(np.angle(factor)), float(lags[0]), float(lags[1]))
    sds = (spread[0] / abs(factor), *spread[1:])
    scale, turn, speed_lag, course_lag = (
        Estimate(value, float(sd)) if told_by_data else None
        for value, sd, told_by_data in zip(values, sds, known, strict=True)
    )
    return replace(
        start,
        factor=complex(factor * 1j**start.quarters),
        scale=scale,
        turn_rad=turn,
        speed_lag_s=speed_lag,
        course_lag_s=course_lag,
    )


def _spread(t: FloatArray, score: FloatArray, cov: FloatArray) -> FloatArray:
    """One sigma [k] of estimates whose scores are ``score`` [m, k], of windows that begin at ``t``
    [m], and whose covariance were the windows independent is ``cov`` [k, k]."""
    cluster = np.unique(t // (2.0 * limits.CORRELATED_S), return_inverse=True)[1]
    sums = np.zeros((int(cluster.max()) + 1, score.shape[1]))
    np.add.at(sums, cluster, score)
    few = len(sums) / max(len(sums) - 1, 1)
    clustered = np.diag(cov @ (few * sums.T @ sums) @ cov)
    # windows overlap: never claim more than as many apart from each other would tell
    overlap = len(t) * limits.WINDOW_S / max(float(np.ptp(t)), limits.WINDOW_S)
    return np.asarray(np.sqrt(np.maximum(clustered, max(overlap, 1.0) * np.diag(cov))))
