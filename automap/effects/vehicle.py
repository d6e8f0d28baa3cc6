"""Effects of the installation, the vehicle and the clocks, as they distort ideal signals.

The simulator's side of what the filter's measurement rows are the derivatives of. Values map
effect to parameter to value, in the catalogue's names and units; what is not given is zero.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from automap.effects.catalogue import CATALOGUE
from automap.frames import rpy_to_matrix
from automap.records import FloatArray

Values = Mapping[str, Mapping[str, float]]


def parameters(values: Values, effect: str) -> FloatArray:
    """Values [k] of an effect's parameters in the catalogue's order."""
    given = values.get(effect, {})
    return np.array([given.get(p.name, 0.0) for p in CATALOGUE[effect].parameters])


def parameter(values: Values, effect: str) -> float:
    """The value of an effect that has one parameter."""
    return float(parameters(values, effect)[0])


def lever_arm_motion(
    C_n_b: FloatArray, turn_rate: FloatArray, arm_m: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Offset (m) and velocity (m/s) NED [n, 3] of a point of the body against its origin.

    ``C_n_b`` [n, 3, 3], ``turn_rate`` [n, 3] rad/s in body axes against the navigation frame,
    ``arm_m`` [3] from the origin to the point in body axes.
    """
    swing = np.einsum("nij,nj->ni", C_n_b, np.cross(turn_rate, arm_m))
    return np.asarray(C_n_b @ arm_m), np.asarray(swing)


def sensor_to_vehicle(values: Values) -> FloatArray:
    """``C_vehicle_sensor`` [3, 3] of ``imu_mounting``: ZYX angles, sensor to vehicle."""
    return rpy_to_matrix(parameters(values, "imu_mounting"))


def stamp_error_s(t_s: FloatArray, values: Values) -> FloatArray:
    """How much later than the truth IMU stamps [n] are.

    ``imu_time_offset`` s, and ``imu_clock_skew`` s/s over ``t_s`` [n] seconds of the right
    clock since the first sample.
    """
    offset = parameter(values, "imu_time_offset")
    return np.asarray(offset + parameter(values, "imu_clock_skew") * t_s)


def slip_yaw(lateral_accel: FloatArray, values: Values) -> FloatArray:
    """Angle [n] in rad by which the nose points right of the path, ``vehicle_sideslip``.

    ``lateral_accel`` [n] m/s^2, right positive: in a right-hand bend the car drifts outwards,
    its velocity points left of its nose.
    """
    return np.asarray(parameter(values, "vehicle_sideslip") * lateral_accel)


def wheel_speed(forward: FloatArray, values: Values) -> FloatArray:
    """What the wheels report [n] m/s at the forward speed [n] of the point that does not slide."""
    return np.asarray((1.0 + parameter(values, "odometer_scale")) * forward)
