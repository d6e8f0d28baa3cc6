"""The non-holonomic constraint: a vehicle moves along its nose, not sideways or off the road."""

from __future__ import annotations

import numpy as np

from automap.effects.measured_kernels import vehicle_velocity
from automap.fusion.arrays import ModelArrays, NodeArrays
from automap.fusion.layout import CH_NHC, NHC, ON_SPRINGS
from automap.fusion.measurements.state import AtNode
from automap.fusion.options import FusionOptions
from automap.fusion.wheel_limits import SPRINGS
from automap.jit import kernel
from automap.records import BoolArray, FloatArray, IntArray


def constrain(
    flags: IntArray,
    var: FloatArray,
    speed: FloatArray,
    lateral: FloatArray,
    still: BoolArray,
    spacing: FloatArray,
    options: FusionOptions,
) -> None:
    """Note at nodes [k] where the constraint holds, and its variances per second.

    ``speed`` m/s, ``lateral`` acceleration m/s^2, ``spacing`` s to the node before.
    """
    flags[(speed > options.nhc_min_speed) & ~still] |= NHC
    # tyres slip with the lateral acceleration, springs move with any
    sd = np.hypot(options.nhc_sd, options.nhc_slip * lateral)
    var[:, CH_NHC] = sd**2 / spacing
    var[:, CH_NHC + 1] = (SPRINGS * sd) ** 2 / spacing


def on_springs(
    t: FloatArray, flags: IntArray, var: FloatArray, speed: FloatArray, mean_s: float
) -> FloatArray:
    """Of the ``speed`` downwards [k], m/s, at the nodes ``t`` [k] s that have the constraint, what
    is off its mean over ``mean_s``, by the weights that ``constrain`` gave them; 0 at the others.
    """
    has = (flags & NHC) > 0
    out = np.zeros(len(t))
    t, speed, weight = t[has], speed[has], 1.0 / var[has, CH_NHC + 1]
    first, last = (np.searchsorted(t, t + side * mean_s / 2, "right") for side in (-1.0, 1.0))
    total, moved = (np.append(0.0, np.cumsum(part)) for part in (weight, weight * speed))
    out[has] = speed - (moved[last] - moved[first]) / (total[last] - total[first])
    return out


def sd_on_springs(flags: IntArray, accel_noise: float, mean_s: float) -> FloatArray:
    """One sigma [k] m/s of the speed downwards off its mean over ``mean_s``, which the constraint
    takes from the readings: of white noise of ``accel_noise`` m/s^2/sqrt(Hz) their integral is a
    Brownian motion, about whose mean over T the variance is that of a second times T / 12."""
    return np.where((flags & NHC) > 0, accel_noise * np.sqrt(mean_s / 12.0), 0.0)


@kernel
def constraint(
    nodes: NodeArrays, k: int, at: AtNode, model: ModelArrays, h: FloatArray, z: FloatArray
) -> tuple[int, int]:
    """Residual ``z`` [2] m/s to the right and down, and rows ``h`` [2, n].

    What the body does on its springs within seconds the readings show, and the constraint would
    take it for a scale that is too large: it says nothing of that (``on_springs``).
    Dissanayake et al., IEEE Transactions on Robotics and Automation 17 (2001); Groves,
    section 15.4.
    """
    if (nodes.flags[k] & NHC) == 0:
        return 0, 0
    terms, params, signals, room = model.on_vehicle, at.params, at.signals, at.room
    vehicle_velocity(
        h, z, at.vel, at.c, at.rate, at.acc, params, terms.codes, terms.weights, signals, room
    )
    z[0], z[1] = -z[1], nodes.fix[k, ON_SPRINGS] - z[2]
    h[0, :] = h[1, :]
    h[1, :] = h[2, :]
    return 2, CH_NHC
