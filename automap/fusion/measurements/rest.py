"""Rest: no velocity, and no turn but the Earth's."""

from __future__ import annotations

from automap.fusion.arrays import ModelArrays, NodeArrays
from automap.fusion.layout import CH_ZARU, CH_ZUPT, N_NAV, STANDSTILL, V_ID
from automap.fusion.measurements.state import AtNode
from automap.fusion.options import FusionOptions
from automap.jit import kernel
from automap.records import BoolArray, FloatArray, IntArray


def note_rest(
    flags: IntArray, var: FloatArray, still: BoolArray, spacing: FloatArray, options: FusionOptions
) -> None:
    """Note at nodes [k] where the vehicle stands, with variances.

    Errors of such pseudo-measurements last about a second: the information is per second.
    """
    flags[still] |= STANDSTILL
    var[:, CH_ZUPT : CH_ZUPT + 3] = (options.zero_velocity_sd**2 / spacing)[:, None]
    var[:, CH_ZARU : CH_ZARU + 3] = (options.zero_rate_sd**2 / spacing)[:, None]


@kernel
def zero_velocity(
    nodes: NodeArrays, k: int, at: AtNode, model: ModelArrays, h: FloatArray, z: FloatArray
) -> tuple[int, int]:
    """Residual ``z`` [3] m/s NED and rows ``h`` [3, n] of the zero-velocity update (Groves,
    section 15.3)."""
    if (nodes.flags[k] & STANDSTILL) == 0:
        return 0, 0
    for a in range(3):
        for j in range(h.shape[1]):
            h[a, j] = 0.0
        h[a, V_ID + a] = 1.0
        z[a] = -at.vel[a]
    return 3, CH_ZUPT


@kernel
def zero_rate(
    nodes: NodeArrays, k: int, at: AtNode, model: ModelArrays, h: FloatArray, z: FloatArray
) -> tuple[int, int]:
    """Residual ``z`` [3] rad/s and rows ``h`` [3, n] of the zero-rate update: the body turns with
    the Earth only, over the interval before the node (Groves, section 15.3)."""
    if (nodes.flags[k] & STANDSTILL) == 0:
        return 0, 0
    c, north, down = at.c, at.place[6], at.place[7]
    for a in range(3):
        for j in range(h.shape[1]):
            h[a, j] = 0.0
        z[a] = c[0, a] * north + c[2, a] * down - at.mean_rate[a]
    terms = model.terms
    for m in range(terms.shape[0]):
        if terms[m, 0] == 0:
            b = terms[m, 2]
            h[terms[m, 1], N_NAV + terms[m, 3]] = -(1.0 if b == 0 else at.reading[b - 1])
    return 3, CH_ZARU
