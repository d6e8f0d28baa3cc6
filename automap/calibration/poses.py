"""Whether rest poses determine an accelerometer's parameters, and which would help."""

from __future__ import annotations

import itertools

import numpy as np

from automap.calibration.accelerometer import N_NINE
from automap.calibration.limits import HELPED_SINGULAR
from automap.records import FloatArray


def determination(directions: FloatArray, n_parameters: int) -> float:
    """Smallest singular value, per sqrt(pose), of the dimensionless design [k, p]."""
    if len(directions) < n_parameters:
        return 0.0
    design = _design(directions, n_parameters)
    values = np.linalg.svd(design, compute_uv=False)
    return float(values[-1] / np.sqrt(len(directions)))


def _design(u: FloatArray, n_parameters: int) -> FloatArray:
    """d|force| in units of g, by scale, bias in g and angle, for directions [k, 3]."""
    columns = [u**2, u]
    if n_parameters == N_NINE:
        columns.append(np.column_stack([-u[:, 0] * u[:, 1], u[:, 0] * u[:, 2], -u[:, 1] * u[:, 2]]))
    return np.hstack(columns)


def helpful_poses(directions: FloatArray, n_parameters: int) -> list[str]:
    """Names of the fewest further poses that would determine the parameters, best first.

    ``directions`` [k, 3] are unit vectors of the specific force, which points up, in sensor
    axes. Of the 26 directions to a cube's faces, edges and corners the one that raises the
    determinant of the information most is taken, again and again.
    """
    grid = np.array([v for v in itertools.product((0, 1, -1), repeat=3) if any(v)], np.float64)
    # faces before edges before corners: the easier to hold, the better
    grid = grid[np.argsort(np.abs(grid).sum(axis=1), kind="stable")]
    candidates = grid / np.linalg.norm(grid, axis=1)[:, None]
    rows = _design(candidates, n_parameters)
    have = directions
    information = 1e-6 * np.eye(n_parameters)
    if len(have):
        design = _design(have, n_parameters)
        information += design.T @ design
    found: list[str] = []
    while determination(have, n_parameters) < HELPED_SINGULAR and len(found) < 12:
        gains = np.einsum("ij,jk,ik->i", rows, np.linalg.inv(information), rows)
        # equal gains: the first, so that faces come first
        best = int(np.flatnonzero(gains > 0.999 * gains.max())[0])
        information += np.outer(rows[best], rows[best])
        have = np.vstack([have, candidates[best]]) if len(have) else candidates[best : best + 1]
        found.append(pose_name(grid[best]))
    return found


def pose_name(direction: FloatArray) -> str:
    """A pose in words: which of the sensor's axes point up in it."""
    parts = [f"{'+' if v > 0 else '-'}{'xyz'[i]}" for i, v in enumerate(direction) if v]
    if len(parts) == 1:
        return f"{parts[0]} up"
    return f"half way between {' and '.join(parts)} up"
