"""How large waves of minutes in the positions are, beside velocities.

The waves are errors that are added to fixes, as those of ``offsets``: their amplitudes come from
the innovations of the constant-velocity filter, beside what a receiver's own filter does. Where a
path is known that an IMU has made, the fixes are taken off it first: what is left moves smoothly,
and positions less the way of the velocities are the same whichever path it is.

That way errs over minutes by what hardly shows in seconds, so that no level of white or short
errors tells it. Waves of half a minute to two are asked instead: no drift makes them, and what they
are larger or smaller than the filter takes them for, slower ones are too, as the power beside a
line in a spectrum is that of the noise under it (Percival and Walden, Spectral Analysis for
Physical Applications, 10.11). No size is taken for right: all are weighed.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from automap.earth import local_ned
from automap.effects import CATALOGUE
from automap.fusion import limits
from automap.fusion.doubts.limits import (
    DRIFT_BESIDE,
    DRIFT_NOISES,
    DRIFT_PROBABILITY,
    DRIFT_SIZES,
    DRIFT_STEPS,
    DRIFT_TIMES_S,
    MEASURED_SCALE,
    OTHER_SCALE,
    SLOPE_ROUNDS,
)
from automap.fusion.doubts.offsets import receivers_own
from automap.fusion.fix_axes import Epochs, whitened_epochs
from automap.fusion.measurements.position import lasting_share
from automap.fusion.options import FusionOptions
from automap.gates import sd_by_median
from automap.interpolation import Poses, poses_at_gps
from automap.records import BoolArray, FloatArray, IntArray, Trajectory
from automap.robust import cauchy_weight

_PLANE = (0, 1)
_LAG_SD, _SCALE_SD = (
    CATALOGUE[effect].parameters[0].prior_sd
    for effect in ("gnss_course_latency", "gnss_velocity_scale")
)
_OWN = 5
"""Columns of ``receivers_own``: three lags, and shares of a velocity along it and across."""


@dataclass(frozen=True)
class Waves:
    """``var`` [k, 2] m^2 north and east of what the positions of k epochs are off by for minutes
    beyond what was taken, about their mean, ``rate_var`` [k, 2] m^2/s^2 of its change, and the odds
    of such an error over those beforehand, ``gain`` nats."""

    var: FloatArray
    rate_var: FloatArray
    gain: float


def about_path(at: Epochs, path: Trajectory, gps_s: FloatArray) -> tuple[Epochs, Poses]:
    """The epochs ``at`` [k] of the instants ``gps_s`` [k], as far as the ``path`` has them, as what
    they differ from it by, and the path there."""
    rows = poses_at_gps(path, gps_s).covered
    at, poses = take(at, rows), poses_at_gps(path, gps_s[rows])
    place = local_ned(poses.lat_rad, poses.lon_rad, poses.height_m, at.ref).reshape(-1, 3)
    expected = np.stack([place, poses.vel_ned], axis=-1).transpose(1, 0, 2)
    return replace(at, z=at.z - expected), poses


def take(at: Epochs, rows: BoolArray) -> Epochs:
    """The epochs of some ``rows`` [k]."""
    return replace(
        at,
        t=at.t[rows],
        z=at.z[:, rows],
        used=at.used[:, rows],
        stated_sd=at.stated_sd[rows],
        white=at.white[:, rows],
        row=at.row[rows],
    )


def waves_of(
    at: Epochs,
    velocity: FloatArray,
    count: int,
    options: FusionOptions,
    levels: Mapping[str, float],
) -> Waves | None:
    """The first ``count`` cosines in the epochs ``at`` [k], whose vehicle goes by ``velocity``
    [k, 2] m/s, by the ``levels`` of their errors; None of what is not finite."""
    z = at.z - np.nan_to_num(at.z[:, :1]) * [1.0, 0.0]
    # a filter begins where its first fix is
    at = replace(at, z=z)

    t = at.t - at.t[0]
    order = np.arange(1, DRIFT_BESIDE * count + 1)
    wave = np.cos(np.pi * np.outer(t / t[-1], order))
    # [k, position or velocity, north or east, of which axis the wave is, wave]
    errors = np.zeros((len(t), 2, 2, 2, len(order)))
    for axis in _PLANE:
        errors[:, 0, axis, axis] = wave
    both = np.concatenate([errors.reshape(len(t), 2, 2, -1), receivers_own(at.t, velocity)], axis=3)
    taken = float(lasting_share(options, levels)[0] * np.median(at.stated_sd[:, :2]))
    rows = [
        whitened_epochs(at, axis, options, levels, np.ascontiguousarray(both[:, :, axis]))
        for axis in _PLANE
    ]
    y, design = np.split(np.vstack(rows), [1], axis=1)
    if not (np.isfinite(y).all() and np.isfinite(design).all()):
        return None
    slow = np.flatnonzero(np.tile(order <= count, 2))
    told = _by_noise(*_information(y[:, 0], design), slow)
    return _averaged(told, t, taken, order[:count] / t[-1])


def _information(y: FloatArray, design: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Information matrix and vector of the columns of ``design`` [m, c] in ``y`` [m], robustly; the
    last ones are the receiver's own."""
    known = _known(design.shape[1])
    weight, rest = np.ones(len(y)), y
    for _ in range(SLOPE_ROUNDS):
        weighed = design * weight[:, None]
        normal = np.linalg.pinv(weighed.T @ design + known, hermitian=True)
        rest = y - design @ (normal @ (weighed.T @ y))
        weight = cauchy_weight((rest / max(sd_by_median(rest), 1e-9)) ** 2)
    spread = float((weight * rest**2).sum() / weight.sum())
    weighed = design * (weight / max(spread, 1e-9))[:, None]
    return weighed.T @ design, weighed.T @ y


Told = tuple[float, float, FloatArray, FloatArray]
"""Variance of the noise in that which was taken, nats, information matrix and vector."""


def _by_noise(information: FloatArray, vector: FloatArray, slow: IntArray) -> list[Told]:
    """Information matrix and vector of the ``slow`` waves and the receiver's own errors, and how
    likely they are, nats, by how large the noise of waves is: the quicker ones are nothing else."""
    square = float(vector @ np.linalg.pinv(information, hermitian=True) @ vector)
    kept = np.concatenate([slow, np.arange(len(vector) - _OWN, len(vector))])
    part, there = information[np.ix_(kept, kept)], vector[kept]
    logs = 2.0 * np.log(np.geomspace(*DRIFT_NOISES))
    nats = -0.5 * (len(vector) * logs + square * np.exp(-logs))
    nats -= 0.5 * (0.5 * logs / limits.LEVEL_SPREAD) ** 2
    return [
        (f, n, part / f, there / f)
        for f, n in zip(np.exp(logs).tolist(), nats.tolist(), strict=True)
    ]


def _known(columns: int) -> FloatArray:
    """What is known beforehand of waves, which may be of any size, and the receiver's own."""
    return np.diag(np.concatenate([np.zeros(columns - _OWN), 1.0 / _own_sd(_SCALE_SD) ** 2]))


def _own_sd(scale: float) -> FloatArray:
    return np.array([_LAG_SD] * 3 + [scale] * 2)


def _averaged(
    told: Sequence[Told],
    t: FloatArray,
    taken: float,
    rate: FloatArray,
) -> Waves:
    """What amplitudes [2 c] of waves make at ``t`` [k] s, over all kinds of errors by the odds that
    they have; ``told`` nats, information matrix and vector by how large the noise is,
    ``rate`` [c] half periods a second, ``taken`` m the slow error that is known."""
    count = 2 * len(rate)
    scores, squares, drifts = [], [], []
    for noise, nats, information, vector in told:
        for prior, size, scale, drift in _kinds(rate, max(1.0 - noise, 0.0)):
            var = np.concatenate([np.tile(size * taken**2, 2), _own_sd(scale) ** 2])
            odds, mean, cov = _posterior(information, vector, var)
            scores.append(nats + math.log(prior) + odds)
            squares.append((cov + np.outer(mean, mean))[:count, :count] * drift)
            drifts.append(drift)
    weight = np.exp(np.array(scores) - max(scores))
    weight /= weight.sum()
    square = np.tensordot(weight, np.array(squares), axes=1)
    parts = square[: len(rate), : len(rate)], square[len(rate) :, len(rate) :]
    phase = np.pi * np.outer(t, rate)
    var, rate_var = (
        np.stack([np.einsum("kc,cd,kd->k", wave, part, wave) for part in parts], axis=1)
        for wave in (np.cos(phase), np.pi * rate * np.sin(phase))
    )
    drifting = float(weight[drifts].sum())
    odds = max(drifting, 1e-300) / max(1.0 - drifting, 1e-300)
    return Waves(var, rate_var, math.log(odds * (1.0 - DRIFT_PROBABILITY) / DRIFT_PROBABILITY))


def _kinds(rate: FloatArray, rest: float) -> Iterator[tuple[float, FloatArray, float, bool]]:
    """Kinds of errors: how probable each is beforehand, variances [c] of the waves' amplitudes, in
    those of the slow error that is known, the scale of velocities, and whether it is a drift.

    Errors of minutes are smooth, as satellites move: of a second-order Gauss-Markov process, both
    of whose time constants are alike (Groves, appendix B.4). Their sizes are as those of levels.
    What of the known error noise does not show, ``rest`` of its variance, may be as smooth.
    """
    factors = np.geomspace(*DRIFT_SIZES, DRIFT_STEPS)
    sizes = np.exp(-0.5 * (np.log(np.maximum(factors, 1.0)) / limits.LEVEL_SPREAD) ** 2)
    sizes *= DRIFT_PROBABILITY / sizes.sum()
    scales = (MEASURED_SCALE, 1.0 - OTHER_SCALE), (_SCALE_SD, OTHER_SCALE)
    for scale, share in scales:
        for tau in DRIFT_TIMES_S:
            power = (1.0 + (np.pi * rate * tau) ** 2) ** -2.0
            # of a mean square of one over the window
            power *= 2.0 / power.sum()
            each = share / len(DRIFT_TIMES_S)
            yield each * (1.0 - DRIFT_PROBABILITY), power * rest, scale, False
            for p, f in zip(sizes, factors, strict=True):
                yield each * p, power * (f**2 + rest), scale, True


def _posterior(
    information: FloatArray, vector: FloatArray, var: FloatArray
) -> tuple[float, FloatArray, FloatArray]:
    """Log evidence, mean and covariance of amplitudes with the variances ``var`` beforehand, which
    may be zero."""
    sd = np.sqrt(var)
    inner = np.eye(len(var)) + sd[:, None] * information * sd
    cov = sd[:, None] * np.linalg.inv(inner) * sd
    mean = cov @ vector
    return 0.5 * (float(vector @ mean) - float(np.linalg.slogdet(inner)[1])), mean, cov
