"""Levels of noise as findings and claims, where they are not as stated.

They are fitted in any case, and compared with what the model stated by likelihood ratio: drift of
the biases, receivers whose figures are off, sensors that are noisier.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np

from automap.effects import CATALOGUE
from automap.effects.catalogue import bias_walks
from automap.fusion.levels import ALL_LEVELS, RECEIVER_LEVELS, VELOCITY_WANDER
from automap.fusion.measurements.position import lasting_share
from automap.fusion.nodes import model_fixes
from automap.gap import limits
from automap.gap.drive import shocks_of
from automap.gap.fit import Fit
from automap.gap.noise import at_top, fit_noise, noise_score, rest_factors
from automap.gap.noise_conditions import Ranged, conditional_noise
from automap.gap.noise_levels import Levels
from automap.gap.reading_steps import coarse
from automap.gap.result import Finding, NoiseClaim, ParameterValue
from automap.gates import exceeds
from automap.records import FloatArray

WALKS = tuple(bias_walks())
SENSOR_LEVELS = ("accel", "gyro")
FIGURES: dict[str, tuple[str, ...]] = {
    "position_h": ("position_h", "wander", "multipath"),
    "position_v": ("position_v", "wander_v", "multipath"),
    "velocity_h": ("velocity_h", VELOCITY_WANDER),
    "velocity_v": ("velocity_v", VELOCITY_WANDER),
}
"""What a receiver states of its errors, and the levels of what these are made of."""
GNSS_LEVELS = (*RECEIVER_LEVELS, *FIGURES)


def stochastic_findings(
    levels: Levels, stated_factors: Mapping[str, float], gap: float, exclude: Collection[str]
) -> list[Finding]:
    """Findings on the noise of fitted drives; ``stated_factors`` the factors of the model as it was
    given, ``gap`` what is left on held-out data."""
    out = []
    fitted = levels.factors
    for name in WALKS:
        ratio = fitted[name] / stated_factors[name]
        if name in exclude or ratio < limits.WALK_FACTOR:
            continue
        as_stated = {name: stated_factors[name]}
        nats = _worth(levels, as_stated)
        if nats >= limits.NOISE_NATS:
            nats = min(nats, levels.free.loss(as_stated) - limits.OCCAM_NATS)
        if nats < limits.NOISE_NATS:
            continue
        value = float(getattr(levels.fits[0].model.options, name)) * fitted[name]
        # one level is fitted to all axes, and each may have another
        relative = math.hypot(_log_sd(levels, name), limits.ANISOTROPY)
        sd = math.inf if at_top(name, fitted[name]) else value * relative
        parameters = {p.name: ParameterValue(value, sd, p.unit) for p in CATALOGUE[name].parameters}
        out.append(Finding(name, parameters, nats, _p(nats), gap, gap))
    found = _noise_scale(levels, stated_factors, gap)
    if found is not None and found.effect not in exclude:
        out.append(found)
    return out


def noise_claims(
    levels: Levels,
    stated_factors: Mapping[str, float],
    held_out: Sequence[Fit] = (),
    stated_shocks: bool = False,
) -> tuple[NoiseClaim, ...]:
    """Levels that the drives want higher than stated, however it is called: what no other level
    says as well. The vehicle's own are not of a sensor or receiver. The level that depends on a
    condition, which ``held_out`` drives bear out, is told with it, and so is what shocks add, but
    for ``stated_shocks``.

    Of a receiver's figure only the whole can be too small: it does not say how much of its error
    lasts, and how that is split is the model's own matter. A sensor that is at rest as noisy as
    that is; else what speaks for its noise must do so without the vehicle constraint.
    """
    fits, fitted = levels.fits, levels.factors
    resting = rest_factors(fits)
    ratios = {level: fitted[level] / stated_factors[level] for level in SENSOR_LEVELS}
    ratios |= dict(zip(FIGURES, _whole(fits, fitted, stated_factors), strict=True))
    out = []
    for level, ratio in ratios.items():
        if ratio < limits.SCALE_FACTOR:
            continue
        parts = FIGURES.get(level, (level,))
        as_stated = {part: fitted[part] / ratio for part in parts}
        nats = _worth(levels, as_stated)
        at_rest = resting.get(level, 0.0) >= limits.SCALE_FACTOR * stated_factors.get(level, np.inf)
        if nats >= limits.NOISE_NATS and level in SENSOR_LEVELS and not at_rest:
            nats = min(nats, levels.free.loss(as_stated) - limits.OCCAM_NATS)
        if nats >= limits.NOISE_NATS:
            out.append(NoiseClaim(level, ratio, nats, _p(nats)))
    ranged = conditional_noise(levels, held_out)
    if ranged is not None:
        out = _under_condition(out, ranged, fits, stated_factors)
    if fits[0].model.options.shocks and not stated_shocks:
        shaken = [_shaken(levels, level, ratios[level]) for level in SENSOR_LEVELS]
        told = {c.level: c for c in shaken if c.evidence_nats >= limits.NOISE_NATS}
        out = [c for c in out if c.condition or c.level not in told] + list(told.values())
    out = [replace(c, cause=coarse(fits, c.level)) if c.level in SENSOR_LEVELS else c for c in out]
    return tuple(sorted(out, key=lambda c: -c.evidence_nats))


def _shaken(levels: Levels, level: str, ratio: float) -> NoiseClaim:
    """What shocks make of a sensor's noise, which is ``ratio`` as large as stated elsewhere, worth
    what the drives are less likely without them, all levels moved to where they suit these then."""
    at = SENSOR_LEVELS.index(level)
    fits, added = list[Fit](), list[FloatArray]()
    for fit in levels.fits:
        psd, problem = shocks_of(fit.opened.drive)[:, at], fit.last.problem
        shocks = problem.samples.shocks.copy()
        shocks[:, at] -= psd
        plain = replace(problem, samples=problem.samples._replace(shocks=shocks))
        fits.append(replace(fit, last=replace(fit.last, problem=plain)))
        added.append(psd)
    psd = np.concatenate(added)
    shaken = psd > 0.0
    if not shaken.any():
        return NoiseClaim(level, ratio, 0.0, 1.0)
    stated = float(getattr(levels.fits[0].model.options, f"{level}_noise"))
    factor = math.hypot(float(np.sqrt(np.mean(psd[shaken]))) / stated, ratio)
    # one level for all of the drive is what both are in the mean
    mean = float(np.sqrt(np.mean(psd))) / stated
    whole = levels.factors | {level: math.hypot(levels.factors[level], mean)}
    held = fit_noise(fits, initial=whole, curvature=levels.curvature)
    nats = levels.score(levels.factors) - noise_score(fits, held)
    share = f"{100.0 * np.mean(shaken):.2g} % of the time"
    where = f"where it scatters most from one reading to the next ({share})"
    return NoiseClaim(level, factor, nats, _p(nats), where, ratio)


def _under_condition(
    claims: Sequence[NoiseClaim],
    ranged: Ranged,
    fits: Sequence[Fit],
    stated_factors: Mapping[str, float],
) -> list[NoiseClaim]:
    """Claims with that of the level that a condition makes larger than stated, if it does."""
    level, fitted = ranged.level, dict(fits[0].model.factors)
    inside, outside = (fitted[level] * each for each in (ranged.inside, ranged.outside))
    if level in FIGURES:
        at = list(FIGURES).index(level)
        inside, outside = (
            _whole(fits, fitted | {level: each}, stated_factors)[at] for each in (inside, outside)
        )
    else:
        inside, outside = inside / stated_factors[level], outside / stated_factors[level]
    if inside < limits.SCALE_FACTOR:
        return list(claims)
    nats = ranged.nats + sum(c.evidence_nats for c in claims if c.level == level)
    one = NoiseClaim(level, inside, nats, _p(nats), str(ranged.condition), outside)
    return [*(c for c in claims if c.level != level), one]


def noise_levels(name: str) -> tuple[str, ...]:
    """The noise levels that a finding on the noise is about; none for wild fixes, which the filter
    refuses under either model."""
    if name in FIGURES or name in ALL_LEVELS:
        return FIGURES.get(name, (name,))
    effect = CATALOGUE.get(name)
    return GNSS_LEVELS if effect is not None and effect.setting == "fuse.adapt" else ()


def _worth(levels: Levels, as_stated: Mapping[str, float]) -> float:
    """Nats that levels are worth against ``as_stated``, all others moved to where they suit the
    drives then, which is asked only where these as they are do not say as much already."""
    nats = levels.score(levels.factors) - levels.score({**levels.factors, **as_stated})
    if nats - limits.OCCAM_NATS < limits.NOISE_NATS:
        return nats - limits.OCCAM_NATS
    return levels.loss(as_stated) - limits.OCCAM_NATS


def _p(nats: float) -> float:
    """Of a likelihood ratio with one degree of freedom at its edge (Self and Liang 1987)."""
    return 0.5 * exceeds(2.0 * (nats + limits.OCCAM_NATS), 1)


def _log_sd(levels: Levels, name: str) -> float:
    """Relative sd of a level from the curvature of the log-likelihood over its logarithm."""
    h = 0.25
    fitted = levels.factors
    up, down = (levels.score({**fitted, name: fitted[name] * np.exp(s)}) for s in (h, -h))
    curve = (up - 2.0 * levels.score(fitted) + down) / h**2
    return float(1.0 / np.sqrt(max(-curve, 1.0)))


def _noise_scale(levels: Levels, stated_factors: Mapping[str, float], gap: float) -> Finding | None:
    """Whether positions and velocities are both noisier, or both better, than they say."""
    fitted = levels.factors
    logs = np.log(_whole(levels.fits, fitted, stated_factors))
    factor = float(np.exp(np.mean(logs)))
    low, high = float(np.exp(logs.min())), float(np.exp(logs.max()))
    if not (factor > limits.SCALE_FACTOR and low > limits.SCALE_FACTOR**0.5) and not (
        factor < 1.0 / limits.SCALE_FACTOR**2 and high < limits.SCALE_FACTOR**-0.5
    ):
        return None
    nats = _worth(levels, {k: stated_factors[k] for k in GNSS_LEVELS})
    if nats < limits.NOISE_NATS:
        return None
    open_ended = any(at_top(level, fitted[level]) for level in GNSS_LEVELS)
    sd = math.inf if open_ended else factor * max(float(np.std(logs)) / 2.0, 0.02)
    parameters = {"factor": ParameterValue(factor, sd, "")}
    return Finding("gnss_noise_scale", parameters, nats, _p(nats), gap, gap)


def _whole(
    fits: Sequence[Fit], fitted: Mapping[str, float], stated_factors: Mapping[str, float]
) -> list[float]:
    """By how much the errors of FIGURES are larger than receivers report."""
    # what lasts of a velocity's error no receiver states
    stated = _sizes(fits, {**stated_factors, VELOCITY_WANDER: 0.0})
    return [float(x) for x in _sizes(fits, fitted) / stated * _floored(fits)]


def _sizes(fits: Sequence[Fit], factors: Mapping[str, float]) -> FloatArray:
    """Sigmas [4] of positions, m, and of velocities, m/s, horizontal and vertical: the white and
    the lasting part together."""
    options = fits[0].model.options
    if "gnss_multipath" not in options.effects:
        options = replace(options, multipath_share=0.0)
    fixes = [fit.opened.session.fixes for fit in fits]
    white = np.median([np.median(f.white_var, axis=0) for f in fixes], axis=0) ** 0.5
    stated = np.median([np.median(f.stated_sd, axis=0) for f in fixes], axis=0)
    lasts = options.velocity_wander_sd * factors["velocity_wander"]
    lasting = [*(stated * lasting_share(options, factors))[[0, 2]], lasts, lasts]
    levels = [factors[name] for name in FIGURES]
    return np.hypot(white[[0, 2, 3, 5]] * levels, lasting)


def _floored(fits: Sequence[Fit]) -> FloatArray:
    """By how much the model took the receivers' figures for larger than they are [4]: positions
    horizontal and vertical, velocities likewise. It believes no figure below its floors."""
    taken: list[FloatArray] = []
    reported: list[FloatArray] = []
    for fit in fits:
        options = fit.model.options
        bare = replace(options, min_position_sd_m=0.0, min_velocity_sd=0.0)
        fixes = fit.opened.drive.fixes
        as_reported = model_fixes(fixes, np.zeros(len(fixes)), bare)
        for out, model in ((taken, fit.opened.session.fixes), (reported, as_reported)):
            var = model.white_var.copy()
            var[:, :3] += model.stated_sd**2
            out.append(np.median(np.sqrt(var), axis=0))
    ratio = np.median(taken, axis=0) / np.maximum(np.median(reported, axis=0), 1e-12)
    return np.asarray(ratio[[0, 2, 3, 5]])
