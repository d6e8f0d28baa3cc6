"""How the sensor sits in the vehicle, from a trajectory fused in the sensor's own axes.

Forward is where the vehicle goes; down is the axis about which it turns and, on average,
where gravity pulls. No assumption is made about the angles: upside down is fine.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from automap.errors import StageError
from automap.frames import matrix_to_rpy
from automap.fusion import limits
from automap.records import FloatArray


@dataclass(frozen=True)
class Mounting:
    """``C_vehicle_sensor`` [3, 3], its ZYX angles [3] and their one-sigma [3] in rad."""

    matrix: FloatArray
    rpy: FloatArray
    sd: FloatArray


def estimate_mounting(
    t: FloatArray, vel_ned: FloatArray, c_n_s: FloatArray, rate: FloatArray, accel_long: FloatArray
) -> Mounting:
    """Mounting from velocity [n, 3], sensor attitude [n, 3, 3] and corrected rate [n, 3].

    ``accel_long`` [n] speed change in m/s^2: epochs of hard braking or acceleration pitch the
    body and are left out.

    Raises:
        StageError: the vehicle hardly moved, so that forward is unknown.
    """
    speed = np.linalg.norm(vel_ned, axis=1)
    yaw_rate = np.linalg.norm(rate, axis=1)
    dt = float(np.median(np.diff(t)))
    straight = (speed > limits.MOUNTING_SPEED) & (yaw_rate < limits.STRAIGHT_RATE)
    straight &= np.abs(accel_long) < limits.STRAIGHT_ACCELERATION
    if straight.sum() * dt < limits.MOUNTING_MOVING_S:
        straight = speed > limits.MOUNTING_SPEED
    if straight.sum() * dt < limits.MOUNTING_MOVING_S:
        raise StageError(
            'the mounting of the IMU (axes = "unknown") cannot be found: the vehicle moved for '
            f"only {straight.sum() * dt:.0f} s above {limits.MOUNTING_SPEED:.0f} m/s; give axes in "
            "drive.toml or use a longer drive"
        )
    v_s = np.einsum("nji,nj->ni", c_n_s[straight], vel_ned[straight])
    forward = _robust_direction(v_s / speed[straight, None])
    spread = v_s / speed[straight, None] - forward
    blocks = max(straight.sum() * dt / limits.FORWARD_BLOCK_S, 1.0)
    sd_forward = (
        float(np.sqrt((spread**2).sum(axis=1).mean() / 2.0 / blocks)) + limits.LEAST_FORWARD_SD
    )

    # down: gravity seen in the sensor where it goes straight on, as what has two wheels leans in
    # bends, and the axis of turning
    moving = speed > limits.MOUNTING_SPEED
    down_seen = c_n_s[straight, 2, :]
    down_gravity = _across(down_seen.mean(axis=0), forward)
    turn_rate = np.einsum("ni,ni->n", rate, c_n_s[:, 2, :])
    right = np.cross(down_gravity, forward)
    roll, var = 0.0, limits.ROAD_ROLL_SD**2 + float(np.var(down_seen @ right)) / blocks
    turn_roll, turn_var = _roll_from_turns(rate, turn_rate, moving, forward, right, dt)
    if abs(turn_roll) < limits.MAX_TURN_ROLL:
        # by the inverses: a drive without a turn tells nothing, with an infinite variance
        weight = (1.0 / turn_var) / (1.0 / var + 1.0 / turn_var)
        roll, var = weight * turn_roll, 1.0 / (1.0 / var + 1.0 / turn_var)
    down = np.cos(roll) * down_gravity - np.sin(roll) * right
    matrix = np.stack([forward, np.cross(down, forward), down])
    sd = np.array([np.sqrt(var), sd_forward, sd_forward])
    return Mounting(matrix, matrix_to_rpy(matrix), sd)


def _roll_from_turns(
    rate: FloatArray,
    turn_rate: FloatArray,
    moving: npt.NDArray[np.bool_],
    forward: FloatArray,
    right: FloatArray,
    dt: float,
) -> tuple[float, float]:
    """Roll in rad of the axis of turning against the level guess, and its variance.

    The body leans outwards, or inwards on two wheels: left and right turns lean opposite ways, so
    each side counts the same and one side alone is trusted less; both by as much as they differ.
    """
    rolls, variances = [], []
    down = np.cross(forward, right)
    for side in (1.0, -1.0):
        use = moving & (side * turn_rate > limits.TURN_RATE)
        angle = float(np.abs(turn_rate[use]).sum()) * dt
        if angle < limits.LEAST_TURN:
            continue
        axis = _across(side * rate[use].sum(axis=0), forward)
        rolls.append(float(np.arctan2(-(axis @ right), axis @ down)))
        variances.append(limits.LEAN_SD**2 + limits.GRADE_SD**2 * (0.5 * np.pi / angle))
    if not rolls:
        return 0.0, np.inf
    lean = 0.5 * float(np.ptp(rolls))
    beyond = max(lean**2 - limits.LEAN_SD**2, 0.0)
    return float(np.mean(rolls)), (float(np.sum(variances)) / len(rolls) + beyond) / len(rolls)


def _robust_direction(units: FloatArray) -> FloatArray:
    """Mean direction [3] of unit vectors [n, 3] with outliers trimmed.

    The first mean is signed by the majority, so that reversing does not cancel driving.
    """
    _, vectors = np.linalg.eigh(units.T @ units)
    axis = vectors[:, -1]
    if (units @ axis > 0).mean() < 0.5:
        axis = -axis
    for _ in range(5):
        angle = np.arccos(np.clip(units @ axis, -1.0, 1.0))
        ahead = angle < np.pi / 2
        limit = max(
            limits.OTHER_WAY_MEDIANS * float(np.median(angle[ahead])), limits.OTHER_WAY_ANGLE
        )
        axis = units[angle < limit].mean(axis=0)
        axis /= np.linalg.norm(axis)
    return np.asarray(axis)


def _across(vector: FloatArray, forward: FloatArray) -> FloatArray:
    """Unit part of a vector perpendicular to ``forward``."""
    rest = vector - forward * float(vector @ forward)
    return np.asarray(rest / np.linalg.norm(rest))
