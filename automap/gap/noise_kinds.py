"""Kinds of noise that a drive may have beyond the usual ones, where it shows them.

Velocities with errors that last longer than an epoch are believed far too much where they are
taken for white, and a few shocks make the sensors look noisy all the time. Either way the sensors'
noise grows until no effect of theirs shows any more.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from automap.fusion.levels import VELOCITY_WANDER
from automap.fusion.shocks import shock_noise
from automap.gap.fit import Fit, fit_drive
from automap.gap.model import GapModel
from automap.gap.noise import fit_noise, noise_score
from automap.gap.search_state import Log

WANDER_SD = 0.05
"""m/s, where the search for the size of lasting velocity errors begins."""
TIMES_S = (2.0, 0.6, 6.0)
WORTH_NATS = 10.0
LIKE_NOISE = ("gnss_latency", "gnss_velocity_latency", "gnss_lever_arm")
"""Chosen: what most often makes velocity errors that last, in every bend. With these free, what
is left is noise; one of each pair that is alike to first order will do."""


@dataclass(frozen=True)
class NoiseFit:
    """Fits under a model whose noise levels suit them, and their log-likelihood in nats."""

    model: GapModel
    fits: list[Fit]
    score: float


def with_noise_kinds(fits: Sequence[Fit], model: GapModel, log: Log) -> NoiseFit:
    """The model with shocks and velocity errors that last, as far as the drives show them, its
    noise fitted. ``model`` has the levels that suit it without them."""
    free = {e: 1.0 for e in LIKE_NOISE if e not in model.included}
    kinds = _kinds(fit_with_noise(fits, model, free), free, log).model
    return fit_with_noise(fits, kinds)


def without_wander(
    fits: Sequence[Fit], model: GapModel, accepted: Mapping[str, float], log: Log
) -> NoiseFit | None:
    """The fits without velocity errors that last, where the effects ``accepted`` explain what was
    taken for such errors; None where they do not, or none were there."""
    if model.options.velocity_wander_sd == 0.0:
        return None
    log("checking whether velocity errors still last")
    now = noise_score(fits, model.factors)
    options = replace(model.options, velocity_wander_sd=0.0)
    factors = {**model.factors, VELOCITY_WANDER: 1.0}
    plain = fit_with_noise(fits, replace(model, options=options, factors=factors), accepted)
    return plain if plain.score > now - WORTH_NATS else None


def _kinds(best: NoiseFit, free: Mapping[str, float], log: Log) -> NoiseFit:
    """The kinds of noise that fits show with the effects ``free`` estimated."""
    options = best.model.options
    if not options.shocks and any(_has_shocks(fit) for fit in best.fits):
        log("fitting the noise of shocks")
        shaken = replace(best.model, options=replace(options, shocks=True))
        tried = fit_with_noise(best.fits, shaken, free)
        best = tried if tried.score > best.score + WORTH_NATS else best
    if options.velocity_wander_sd > 0.0:
        return best
    without = best
    for tau in TIMES_S:
        log(f"fitting velocity errors that last {tau:g} s")
        tried = _wandering(best, tau, free)
        if best is without:
            if tried.score < best.score + WORTH_NATS:
                break
            best = tried
        elif tried.score > best.score:
            return tried
    return best


def fit_with_noise(
    fits: Sequence[Fit], model: GapModel, free: Mapping[str, float] | None = None
) -> NoiseFit:
    """Fits under the model, with the effects ``free`` as states, and the noise levels that suit
    them."""
    begun = [fit_drive(fit.opened, model, free, linearised_at=fit) for fit in fits]
    model = replace(model, factors=fit_noise(begun))
    done = [fit_drive(fit.opened, model, free, linearised_at=fit) for fit in begun]
    return NoiseFit(model, done, noise_score(done, model.factors))


def _wandering(known: NoiseFit, tau_s: float, free: Mapping[str, float]) -> NoiseFit:
    """The same with velocity errors that last so long."""
    options = replace(
        known.model.options, velocity_wander_sd=WANDER_SD, velocity_wander_tau_s=tau_s
    )
    factors = known.model.factors
    if known.model.options.velocity_wander_sd == 0.0:
        factors = {**factors, VELOCITY_WANDER: 1.0}
    return fit_with_noise(known.fits, replace(known.model, options=options, factors=factors), free)


def _has_shocks(fit: Fit) -> bool:
    """Whether the drive has shocks that are worth a look."""
    imu = fit.opened.drive.imu
    step = float(np.median(np.diff(imu.t_ns))) * 1e-9
    return bool(shock_noise(np.concatenate([imu.gyro, imu.accel], axis=1), step).any())
