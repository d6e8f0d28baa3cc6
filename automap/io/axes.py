"""Sensor axes as written in a manifest: letters, a matrix or "unknown"."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from automap.errors import ConfigError
from automap.records import FloatArray, ImuData

_DIRECTIONS = {
    "F": (1.0, 0.0, 0.0),
    "B": (-1.0, 0.0, 0.0),
    "R": (0.0, 1.0, 0.0),
    "L": (0.0, -1.0, 0.0),
    "D": (0.0, 0.0, 1.0),
    "U": (0.0, 0.0, -1.0),
}
_MATRIX_TOLERANCE = 1e-3
_DIGITS = 12
"""More than any sensor has, and less than the sixteen of the arithmetic."""

Axes = str | Sequence[Sequence[float]]
"""Letters, rows of a matrix, or "unknown"."""


@dataclass(frozen=True)
class ImuAxes:
    """How the readings of an IMU become vehicle axes (FRD): ``accel`` and ``gyro`` [3, 3], each
    orthonormal and possibly mirrored. Not ``known``: they lead to right-handed axes of the
    sensor's case, whose mounting nobody stated."""

    accel: FloatArray = field(default_factory=lambda: np.eye(3))
    gyro: FloatArray = field(default_factory=lambda: np.eye(3))
    known: bool = True

    def apply(self, gyro: FloatArray, accel: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Rates [n, 3] and forces [n, 3] as read, in these axes."""
        # not with @, which starts the linear algebra's threads for three columns
        return (
            np.ascontiguousarray(np.einsum("ij,nj->ni", self.gyro, gyro)),
            np.ascontiguousarray(np.einsum("ij,nj->ni", self.accel, accel)),
        )

    def as_read(self, imu: ImuData) -> ImuData:
        """Readings in these axes as their triads gave them: only there an axis that stands still
        keeps one number, to which what turning twice has rounded is rounded back."""
        gyro = np.einsum("ji,nj->ni", self.gyro, imu.gyro)
        accel = np.einsum("ji,nj->ni", self.accel, imu.accel)
        return replace(imu, gyro=_rounded(gyro), accel=_rounded(accel))


def _rounded(values: FloatArray) -> FloatArray:
    """Values to ``_DIGITS`` of their largest, in their place."""
    most = max(float(values.max(initial=0.0)), -float(values.min(initial=0.0)))
    if most > 0.0:
        np.round(values, _DIGITS - math.ceil(math.log10(most)), out=values)
    return values


def imu_axes(axes: Axes, accel_axes: Axes | None = None, gyro_axes: Axes | None = None) -> ImuAxes:
    """The axes that a manifest states: ``axes`` of the case, and of a triad that has others.

    Where ``axes`` is "unknown" the axes of the triads are those in the case.
    """
    case = axes_matrix(axes)
    rest = np.eye(3) if case is None else case
    return ImuAxes(
        rest if accel_axes is None else triad_matrix(accel_axes),
        rest if gyro_axes is None else triad_matrix(gyro_axes),
        case is not None,
    )


def axes_matrix(axes: Axes) -> FloatArray | None:
    """C_vehicle_sensor [3, 3], to forward-right-down, or None for "unknown".

    ``axes`` is three letters that say where the sensor's x, y and z point in the vehicle
    (F forward, B back, R right, L left, U up, D down: "FRD", "FLU", "RFU"), a rotation
    matrix from sensor to vehicle axes, or "unknown". A matrix is made exactly orthonormal
    (nearest rotation, polar decomposition). Raises ConfigError without a file name, which
    the caller knows, for a left-handed or impossible set of axes.
    """
    if isinstance(axes, str):
        return None if axes.lower() == "unknown" else _from_letters(axes)
    return _from_matrix(axes)


def triad_matrix(axes: Axes) -> FloatArray:
    """The same [3, 3] of one triad, which may be left-handed: a negated or mirrored one is.

    Raises ConfigError for impossible axes, and for "unknown".
    """
    if isinstance(axes, str):
        if axes.lower() == "unknown":
            raise ConfigError(
                'only axes may be "unknown"; leave the axes of the triads out then, and how they '
                "are to each other is found as well"
            )
        return _from_letters(axes, mirrored=True)
    return _from_matrix(axes, mirrored=True)


def axes_value(matrix: FloatArray) -> str:
    """A matrix [3, 3] as a manifest has it: letters in quotes where there are such, else rows."""
    nearest = np.round(matrix)
    if np.abs(matrix - nearest).max() < _MATRIX_TOLERANCE:
        letters = {direction: letter for letter, direction in _DIRECTIONS.items()}
        return '"' + "".join(letters[tuple(column)] for column in (nearest + 0.0).T.tolist()) + '"'
    rows = (", ".join(f"{value:.4f}" for value in row) for row in matrix.tolist())
    return "[" + ", ".join(f"[{row}]" for row in rows) + "]"


def _from_letters(text: str, mirrored: bool = False) -> FloatArray:
    letters = text.upper()
    if len(letters) != 3 or any(letter not in _DIRECTIONS for letter in letters):
        hint = ""
        if letters in ("NED", "ENU", "NWU"):
            hint = f" {letters} are axes of the Earth, not of the vehicle."
        raise ConfigError(
            f'axes = "{text}" is not understood.{hint} Write three letters out of F or B, R or L, '
            'U or D that say where the sensor\'s x, y and z point (such as "FRD"), '
            'a 3x3 matrix, or "unknown"'
        )
    C = np.array([_DIRECTIONS[letter] for letter in letters]).T
    determinant = np.linalg.det(C)
    if abs(determinant) < 0.5:
        raise ConfigError(
            f'axes = "{text}" names one direction twice; name each of forward/back, right/left, '
            "up/down once"
        )
    if determinant < 0 and not mirrored:
        flipped = (
            letters[:2] + {"U": "D", "D": "U", "F": "B", "B": "F", "R": "L", "L": "R"}[letters[2]]
        )
        raise ConfigError(
            f'axes = "{text}" are left-handed, which no sensor is; probably it is "{flipped}", '
            "or one triad alone is so: write accel_axes or gyro_axes"
        )
    return C


def _from_matrix(rows: Sequence[Sequence[float]], mirrored: bool = False) -> FloatArray:
    try:
        C = np.array(rows, dtype=np.float64)
    except ValueError:
        # rows of different lengths
        C = np.zeros(0)
    if C.shape != (3, 3) or not np.all(np.isfinite(C)):
        raise ConfigError("the axes matrix must be three rows of three finite numbers")
    excess = float(np.abs(C @ C.T - np.eye(3)).max())
    if excess > _MATRIX_TOLERANCE:
        raise ConfigError(
            f"the axes matrix is no rotation: its rows are off orthonormal by {excess:.2g}; "
            "give the rotation from sensor to vehicle axes with more digits"
        )
    if np.linalg.det(C) < 0 and not mirrored:
        raise ConfigError(
            "the axes matrix mirrors (determinant -1); flip the sign of one row, or write it as "
            "accel_axes or gyro_axes where one triad alone is left-handed"
        )
    u, _, vt = np.linalg.svd(C)
    return np.asarray(u @ vt, dtype=np.float64)
