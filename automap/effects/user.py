"""Effects that a user adds: defined once, like those of the catalogue, and part of it then."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from automap.effects.catalogue import CATALOGUE, Effect, Parameter
from automap.effects.signals import Signals
from automap.errors import ConfigError
from automap.records import FloatArray

Signal = Callable[[Signals], FloatArray]

INERTIAL = ("gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z")
"""Readings, rad/s and m/s^2."""
OF_FIXES = (
    "position_along",
    "position_across",
    "height",
    "velocity_along",
    "velocity_across",
    "velocity_down",
)
"""Fixes: along the track, to its right, up; m and m/s."""
ACTS_ON = INERTIAL + OF_FIXES
_NAME = re.compile(r"[a-z][a-z0-9_]{0,39}")


@dataclass(frozen=True)
class UserTerm:
    """One parameter of a user's effect: reading = true + parameter * signal.

    ``on`` one of ``ACTS_ON``; ``prior_sd`` how large the parameter may well be, one sigma, in
    ``unit``; ``signal`` a function of the drive's quantities, [n]; ``formula`` its text where
    it was given as one.
    """

    parameter: str
    on: str
    signal: Signal
    prior_sd: float
    unit: str = ""
    formula: str = ""


@dataclass(frozen=True)
class UserEffect(Effect):
    """A user's effect; all its terms act on the readings, or all on the fixes."""

    terms: tuple[UserTerm, ...] = ()

    def term(self, parameter: str) -> UserTerm:
        """The term of a parameter."""
        return next(t for t in self.terms if t.parameter == parameter)

    @property
    def on_fixes(self) -> bool:
        """Whether it acts on the fixes."""
        return self.family == "gnss"


def user_effect(name: str, summary: str, *terms: UserTerm) -> UserEffect:
    """Make an effect.

    Raises:
        ConfigError: a name, channel or number that cannot be.
    """
    if not _NAME.fullmatch(name):
        raise ConfigError(
            f"'{name}' cannot be the name of an effect; use small letters, digits and _"
        )
    if not terms:
        raise ConfigError(f"the effect '{name}' has no parameter; give it one")
    seen: set[str] = set()
    for term in terms:
        place = f"{name}.{term.parameter}"
        if not _NAME.fullmatch(term.parameter) or term.parameter in seen:
            raise ConfigError(f"'{place}': name each parameter once, in small letters")
        seen.add(term.parameter)
        if term.on not in ACTS_ON:
            raise ConfigError(
                f"'{place}' acts on '{term.on}', which there is not; choose from "
                + ", ".join(ACTS_ON)
            )
        if not (np.isfinite(term.prior_sd) and term.prior_sd > 0.0):
            raise ConfigError(f"'{place}': prior_sd is {term.prior_sd}; give a number above 0")
    sides = {t.on in OF_FIXES for t in terms}
    if len(sides) > 1:
        raise ConfigError(
            f"the effect '{name}' acts on readings and on fixes; make two effects of it"
        )
    parameters = tuple(Parameter(t.parameter, t.unit, t.prior_sd) for t in terms)
    return UserEffect(name, "gnss" if sides.pop() else "imu", parameters, summary, terms)


def user_effects() -> list[UserEffect]:
    """The effects that users have added, in order."""
    return [e for e in CATALOGUE.values() if isinstance(e, UserEffect)]


def set_user_effects(effects: Iterable[UserEffect]) -> None:
    """Make these, and no others, the users' effects of this process.

    Raises:
        ConfigError: two of one name, or one that the catalogue has already.
    """
    chosen = list(effects)
    own = {n: e for n, e in CATALOGUE.items() if not isinstance(e, UserEffect)}
    columns = {f"{n}_{p.name}" for n, e in own.items() for p in e.parameters}
    named: set[str] = set()
    for effect in chosen:
        if effect.name in own:
            raise ConfigError(
                f"there is an effect '{effect.name}' already; give yours another name"
            )
        if effect.name in named:
            raise ConfigError(f"the effect '{effect.name}' is defined twice; rename one")
        named.add(effect.name)
        for p in effect.parameters:
            column = f"{effect.name}_{p.name}"
            if column in columns:
                raise ConfigError(
                    f"the parameter '{column}' exists already; rename the effect '{effect.name}'"
                )
            columns.add(column)
    CATALOGUE.clear()
    CATALOGUE.update(own)
    CATALOGUE.update({e.name: e for e in chosen})


def add_user_effect(effect: UserEffect) -> None:
    """Add one to the users' effects, in place of one of the same name."""
    set_user_effects([*(e for e in user_effects() if e.name != effect.name), effect])


def signal_of(effect: str, parameter: str, signals: Signals) -> FloatArray:
    """The signal [n] of a user's effect's parameter.

    Raises:
        ConfigError: its function fails, or gives something else than a number an instant.
    """
    known = CATALOGUE[effect]
    assert isinstance(known, UserEffect)
    place = f"the effect '{effect}', parameter '{parameter}'"
    try:
        with np.errstate(all="ignore"):
            value = np.asarray(known.term(parameter).signal(signals), np.float64)
    except Exception as error:
        # whatever a user's function does, the place of the fault is what helps
        raise ConfigError(
            f"{place}: its function fails with {type(error).__name__}: {error}"
        ) from error
    if value.ndim == 0:
        value = np.full(len(signals.time), float(value))
    if value.shape != signals.time.shape:
        raise ConfigError(
            f"{place}: its function gives {value.shape} for {len(signals.time)} instants; "
            "one number an instant is wanted"
        )
    bad = np.flatnonzero(~np.isfinite(value))
    if len(bad):
        raise ConfigError(
            f"{place} is no number {signals.time[bad[0]]:.1f} s into the drive; "
            "keep it finite there, for instance with max(speed, 1)"
        )
    return value
