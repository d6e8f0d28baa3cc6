"""How large waves of minutes in the positions are, beside velocities.

The waves are errors that are added to fixes, as those of ``offsets``: their amplitudes come from
the innovations of the constant-velocity filter, beside what a receiver's own filter does. Where a
path is known that an IMU has made, the fixes are taken off it first: what is left moves by the
path's errors alone, and velocities tell nearly all that lies between two fixes. How large
the errors of velocities are, and how long they last, is what those fixes make likeliest.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from automap.earth import local_ned
from automap.effects import CATALOGUE
from automap.fusion import limits
from automap.fusion.adapt import COARSE
from automap.fusion.doubts.limits import (
    DRIFT_PROBABILITY,
    DRIFT_SIZES,
    DRIFT_STEPS,
    DRIFT_TIMES_S,
    MEASURED_SCALE,
    OTHER_SCALE,
    SLOPE_ROUNDS,
)
from automap.fusion.doubts.offsets import receivers_own
from automap.fusion.fix_axes import Epochs, smooth_epochs, whitened_epochs
from automap.fusion.levels import ROAD_ACCELERATION, TIME_LEVELS, VELOCITY_WANDER
from automap.fusion.measurements.position import lasting_share
from automap.fusion.options import FusionOptions
from automap.gates import sd_by_median
from automap.interpolation import poses_at_gps
from automap.records import BoolArray, FloatArray, Trajectory
from automap.robust import cauchy_weight

_PLANE = (0, 1)
_LAG_SD, _SCALE_SD = (
    CATALOGUE[effect].parameters[0].prior_sd
    for effect in ("gnss_course_latency", "gnss_velocity_scale")
)
_OWN = 5
"""Columns of ``receivers_own``: three lags, and shares of a velocity along it and across."""
_FITTED = {
    ROAD_ACCELERATION: (2.0**-7, 4.0),
    VELOCITY_WANDER: (1.0 / 32.0, COARSE.limit),
    "velocity_h": (1.0 / 32.0, COARSE.limit),
}
"""Levels that fixes are asked for, with bounds: an IMU leaves a hundredth of what roads make, and
velocities are white to 3 mm/s."""
_STEPS = 3.0, 0.7, 0.7
"""First steps of their logarithms, downwards."""
_TIMES = 0.25, 0.5, 1.0
"""How long velocities err, in the time that is usual: one second to four, as recorded phones'
correlate by 0.1 to 0.3 after five."""


@dataclass(frozen=True)
class Waves:
    """``var`` [k, 2] m^2 north and east of what the positions of k epochs are off by for minutes
    beyond what was taken, about their mean, ``rate_var`` [k, 2] m^2/s^2 of its change, and the odds
    of such an error over those beforehand, ``gain`` nats."""

    var: FloatArray
    rate_var: FloatArray
    gain: float


def about_path(at: Epochs, path: Trajectory, gps_s: FloatArray) -> tuple[Epochs, FloatArray]:
    """The epochs ``at`` [k] of the instants ``gps_s`` [k], as far as the ``path`` has them, as what
    they differ from it by, and the velocities of the path there [m, 2] m/s."""
    poses = poses_at_gps(path, gps_s)
    rows = poses.covered
    place = local_ned(poses.lat_rad, poses.lon_rad, poses.height_m, at.ref).reshape(-1, 3)
    expected = np.stack([place, poses.vel_ned], axis=-1).transpose(1, 0, 2)
    return replace(take(at, rows), z=(at.z - expected)[:, rows]), poses.vel_ned[rows, :2]


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
    about: bool,
) -> Waves | None:
    """The first ``count`` cosines in the epochs ``at`` [k], whose vehicle goes by ``velocity``
    [k, 2] m/s, by the ``levels`` of their errors; None of what is not finite.

    Beside a motion that is known, where the epochs are ``about`` a path, what lasts of velocities
    shows and is asked for; else it hides in how the vehicle was driven.
    """
    z = at.z - np.nan_to_num(at.z[:, :1]) * [1.0, 0.0]
    # a filter begins where its first fix is
    at = replace(at, z=z)

    t = at.t - at.t[0]
    order = np.arange(1, count + 1)
    wave = np.cos(np.pi * np.outer(t / t[-1], order))
    # [k, position or velocity, north or east, of which axis the wave is, wave]
    errors = np.zeros((len(t), 2, 2, 2, count))
    for axis in _PLANE:
        errors[:, 0, axis, axis] = wave
    both = np.concatenate([errors.reshape(len(t), 2, 2, -1), receivers_own(at.t, velocity)], axis=3)
    parts = [np.ascontiguousarray(both[:, :, axis]) for axis in _PLANE]
    taken = float(lasting_share(options, levels)[0] * np.median(at.stated_sd[:, :2]))
    fitted = _FITTED if about else {ROAD_ACCELERATION: _FITTED[ROAD_ACCELERATION]}
    told = []
    for time in _TIMES if about else (1.0,):
        rest = at
        # what drifts makes velocities seem to err: their levels with it, and without
        for _ in range(2 if about else 1):
            trial = _likeliest(rest, options, {**levels, TIME_LEVELS[1]: time}, fitted)
            rows = [whitened_epochs(at, axis, options, trial, parts[axis]) for axis in _PLANE]
            y, design = np.split(np.vstack(rows), [1], axis=1)
            if not (np.isfinite(y).all() and np.isfinite(design).all()):
                break
            information, vector = _information(y[:, 0], design)
            told.append((_nats(at, options, trial), information, vector))
            amplitude = _amplitudes(information, vector)[: 2 * count]
            z = at.z.copy()
            z[:2] -= (both[..., : 2 * count] @ amplitude).transpose(2, 0, 1)
            rest = replace(at, z=z)
    return _averaged(told, t, taken, order / t[-1]) if told else None


def _nats(at: Epochs, options: FusionOptions, levels: Mapping[str, float]) -> float:
    return sum(smooth_epochs(at, axis, options, levels, np.zeros((0, 4))) for axis in _PLANE)


def _likeliest(
    at: Epochs,
    options: FusionOptions,
    begun: Mapping[str, float],
    fitted: Mapping[str, tuple[float, float]],
) -> dict[str, float]:
    """The likeliest levels ``fitted``, by their bounds, beside the others that are ``begun``.

    One makes up for another: a simplex goes up (Nelder and Mead, The Computer Journal 7, 1965).
    """
    from scipy.optimize import minimize

    low, high = np.log(list(fitted.values())).T

    def levels_of(x: FloatArray) -> dict[str, float]:
        return {**begun, **dict(zip(fitted, np.exp(np.clip(x, low, high)).tolist(), strict=True))}

    start = np.clip(np.log([begun.get(name, 1.0) for name in fitted]), low, high)
    corners = np.clip(np.vstack([start, start - np.diag(_STEPS[: len(start)])]), low, high)
    found = minimize(
        lambda x, *_: -_nats(at, options, levels_of(np.asarray(x))),
        start,
        method="Nelder-Mead",
        options={"initial_simplex": corners, "maxfev": 300, "xatol": 0.05, "fatol": 0.1},
    )
    return levels_of(found.x)


def _information(y: FloatArray, design: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Information matrix and vector of the columns of ``design`` [m, c] in ``y`` [m], robustly; the
    last ones are the receiver's own."""
    known = np.zeros(design.shape[1])
    known[-_OWN:] = 1.0 / _own_sd(_SCALE_SD) ** 2
    weight, rest = np.ones(len(y)), y
    for _ in range(SLOPE_ROUNDS):
        weighed = design * weight[:, None]
        normal = np.linalg.pinv(weighed.T @ design + np.diag(known), hermitian=True)
        rest = y - design @ (normal @ (weighed.T @ y))
        weight = cauchy_weight((rest / max(sd_by_median(rest), 1e-9)) ** 2)
    # a filter that is less sure than it might be proves nothing
    spread = max(float((weight * rest**2).sum() / weight.sum()), 1.0)
    weighed = design * (weight / spread)[:, None]
    return weighed.T @ design, weighed.T @ y


def _amplitudes(information: FloatArray, vector: FloatArray) -> FloatArray:
    """Of waves of any size, beside the receiver's own errors."""
    known = np.zeros(len(vector))
    known[-_OWN:] = 1.0 / _own_sd(_SCALE_SD) ** 2
    return np.asarray(np.linalg.pinv(information + np.diag(known), hermitian=True) @ vector)


def _own_sd(scale: float) -> FloatArray:
    return np.array([_LAG_SD] * 3 + [scale] * 2)


def _averaged(
    told: Sequence[tuple[float, FloatArray, FloatArray]],
    t: FloatArray,
    taken: float,
    rate: FloatArray,
) -> Waves:
    """What amplitudes [2 c] of waves make at ``t`` [k] s, over all kinds of errors by the odds that
    they have; ``told`` nats, information matrix and vector by the time that velocities err for,
    ``rate`` [c] half periods a second, ``taken`` m the slow error that is known."""
    count = 2 * len(rate)
    scores, squares, drifts = [], [], []
    for nats, information, vector in told:
        for prior, size, scale in _kinds(rate):
            var = np.concatenate([np.tile(size * taken**2, 2), _own_sd(scale) ** 2])
            odds, mean, cov = _posterior(information, vector, var)
            scores.append(nats + math.log(prior) + odds)
            squares.append((cov + np.outer(mean, mean))[:count, :count])
            drifts.append(bool(size.any()))
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


def _kinds(rate: FloatArray) -> Iterator[tuple[float, FloatArray, float]]:
    """Kinds of errors: how probable each is beforehand, variances [c] of the waves' amplitudes, in
    those of the slow error that is known, and the scale of velocities.

    Errors of minutes are smooth, as satellites move: of a second-order Gauss-Markov process, both
    of whose time constants are alike (Groves, appendix B.4). Their sizes are as those of levels.
    """
    factors = np.geomspace(*DRIFT_SIZES, DRIFT_STEPS)
    sizes = np.exp(-0.5 * (np.log(np.maximum(factors, 1.0)) / limits.LEVEL_SPREAD) ** 2)
    each = sizes / sizes.sum() / len(DRIFT_TIMES_S) * DRIFT_PROBABILITY
    scales = (MEASURED_SCALE, 1.0 - OTHER_SCALE), (_SCALE_SD, OTHER_SCALE)
    for scale, share in scales:
        yield share * (1.0 - DRIFT_PROBABILITY), np.zeros(len(rate)), scale
        for tau in DRIFT_TIMES_S:
            power = (1.0 + (np.pi * rate * tau) ** 2) ** -2.0
            # of a mean square of one over the window
            power *= 2.0 / power.sum()
            yield from (
                (share * p, power * f**2, scale) for p, f in zip(each, factors, strict=True)
            )


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
