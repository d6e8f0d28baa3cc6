"""The speed that wheels report."""

from __future__ import annotations

from dataclasses import dataclass

from automap.effects.measured_kernels import vehicle_velocity
from automap.fusion.arrays import ModelArrays, NodeArrays
from automap.fusion.layout import CH_ODOMETER, ODOMETER, UNSIGNED, WHEEL_SPEED
from automap.fusion.measurements.state import AtNode
from automap.fusion.wheel_limits import FASTEST_REVERSE, SLOW_WHEELS
from automap.jit import kernel
from automap.records import FloatArray, IntArray


@dataclass(frozen=True)
class Odometer:
    """Wheel or CAN speed as the filter takes it: each reading is measured at its own time.

    ``t`` [m] seconds of their stamps on the fixes' time axis, ``speed`` [m] m/s, ``var`` [m] its
    variance; ``late_s`` how much later than the truth the stamps seem to be, to begin with;
    ``signed`` whether a speed backwards is told as negative.
    """

    t: FloatArray
    speed: FloatArray
    var: FloatArray
    late_s: float = 0.0
    signed: bool = False


def note_wheels(
    flags: IntArray, values: FloatArray, var: FloatArray, row: IntArray, odometer: Odometer
) -> None:
    """Note the speeds at nodes [k]; ``row`` [k] the reading that was taken there, -1 for none."""
    has = row >= 0
    flags[has] |= ODOMETER | (0 if odometer.signed else UNSIGNED)
    values[has, WHEEL_SPEED] = odometer.speed[row[has]]
    var[has, CH_ODOMETER] = odometer.var[row[has]]


@kernel
def wheel_speed(
    nodes: NodeArrays, k: int, at: AtNode, model: ModelArrays, h: FloatArray, z: FloatArray
) -> tuple[int, int]:
    """Residual ``z`` [1] m/s and row ``h`` [1, n] (Groves, section 6.3)."""
    if (nodes.flags[k] & ODOMETER) == 0:
        return 0, 0
    terms, params, signals, room = model.on_vehicle, at.params, at.signals, at.room
    vehicle_velocity(
        h, z, at.vel, at.c, at.rate, at.acc, params, terms.codes, terms.weights, signals, room
    )
    told = nodes.fix[k, WHEEL_SPEED]
    if (nodes.flags[k] & UNSIGNED) != 0 and told < FASTEST_REVERSE:
        if told < SLOW_WHEELS:
            # it may be either way: the variance has its size
            told = 0.0
        elif z[0] < 0.0:
            told = -told
    z[0] = told - z[0]
    return 1, CH_ODOMETER
