"""What every receiver does, named as a finding where it is gross: wild fixes, courses that lag by
metres, speeds that are told too low.

All are in every model. An antenna so far behind where it is said does to velocities what courses
that lag do: as a part of every model these let nothing else be named in their place, told by nobody
they would swallow a wrong arm.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence

import numpy as np

from automap.effects import CATALOGUE
from automap.fusion.filtered import full_covariance
from automap.fusion.layout import CH_VEL, N_NAV
from automap.gap import limits
from automap.gap.drive import OpenDrive, count_outliers
from automap.gap.fit import BEHIND, Fit, Values, without
from automap.gap.found import Found
from automap.gap.noise import Fitted, fitted_about, with_noise
from automap.gap.result import Finding, ParameterValue, advice
from automap.gap.scoring import epochs, fit_held_out, gain_over, likelier, whitener_of
from automap.gates import exceeds
from automap.records import FloatArray

ARM, TOO_LOW = "gnss_lever_arm", "gnss_speed_offset"
USUAL = (BEHIND, TOO_LOW)
"""Effects of every receiver."""


def outliers_finding(fits: Sequence[Fit], gap: float) -> Finding | None:
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


def usual_findings(
    found: Found,
    values: Values,
    held_out: Sequence[OpenDrive],
    final: Sequence[Fit],
    stated: Mapping[str, float],
    gap: float,
    exclude: Collection[str],
) -> dict[str, tuple[Finding, Fitted]]:
    """The effects of every receiver that are told, each with the fit that is without it, but for
    those to ``exclude``."""
    asked = [effect for effect in USUAL if effect not in exclude]
    every = [(e, usual_finding(e, found, values, held_out, final, stated, gap)) for e in asked]
    return {effect: one for effect, one in every if one is not None}


def values_for_runs(usual: Iterable[Finding]) -> dict[str, dict[str, float]]:
    """What findings say of effects that every model estimates, for runs that do not: but for how
    speeds are cut off, which is a receiver's way and not worth a value."""
    return {
        one.effect: {p: known.value for p, known in one.parameters.items()}
        for one in usual
        if one.effect == BEHIND
    }


def usual_finding(
    effect: str,
    found: Found,
    values: Values,
    held_out: Sequence[OpenDrive],
    final: Sequence[Fit],
    stated: Mapping[str, float],
    gap: float,
) -> tuple[Finding, Fitted] | None:
    """An effect that is part of every model, where fitted and held-out drives are likelier with it
    beyond all doubt, and the fit without it.

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
    before = gain_over(final, held, whitener_of(final[0])) / epochs(final)
    close = (ARM,) if effect == BEHIND and ARM not in found.chosen.names else ()
    # a step of what is cut off is twice what that takes away in the mean
    steps = f"speeds that are cut off, not rounded, in steps of {-2.0 * value:.2g} m/s"
    told = {parameter.name: ParameterValue(value, sd, parameter.unit)}
    finding = Finding(
        *(effect, told, nats, exceeds(2.0 * nats, 1)),
        *(gap + before, gap, close, advice(effect, close)),
        steps if effect == TOO_LOW and value < 0.0 else "",
    )
    return finding, bare


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
