"""Short ways to write parameters and terms of an effect."""

from __future__ import annotations

import math

from automap.effects.effect import Parameter
from automap.effects.terms import ONE, Kind, Term

XYZ = "x y z"
ROLL_PITCH_YAW = "roll pitch yaw"
NINE = "xx xy xz yx yy yz zx zy zz"


def named(names: str, unit: str, sd: float, at_least: float = -math.inf) -> tuple[Parameter, ...]:
    """Parameters of these names, all alike."""
    return tuple(Parameter(n, unit, sd, at_least) for n in names.split())


def xyz(unit: str, sd: float, at_least: float = -math.inf) -> tuple[Parameter, ...]:
    """A parameter an axis."""
    return named(XYZ, unit, sd, at_least)


def axes(
    on: str | tuple[str, ...],
    kind: Kind = Kind.AXIS,
    names: str = XYZ,
    signal: str = ONE,
    weight: float = 1.0,
) -> tuple[Term, ...]:
    """A parameter an axis; ``{}`` in the signal stands for the parameter's name."""
    measured = (on,) if isinstance(on, str) else on
    return tuple(
        Term(name, each, kind, axis, signal.format(name), weight)
        for axis, name in enumerate(names.split())
        for each in measured
    )


def matrix(sensor: str, signal: str, names: str) -> tuple[Term, ...]:
    """Parameters named by output axis and input axis; ``{}`` in the signal is the latter."""
    return tuple(
        Term(name, sensor, Kind.AXIS, XYZ.split().index(name[0]), signal.format(name[1]))
        for name in names.split()
    )


def one(
    parameter: str,
    on: str | tuple[str, ...],
    kind: Kind,
    axis: int = 0,
    signal: str = ONE,
    weight: float = 1.0,
) -> tuple[Term, ...]:
    """One parameter that acts alike on all that is named."""
    measured = (on,) if isinstance(on, str) else on
    return tuple(Term(parameter, each, kind, axis, signal, weight) for each in measured)
