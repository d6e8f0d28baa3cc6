"""What one fit has found of an effect."""

from __future__ import annotations

from automap.gap.fit import Fit
from automap.gap.joint import Joint


def estimates(fit: Fit, effect: str) -> dict[str, tuple[float, float]]:
    """Parameter -> value and sd."""
    return Joint(fit.names, fit.values, fit.cov, 0.0).of(effect)


def value_of(fit: Fit, effect: str) -> dict[str, float]:
    """Parameter -> value."""
    return {p: value for p, (value, _) in estimates(fit, effect).items()}
