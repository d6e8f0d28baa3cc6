"""Small filter problems for the fusion's tests, and access to what the kernels leave."""

from __future__ import annotations

import numpy as np

from automap.frames import matrix_to_quat
from automap.fusion.kernel_runs import Start
from automap.fusion.layout import MAX_SCALARS, N_VALUES
from automap.fusion.nodes import Nodes
from automap.records import FloatArray, IntArray
from tests.unit.fusion_motion import Motion, Truth


def make_nodes(
    t: FloatArray,
    flags: IntArray | None = None,
    values: FloatArray | None = None,
    var: FloatArray | None = None,
    stated_sd: FloatArray | None = None,
) -> Nodes:
    """Nodes at ``t`` [k]; by default nothing is measured. ``values`` as far as they are given."""
    k = len(t)
    of_nodes = np.zeros((k, N_VALUES))
    if values is not None:
        of_nodes[:, : values.shape[1]] = values
    return Nodes(
        np.asarray(t, np.float64),
        np.zeros(k, np.int64) if flags is None else flags.astype(np.int64),
        of_nodes,
        np.ones((k, MAX_SCALARS)) if var is None else var,
        np.ones((k, 3)) if stated_sd is None else stated_sd,
        np.ones((k, 3)) if stated_sd is None else stated_sd,
        np.full(k, -1, np.int64),
        np.ones((k, 6)),
    )


def nominal_of(truth: Truth) -> FloatArray:
    """Nominal states [n, 10] of true ones."""
    place = np.column_stack([truth.lat, truth.lon, truth.height])
    return np.concatenate([place, truth.vel, matrix_to_quat(truth.c_n_b)], axis=1)


def true_start(motion: Motion, sd: FloatArray | None = None) -> Start:
    """A start at the true state with sd 5 m, 1 m/s, 3 deg."""
    spread = np.repeat([5.0, 1.0, 0.05], 3) if sd is None else sd
    return Start(nominal_of(motion.at(np.zeros(1)))[0], spread)


def full_transition(trans: FloatArray, span: float, tau: FloatArray) -> FloatArray:
    """The transition matrix [n, n] of navigation rows [9, n] and decays."""
    n = trans.shape[1]
    full = np.eye(n)
    full[:9] = trans
    for j in range(9, n):
        if tau[j] > 0:
            full[j, j] = np.exp(-span / tau[j])
    return full
