"""From nodes to tables: trajectory at IMU rate, parameters over time, innovations."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from automap.frames import (
    matrix_to_quat,
    quat_multiply,
    quat_to_matrix,
    quat_to_rpy,
    rpy_sd_from_tilt,
)
from automap.fusion.aside import Matrices
from automap.fusion.delay_states import contained
from automap.fusion.dense_pieces import MARGIN_S, dense_pieces
from automap.fusion.filtered import filtered_variances
from automap.fusion.kernel_runs import (
    PARAMETER_STEP_S,
    AnyFloats,
    ForwardRun,
    PathStates,
    SmoothRun,
)
from automap.fusion.layout import CH_VEL, CHANNELS, N_NAV, PHI_ID
from automap.fusion.nodes import Nodes, Shift
from automap.fusion.problem import Problem
from automap.fusion.resample import shift_states
from automap.fusion.stamp_error import covariance_at_stamps, rates_of_change
from automap.lever_arm import arm_covariance
from automap.records import ClockModel, FloatArray, IntArray, Trajectory


@dataclass(frozen=True)
class ParameterHistory:
    """Estimated parameters [k, p] with sd [k, p] at instants ``t_ns`` [k], named ``names``."""

    t_ns: IntArray
    names: tuple[str, ...]
    values: FloatArray
    sd: FloatArray


@dataclass(frozen=True)
class NodeStates:
    """States [k, 10], parameters [k, p] and reported covariance [k, r, r] at the nodes."""

    nominal: FloatArray
    params: FloatArray
    cov: AnyFloats | Matrices


@dataclass(frozen=True)
class Innovations:
    """One row per scalar measurement: stamp, channel name, innovation, its sd, block NIS."""

    t_ns: IntArray
    channel: npt.NDArray[np.object_]
    innovation: FloatArray
    sd: FloatArray
    nis: FloatArray
    accepted: npt.NDArray[np.bool_]


def node_trajectory(
    problem: Problem,
    nodes: Nodes,
    states: NodeStates,
    t_ns: IntArray,
    clock: ClockModel,
    delay: FloatArray,
    delay_is_clock: bool,
    turn: FloatArray,
    unseen_sd: FloatArray,
    arm_sd: FloatArray,
    slip_sd: float,
    slope_sd: float,
    age_sd: float,
    blend: bool,
) -> Iterator[Trajectory]:
    """Trajectory at the IMU epochs ``t_ns`` of nodes' states, stretch by stretch.

    ``turn`` [3, 3] takes sensor axes (as filtered) to the vehicle's, [n, 3, 3] where a mounting
    moves.
    ``unseen_sd`` [k, 6] m and m/s NED at the nodes is what no measurement tells of the errors of
    position and velocity, ``arm_sd`` [3] m of the arm to the antenna along the vehicle's axes,
    ``slip_sd`` rad of the heading's, ``slope_sd`` of the pitch's, ``age_sd`` s of the age of the
    fixes, to which the motion was dated.
    ``delay`` [n] is how much later than the fixes' clock the stamps run, in s: an error of the
    clock, or of the samples, which then belong to ``delay`` earlier than their stamp.
    """
    margin = MARGIN_S + float(np.abs(delay).max(initial=0.0))
    back = matrix_to_quat(np.swapaxes(turn, -1, -2))
    path = PathStates(states.nominal, states.params)
    for piece in dense_pieces(problem, nodes, path, blend, margin):
        t, at = problem.t[piece.around], nodes.t[piece.nodes]
        nominal, dense = states.nominal[piece.nodes], piece.dense
        change = rates_of_change(t, dense, at)
        told = states.cov[piece.nodes]
        cov = covariance_at_stamps(problem.model, told, at, change, age_sd)
        cov[:, range(6), range(6)] += unseen_sd[piece.nodes] ** 2
        if not delay_is_clock:
            dense = shift_states(t, dense, delay[piece.around])
        own = slice(piece.rows.start - piece.around.start, piece.rows.stop - piece.around.start)
        t, dense, stamps = t[own], dense[own], t_ns[piece.rows]
        late = delay[piece.rows] if delay_is_clock else 0.0
        back_here, back_there, turn_there = back, back, turn
        if turn.ndim > 2:
            there = np.clip(np.searchsorted(problem.t, at), 0, len(problem.t) - 1)
            back_here, back_there, turn_there = back[piece.rows], back[there], turn[there]
        attitude = quat_multiply(nominal[:, 6:10], back_there)
        # fixes hold a velocity to that of the antenna over a bend, not over a sway and back
        bend = change[:, PHI_ID:] * [0.0, 0.0, 1.0]
        cov[:, :PHI_ID, :PHI_ID] += arm_covariance(quat_to_matrix(attitude), bend, arm_sd)
        node_rpy = quat_to_rpy(attitude)
        node_sd = rpy_sd_from_tilt(node_rpy, vehicle_tilt(nominal, cov, turn_there))
        node_sd[:, 1:] = np.hypot(node_sd[:, 1:], [slope_sd, slip_sd])
        variances = [np.maximum(cov[:, i, i], 0.0) for i in range(6)]
        variance = np.stack([_between(t, at, v, blend) for v in variances], axis=1)
        yield Trajectory(
            t_ns=stamps,
            gps_s=clock.gps_s(stamps) - late,
            lat_rad=dense[:, 0],
            lon_rad=(dense[:, 1] + np.pi) % (2 * np.pi) - np.pi,
            height_m=dense[:, 2],
            vel_ned=dense[:, 3:6],
            rpy=quat_to_rpy(quat_multiply(dense[:, 6:10], back_here)),
            sd_pos_ned=np.sqrt(variance[:, :3]),
            sd_vel_ned=np.sqrt(variance[:, 3:6]),
            sd_rpy=np.stack([_between(t, at, node_sd[:, i], blend) for i in range(3)], axis=1),
            slip_sd=np.array(slip_sd),
        )


def _between(t: FloatArray, node_t: FloatArray, values: FloatArray, blend: bool) -> FloatArray:
    """Values of nodes at other instants: a filter knows nothing of the next node."""
    if blend:
        return np.interp(t, node_t, values)
    before = np.searchsorted(node_t, t, side="right") - 1
    return np.asarray(values[np.clip(before, 0, len(node_t) - 1)])


def vehicle_tilt(nominal: FloatArray, cov: FloatArray, turn: FloatArray) -> FloatArray:
    """Covariance [k, 3, 3] of the vehicle's attitude error in NED at nodes.

    C_n_vehicle = C_n_sensor M': errors of sensor attitude phi and mounting m combine to
    phi - C_n_vehicle m, and they are correlated, since both come from the same motion. ``cov``
    [k, 9 or 12, 9 or 12] navigation errors and mounting.
    """
    phi = slice(PHI_ID, PHI_ID + 3)
    tilt = cov[:, phi, phi].copy()
    if cov.shape[1] > N_NAV:
        mount = slice(N_NAV, cov.shape[1])
        c = quat_to_matrix(nominal[:, 6:10]) @ np.swapaxes(turn, -1, -2)
        cross = c @ cov[:, mount, phi]
        tilt += c @ cov[:, mount, mount] @ np.swapaxes(c, 1, 2)
        tilt -= cross + np.swapaxes(cross, 1, 2)
    return tilt


def parameter_history(
    problem: Problem, smooth: SmoothRun, base_ns: int, shift: Shift
) -> ParameterHistory:
    """All parameters about once a second, in the unit of their effect."""
    names = problem.model.names
    values = smooth.params.copy()
    for name, value in contained(shift):
        if name in names:
            values[:, names.index(name)] += value
    noted = np.isfinite(smooth.param_var).all(axis=1)
    sd = np.sqrt(np.maximum(smooth.param_var[noted], 0.0))
    t_ns = base_ns + np.rint(smooth.nodes.t[noted] * 1e9).astype(np.int64)
    return ParameterHistory(t_ns, names, values[noted], sd)


def filter_history(
    problem: Problem, forward: ForwardRun, base_ns: int, shift: Shift
) -> ParameterHistory:
    """What the forward filter made of the parameters, about once a second."""
    names = problem.model.names
    seconds = np.floor(forward.nodes.t / PARAMETER_STEP_S)
    rows = np.flatnonzero(np.diff(seconds, append=np.inf) > 0)
    values = forward.store.params[rows] + forward.store.mean[rows, N_NAV:]
    for name, value in contained(shift):
        if name in names:
            values[:, names.index(name)] += value
    sd = np.sqrt(np.maximum(filtered_variances(problem, forward)[rows], 0.0))
    t_ns = base_ns + np.rint(forward.nodes.t[rows] * 1e9).astype(np.int64)
    return ParameterHistory(t_ns, names, values, sd)


def innovations(forward: ForwardRun, base_ns: int, outliers: IntArray) -> Innovations:
    """The innovation table of a forward run; positions of ``outliers`` count as refused."""
    store = forward.store
    node, channel = store.info[:, 0], store.info[:, 1]
    names = np.array(CHANNELS, dtype=object)
    suspect = np.isin(forward.nodes.fix_row[node], outliers) & (channel < CH_VEL)
    return Innovations(
        base_ns + np.rint(forward.nodes.t[node] * 1e9).astype(np.int64),
        names[channel],
        store.nu,
        np.sqrt(store.var),
        store.nis[node, channel],
        (store.info[:, 2] > 0) & ~suspect,
    )
