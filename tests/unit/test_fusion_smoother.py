"""The smoother against dense forms of the same linear problem, and its iteration."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from automap.fusion import kernels
from automap.fusion.filtered import full_covariance
from automap.fusion.kernel_runs import ForwardRun, Start, run_forward
from automap.fusion.kernel_runs import run_smoother as smooth
from automap.fusion.layout import (
    HAS_POS_H,
    HAS_POS_V,
    HAS_VEL_H,
    HAS_VEL_V,
    N_NAV,
    NHC,
    STANDSTILL,
)
from automap.fusion.model import build_state_model
from automap.fusion.nodes import Shift
from automap.fusion.options import FusionOptions
from automap.fusion.problem import Problem, make_problem
from automap.fusion.stamp_error import reported_rows
from tests.unit.fusion_drive import Sensor, record
from tests.unit.fusion_motion import city_drive
from tests.unit.fusion_problem import full_transition, make_nodes, true_start
from tests.unit.fusion_receiver import GPS0, Receiver, receive

ALL = HAS_POS_H | HAS_POS_V | HAS_VEL_H | HAS_VEL_V
EFFECTS = (
    "accel_bias",
    "gyro_bias",
    "gyro_scale",
    "gnss_lever_arm",
    "imu_time_offset",
    "gnss_correlated_noise",
    "imu_mounting",
    "nhc_lever_arm",
)


def _problem(seconds: float, gate: float) -> tuple[Problem, ForwardRun, Start]:
    motion = city_drive(seconds, seed=11, rest_s=4.0)
    options = FusionOptions(effects=EFFECTS, gate_probability=gate)
    problem = make_problem(record(motion, Sensor(), 5), build_state_model(options), options)
    fixes = receive(motion, Receiver(rate=2.0), 6)
    t = fixes.gps_s - GPS0
    speed = np.linalg.norm(fixes.vel_ned, axis=1)
    flags = np.where(np.arange(len(t)) % 5 == 3, 0, ALL)
    flags = np.where(speed > 3.0, flags | NHC, np.where(t < 4.0, flags | STANDSTILL, flags))
    values = np.column_stack([fixes.lat_rad, fixes.lon_rad, fixes.height_m, fixes.vel_ned])
    sd = [0.25] * 2 + [0.45] + [0.07] * 3 + [0.2, 0.4] + [0.03] * 3 + [1e-3] * 3
    nodes = make_nodes(t, flags, values, np.tile(np.square(sd), (len(t), 1)))
    start = true_start(motion, np.repeat([3.0, 0.5, 0.03], 3))
    return problem, run_forward(problem, nodes, start, Shift()), start


def _rts(problem: Problem, forward: ForwardRun) -> tuple[np.ndarray, np.ndarray]:
    """Rauch-Tung-Striebel with full matrices: corrections [k, n] and covariances."""
    store, t = forward.store, forward.nodes.t
    covs = full_covariance(store.cov, problem.model.size)
    k, n = store.mean.shape
    scale = np.sqrt(np.diag(covs[0]))
    dx, cov = np.zeros((k, n)), covs.copy()
    for i in range(k - 2, -1, -1):
        rows = slice(store.scalars[i], store.scalars[i + 1])
        gain, nu, var = store.gain[rows], store.nu[rows], store.var[rows]
        before = covs[i + 1] + (gain.T * var) @ gain
        full = full_transition(store.trans[i + 1], t[i + 1] - t[i], problem.model.tau)
        scaled = before / np.outer(scale, scale)
        g = np.linalg.solve(scaled, (full @ covs[i]) / scale[:, None]).T / scale
        dx[i] = g @ (dx[i + 1] + gain.T @ nu)
        cov[i] = covs[i] + g @ (cov[i + 1] - before) @ g.T
    return dx, cov


def test_smoothed_states_and_covariances_are_those_of_full_rts() -> None:
    problem, forward, _ = _problem(60.0, gate=1e-3)
    smoothed = smooth(problem, forward)
    dx, cov = _rts(problem, forward)
    nominal, params = forward.store.nominal.copy(), forward.store.params.copy()
    kernels.apply_correction(nominal, params, forward.store.mean + dx)
    sd = np.sqrt(np.einsum("kii->ki", cov))
    metres = np.array([6.4e6, 6.4e6, 1.0])
    assert np.abs((smoothed.nominal - nominal)[:, :3] * metres / sd[:, :3]).max() < 1e-6
    assert np.abs((smoothed.nominal - nominal)[:, 3:6] / sd[:, 3:6]).max() < 1e-6
    assert np.abs((smoothed.nominal - nominal)[:, 6:] / sd[:, 6:7]).max() < 1e-6
    assert np.abs((smoothed.params - params) / sd[:, N_NAV:]).max() < 1e-6
    navigation = np.sqrt(np.einsum("kii->ki", smoothed.cov))[:, :N_NAV]
    assert navigation == pytest.approx(sd[:, :N_NAV], rel=1e-6)
    rows = reported_rows(problem.model)
    assert len(rows) == N_NAV + 4
    size = sd[:, rows][:, :, None] * sd[:, rows][:, None, :]
    assert np.abs((smoothed.cov - cov[:, rows][:, :, rows]) / size).max() < 1e-6


def test_the_estimate_is_the_minimum_of_the_batch_least_squares() -> None:
    """All nodes at once: prior, dynamics and measurements stacked and solved."""
    problem, forward, _ = _problem(12.0, gate=1e-12)
    store, t = forward.store, forward.nodes.t
    covs = full_covariance(store.cov, problem.model.size)
    k, n = store.mean.shape
    dx, cov = _rts(problem, forward)
    # the first node's state before its updates, then P := F P F' + Q gives the noises
    rows = slice(0, store.scalars[0])
    gain, var = store.gain[rows], store.var[rows]
    prior = covs[0] + (gain.T * var) @ gain
    information, vector = np.zeros((k * n, k * n)), np.zeros(k * n)
    # unknowns: errors relative to the nominal after each node's update
    miss = [gain.T @ store.nu[rows]]
    information[:n, :n] += np.linalg.inv(prior)
    vector[:n] -= np.linalg.inv(prior) @ miss[0]
    for i in range(1, k):
        rows = slice(store.scalars[i - 1], store.scalars[i])
        gain, var = store.gain[rows], store.var[rows]
        miss.append(gain.T @ store.nu[rows])
        full = full_transition(store.trans[i], t[i] - t[i - 1], problem.model.tau)
        noise = covs[i] + (gain.T * var) @ gain - full @ covs[i - 1] @ full.T
        # constants have no noise of their own: a trace of it makes the matrix regular
        noise += np.diag(1e-10 * np.diag(covs[i]))
        weight = np.linalg.inv(noise)
        both = np.hstack([-full, np.eye(n)])
        at = slice((i - 1) * n, (i + 1) * n)
        information[at, at] += both.T @ weight @ both
        vector[at] -= both.T @ weight @ miss[i]
    previous = 0
    for i in range(k):
        p, move = None, np.zeros(n)
        for r in range(previous, store.scalars[i]):
            h, s = store.h[r], store.var[r]
            if p is None:
                first = slice(previous, store.scalars[i])
                g, v = store.gain[first], store.var[first]
                p = covs[i] + (g.T * v) @ g
            noise_var = s - h @ p @ h
            at = slice(i * n, (i + 1) * n)
            # residual against the nominal before the update: innovation plus what moved it
            residual = store.nu[r] + h @ move - h @ miss[i]
            information[at, at] += np.outer(h, h) / noise_var
            vector[at] += h * residual / noise_var
            move = move + store.gain[r] * store.nu[r]
            p = p - np.outer(store.gain[r], store.gain[r]) * s
        previous = store.scalars[i]
    size = np.tile(np.sqrt(np.diag(covs[0])), k)
    solution = np.linalg.solve(information * np.outer(size, size), vector * size) * size
    batch = np.linalg.inv(information * np.outer(size, size)) * np.outer(size, size)
    sd = np.sqrt(np.einsum("kii->ki", cov))
    assert np.abs((solution.reshape(k, n) - dx) / sd).max() < 2e-3
    assert np.sqrt(np.diag(batch)).reshape(k, n) == pytest.approx(sd, rel=2e-3)


def test_iterations_from_two_starts_meet() -> None:
    """The prior is one; where the first linearisation stood must not matter in the end."""
    problem, forward, start = _problem(60.0, gate=1e-12)
    ends = []
    for turn in (0.0, 0.15):
        nominal = start.nominal.copy()
        w, x, y, z = nominal[6:10]
        c, s = np.cos(turn / 2), np.sin(turn / 2)
        nominal[6:10] = [c * w - s * z, c * x - s * y, c * y + s * x, c * z + s * w]
        nominal[0] += turn * 1e-5
        away = replace(start, nominal=nominal, sd=start.sd + turn * np.eye(9)[8])
        about = smooth(problem, run_forward(problem, forward.nodes, away, Shift()))
        for _ in range(4):
            run = run_forward(problem, forward.nodes, start, Shift(), linearised_at=about)
            about = smooth(problem, run)
        ends.append(about)
    a, b = ends
    sd = np.sqrt(np.einsum("kii->ki", a.cov))
    metres = np.array([6.4e6, 5.2e6, 1.0])
    assert np.abs((a.nominal - b.nominal)[:, :3] * metres / sd[:, :3]).max() < 0.01
    assert np.abs((a.nominal - b.nominal)[:, 3:6] / sd[:, 3:6]).max() < 0.01
    assert np.abs((a.nominal - b.nominal)[:, 6:] / sd[:, 6:9].min()).max() < 0.01


def test_smoothing_never_loses_certainty_and_meets_the_filter_at_the_end() -> None:
    problem, forward, _ = _problem(60.0, gate=1e-3)
    smoothed = smooth(problem, forward)
    filtered = np.einsum("kii->ki", full_covariance(forward.store.cov, problem.model.size))[
        :, :N_NAV
    ]
    variances = np.einsum("kii->ki", smoothed.cov)[:, :N_NAV]
    assert (variances <= filtered * (1 + 1e-9)).all()
    assert variances[-1] == pytest.approx(filtered[-1], rel=1e-9)
    assert smoothed.nominal[-1] == pytest.approx(forward.store.nominal[-1], rel=1e-12)
