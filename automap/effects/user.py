"""Effects that a user adds: defined once, like those of the catalogue, and part of it then."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from automap.effects.catalogue import CATALOGUE
from automap.effects.effect import Effect, Parameter
from automap.effects.signals import Signals
from automap.effects.terms import (
    ACCEL,
    GYRO,
    POSITION,
    TRAVEL,
    VEHICLE,
    VELOCITY,
    Kind,
    Term,
)
from automap.errors import ConfigError
from automap.records import FloatArray

Signal = Callable[[Signals], FloatArray]

INERTIAL = ("gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z")
"""Readings, rad/s and m/s^2."""
OF_VEHICLE = ("odometer", "nhc_y", "nhc_z")
"""What the wheels report, and what the point that follows the road does to the right and down,
where the vehicle constraint takes it for nothing; m/s."""
OF_FIXES = (
    "position_along",
    "position_across",
    "height",
    "velocity_along",
    "velocity_across",
    "velocity_down",
)
"""Fixes: along the track, to its right, up; m and m/s."""
OF_CAMERA = ("camera_roll", "camera_pitch", "camera_yaw", "camera_time")
"""The camera: turned about its own axes, rad, and what is added to its stamps, s."""
OF_MOUNT = ("imu_roll", "imu_pitch", "imu_yaw")
OF_IMU = (*OF_MOUNT, "imu_time")
"""The inertial unit: turned further in the vehicle, as its mounting, rad, and how late its stamps
are, s."""
OF_ANTENNA = ("antenna_x", "antenna_y", "antenna_z")
"""The antenna: how much further it sits along the vehicle's axes, m."""
INSTALLED = OF_IMU + OF_ANTENNA
ACTS_ON = INERTIAL + OF_IMU + OF_FIXES + OF_ANTENNA + OF_VEHICLE + OF_CAMERA
_FAMILY = dict.fromkeys(INERTIAL, "imu") | dict.fromkeys((*OF_FIXES, *OF_ANTENNA), "gnss")
_FAMILY |= dict.fromkeys((*OF_VEHICLE, *OF_MOUNT), "vehicle") | dict.fromkeys(OF_CAMERA, "camera")
_FAMILY["imu_time"] = "clock"
_SEPARATOR = "."
COSINE, SINE = "cos", "sin"
"""Parts of a signal along a track: times cosine or sine of the heading."""
LATE = {GYRO: "angular_acceleration", ACCEL: "jerk"}
"""What a reading shows less for each second that its stamp is late."""
_NAME = re.compile(r"[a-z][a-z0-9_]{0,39}")


@dataclass(frozen=True)
class UserTerm:
    """One parameter of a user's effect: reading, angle or delay = true + parameter * signal.

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
    """A user's effect; its ``formulas`` all act on readings, fixes, the vehicle or the camera."""

    formulas: tuple[UserTerm, ...] = ()

    def formula(self, parameter: str) -> UserTerm:
        """The user's term of a parameter."""
        return next(t for t in self.formulas if t.parameter == parameter)


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
    families = {_FAMILY[t.on] for t in terms}
    if len(families) > 1:
        raise ConfigError(
            f"the effect '{name}' acts on more than one of readings, fixes, vehicle, stamps and "
            "camera; make an effect for each"
        )
    parameters = tuple(Parameter(t.parameter, t.unit, t.prior_sd) for t in terms)
    acting = tuple(term for t in terms for term in _terms(name, t))
    return UserEffect(name, families.pop(), parameters, summary, acting, formulas=terms)


@dataclass(frozen=True)
class Toward:
    """Part of a channel of users' effects: on what it acts, along which axis, with which sign, in
    which way; ``turned``: times cosine or sine of the heading, for channels along the track or
    across, or less what that reading changes by."""

    on: str
    axis: int
    weight: float = 1.0
    turned: str = ""
    kind: Kind = Kind.AXIS


def towards(channel: str) -> tuple[Toward, ...]:
    """How one of ``ACTS_ON`` acts on what is measured."""
    if channel in INERTIAL:
        sensor, _, letter = channel.partition("_")
        return (Toward(sensor, "xyz".index(letter)),)
    if channel in OF_MOUNT:
        axis = OF_MOUNT.index(channel)
        return tuple(Toward(on, axis, kind=Kind.TURN) for on in (POSITION, VELOCITY, VEHICLE))
    if channel in OF_ANTENNA:
        axis = OF_ANTENNA.index(channel)
        return tuple(Toward(on, axis, kind=Kind.POINT) for on in (POSITION, VELOCITY))
    if channel in OF_IMU:
        # not fixes that are early by what it is late now: between them the same stamps count time
        return tuple(
            Toward(on, axis, 1.0, f"{signal}_{letter}", Kind.TIME)
            for on, signal in LATE.items()
            for axis, letter in enumerate("xyz")
        )
    if channel in OF_VEHICLE:
        axis = OF_VEHICLE.index(channel)
        # the wheels report what is added; the constraint says nothing where there is something
        return (Toward(VEHICLE, axis, 1.0 if axis == 0 else -1.0),)
    if channel in OF_CAMERA:
        return ()  # what it does to boxes: camera_user
    on = VELOCITY if channel.startswith(VELOCITY) else POSITION
    if channel.endswith("along"):
        return Toward(on, 0, 1.0, COSINE), Toward(on, 1, 1.0, SINE)
    if channel.endswith("across"):
        return Toward(on, 0, -1.0, SINE), Toward(on, 1, 1.0, COSINE)
    return (Toward(on, 2, -1.0 if channel == "height" else 1.0),)


def _terms(effect: str, given: UserTerm) -> Iterable[Term]:
    """How a user's term acts; its signal is named by effect and parameter, and the part of it."""
    for part in towards(given.on):
        name = _SEPARATOR.join([effect, given.parameter, *([part.turned] if part.turned else [])])
        yield Term(given.parameter, part.on, part.kind, part.axis, name, part.weight)


def turned(values: FloatArray, part: str, signals: Signals) -> FloatArray:
    """Values [n] times cosine or sine of the heading, less what a reading changes by in as many
    seconds, or as they are."""
    if not part:
        return values
    if part not in (COSINE, SINE):
        return np.asarray(-values * getattr(signals, part))
    return np.asarray(values * (np.cos if part == COSINE else np.sin)(signals.heading))


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


def is_users(signal: str) -> bool:
    """Whether a term's signal is a user's, or follows from the drive's quantities like one."""
    return _SEPARATOR in signal or signal in TRAVEL


def user_signal(name: str, signals: Signals) -> FloatArray:
    """A user's signal [n], or one of ``TRAVEL``, by its name in a term.

    Raises:
        ConfigError: its function fails, or gives something else than a number an instant.
    """
    if name in TRAVEL:
        return np.asarray(getattr(signals, name))
    effect, parameter, *part = name.split(_SEPARATOR)
    return turned(signal_of(effect, parameter, signals), part[0] if part else "", signals)


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
            value = np.asarray(known.formula(parameter).signal(signals), np.float64)
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
