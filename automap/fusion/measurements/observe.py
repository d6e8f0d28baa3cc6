"""All measurements of a node, in the order in which the filter takes them."""

from __future__ import annotations

from automap.fusion.arrays import ModelArrays, NodeArrays
from automap.fusion.layout import (
    HAS_POS_H,
    HAS_POS_V,
    HAS_VEL_H,
    HAS_VEL_V,
    NHC,
    ODOMETER,
    STANDSTILL,
)
from automap.fusion.measurements.constraint import constraint
from automap.fusion.measurements.position import position
from automap.fusion.measurements.rest import zero_rate, zero_velocity
from automap.fusion.measurements.state import AtNode
from automap.fusion.measurements.velocity import velocity
from automap.fusion.measurements.wheel_speed import wheel_speed
from automap.jit import kernel
from automap.records import FloatArray

HAS = (HAS_POS_H | HAS_POS_V, HAS_VEL_H | HAS_VEL_V, NHC, ODOMETER, STANDSTILL, STANDSTILL)
"""Flags of the nodes that have a measurement, by its number."""


@kernel
def observe(
    number: int,
    nodes: NodeArrays,
    k: int,
    at: AtNode,
    model: ModelArrays,
    h: FloatArray,
    z: FloatArray,
) -> tuple[int, int]:
    """Residual ``z`` [3] and rows ``h`` [3, n] of one measurement of node ``k``: number of rows
    (none where the node does not have it), first channel."""
    if number == 0:
        return position(nodes, k, at, model, h, z)
    if number == 1:
        return velocity(nodes, k, at, model, h, z)
    if number == 2:
        return constraint(nodes, k, at, model, h, z)
    if number == 3:
        return wheel_speed(nodes, k, at, model, h, z)
    if number == 4:
        return zero_velocity(nodes, k, at, model, h, z)
    return zero_rate(nodes, k, at, model, h, z)
