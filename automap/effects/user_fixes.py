"""What users' effects of known size add to fixes."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from automap.effects.catalogue import CATALOGUE
from automap.effects.signals import Signals
from automap.effects.user import UserEffect, signal_of
from automap.records import FloatArray


def acts_on_fixes(effect: str) -> bool:
    """Whether it is a user's effect on the fixes."""
    known = CATALOGUE.get(effect)
    return isinstance(known, UserEffect) and known.on_fixes


def direction(on: str, heading: FloatArray) -> FloatArray:
    """Unit vectors NED [n, 3] of a channel of the fixes at headings [n]."""
    zero = np.zeros(len(heading))
    if on.endswith("along"):
        return np.stack([np.cos(heading), np.sin(heading), zero], axis=1)
    if on.endswith("across"):
        return np.stack([-np.sin(heading), np.cos(heading), zero], axis=1)
    sign = -1.0 if on == "height" else 1.0
    return np.stack([zero, zero, np.full(len(heading), sign)], axis=1)


def unit_errors(effect: str, parameter: str, signals: Signals) -> tuple[FloatArray, FloatArray]:
    """Position in m and velocity in m/s, NED [n, 3], that a unit of a parameter adds."""
    known = CATALOGUE[effect]
    assert isinstance(known, UserEffect)
    on = known.term(parameter).on
    vectors = signal_of(effect, parameter, signals)[:, None] * direction(on, signals.heading)
    none = np.zeros_like(vectors)
    return (none, vectors) if on.startswith("velocity") else (vectors, none)


def fix_errors(
    values: Mapping[str, Mapping[str, float]], signals: Signals
) -> tuple[FloatArray, FloatArray]:
    """Position and velocity errors NED [n, 3] of all users' effects among ``values``."""
    position = np.zeros((len(signals.time), 3))
    velocity = np.zeros_like(position)
    for effect, given in values.items():
        if not acts_on_fixes(effect):
            continue
        for parameter, value in given.items():
            if value != 0.0:
                p, v = unit_errors(effect, parameter, signals)
                position += value * p
                velocity += value * v
    return position, velocity
