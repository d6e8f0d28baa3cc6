"""Effects that add to the inertial readings: reading = true + sum theta_j phi_j(true).

Each term acts on one axis of one sensor through one basis signal. That is all the filter kernel
needs to know: it receives rows of codes, those of one parameter one after the other, and, for
signals that are not the reading itself, extra columns computed here.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from automap.effects.catalogue import CATALOGUE, effect_named
from automap.effects.effect import Parameter
from automap.effects.inertial_signals import DEAD, LATE, inertial_signal, late, shape_of
from automap.effects.signals import Signals
from automap.effects.terms import INERTIAL, ONE
from automap.errors import ConfigError
from automap.records import FloatArray

GYRO, ACCEL = range(2)

# basis signals known to the kernel: 1, angular rate x y z, specific force x y z; further
# numbers count the extra columns of ``extra_basis``
BASIS_ONE = 0
BASIS_RATE = 1
BASIS_FORCE = 4
BASIS_EXTRA = 7


@dataclass(frozen=True)
class ImuTerm:
    """One parameter of an inertial effect on one axis; most act on one only.

    ``sensor`` GYRO or ACCEL, ``axis`` 0..2 the output axis, ``basis`` the number of the
    signal; ``extra`` the name of the signal when it is not one of the kernel's own.
    """

    effect: str
    parameter: Parameter
    sensor: int
    axis: int
    basis: int
    extra: str | None = None

    @property
    def name(self) -> str:
        """Column name in tables, e.g. ``accel_bias_x``."""
        return f"{self.effect}_{self.parameter.name}"


_OWN = {ONE: BASIS_ONE}
_OWN |= {f"rate_{axis}": BASIS_RATE + i for i, axis in enumerate("xyz")}
_OWN |= {f"force_{axis}": BASIS_FORCE + i for i, axis in enumerate("xyz")}


def imu_terms(effects: list[str]) -> list[ImuTerm]:
    """The terms of the named inertial effects, in order, extra signals numbered.

    Raises:
        ConfigError: an unknown effect, or one that is not an inertial one.
    """
    terms: list[ImuTerm] = []
    extras: list[str] = []
    for name in effects:
        effect = effect_named(name)
        if not effect.acts_on(*INERTIAL):
            raise ConfigError(f"effect '{name}' does not act on inertial readings")
        for parameter in effect.parameters:
            for term in effect.terms_of(parameter.name):
                extra = None
                if term.signal not in _OWN:
                    extra = term.signal
                    if extra not in extras:
                        extras.append(extra)
                basis = _OWN[term.signal] if extra is None else BASIS_EXTRA + extras.index(extra)
                sensor = INERTIAL.index(term.on)
                terms.append(ImuTerm(name, parameter, sensor, term.axis, basis, extra))
    return terms


def extra_basis(
    terms: list[ImuTerm],
    gyro: FloatArray,
    accel: FloatArray,
    temp_c: FloatArray | None = None,
    speed: FloatArray | None = None,
    temp_ref_c: float | None = None,
    signals: Signals | None = None,
    as_read: tuple[FloatArray, FloatArray] | None = None,
) -> FloatArray:
    """Extra basis signals [n, k] of the terms at true rates and forces [n, 3].

    ``temp_c`` [n] in deg C against ``temp_ref_c`` (default: its median), ``speed`` [n] in m/s;
    ``signals`` [n] for what follows from the drive (``asks_for_the_drive``); ``as_read`` the
    readings [n, 3], [n, 3] with all their errors, for dead zones, where they are not the same as
    the rates and forces. A signal whose source is missing is zero.
    """
    names: dict[int, str] = {t.basis: t.extra for t in terms if t.extra is not None}
    out = np.zeros((len(gyro), len(names)))
    for basis, name in names.items():
        of = as_read if as_read is not None and name.startswith(DEAD) else (gyro, accel)
        out[:, basis - BASIS_EXTRA] = inertial_signal(name, *of, temp_c, speed, temp_ref_c, signals)
    return out


def distort_imu(
    gyro: FloatArray,
    accel: FloatArray,
    values: dict[str, dict[str, float]],
    temp_c: FloatArray | None = None,
    speed: FloatArray | None = None,
    temp_ref_c: float | None = None,
    signals: Signals | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Readings [n, 3], [n, 3] of a sensor with the given errors at true rates and forces.

    ``values`` maps effect to parameter to value, e.g. ``{"accel_bias": {"x": 0.1}}``; effects
    of other families are passed over. This is the simulator's side of the model.
    """
    names = [n for n in values if n in CATALOGUE and CATALOGUE[n].family == "imu"]
    terms = imu_terms(names)
    extra = extra_basis(terms, gyro, accel, temp_c, speed, temp_ref_c, signals)
    rates, forces = gyro.copy(), accel.copy()
    # a dead zone comes last: it takes from what would be read without it
    for term in sorted(terms, key=lambda t: (t.extra or "").startswith(DEAD)):
        theta = values[term.effect].get(term.parameter.name, 0.0)
        if theta == 0.0:
            continue
        target = rates if term.sensor == GYRO else forces
        name = term.extra or ""
        if signals is not None and name.startswith(LATE):
            target[:, term.axis] += late(name, theta, gyro, accel, signals.time)
        elif name.startswith(DEAD):
            target[:, term.axis] += theta * shape_of(name, rates, forces)
        else:
            target[:, term.axis] += theta * _basis_signal(term, gyro, accel, extra)
    return rates, forces


def _basis_signal(
    term: ImuTerm, gyro: FloatArray, accel: FloatArray, extra: FloatArray
) -> FloatArray | float:
    if term.basis == BASIS_ONE:
        return 1.0
    if term.basis < BASIS_FORCE:
        return gyro[:, term.basis - BASIS_RATE]
    if term.basis < BASIS_EXTRA:
        return accel[:, term.basis - BASIS_FORCE]
    return extra[:, term.basis - BASIS_EXTRA]
