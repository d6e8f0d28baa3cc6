"""What every model has, named as a finding where it is gross: noise, courses that lag by metres,
speeds that are told too low.

Both are fitted in any case. Levels of noise are compared with what the model stated, by likelihood
ratio: drift of the biases, receivers whose figures are off, wild fixes. An antenna so far behind
where it is said does to velocities what courses that lag do: as a part of every model these let
nothing else be named in their place, told by nobody they would swallow a wrong arm.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np

from automap.effects import CATALOGUE
from automap.effects.catalogue import bias_walks
from automap.fusion.filtered import full_covariance
from automap.fusion.layout import CH_VEL, N_NAV
from automap.fusion.levels import ALL_LEVELS, RECEIVER_LEVELS, VELOCITY_WANDER
from automap.fusion.measurements.position import lasting_share
from automap.fusion.nodes import model_fixes
from automap.gap import limits
from automap.gap.drive import OpenDrive, count_outliers
from automap.gap.fit import Fit, Values, without
from automap.gap.noise import fit_noise, fitted_about, noise_score, rest_factors, with_noise
from automap.gap.noise_conditions import Ranged, conditional_noise, unconstrained
from automap.gap.reading_steps import coarse
from automap.gap.result import Finding, NoiseClaim, ParameterValue, advice
from automap.gap.scoring import epochs, fit_held_out, likelier, total_score, whitener_of
from automap.gap.screening import Found
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
BEHIND, ARM, TOO_LOW = "gnss_course_distance", "gnss_lever_arm", "gnss_speed_offset"
USUAL = (BEHIND, TOO_LOW)
"""Effects of every receiver."""


def stochastic_findings(
    fits: Sequence[Fit], stated_factors: Mapping[str, float], gap: float, exclude: Collection[str]
) -> list[Finding]:
    """Findings on the noise of fitted drives; ``stated_factors`` the factors of the model as it was
    given, ``gap`` what is left on held-out data."""
    out = []
    fitted = dict(fits[0].model.factors)
    score = _memo(lambda f: noise_score(fits, f))
    for name in WALKS:
        ratio = fitted[name] / stated_factors[name]
        if name in exclude or ratio < limits.WALK_FACTOR:
            continue
        as_stated = {name: stated_factors[name]}
        nats = score(fitted) - score(_at_best(fits, fitted | as_stated, (name,)))
        nats = min(nats, _of_no_vehicle(fits, fitted, as_stated)) - limits.OCCAM_NATS
        if nats < limits.NOISE_NATS:
            continue
        value = float(getattr(fits[0].model.options, name)) * fitted[name]
        spread = value * _log_sd(score, fitted, name)
        parameters = {
            p.name: ParameterValue(value, spread, p.unit) for p in CATALOGUE[name].parameters
        }
        out.append(Finding(name, parameters, nats, _p(nats), gap, gap))
    for found in (_noise_scale(fits, fitted, stated_factors, score, gap), _outliers(fits, gap)):
        if found is not None and found.effect not in exclude:
            out.append(found)
    return out


def noise_claims(
    fits: Sequence[Fit], stated_factors: Mapping[str, float], held_out: Sequence[Fit] = ()
) -> tuple[NoiseClaim, ...]:
    """Levels that the drives want higher than stated, however it is called: what no other level
    says as well. The vehicle's own are not of a sensor or receiver. The level that depends on a
    condition, which ``held_out`` drives bear out, is told with it.

    Of a receiver's figure only the whole can be too small: it does not say how much of its error
    lasts, and how that is split is the model's own matter. A sensor that is at rest as noisy as
    that is; else what speaks for its noise must do so without the vehicle constraint.
    """
    fitted = dict(fits[0].model.factors)
    score = _memo(lambda f: noise_score(fits, f))
    resting = rest_factors(fits)
    ratios = {level: fitted[level] / stated_factors[level] for level in SENSOR_LEVELS}
    ratios |= dict(zip(FIGURES, _whole(fits, fitted, stated_factors), strict=True))
    out = []
    for level, ratio in ratios.items():
        if ratio < limits.SCALE_FACTOR:
            continue
        parts = FIGURES.get(level, (level,))
        as_stated = {part: fitted[part] / ratio for part in parts}
        held = _at_best(fits, fitted | as_stated, parts)
        nats = score(fitted) - score(held)
        if (
            level in SENSOR_LEVELS
            and resting.get(level, 0.0) < limits.SCALE_FACTOR * stated_factors[level]
        ):
            nats = min(nats, _of_no_vehicle(fits, fitted, as_stated))
        nats -= limits.OCCAM_NATS
        if nats >= limits.NOISE_NATS:
            out.append(NoiseClaim(level, ratio, nats, _p(nats)))
    ranged = conditional_noise(fits, held_out)
    if ranged is not None:
        out = _under_condition(out, ranged, fits, stated_factors)
    out = [replace(c, cause=coarse(fits, c.level)) if c.level in SENSOR_LEVELS else c for c in out]
    return tuple(sorted(out, key=lambda c: -c.evidence_nats))


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


def _at_best(
    fits: Sequence[Fit], factors: Mapping[str, float], held: Collection[str]
) -> dict[str, float]:
    """The factors with all levels but those ``held`` moved to where they suit the drives best:
    what another level can say as well is no evidence for one."""
    return fit_noise(fits, [k for k in ALL_LEVELS if k not in held], factors)


def _of_no_vehicle(
    fits: Sequence[Fit], fitted: Mapping[str, float], as_stated: Mapping[str, float]
) -> float:
    """Log-likelihood ratio, nats, of levels free beside ``as_stated`` where nothing is known of how
    the vehicle moves: a body that sways against its path looks like noise of the sensors in it."""
    free = [unconstrained(f) for f in fits]
    best = fit_noise(free, initial=fitted)
    held = _at_best(free, best | dict(as_stated), tuple(as_stated))
    return noise_score(free, best) - noise_score(free, held)


def _memo(
    score: Callable[[Mapping[str, float]], float],
) -> Callable[[Mapping[str, float]], float]:
    known: dict[tuple[tuple[str, float], ...], float] = {}

    def remembered(factors: Mapping[str, float]) -> float:
        key = tuple(sorted(factors.items()))
        if key not in known:
            known[key] = score(factors)
        return known[key]

    return remembered


def _p(nats: float) -> float:
    """Of a likelihood ratio with one degree of freedom at its edge (Self and Liang 1987)."""
    return 0.5 * exceeds(2.0 * (nats + limits.OCCAM_NATS), 1)


def _log_sd(
    score: Callable[[Mapping[str, float]], float], fitted: Mapping[str, float], name: str
) -> float:
    """Relative sd of a level from the curvature of the log-likelihood over its logarithm."""
    h = 0.25
    up, down = (score({**fitted, name: fitted[name] * np.exp(s)}) for s in (h, -h))
    curve = (up - 2.0 * score(fitted) + down) / h**2
    return float(1.0 / np.sqrt(max(-curve, 1.0)))


def _noise_scale(
    fits: Sequence[Fit],
    fitted: Mapping[str, float],
    stated_factors: Mapping[str, float],
    score: Callable[[Mapping[str, float]], float],
    gap: float,
) -> Finding | None:
    """Whether positions and velocities are both noisier, or both better, than they say."""
    logs = np.log(_whole(fits, fitted, stated_factors))
    factor = float(np.exp(np.mean(logs)))
    low, high = float(np.exp(logs.min())), float(np.exp(logs.max()))
    if not (factor > limits.SCALE_FACTOR and low > limits.SCALE_FACTOR**0.5) and not (
        factor < 1.0 / limits.SCALE_FACTOR**2 and high < limits.SCALE_FACTOR**-0.5
    ):
        return None
    null = {**fitted, **{k: stated_factors[k] for k in GNSS_LEVELS}}
    nats = score(fitted) - score(_at_best(fits, null, GNSS_LEVELS)) - limits.OCCAM_NATS
    if nats < limits.NOISE_NATS:
        return None
    spread = factor * max(float(np.std(logs)) / 2.0, 0.02)
    parameters = {"factor": ParameterValue(factor, spread, "")}
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


def _outliers(fits: Sequence[Fit], gap: float) -> Finding | None:
    """Wild positions: those screened out beforehand and those the filter refused."""
    from scipy.stats import binom

    count, wild = 0, 0
    for fit in fits:
        store = fit.last.forward.store
        nis: FloatArray = store.nis[:, :CH_VEL]
        measured = np.isfinite(nis).any(axis=1)
        count += int(measured.sum())
        beyond = np.nan_to_num(nis[measured]).max(axis=1) > limits.OUTLIER_NIS
        screened = fit.opened.n_outliers
        if screened:
            # that was by the receiver's own figures; by what they turned out to be they may be none
            drive, model = fit.opened.drive, fit.model
            screened = min(screened, count_outliers(drive, model.options, model.factors))
        wild += min(int(beyond.sum()) + screened, int(measured.sum()))
    share = wild / max(count, 1)
    if share < limits.WILD_SHARE or wild < 3:
        return None
    p = float(binom.sf(wild - 1, count, limits.USUAL_SHARE))
    if p > limits.WILD_P:
        return None
    usual = limits.USUAL_SHARE
    nats = wild * np.log(share / usual) + (count - wild) * np.log1p(-share)
    nats -= (count - wild) * np.log1p(-usual)
    sd = float(np.sqrt(share * (1.0 - share) / count))
    parameters = {"fraction": ParameterValue(share, sd, "")}
    return Finding("gnss_outliers", parameters, float(nats), p, gap, gap)


def usual_finding(
    effect: str,
    found: Found,
    values: Values,
    held_out: Sequence[OpenDrive],
    final: Sequence[Fit],
    stated: Mapping[str, float],
    gap: float,
) -> Finding | None:
    """An effect that is part of every model, where fitted and held-out drives are likelier with it
    beyond all doubt.

    ``values`` of what else was found, ``final`` the held-out fits under all of it, ``stated`` the
    factors of the noise as it was asked with, ``gap`` what is left on held-out data.
    """
    fits = found.fitted.fits
    own = found.fitted.model
    if effect not in own.options.effects or effect in own.values:
        # no part of it, or known already
        return None
    (parameter,) = CATALOGUE[effect].parameters
    value, sd = _estimate(effect, fits)
    # no course is that of a place ahead; and what is a few sigmas is worth no name
    if (effect == BEHIND and value <= 0.0) or abs(value) < limits.ONE_IN_A_THOUSAND * sd:
        return None
    model = without(own, effect)
    bare = with_noise(fitted_about(model, found.fitted.estimate, fits), stated)
    held = fit_held_out(held_out, bare.model, values, final)
    nats, sigmas = likelier((*fits, *final), (*bare.fits, *held))
    # as dear as any other name
    prior = float(np.log1p(-limits.OUTSIDE_LIBRARY) - np.log(len(found.selection.candidates)))
    if nats + prior < limits.LEAST_ODDS or sigmas < limits.ONE_IN_A_THOUSAND:
        return None
    # nats of an estimate are half the square of its sigmas, and scatter as much as these: half of
    # the sigmas stretch by stretch are those of the nats
    sd = max(sd, abs(value) / (2.0 * sigmas))
    whitener = whitener_of(final[0])
    before = (total_score(final, whitener) - total_score(held, whitener)) / epochs(final)
    close = (ARM,) if effect == BEHIND and ARM not in found.chosen.names else ()
    # a step of what is cut off is twice what that takes away in the mean
    steps = f"speeds that are cut off, not rounded, in steps of {-2.0 * value:.2g} m/s"
    told = {parameter.name: ParameterValue(value, sd, parameter.unit)}
    return Finding(
        *(effect, told, nats, exceeds(2.0 * nats, 1)),
        *(gap + before, gap, close, advice(effect, close)),
        steps if effect == TOO_LOW and value < 0.0 else "",
    )


def _estimate(effect: str, fits: Sequence[Fit]) -> tuple[float, float]:
    """The one parameter of an effect in every model, of all drives together, and its sd."""
    prior = CATALOGUE[effect].parameters[0].prior_sd ** -2.0
    (state,) = CATALOGUE[effect].states
    info, eta = prior, 0.0
    for fit in fits:
        model = fit.last.problem.model
        row = N_NAV + model.names.index(f"{effect}_{state}")
        cov = full_covariance(fit.last.forward.store.cov[-1:], model.size)[0]
        own = 1.0 / float(cov[row, row])
        info += own - prior
        eta += own * fit.last.totals()[f"{effect}_{state}"]
    return eta / info, float(info**-0.5)
