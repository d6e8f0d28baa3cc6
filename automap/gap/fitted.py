"""A set of effects fitted to drives as states of the filter, with the noise that suits it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from automap.fusion.levels import ALL_LEVELS
from automap.gap.drive import OpenDrive
from automap.gap.fit import Fit, fit_drive
from automap.gap.model import GapModel, parameter_names, prior_sd
from automap.gap.noise import fit_noise, noise_score
from automap.gap.scoring import Joint, combine

Log = Callable[[str], None]
INERTIAL_LEVELS = ("accel", "gyro")


@dataclass(frozen=True)
class Fitted:
    """A set of effects fitted: ``estimate`` effect -> factor on its prior sds, ``fits`` of all
    drives with these as states, under ``model`` with the noise that suits them."""

    model: GapModel
    estimate: Mapping[str, float]
    fits: tuple[Fit, ...]

    def joint(self) -> Joint:
        """The drives' estimates as one."""
        sds = [
            scale * prior_sd(self.model.options, effect, parameter)
            for effect, scale in self.estimate.items()
            for parameter in parameter_names(effect)
        ]
        return combine(self.fits, [0.0] * len(self.fits), np.array(sds))

    def values(self) -> dict[str, dict[str, float]]:
        """Effect -> parameter -> estimated value."""
        joint = self.joint()
        return {e: {p: v for p, (v, _) in joint.of(e).items()} for e in self.estimate}


def open_fits(drives: Sequence[OpenDrive], model: GapModel, log: Log) -> Fitted:
    """The base model fitted, its noise first."""
    log("fitting the base model")
    fits = tuple(fit_drive(d, model) for d in drives)
    log("fitting the noise")
    return with_noise(Fitted(model, {}, fits), model.factors)


def with_noise(fitted: Fitted, stated: Mapping[str, float]) -> Fitted:
    """The set with the noise levels that make the drives likeliest.

    The likelihood has a top where the sensors are noisy and one where the receiver is; so it is
    climbed from the levels that the set has, from those stated, and with either moved first.
    """
    fits = fitted.fits
    others = tuple(k for k in ALL_LEVELS if k not in INERTIAL_LEVELS)
    starts = [dict(fitted.model.factors), dict(stated)]
    if not fitted.estimate:
        starts = [fit_noise(fits, levels, initial=stated) for levels in (INERTIAL_LEVELS, others)]
    tops = [fit_noise(fits, initial=start) for start in starts]
    factors = max(tops, key=lambda f: noise_score(fits, f))
    model = replace(fitted.model, factors=factors)
    return fitted_about(model, fitted.estimate, fits)


def fitted_about(model: GapModel, estimate: Mapping[str, float], about: Sequence[Fit]) -> Fitted:
    """The set ``estimate`` as states under a model, beginning about other fits of the drives."""
    fits = tuple(fit_drive(f.opened, model, estimate, linearised_at=f) for f in about)
    return Fitted(model, dict(estimate), fits)
