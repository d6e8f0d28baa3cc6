"""Effects of the installation, the vehicle and the clocks, as they distort ideal signals.

Exactly what the filter's rows are the derivatives of. Values map effect to parameter to value, in
the catalogue's names and units; what is not given is zero.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from automap.effects.catalogue import CATALOGUE
from automap.effects.limits import COURSE_SPEED
from automap.effects.measured import Distortion, Values, distortion
from automap.effects.terms import (
    ELAPSED,
    FORWARD_ACCELERATION,
    LATERAL_ACCELERATION,
    POSITION,
    VEHICLE,
)
from automap.effects.user import user_effects
from automap.frames import rpy_to_matrix
from automap.records import FloatArray


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
    ``arm_m`` [3], or [n, 3], from the origin to the point in body axes.
    """
    swing = np.einsum("nij,nj->ni", C_n_b, np.cross(turn_rate, arm_m))
    if arm_m.ndim > 1:
        return np.einsum("nij,nj->ni", C_n_b, arm_m), np.asarray(swing)
    return np.asarray(C_n_b @ arm_m), np.asarray(swing)


def sensor_to_vehicle(values: Values) -> FloatArray:
    """``C_vehicle_sensor`` [3, 3] of ``imu_mounting``: ZYX angles, sensor to vehicle."""
    return rpy_to_matrix(_constant(values).turn[0])


def mounting_angles(values: Values, n: int, signal: Callable[[str], FloatArray]) -> FloatArray:
    """ZYX angles [n, 3] rad, sensor to vehicle, of a mounting that users' effects move; ``signal``
    gives theirs."""
    none = dict.fromkeys((FORWARD_ACCELERATION, LATERAL_ACCELERATION), np.zeros(n))
    return distortion(values, VEHICLE, n, lambda s: none[s] if s in none else signal(s)).turn


def sliding_point(values: Values) -> FloatArray:
    """From the IMU to the point that does not slide, [3] m in vehicle axes."""
    return _constant(values).arm


def stamp_error_s(
    t_s: FloatArray, values: Values, signal: Callable[[str], FloatArray] | None = None
) -> FloatArray:
    """How much later than the truth IMU stamps [n] are, ``t_s`` [n] s of the right clock after
    the first sample: the delays of clocks, as fixes show them against stamps that are late;
    ``signal`` gives those of users."""

    def now(name: str) -> FloatArray:
        return t_s if name == ELAPSED or signal is None else signal(name)

    late = distortion(values, POSITION, len(t_s), now, ("clock",)).late
    for effect in user_effects():
        if effect.family == "clock":
            for p, value in values.get(effect.name, {}).items():
                late = late + value * now(f"{effect.name}.{p}")
    return late


def nose_angles(
    values: Values,
    speed: FloatArray,
    forward: FloatArray,
    lateral: FloatArray,
    signal: Callable[[str], FloatArray],
) -> FloatArray:
    """Angles [n, 3] in rad about the vehicle's axes by which the nose is turned against the path.

    ``speed`` [n] m/s, ``forward`` and ``lateral`` acceleration [n] m/s^2, right positive;
    ``signal`` gives those of users. In a right-hand bend a car with ``vehicle_sideslip`` drifts
    outwards: its velocity points left of its nose. Where a constraint's reading of nothing is said
    to have something added, the point that follows the road slides by as much.
    """
    own = {FORWARD_ACCELERATION: forward, LATERAL_ACCELERATION: lateral}
    acting = distortion(values, VEHICLE, len(speed), lambda n: own[n] if n in own else signal(n))
    out = acting.slip.copy()
    moving = np.maximum(speed, COURSE_SPEED)
    # to slide to the right is to point left of the path
    out[:, 2] += acting.added[:, 1] / moving
    out[:, 1] -= acting.added[:, 2] / moving
    return out


def wheel_instants(t_s: FloatArray, values: Values) -> FloatArray:
    """The instants [n] s of whose motion wheel speeds stamped ``t_s`` [n] s tell."""
    none = np.zeros(len(t_s))
    late = distortion(values, VEHICLE, len(t_s), lambda n: t_s if n == ELAPSED else none).late
    return t_s + late


def wheel_speed(
    forward: FloatArray, values: Values, signal: Callable[[str], FloatArray]
) -> FloatArray:
    """What the wheels report [n] m/s at the forward speed [n] of the point that does not slide;
    ``signal`` gives those of users."""
    none = dict.fromkeys((FORWARD_ACCELERATION, LATERAL_ACCELERATION), np.zeros(len(forward)))
    acting = distortion(
        values, VEHICLE, len(forward), lambda n: none[n] if n in none else signal(n)
    )
    return np.asarray(acting.longer[0] * forward + acting.added[:, 0])


def _constant(values: Values) -> Distortion:
    """What is the same at all instants."""
    return distortion(values, VEHICLE, 1, lambda name: np.zeros(1))
