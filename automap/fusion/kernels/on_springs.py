"""What the body does on its springs, as a path that was found before shows it."""

from __future__ import annotations

import numpy as np

from automap.effects.term_sums import SIGNAL_COLUMN, new_room, set_signals
from automap.fusion.arrays import Legs, ModelArrays, NodeArrays, Samples
from automap.fusion.kernels.readings import acceleration
from automap.fusion.kernels.state import load_state
from automap.fusion.layout import N_NAV, ON_SPRINGS
from automap.fusion.measurements.constraint import constraint
from automap.fusion.measurements.state import AtNode
from automap.jit import kernel
from automap.records import FloatArray


@kernel
def speed_downwards(
    samples: Samples,
    model: ModelArrays,
    nodes: NodeArrays,
    nominal: FloatArray,
    params: FloatArray,
    legs: Legs,
    out: FloatArray,
) -> None:
    """``out`` [k] := speed, m/s down in the vehicle's axes, of the point that does not slide, at
    the nodes that have the constraint, of a path ``nominal`` [k, 10], ``params`` [k, p] with the
    ``legs`` between them; 0 at the others."""
    pos, vel, q, c = np.zeros(3), np.zeros(3), np.zeros(4), np.zeros((3, 3))
    xi, rate, now, acc = np.zeros(params.shape[1]), np.zeros(3), np.zeros(6), np.zeros(3)
    mid, place = np.zeros(legs.mid.shape[1]), np.zeros(legs.place.shape[1])
    signals = np.zeros(SIGNAL_COLUMN + nodes.signals.shape[1])
    at = AtNode(pos, vel, acc, c, now[:3], rate, mid, place, xi, signals, new_room())
    h, z = np.zeros((3, N_NAV + params.shape[1])), np.zeros(3)
    for k in range(nodes.t.shape[0]):
        out[k] = 0.0
        load_state(nominal[k], params[k], pos, vel, q, c, xi)
        rate[:], now[:] = legs.rate[k], legs.now[k]
        mid[:], place[:] = legs.mid[k], legs.place[k]
        acceleration(samples, legs.at[k], nodes.t[k], place[2], c, now[3:], acc)
        set_signals(signals, nodes.t[k], nodes.signals[k])
        if constraint(nodes, k, at, model, h, z)[0] > 0:
            out[k] = nodes.fix[k, ON_SPRINGS] - z[1]
