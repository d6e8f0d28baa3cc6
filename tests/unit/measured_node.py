"""One measurement of one node, predicted in a state that a test chooses."""

from __future__ import annotations

import numpy as np

from automap.effects.term_sums import (
    SIGNAL_COLUMN,
    new_room,
    set_signals,
)
from automap.fusion.arrays import ModelArrays, NodeArrays
from automap.fusion.layout import (
    HAS_POS_H,
    HAS_POS_V,
    HAS_VEL_H,
    HAS_VEL_V,
    MAX_SCALARS,
    N_VALUES,
    NHC,
    ODOMETER,
    STANDSTILL,
    WHEEL_SPEED,
)
from automap.fusion.measurements.observe import observe
from automap.fusion.measurements.state import AtNode
from automap.fusion.mechanisation import N_EARTH, earth_terms
from automap.fusion.model import StateModel

POSITION, VELOCITY, CONSTRAINT, WHEELS, ZERO_VELOCITY, ZERO_RATE = range(6)
_ALL = HAS_POS_H | HAS_POS_V | HAS_VEL_H | HAS_VEL_V | NHC | ODOMETER | STANDSTILL


def measured(
    number: int,
    model: StateModel,
    pos: np.ndarray,
    vel: np.ndarray,
    c: np.ndarray,
    params: np.ndarray,
    fix: np.ndarray | None = None,
    speed: float = 0.0,
    rate: np.ndarray | None = None,
    acc: np.ndarray | None = None,
    t: float = 0.0,
    signals: np.ndarray | None = None,
    reading: np.ndarray | None = None,
    more_flags: int = 0,
    lacking: int = 0,
) -> tuple[np.ndarray, np.ndarray]:
    """Rows [r, n] and residuals [r] of a measurement; ``fix`` [6] position and velocity,
    ``signals`` [e] those that the model's terms ask for, ``lacking`` flags that are not set."""
    none = np.zeros(3)
    columns = np.ones(len(model.signals)) if signals is None else signals
    values = np.zeros((1, N_VALUES))
    values[0, :6] = np.concatenate([pos, vel]) if fix is None else fix
    values[0, WHEEL_SPEED] = speed
    nodes = NodeArrays(
        np.array([t]),
        np.array([_ALL & ~lacking | more_flags]),
        values,
        np.ones((1, MAX_SCALARS)),
        columns[None].astype(float),
        np.ones((1, 3)),
    )
    arrays = ModelArrays(
        model.term_table,
        *model.measured,
        model.tau,
        model.walk,
        model.kept,
        np.zeros(2),
        0.0,
        np.zeros(5),
        True,
    )
    place = np.zeros(N_EARTH)
    earth_terms(pos, True, place)
    now = np.zeros(SIGNAL_COLUMN + len(columns))
    set_signals(now, t, nodes.signals[0])
    turn = none if rate is None else rate
    at = AtNode(
        pos.copy(),
        vel.copy(),
        none if acc is None else acc,
        np.ascontiguousarray(c),
        turn,
        turn,
        np.zeros(6) if reading is None else reading,
        place,
        params,
        now,
        new_room(),
    )
    h, z = np.full((3, model.size), np.nan), np.full(3, np.nan)
    rows, _ = observe(number, nodes, 0, at, arrays, h, z)
    return h[:rows].copy(), z[:rows].copy()
