"""The sensor model: every named physical effect, defined once.

An effect has a name, parameters with units and prior, and says either how it adds to an
inertial reading (``imu``: terms theta * phi(true) on one axis), or how it acts on a fix,
on the vehicle constraint, or on the camera. Simulator, estimator and gap finder use these
definitions and nothing else. Names and units are those users write in configuration files.
Users add effects of their own with ``user_effect``.
"""

from automap.effects.catalogue import CATALOGUE, Effect, Parameter, effect_named
from automap.effects.imu import (
    BASIS_FORCE,
    BASIS_ONE,
    BASIS_RATE,
    ImuTerm,
    distort_imu,
    extra_basis,
    imu_terms,
)
from automap.effects.signals import Signals
from automap.effects.user import UserEffect, UserTerm, user_effect

__all__ = [
    "BASIS_FORCE",
    "BASIS_ONE",
    "BASIS_RATE",
    "CATALOGUE",
    "Effect",
    "ImuTerm",
    "Parameter",
    "Signals",
    "UserEffect",
    "UserTerm",
    "distort_imu",
    "effect_named",
    "extra_basis",
    "imu_terms",
    "user_effect",
]
