"""The sensor model: every named physical effect, defined once.

An effect has a name, parameters with units and priors, and terms (``terms``): on which readings,
fixes or motion of the vehicle each parameter acts, in which way, times which signal. The simulator
applies them exactly (``imu.distort_imu``, ``measured.distortion``), filter and gap finder take
their columns (``imu.imu_terms``, ``measured_kernels``); neither knows an effect by its name. What
the camera's effects do is in the camera's own model (``camera``). Names and units are those users
write in configuration files. Users add effects of their own with ``user_effect``.
"""

from automap.effects.catalogue import CATALOGUE, effect_named
from automap.effects.effect import Effect, Parameter
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
