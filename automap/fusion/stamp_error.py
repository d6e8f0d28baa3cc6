"""What an unsure IMU delay adds to the error of a state that is told by its stamp.

The filter's states belong to the samples; the output belongs to the stamps' instants. Between
the two lies the delay, and where it is wrong by d, position, velocity and attitude are told as
they were d earlier or later: e_out = e + x' d, with x' the velocity, acceleration and turn rate.
In a bend a few milliseconds turn the heading by more than all other errors do. The delay and
the states were estimated together, so their errors are correlated.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from automap.effects import CATALOGUE
from automap.effects.terms import ELAPSED, ONE
from automap.frames import quat_multiply
from automap.fusion.layout import N_NAV, V_ID
from automap.fusion.limits import HALF_STEP_S
from automap.fusion.model import StateModel
from automap.fusion.resample import states_at
from automap.records import FloatArray, IntArray

MOUNTING = "imu_mounting"
STAMPS = tuple(e.name for e in CATALOGUE.values() if e.family == "clock")


def reported_rows(model: StateModel) -> IntArray:
    """States whose covariance is kept per node: navigation, mounting, delay and skew, those of
    them that are estimated."""
    rows = [np.arange(N_NAV), *(np.r_[model.rows(e)] for e in (MOUNTING, *STAMPS))]
    return np.concatenate(rows).astype(np.int64)


def mounting_rows(model: StateModel) -> slice:
    """Where the mounting stands among the reported rows; empty where it is not estimated."""
    rows = model.rows(MOUNTING)
    return slice(N_NAV, N_NAV + rows.stop - rows.start)


def covariance_at_stamps(
    model: StateModel,
    told: npt.NDArray[np.floating[Any]],
    node_t: FloatArray,
    change: FloatArray,
    age_sd: float = 0.0,
) -> FloatArray:
    """Covariance [k, m, m] of navigation errors and mounting at the stamps' instants.

    ``told`` [k, r, r] of the reported rows, ``node_t`` [k] s, ``change`` [k, 9] the states'
    rates of change (see ``rates_of_change``). ``age_sd`` s is how far fixes may be from the instant
    of their tag where no state says so: velocity and attitude are then of another instant. In
    the position it is a part of the accuracy that receivers state, and is not counted again.
    """
    own = mounting_rows(model).stop
    cov: FloatArray = told.astype(np.float64)
    out = cov[:, :own, :own].copy()
    moved = change[:, V_ID:N_NAV]
    out[:, V_ID:N_NAV, V_ID:N_NAV] += age_sd**2 * moved[:, :, None] * moved[:, None, :]
    late_by = {ONE: np.ones_like(node_t), ELAPSED: node_t}
    weights = [late_by[CATALOGUE[e].terms[0].signal] for e in STAMPS if e in model.places]
    if not weights:
        return out
    late = np.stack(weights, axis=1)
    # what the states' errors share with the delay at the node, and its variance there
    shared = np.einsum("kij,kj->ki", cov[:, :own, own:], late)
    variance = np.einsum("ki,kij,kj->k", late, cov[:, own:, own:], late)
    full = np.zeros((len(node_t), own))
    full[:, :N_NAV] = change
    cross = full[:, :, None] * shared[:, None, :]
    out += cross + np.swapaxes(cross, 1, 2)
    out += variance[:, None, None] * full[:, :, None] * full[:, None, :]
    return out


def rates_of_change(t: FloatArray, states: FloatArray, node_t: FloatArray) -> FloatArray:
    """Velocity, acceleration and turn rate [k, 9] in NED at nodes of states [n, 10] at ``t``."""
    if len(t) < 2:
        return np.zeros((len(node_t), N_NAV))
    before = states_at(t, states, np.maximum(node_t - HALF_STEP_S, t[0]))
    after = states_at(t, states, np.minimum(node_t + HALF_STEP_S, t[-1]))
    turned = quat_multiply(after[:, 6:10], before[:, 6:10] * [1.0, -1.0, -1.0, -1.0])
    turned *= np.sign(turned[:, :1]) + (turned[:, :1] == 0.0)
    span = np.minimum(node_t + HALF_STEP_S, t[-1]) - np.maximum(node_t - HALF_STEP_S, t[0])
    rate = 1.0 / np.maximum(span, 1e-3)[:, None]
    return np.concatenate(
        [
            0.5 * (after[:, 3:6] + before[:, 3:6]),
            (after[:, 3:6] - before[:, 3:6]) * rate,
            2.0 * turned[:, 1:] * rate,
        ],
        axis=1,
    )
