"""Gap finding on a desk: rest poses and turns instead of drives.

At rest the corrected accelerometer reads gravity in every pose; after a turn the gyro carries
the old direction of gravity onto the new one. What is left over under a sensor model is its
gap, and effects are tried one after another, judged on poses that the fit has not seen.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from automap.calibration.accelerometer import directions_of
from automap.calibration.gravity_kernel import carry_direction
from automap.calibration.gyroscope import GyroFit, Turn, fit_gyro, turns_between
from automap.calibration.rest_search import pose_means
from automap.calibration.static import StaticCalibration, calibrate_static
from automap.effects import CATALOGUE, distort_imu
from automap.effects.terms import ACCEL
from automap.gap.limits import CLOSE_NATS, DESK_FOLDS, DESK_HUBER, DESK_P, LEAST_ODDS
from automap.gap.result import Finding, ParameterValue
from automap.gates import OUTSIDE_95, sd_by_median, sigmas
from automap.records import FloatArray, IntArray, RawImu

ACCEL_LIBRARY = ("accel_misalignment", "accel_quadratic", "accel_scale_asymmetry")
"""Chosen: what a dozen poses at rest can show beside bias and scale, which they are fitted with."""


@dataclass(frozen=True)
class PoseGap:
    """Left-over norms [k] m/s^2 of held-out poses, by the model before and after, and the like
    of held-out turns [t] rad."""

    accel_before: FloatArray
    accel_after: FloatArray
    gyro_before: FloatArray
    gyro_after: FloatArray


@dataclass(frozen=True)
class LaboratoryResult:
    """What a desk log shows: findings, gaps (rms on held-out poses in m/s^2), the calibration."""

    gap_before: float
    gap_after: float
    findings: tuple[Finding, ...]
    poses: PoseGap
    calibration: StaticCalibration
    verdict: str


@dataclass(frozen=True)
class PoseFit:
    """Six parameters and those of the effects: ``x`` [q], ``cov`` [q, q], residuals [k]."""

    effects: tuple[str, ...]
    x: FloatArray
    cov: FloatArray
    residuals: FloatArray
    spread: float

    def of(self, effect: str) -> dict[str, tuple[float, float]]:
        """Parameter -> value and sd."""
        every = [(name, p.name) for name in self.effects for p in CATALOGUE[name].parameters]
        sds = np.sqrt(np.diag(self.cov))[6:]
        rows = zip(every, self.x[6:].tolist(), sds.tolist(), strict=True)
        return {p: (value, sd) for (name, p), value, sd in rows if name == effect}


def find_laboratory_gaps(
    logs: Sequence[RawImu], gravity: float, exclude: Collection[str] = ()
) -> LaboratoryResult:
    """Name what the six-parameter model of the accelerometer, and a gyro model of scale, bias
    and axes, lack on multi-pose logs.

    ``gravity`` m/s^2; ``exclude`` effects that are not tried.

    Raises:
        InputError: no rests or too few poses, as ``calibrate_static`` does.
    """
    calibration = calibrate_static(list(logs), gravity)
    means, _ = pose_means(calibration.search.rests)
    findings, before, after = _accelerometer(calibration, means, gravity, exclude)
    gyro_finding, gyro_before, gyro_after = _gyro(list(logs), calibration, gravity, exclude)
    if gyro_finding is not None:
        findings.append(gyro_finding)
    poses = PoseGap(before, after, gyro_before, gyro_after)
    first, last = _rms(before), _rms(after)
    return LaboratoryResult(
        first, last, tuple(findings), poses, calibration, _verdict(findings, first, last)
    )


def _verdict(findings: Sequence[Finding], before: float, after: float) -> str:
    if not findings:
        return "nothing is missing from the sensor model as far as these poses can show"
    names = ", ".join(f.effect for f in findings)
    text = f"missing from the sensor model: {names}"
    if any(CATALOGUE[f.effect].sensor == ACCEL for f in findings):
        text += (
            f"; on held-out poses the norm is off gravity by {after:.2g} m/s^2 instead of "
            f"{before:.2g}"
        )
    return text


def _accelerometer(
    calibration: StaticCalibration, means: FloatArray, gravity: float, exclude: Collection[str]
) -> tuple[list[Finding], FloatArray, FloatArray]:
    six = calibration.accel_six
    scaled = means * six.scale + six.bias
    accepted: tuple[str, ...] = ()
    fit = _fit_poses(scaled, gravity, accepted)
    held = _held_out(scaled, gravity, accepted)
    first = held
    findings: list[Finding] = []
    while True:
        library = [e for e in ACCEL_LIBRARY if e not in accepted and e not in exclude]
        trials = []
        for effect in library:
            if len(scaled) < 6 + 3 * (len(accepted) + 1) + 3:
                continue
            trial = _fit_poses(scaled, gravity, (*accepted, effect))
            trials.append((_pose_nats(fit, trial, effect), effect, trial))
        trials.sort(key=lambda t: -t[0])
        if not trials:
            break
        nats, effect, trial = trials[0]
        p = min(1.0, len(ACCEL_LIBRARY) * _f_test(fit, trial))
        ahead = _held_out(scaled, gravity, (*accepted, effect))
        if nats < LEAST_ODDS or p > DESK_P or not _rms(ahead) < _rms(held):
            break
        confusable = tuple(e for n, e, _ in trials[1:] if nats - n < CLOSE_NATS)
        values = _parameters(effect, trial.of(effect))
        findings.append(Finding(effect, values, nats, p, _rms(held), _rms(ahead), confusable))
        accepted, fit, held = (*accepted, effect), trial, ahead
    return findings, first, held


def _parameters(
    effect: str, values: Mapping[str, tuple[float, float]]
) -> dict[str, ParameterValue]:
    units = {p.name: p.unit for p in CATALOGUE[effect].parameters}
    return {p: ParameterValue(v, sd, units[p]) for p, (v, sd) in values.items()}


def _true_force(scaled: FloatArray, x: FloatArray, effects: Sequence[str]) -> FloatArray:
    """Forces [k, 3] that read ``scaled``; x: relative scale [3], bias [3], effects' values."""
    reading = scaled * (1.0 + x[:3]) + x[3:6]
    values: dict[str, dict[str, float]] = {}
    at = 6
    for effect in effects:
        names = [p.name for p in CATALOGUE[effect].parameters]
        values[effect] = dict(zip(names, map(float, x[at : at + len(names)]), strict=True))
        at += len(names)
    true = reading.copy()
    still = np.zeros_like(true)
    for _ in range(6 if values else 0):
        _, seen = distort_imu(still, true, values)
        true = true + reading - seen
    return true


def _fit_poses(scaled: FloatArray, gravity: float, effects: tuple[str, ...]) -> PoseFit:
    """Least squares of the norms, outliers held back by Huber's loss."""
    from scipy.optimize import least_squares

    priors = [p.prior_sd for e in effects for p in CATALOGUE[e].parameters]

    def residuals(x: FloatArray) -> FloatArray:
        return np.asarray(np.linalg.norm(_true_force(scaled, x, effects), axis=1) - gravity)

    x0 = np.zeros(6 + len(priors))
    x_scale = np.concatenate([np.full(3, 1e-2), np.full(3, 0.1), priors])
    plain = least_squares(residuals, x0, x_scale=x_scale)
    spread = max(sd_by_median(plain.fun), 1e-6)
    robust = least_squares(
        residuals, plain.x, x_scale=x_scale, loss="huber", f_scale=DESK_HUBER * spread
    )
    r = residuals(robust.x)
    dof = max(len(r) - len(robust.x), 1)
    variance = float(np.sum(np.clip(r, -DESK_HUBER * spread, DESK_HUBER * spread) ** 2)) / dof
    jac = np.asarray(robust.jac)
    cov = variance * np.linalg.pinv(jac.T @ jac)
    return PoseFit(effects, np.asarray(robust.x), cov, r, float(np.sqrt(variance)))


def _held_out(scaled: FloatArray, gravity: float, effects: tuple[str, ...]) -> FloatArray:
    """Left-over norms [k] of each pose under the fit to the other folds."""
    k = len(scaled)
    fold = np.arange(k) % min(DESK_FOLDS, k)
    out = np.empty(k)
    for number in range(int(fold.max()) + 1):
        test = fold == number
        fit = _fit_poses(scaled[~test], gravity, effects)
        out[test] = np.linalg.norm(_true_force(scaled[test], fit.x, effects), axis=1) - gravity
    return out


def _pose_nats(before: PoseFit, after: PoseFit, effect: str) -> float:
    """Log Bayes factor with the noise level unknown in both, by Laplace's approximation."""
    k = len(before.residuals)
    gain = 0.5 * k * np.log(before.spread**2 / max(after.spread**2, 1e-300))
    sds = np.array([p.prior_sd for p in CATALOGUE[effect].parameters])
    at = slice(len(after.x) - len(sds), len(after.x))
    cov = after.cov[at, at] / np.outer(sds, sds)
    value = after.x[at] / sds
    occam = 0.5 * np.linalg.slogdet(cov @ np.linalg.inv(cov + np.eye(len(sds))))[1]
    prior = 0.5 * float(value @ np.linalg.solve(cov + np.eye(len(sds)), value))
    own = 0.5 * float(value @ np.linalg.solve(cov, value))
    # what the prior takes back of the gain, at most all that the estimate is worth
    return float(gain + occam - min(prior, own) * (1.0 if prior < own else 0.0) / max(own, 1.0))


def _f_test(before: PoseFit, after: PoseFit) -> float:
    k, q = len(after.residuals), len(after.x)
    rss0 = before.spread**2 * max(k - len(before.x), 1)
    return _by_chance(rss0, after.spread**2 * max(k - q, 1), q - len(before.x), max(k - q, 1))


def _by_chance(before: float, after: float, more: int, left: int) -> float:
    """Chance that squares drop so by ``more`` parameters, ``left`` degrees of freedom left, where
    nothing is missing (F test)."""
    from scipy.stats import f

    ratio = max(before - after, 0.0) / more / max(after / left, 1e-300)
    return float(f.sf(ratio, more, left))


def _gyro(
    logs: list[RawImu], calibration: StaticCalibration, gravity: float, exclude: Collection[str]
) -> tuple[Finding | None, FloatArray, FloatArray]:
    """Whether the gyro reads specific force."""
    none = np.zeros(0)
    base, with_g = calibration.gyro, calibration.gyro_with_g
    if base is None or with_g is None or "gyro_g_sensitivity" in exclude:
        return None, none, none
    accel = calibration.accel
    rests = calibration.search.gyro_rests
    means, variances = pose_means(rests)
    forces = [accel.apply(log.accel) for log in logs]
    spread = (variances * accel.scale**2 + accel.floor**2) / gravity**2
    turns = turns_between(logs, forces, rests, directions_of(accel, means), spread, gravity)
    fold: IntArray = np.arange(len(turns)) % DESK_FOLDS
    errors = np.zeros((2, len(turns)))
    for number in range(DESK_FOLDS):
        train = [t for t, f in zip(turns, fold, strict=True) if f != number]
        for row, flag in enumerate((False, True)):
            fit = fit_gyro(logs, forces, rests, train, accel, gravity, flag)
            for i in np.flatnonzero(fold == number):
                errors[row, i] = _turn_error(turns[i], fit, gravity)
    before, after = errors
    n = 2 * len(turns) + 3 * len(rests)
    rss0, rss1 = _gyro_squares(base, base), _gyro_squares(with_g, base)
    # Schwarz's approximation of the log Bayes factor; nine parameters more
    nats = float(0.5 * n * np.log(rss0 / max(rss1, 1e-300)) - 0.5 * 9.0 * np.log(n))
    p = _by_chance(rss0, rss1, 9, max(n - 21, 1))
    if nats < LEAST_ODDS or p > DESK_P or not _robust(after) < _robust(before):
        return None, before, before
    names = [q.name for q in CATALOGUE["gyro_g_sensitivity"].parameters]
    # the half widths are those of 95 % intervals
    sd = np.asarray(with_g.half_width[12:21]) / sigmas(OUTSIDE_95)
    values = dict(zip(names, zip(with_g.g_sensitivity.ravel(), sd, strict=True), strict=True))
    parameters = _parameters(
        "gyro_g_sensitivity", {k: (float(v), float(s)) for k, (v, s) in values.items()}
    )
    finding = Finding("gyro_g_sensitivity", parameters, nats, p, _robust(before), _robust(after))
    return finding, before, after


def _gyro_squares(fit: GyroFit, scale: GyroFit) -> float:
    """Sum of squares of turns and rests, each in units of the base fit's spread."""
    turn, rest = max(scale.turn_rms, 1e-9), max(_rms(scale.rest_rates.ravel()), 1e-12)
    turns = len(fit.turn_errors) * 2.0 * (fit.turn_rms / turn) ** 2
    return float(turns + fit.rest_rates.size * (_rms(fit.rest_rates.ravel()) / rest) ** 2)


def _turn_error(turn: Turn, fit: GyroFit, gravity: float) -> float:
    """Angle in rad between gravity carried over a turn and gravity measured after it."""
    table = np.zeros((3, 7))
    table[:, 0] = fit.matrix @ fit.bias
    table[:, 1:4] = fit.matrix * fit.scale
    table[:, 4:7] = -fit.g_sensitivity * gravity
    end, sensitivity = np.empty(3), np.empty((3, 3, 7))
    carry_direction(turn.signals @ table.T, turn.signals, turn.dt, turn.start, end, sensitivity)
    return float(2.0 * np.arcsin(np.clip(0.5 * np.linalg.norm(end - turn.end), 0.0, 1.0)))


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0


def _robust(values: FloatArray) -> float:
    """Median size, which one bad turn does not rule."""
    return float(np.median(np.abs(values))) if len(values) else 0.0
