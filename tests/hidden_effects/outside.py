"""Errors of real cars and sensors that are in no library, each with what is true about it.

Every kind states where a finder must see it: the channels of the filter in which it shows, and
which misfits ("period", "time", "speed", ...) say when. What a fitted name or formula takes away
on another day is computed, not stated.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from tests.hidden_effects.extras import Extras
from tests.hidden_effects.geodesy import Array
from tests.hidden_effects.imu import Signals
from tests.hidden_effects.motion import Motion, Path, State, to_nav
from tests.hidden_effects.route import MARGIN_S

VELOCITY = ("velocity_n", "velocity_e", "velocity_d")
POSITION = ("position_n", "position_e", "position_d")
LEVEL = ("velocity_n", "velocity_e", "position_n", "position_e")
VERTICAL = ("velocity_d", "position_d")
NHC = ("nhc_y", "nhc_z")
IMAGE = ("image_u", "image_v")
INERTIAL = VELOCITY + POSITION + NHC
"""What readings do wrong shows wherever the path is measured."""


@dataclass(frozen=True)
class Outside:
    """One error: ``channel`` in which it acts, for people and for formulas; ``truth`` in plain
    words, {} for the size; ``shows`` the filter's channels; ``when`` the kinds of misfits that
    place it; ``noise`` whether a claim that noise is more than stated says it as well; sizes
    from ``small`` to ``large`` in ``unit``, of both signs where ``signed``; ``extras`` of a
    size."""

    kind: str
    channel: str
    truth: str
    shows: tuple[str, ...]
    when: tuple[str, ...]
    small: float
    large: float
    unit: str
    extras: Callable[[float], Extras]
    noise: bool = False
    signed: bool = True

    def told(self, size: float) -> str:
        """The record of the truth."""
        return f"{self.channel}: {self.truth.format(f'{size:.3g} {self.unit}')}"


Maker = Callable[[np.random.Generator, float], Outside]


def imu_only(
    gyro: Sequence[Callable[[Signals], Array] | None] = (None, None, None),
    accel: Sequence[Callable[[Signals], Array] | None] = (None, None, None),
) -> Callable[[float], Extras]:
    """Readings to which a size times these functions of the motion is added, axis by axis."""

    def of_size(size: float) -> Extras:
        def errors(s: Signals) -> tuple[Array, Array]:
            out = np.zeros_like(s.rate), np.zeros_like(s.force)
            for target, functions in zip(out, (gyro, accel), strict=True):
                for axis, function in enumerate(functions):
                    if function is not None:
                        target[:, axis] = size * function(s)
            return out

        return Extras(imu=errors)

    return of_size


def on(channel: str, function: Callable[[Signals], Array]) -> Callable[[float], Extras]:
    """The same for one axis, ``gyro_x`` .. ``accel_z``."""
    functions: list[Callable[[Signals], Array] | None] = [None, None, None]
    functions["xyz".index(channel[-1])] = function
    return imu_only(gyro=functions) if channel[0] == "g" else imu_only(accel=functions)


def any_axis(rng: np.random.Generator, sensor: str, axes: str = "xyz") -> str:
    """A channel of ``sensor`` by chance."""
    return f"{sensor}_{rng.choice(list(axes))}"


def lagged(values: Array, tau_s: float, step_s: float) -> Array:
    """First-order low-pass of ``values`` [n] or [n, k], at rest in their start."""
    keep = float(np.exp(-step_s / tau_s))
    first = keep * np.asarray(values[:1])
    out, _ = lfilter([1.0 - keep], [1.0, -keep], values, axis=0, zi=first)
    return np.asarray(out)


FixFunction = Callable[[State, float], Array]
"""A quantity over a whole drive [n], from the motion every given number of seconds."""
GRID_S = 0.05


def over_drive(motion: Motion, t: Array, function: FixFunction) -> Array:
    """``function`` of the motion from before its start on, at instants ``t`` [n]."""
    grid = np.arange(-MARGIN_S + 1.0, motion.seconds + 1.0, GRID_S)
    values = function(motion.at(grid), GRID_S)
    if values.ndim == 1:
        return np.interp(t, grid, values)
    return np.column_stack([np.interp(t, grid, column) for column in values.T])


def to_north(motion: Motion, t: Array, along: Array, across: Array, down: Array) -> Array:
    """Values along and across the heading, and down, as north, east, down [n, 3]."""
    yaw = motion.at(t).rpy[:, 2]
    c, s = np.cos(yaw), np.sin(yaw)
    return np.column_stack([c * along - s * across, s * along + c * across, down])


def fixes(
    position: Callable[[Motion, Array], Array] | None = None,
    velocity: Callable[[Motion, Array], Array] | None = None,
) -> Callable[[float], Extras]:
    """Fixes to which a size times these [n, 3] north, east, down is added."""

    def of_size(size: float) -> Extras:
        def errors(motion: Motion, t: Array) -> tuple[Array, Array]:
            zero = np.zeros((len(t), 3))
            pos = zero if position is None else size * position(motion, t)
            vel = zero if velocity is None else size * velocity(motion, t)
            return pos, vel

        return Extras(fix=errors)

    return of_size


def antenna(offset: FixFunction) -> Callable[[float], Extras]:
    """Fixes of an antenna that moves by a size times ``offset`` [n, 3] in vehicle axes."""

    def in_nav(state: State, step_s: float) -> Array:
        return to_nav(state.C_n_b, offset(state, step_s))

    def position(motion: Motion, t: Array) -> Array:
        return over_drive(motion, t, in_nav)

    def velocity(motion: Motion, t: Array) -> Array:
        return over_drive(motion, t, lambda s, h: np.gradient(in_nav(s, h), h, axis=0))

    return fixes(position, velocity)


def mount(angles: Callable[[Signals], Array]) -> Callable[[float], Extras]:
    """Readings of an IMU whose mount turns by a size times ``angles`` [n, 3] rad, small."""

    def of_size(size: float) -> Extras:
        def errors(s: Signals) -> tuple[Array, Array]:
            turn = size * angles(s)
            swing = np.gradient(turn, s.t, axis=0)
            return np.cross(s.rate, turn) + swing, np.cross(s.force, turn)

        return Extras(imu=errors)

    return of_size


def nose(axis: int, function: Callable[[Path], Array]) -> Callable[[float], Extras]:
    """A body that turns by a size times ``function`` about an axis, rad."""

    def of_size(size: float) -> Extras:
        def body(path: Path) -> Array:
            out = np.zeros((len(path.t), 3))
            out[:, axis] = size * function(path)
            return out

        return Extras(body=body)

    return of_size


def all_makers() -> Mapping[str, Maker]:
    """Every kind's maker, sensors, receivers and cars in turns, then those that came later: cases
    of the others stay as they are."""
    from tests.hidden_effects.outside_car import CAR
    from tests.hidden_effects.outside_coupled import COUPLED
    from tests.hidden_effects.outside_imu import SENSOR
    from tests.hidden_effects.outside_late import LATE
    from tests.hidden_effects.outside_more import MORE
    from tests.hidden_effects.outside_receiver import RECEIVER
    from tests.hidden_effects.outside_slow import SLOW
    from tests.hidden_effects.outside_thresholds import THRESHOLDS

    lists = [list(part.items()) for part in (SENSOR, RECEIVER, CAR)]
    placed = [((i + 0.5) / len(part), item) for part in lists for i, item in enumerate(part)]
    first = dict(item for _, item in sorted(placed, key=lambda p: (p[0], p[1][0])))
    return {**first, **MORE, **SLOW, **LATE, **THRESHOLDS, **COUPLED}
