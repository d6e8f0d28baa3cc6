"""Velocity errors of a receiver that last longer than an epoch.

Where they are taken for white, ten velocities a second are believed far too much, and the sensors'
noise grows until it follows them: then no effect of the sensors shows any more.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from automap.fusion.levels import VELOCITY_WANDER
from automap.gap.fit import Fit, fit_drive
from automap.gap.model import GapModel
from automap.gap.noise import Curvatures, fit_noise, noise_score
from automap.gap.search_state import Say

SD = 0.05
"""m/s, where the search for its size begins."""
TIMES_S = (2.0, 0.6, 6.0)
WORTH_NATS = 10.0


def with_velocity_wander(
    fits: Sequence[Fit], model: GapModel, say: Say
) -> tuple[GapModel, dict[str, float]]:
    """The model with velocity errors that wander, and the noise factors with it; as it was where
    the drives do not show them. ``fits`` are under any noise, ``model`` has the levels that suit.
    """
    if model.options.velocity_wander_sd > 0.0:
        return model, dict(model.factors)
    best, most = model, noise_score(fits, model.factors) + WORTH_NATS
    known: Curvatures = {}
    for tau in TIMES_S:
        say(f"fitting velocity errors that last {tau:g} s")
        options = replace(model.options, velocity_wander_sd=SD, velocity_wander_tau_s=tau)
        tried = replace(best, options=options, factors={**best.factors, VELOCITY_WANDER: 1.0})
        wandering = [fit_drive(fit.opened, tried, near=fit) for fit in fits]
        factors = fit_noise(wandering, known=known)
        score = noise_score(wandering, factors)
        if score > most:
            shorter = best is not model
            best, most = replace(tried, factors=factors), score
            if shorter:
                break
        elif best is model:
            break
    return best, dict(best.factors)
