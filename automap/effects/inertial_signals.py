"""Signals of inertial terms that are no reading: shapes of a reading, and of the drive.

A term names its signal: ``sq_force_x`` is the square of the specific force along x, ``late_rate_z``
what a rate reads more for each second that it is late. Shapes are functions of the true reading at
that instant, but for those of a dead zone: it lies where the sensor reads nothing, its bias
included, and is a function of what it reads otherwise. Formulas say them to people.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from automap.effects.limits import DEAD_FORCE, DEAD_RATE, WARM_UP_S
from automap.effects.signals import Signals
from automap.effects.terms import SPEED_SQUARED, TEMPERATURE, WARM_UP
from automap.effects.user import is_users, user_signal
from automap.records import FloatArray

LATE, DEAD = "late", "dead"


@dataclass(frozen=True)
class Shape:
    """A function of one reading [n], and its formula with ``{}`` for the reading."""

    of: Callable[[FloatArray], FloatArray]
    formula: str


def _dead(width: float) -> Shape:
    return Shape(lambda reading: -np.tanh(reading / width), f"-tanh({{}} / {width:g})")


_ABS, _SQ = Shape(np.abs, "abs({})"), Shape(np.square, "{}^2")
_CUBE = Shape(lambda reading: -(reading**3), "-{}^3")
SHAPES: Mapping[tuple[str, str], Shape] = {
    ("abs", "rate"): _ABS,
    ("abs", "force"): _ABS,
    ("sq", "rate"): _SQ,
    ("sq", "force"): _SQ,
    ("lost", "rate"): _CUBE,
    ("lost", "force"): _CUBE,
    (DEAD, "rate"): _dead(DEAD_RATE),
    (DEAD, "force"): _dead(DEAD_FORCE),
}
"""By the first and second word of a signal's name; the third is the axis."""


def asks_for_the_drive(name: str) -> bool:
    """Whether a term's signal follows from the quantities of a drive: its time, or a user's."""
    return is_users(name) or name == WARM_UP or name.startswith(f"{LATE}_")


def formula_of(name: str) -> str:
    """The formula of a signal that is not a user's; nothing for a delay, which has none."""
    of_drive = {TEMPERATURE: TEMPERATURE, SPEED_SQUARED: "speed^2"}
    of_drive[WARM_UP] = f"exp(-time / {WARM_UP_S:g})"
    if name in of_drive:
        return of_drive[name]
    shape, _, reading = name.partition("_")
    return "" if shape == LATE else SHAPES[shape, reading[:-2]].formula.format(reading)


def inertial_signal(
    name: str,
    gyro: FloatArray,
    accel: FloatArray,
    temp_c: FloatArray | None,
    speed: FloatArray | None,
    temp_ref_c: float | None,
    signals: Signals | None,
) -> FloatArray:
    """One signal [n] by its name, at rates and forces [n, 3] of which it is a function; the others
    as for ``imu.extra_basis``. Zero where its source is missing."""
    none = np.zeros(len(gyro))
    if name == TEMPERATURE:
        if temp_c is None or not np.isfinite(temp_c).any():
            return none
        ref = float(np.nanmedian(temp_c)) if temp_ref_c is None else temp_ref_c
        return np.nan_to_num(temp_c - ref)
    if name == SPEED_SQUARED:
        return none if speed is None else speed**2
    if asks_for_the_drive(name):
        if signals is None:
            return none
        if is_users(name):
            return user_signal(name, signals)
        if name == WARM_UP:
            return np.asarray(np.exp(-signals.time / WARM_UP_S))
        return -np.gradient(_reading(name, gyro, accel), signals.time)
    return shape_of(name, gyro, accel)


def shape_of(name: str, gyro: FloatArray, accel: FloatArray) -> FloatArray:
    """A shape [n] of a reading by its name, at rates and forces [n, 3]."""
    shape, source, _ = name.split("_")
    return np.asarray(SHAPES[shape, source].of(_reading(name, gyro, accel)))


def late(
    name: str, seconds: float, gyro: FloatArray, accel: FloatArray, time: FloatArray
) -> FloatArray:
    """What a reading shows more [n] that is late by so much, exactly (linear between samples at
    ``time`` [n] s): ``seconds`` times its signal to first order."""
    reading = _reading(name, gyro, accel)
    return np.asarray(np.interp(time - seconds, time, reading) - reading)


def _reading(name: str, gyro: FloatArray, accel: FloatArray) -> FloatArray:
    _, source, axis = name.split("_")
    return np.asarray((gyro if source == "rate" else accel)[:, "xyz".index(axis)])
