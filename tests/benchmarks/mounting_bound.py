"""How well the boxes of a simulated drive can tell how its camera is mounted, at best.

The bound of Cramer and Rao for turn and time offset of the camera, with the place and size of
every sign unknown and the trajectory's attitude and velocity off by a process of stated sigma
and time constant, constant through a pass. What the trajectory's attitude is off by in the mean
looks like a turn of the camera to every sign, so the bound is never below the sd of that mean.
"""

from __future__ import annotations

import numpy as np

from automap.earth import from_local_ned, local_ned
from automap.geolocation.landmark import SizePrior
from automap.geolocation.landmark_kernels import N_COMMON, Boxes, common_columns, normal_equations
from automap.geolocation.views import MeasurementNoise, Views, build_views
from automap.records import FloatArray, IntArray
from automap.robust import PLAIN
from tests.benchmarks.geolocation_world import ORIGIN, Difficulty, World

TURN_AND_TIME = slice(0, 4)
_NUISANCE = [0, 1, 2, 9, 10, 11]
"""Attitude and velocity of the trajectory among what is common to the views of a pass."""
_NEW_PASS_S = 20.0
_PRIOR = SizePrior()


def mounting_bound(world: World, d: Difficulty) -> tuple[FloatArray, FloatArray]:
    """Least sd [4] of roll, pitch, yaw (rad) and time offset (s): with the trajectory's errors
    as unknown as they are, and with a trajectory without any."""
    views = build_views(
        world.trajectory, [world.detections], {"front": world.true_camera}, MeasurementNoise()
    )
    lat, lon, height = from_local_ned(world.position, ORIGIN)
    place = local_ned(lat, lon, height, views.origin)
    focal = float(world.true_camera.matrix[0, 0])
    known, time = [], []
    owner = world.owner[views.row]
    for sign in range(len(place)):
        rows = np.flatnonzero(owner == sign)
        ends = np.flatnonzero(np.diff(views.t_ns[rows]) > _NEW_PASS_S * 1e9) + 1
        for seen in np.split(rows, ends):
            if len(seen):
                known.append(_of_pass(views, seen, place[sign], float(world.size[sign]), focal, d))
                time.append(float(views.t_ns[seen].mean()) * 1e-9)
    told, n = np.array(known), len(known)
    before = np.diag(np.array([np.radians(d.mount_sd_deg)] * 3 + [d.late_sd_s], np.float64) ** -2.0)
    alone = before + told[:, TURN_AND_TIME, TURN_AND_TIME].sum(axis=0)
    cross = told[:, TURN_AND_TIME][:, :, _NUISANCE]
    own = told[:, _NUISANCE][:, :, _NUISANCE]
    total = np.linalg.inv(_process_covariance(np.array(time), d))
    for k in range(n):
        total[6 * k : 6 * k + 6, 6 * k : 6 * k + 6] += own[k]
    wide = np.concatenate(list(cross), axis=1)
    with_errors = alone - wide @ np.linalg.solve(total, wide.T)
    sds = [np.sqrt(np.diag(np.linalg.inv(information))) for information in (with_errors, alone)]
    return sds[0], sds[1]


def _of_pass(
    views: Views, rows: IntArray, place: FloatArray, size: float, focal: float, d: Difficulty
) -> FloatArray:
    """Information [12, 12] of one sign's boxes on what is common to them, its own unknowns
    eliminated."""
    anchor = int(rows[np.argmax(views.measured[rows, 2])])
    C = views.C_cam_ref[rows]
    q = np.einsum("nij,nj->ni", C, place - views.centre[rows])
    tall = focal * size / q[:, 0]
    box = np.hypot(d.box_px, d.box_share * tall)
    sd = np.column_stack([box / focal, box / focal, box / tall])
    expected = np.column_stack([q[:, 1:] / q[:, :1], np.log(size / q[:, 0])])
    a = int(np.flatnonzero(rows == anchor)[0])
    parameters = np.array([*expected[a, :2], np.log(q[a, 0]), np.log(size)])
    M = np.ascontiguousarray(C @ views.C_cam_ref[anchor].T)
    b = np.einsum("nij,nj->ni", C, views.centre[anchor] - views.centre[rows])
    elapsed = (views.t_ns[rows] - views.t_ns[anchor]) * 1e-9
    columns, _ = common_columns(
        *(parameters, M, b, expected[:, 2], views.share[rows], views.rate[rows]),
        *(views.velocity[rows], views.C_cam_body[rows], views.lens[views.camera[rows]], elapsed),
    )
    usual = float(np.log(_PRIOR.size_m)), _PRIOR.log_sd
    boxes = Boxes(M, b, expected, sd, np.zeros(len(rows)), *usual)
    N, A, shared, *_ = normal_equations(parameters, boxes, columns, np.zeros(N_COMMON), PLAIN)
    return np.asarray(shared[:N_COMMON, :N_COMMON] - A.T @ np.linalg.solve(N, A))


def _process_covariance(time: FloatArray, d: Difficulty) -> FloatArray:
    """Covariance [6n, 6n] of attitude and velocity errors at the passes' times [n].

    Second-order Gauss-Markov processes, those of the velocity the derivatives of the position's.
    """
    rate = 2.0 / d.tau_s
    x = rate * np.abs(time[:, None] - time[None])
    attitude = np.radians([d.tilt_sd, d.tilt_sd, d.yaw_sd])
    velocity = rate * np.array([d.position_sd, d.position_sd, d.height_sd])
    covariance = np.kron((1.0 + x) * np.exp(-x), np.diag([*attitude**2, 0.0, 0.0, 0.0]))
    covariance += np.kron((1.0 - x) * np.exp(-x), np.diag([0.0, 0.0, 0.0, *velocity**2]))
    return np.asarray(covariance + 1e-14 * np.eye(len(covariance)))
