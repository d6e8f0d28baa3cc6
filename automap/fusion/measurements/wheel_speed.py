"""The speed that wheels report."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from automap.effects.measured_kernels import vehicle_velocity
from automap.fusion.arrays import ModelArrays, NodeArrays
from automap.fusion.layout import CH_ODOMETER, ODOMETER, WHEEL_SPEED
from automap.fusion.limits import ODOMETER_GAP_S, ODOMETER_LAG_S
from automap.fusion.measurements.state import AtNode
from automap.fusion.options import FusionOptions
from automap.jit import kernel
from automap.records import BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class Odometer:
    """Wheel or CAN speed: ``t`` [m] seconds on the fixes' time axis, ``speed`` [m] m/s."""

    t: FloatArray
    speed: FloatArray

    def near(self, t: FloatArray) -> BoolArray:
        """Which instants [n] lie between samples that are close together."""
        i = np.clip(np.searchsorted(self.t, t), 1, len(self.t) - 1)
        inside = (t >= self.t[0]) & (t <= self.t[-1])
        return np.asarray(inside & (self.t[i] - self.t[i - 1] < ODOMETER_GAP_S))


def note_wheels(
    flags: IntArray,
    values: FloatArray,
    var: FloatArray,
    odometer: Odometer,
    instants: FloatArray,
    spacing: FloatArray,
    options: FusionOptions,
) -> None:
    """Note the speeds at nodes [k], at ``instants`` s of the odometer's clock, with variances."""
    near = odometer.near(instants)
    flags[near] |= ODOMETER
    values[near, WHEEL_SPEED] = np.interp(instants[near], odometer.t, odometer.speed)
    # wheel sensors report late by a time nobody states: less sure while the speed changes
    slope = np.abs(np.gradient(odometer.speed, odometer.t))
    late = ODOMETER_LAG_S * np.interp(instants, odometer.t, slope)
    var[:, CH_ODOMETER] = (options.odometer_sd**2 + late**2) / spacing


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
    z[0] = nodes.fix[k, WHEEL_SPEED] - z[0]
    return 1, CH_ODOMETER
