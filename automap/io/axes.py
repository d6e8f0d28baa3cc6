"""Sensor axes as written in a manifest: letters, a matrix or "unknown"."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from automap.errors import ConfigError
from automap.records import FloatArray

_DIRECTIONS = {
    "F": (1.0, 0.0, 0.0),
    "B": (-1.0, 0.0, 0.0),
    "R": (0.0, 1.0, 0.0),
    "L": (0.0, -1.0, 0.0),
    "D": (0.0, 0.0, 1.0),
    "U": (0.0, 0.0, -1.0),
}
_MATRIX_TOLERANCE = 1e-3


def axes_matrix(axes: str | Sequence[Sequence[float]]) -> FloatArray | None:
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


def _from_letters(text: str) -> FloatArray:
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
    if determinant < 0:
        flipped = (
            letters[:2] + {"U": "D", "D": "U", "F": "B", "B": "F", "R": "L", "L": "R"}[letters[2]]
        )
        raise ConfigError(
            f'axes = "{text}" are left-handed, which no sensor is; probably it is "{flipped}"'
        )
    return C


def _from_matrix(rows: Sequence[Sequence[float]]) -> FloatArray:
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
    if np.linalg.det(C) < 0:
        raise ConfigError("the axes matrix mirrors (determinant -1); flip the sign of one row")
    u, _, vt = np.linalg.svd(C)
    return np.asarray(u @ vt, dtype=np.float64)
