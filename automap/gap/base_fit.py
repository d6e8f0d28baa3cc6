"""The base model fitted to drives, and what of it the drives decide before anything is asked."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from automap.effects import CATALOGUE
from automap.fusion.delay_states import COURSE_DISTANCE_STATE
from automap.gap import limits
from automap.gap.drive import OpenDrive, shocks_of, with_shocks
from automap.gap.fit import BEHIND, GapModel, fit_drive, without
from automap.gap.noise import INERTIAL_LEVELS, Fitted, Log, open_fits, with_levels
from automap.gap.scoring import likelier


def first_fit(opened: Sequence[OpenDrive], model: GapModel, log: Log) -> Fitted:
    """A model fitted, its noise first, but for courses of a place behind where that is ahead, or
    further behind than with any receiver: then an antenna is there, or a course's delay, to which
    all else is bent where the model takes it up so."""
    base = open_fits(opened, model, log)
    (usual,) = CATALOGUE[BEHIND].parameters
    metres = np.mean([fit.last.totals().get(COURSE_DISTANCE_STATE, 0.0) for fit in base.fits])
    if not 0.0 <= metres <= limits.ONE_IN_A_THOUSAND * usual.prior_sd:
        # the noise is much the same: it need not be sought from everywhere again
        fewer = replace(without(model, BEHIND), factors=base.model.factors)
        base = with_levels(Fitted(fewer, {}, tuple(fit_drive(d, fewer) for d in opened)))
    return _with_shocks(base, log)


def _with_shocks(base: Fitted, log: Log) -> Fitted:
    """The fit with the noise of shocks where the readings show some and the drives are likelier so:
    one level for a whole drive is the mean of potholes and of smooth road, and hides between them
    what the smooth road tells."""
    if base.model.options.shocks:
        return base
    psd = np.concatenate([shocks_of(fit.opened.drive) for fit in base.fits]).mean(axis=0)
    if not psd.any():
        return base
    log("fitting the noise with shocks")
    options = replace(base.model.options, shocks=True)
    factors = dict(base.model.factors)
    for level, shaken in zip(INERTIAL_LEVELS, psd, strict=True):
        # both together are what was fitted without; where shocks alone are more, much less is left
        whole = (factors[level] * getattr(options, f"{level}_noise")) ** 2
        factors[level] *= float(np.sqrt(whole / (whole + shaken)))
    model = replace(base.model, options=options, factors=factors)
    fits = tuple(fit_drive(with_shocks(f.opened), model, linearised_at=f) for f in base.fits)
    other = with_levels(Fitted(model, {}, fits, base.curvature))
    nats, sigmas = likelier(other.fits, base.fits)
    return other if nats >= limits.CLOSE_NATS and sigmas > limits.APART else base
