"""Courses that lag by a distance: part of every model, and a finding where they do.

An antenna so far behind where it is said does to velocities what they do. As a part of every model
they let nothing else be named in their place; told by nobody they would swallow a wrong arm.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from automap.effects import CATALOGUE
from automap.fusion.delay_states import COURSE_DISTANCE_STATE
from automap.fusion.filtered import full_covariance
from automap.fusion.layout import N_NAV
from automap.gap import limits
from automap.gap.drive import OpenDrive
from automap.gap.fit import Fit, Values, without_course_distance
from automap.gap.noise import fitted_about, with_noise
from automap.gap.result import Finding, ParameterValue, advice
from automap.gap.scoring import epochs, fit_held_out, likelier, total_score, whitener_of
from automap.gap.screening import Found
from automap.gates import exceeds

NAME, ARM = "gnss_course_distance", "gnss_lever_arm"


def course_distance_finding(
    found: Found,
    values: Values,
    held_out: Sequence[OpenDrive],
    final: Sequence[Fit],
    stated: Mapping[str, float],
    gap: float,
) -> Finding | None:
    """The distance, where fitted and held-out drives are likelier with it beyond all doubt.

    ``values`` of what else was found, ``final`` the held-out fits under all of it, ``stated`` the
    factors of the noise as it was asked with, ``gap`` what is left on held-out data.
    """
    fits = found.fitted.fits
    if COURSE_DISTANCE_STATE not in fits[0].last.problem.model.names:
        return None
    value, sd = _estimate(fits)
    model = without_course_distance(found.fitted.model)
    bare = with_noise(fitted_about(model, found.fitted.estimate, fits), stated)
    held = fit_held_out(held_out, bare.model, values, final)
    nats, sigmas = likelier((*fits, *final), (*bare.fits, *held))
    # as dear as any other name
    prior = float(np.log1p(-limits.OUTSIDE_LIBRARY) - np.log(len(found.selection.candidates)))
    clear = nats + prior >= limits.LEAST_ODDS and sigmas >= limits.ONE_IN_A_THOUSAND
    if value <= 0.0 or not clear:
        return None
    # nats of an estimate are half the square of its sigmas, and scatter as much as these: half of
    # the sigmas stretch by stretch are those of the nats
    sd = max(sd, value / (2.0 * sigmas))
    whitener, unit = whitener_of(final[0]), CATALOGUE[NAME].parameters[0].unit
    before = (total_score(final, whitener) - total_score(held, whitener)) / epochs(final)
    close = () if ARM in found.chosen.names else (ARM,)
    return Finding(
        *(NAME, {"m": ParameterValue(value, sd, unit)}, nats, exceeds(2.0 * nats, 1)),
        *(gap + before, gap, close, advice(NAME, close)),
    )


def _estimate(fits: Sequence[Fit]) -> tuple[float, float]:
    """The distance in m of all drives together, and its sd."""
    prior = CATALOGUE[NAME].parameters[0].prior_sd ** -2.0
    info, eta = prior, 0.0
    for fit in fits:
        model = fit.last.problem.model
        row = N_NAV + model.names.index(COURSE_DISTANCE_STATE)
        cov = full_covariance(fit.last.forward.store.cov[-1:], model.size)[0]
        own = 1.0 / float(cov[row, row])
        info += own - prior
        eta += own * fit.last.totals()[COURSE_DISTANCE_STATE]
    return eta / info, float(info**-0.5)
