"""The fusion on recordings with a reference: an independent filter's run, and real drives."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pymap3d
import pytest

from automap.frames import matrix_to_quat, matrix_to_rpy, quat_to_matrix, rpy_to_matrix
from automap.fusion.filtered import filtered_states, full_covariance
from automap.fusion.kernel_runs import Start, run_forward
from automap.fusion.layout import MAX_SCALARS
from automap.fusion.model import build_state_model
from automap.fusion.nodes import Nodes, Shift
from automap.fusion.options import FusionOptions
from automap.fusion.problem import make_problem
from automap.io.receiver import read_receiver_log
from automap.records import FloatArray, ImuData

BEGIN_NS, BEGIN_GPS_S = 4_000_000_000_000, 1457486418.0
SETTLED_S = 120.0
COMPONENTS = ("n", "e", "d", "vn", "ve", "vd", "roll", "pitch", "yaw")
_POSE = ("lat_deg", "lon_deg", "height_m", "vn", "ve", "vd", "roll_deg", "pitch_deg", "yaw_deg")


@dataclass(frozen=True)
class Comparison:
    """Times [k] s, our and the reference filter's errors against truth [k, 9] (m, m/s, deg)
    and our sd [k, 9]."""

    t: FloatArray
    ours: FloatArray
    theirs: FloatArray
    sd: FloatArray


@pytest.fixture(scope="module")
def white_noise(shared_data: Path) -> Comparison:
    """The forward filter alone, with the reference's sigmas, from the true state."""
    folder = shared_data / "reference" / "white-noise-drive"
    raw = _csv(folder / "imu.csv")
    imu = ImuData(
        raw["t_ns"].astype(np.int64),
        np.column_stack([raw[a] for a in ("gx", "gy", "gz")]),
        np.column_stack([raw[a] for a in ("ax", "ay", "az")]),
    )
    fixes = read_receiver_log(folder / "gnss.ubx").fixes
    reference, truth = _csv(folder / "pyins_filter.csv"), _csv(folder / "truth" / "trajectory.csv")
    options = FusionOptions(
        effects=("accel_bias", "gyro_bias", "accel_scale", "gyro_scale"),
        prior_sd={
            "accel_bias": {"*": 0.08},
            "gyro_bias": {"*": np.radians(900.0) / 3600.0},
            "accel_scale": {"*": 0.004},
            "gyro_scale": {"*": 0.004},
        },
        accel_noise=0.06 / 60.0,
        gyro_noise=np.radians(0.15) / 60.0,
        accel_bias_walk=0.0,
        gyro_bias_walk=0.0,
        velocity_wander_sd=0.0,
        gate_probability=1e-12,
    )
    problem = make_problem(imu, build_state_model(options), options)
    epochs = (reference["t_ns"] - imu.t_ns[0]) * 1e-9
    nodes = _nodes(fixes.gps_s - BEGIN_GPS_S - (int(imu.t_ns[0]) - BEGIN_NS) * 1e-9, fixes, epochs)
    first = np.array([truth[name][0] for name in _POSE])
    attitude = rpy_to_matrix(np.radians(first[6:9]))
    start = Start(
        np.concatenate([np.radians(first[:2]), first[2:6], matrix_to_quat(attitude)]),
        np.array([2.0, 2.0, 2.0, 0.1, 0.1, 0.1, *np.radians([0.5, 0.5, 1.0])]),
    )
    run = run_forward(problem, nodes, start, Shift())
    at = nodes.fix_row < 0
    states, cov = (
        filtered_states(problem, run)[0][at],
        full_covariance(run.store.cov, problem.model.size)[at],
    )
    ours = np.column_stack(
        [np.degrees(states[:, :2]), states[:, 2:6], np.degrees(_rpy(states[:, 6:10]))]
    )
    theirs = np.column_stack([reference[name] for name in _POSE])
    true = np.column_stack(
        [np.interp(reference["t_ns"], truth["t_ns"], _unwrapped(truth, name)) for name in _POSE]
    )
    # sd of the angles to first order: level attitude, heading about down
    sd = np.sqrt(np.einsum("kii->ki", cov)[:, :9])
    sd[:, 6:] = np.degrees(sd[:, 6:])
    return Comparison(epochs, _errors(ours, true), _errors(theirs, true), sd)


def _csv(path: Path) -> dict[str, np.ndarray]:
    with path.open() as file:
        names = file.readline().strip().split(",")
    rows = np.loadtxt(path, delimiter=",", skiprows=1)
    table: dict[str, np.ndarray] = dict(zip(names, rows.T, strict=True))
    table["t_ns"] = np.rint(table["t_ns"]).astype(np.int64)
    return table


def _unwrapped(table: dict[str, np.ndarray], name: str) -> FloatArray:
    values = table[name]
    return np.degrees(np.unwrap(np.radians(values))) if name == "yaw_deg" else values


def _rpy(quat: FloatArray) -> FloatArray:
    return matrix_to_rpy(quat_to_matrix(quat))


def _nodes(t_fix: FloatArray, fixes, epochs: FloatArray) -> Nodes:  # type: ignore[no-untyped-def]
    """Fixes with the reference's sigmas, and the reference's epochs without measurement."""
    times = np.concatenate([t_fix, epochs])
    row = np.concatenate([np.arange(len(t_fix)), np.full(len(epochs), -1)])
    keep = (times >= 0.0) & (times <= epochs[-1])
    order = np.lexsort((-row, times))
    order = order[keep[order]]
    times, row = times[order], row[order]
    var = np.ones((len(times), MAX_SCALARS))
    var[:, 3:6] = 0.05**2
    values = np.column_stack([fixes.lat_rad, fixes.lon_rad, fixes.height_m, fixes.vel_ned])
    return Nodes(
        times,
        np.where(row >= 0, 15, 0).astype(np.int64),
        np.where(row[:, None] >= 0, values[np.maximum(row, 0)], 0.0),
        var,
        np.ones((len(times), 3)),
        np.ones((len(times), 3)),
        row.astype(np.int64),
        np.ones((len(times), 6)),
    )


def _errors(poses: FloatArray, true: FloatArray) -> FloatArray:
    ned = np.stack(pymap3d.geodetic2ned(*poses[:, :3].T, *true[:, :3].T), axis=1)
    angles = (poses[:, 6:] - true[:, 6:] + 180.0) % 360.0 - 180.0
    return np.concatenate([ned, poses[:, 3:6] - true[:, 3:6], angles], axis=1)


def test_the_filter_is_as_accurate_as_the_reference_filter(white_noise: Comparison) -> None:
    settled = white_noise.t >= SETTLED_S
    ours = np.sqrt(np.mean(white_noise.ours[settled] ** 2, axis=0))
    theirs = np.sqrt(np.mean(white_noise.theirs[settled] ** 2, axis=0))
    assert dict(zip(COMPONENTS, ours / theirs, strict=True)) == pytest.approx(
        dict.fromkeys(COMPONENTS, 1.0), abs=0.03
    )


def test_the_two_filters_agree_to_a_fraction_of_their_sd(white_noise: Comparison) -> None:
    settled = white_noise.t >= SETTLED_S
    apart = (white_noise.ours - white_noise.theirs) / white_noise.sd
    assert np.abs(apart[settled]).max() < 0.2
    assert np.sqrt(np.mean(apart**2, axis=0)).max() < 0.1


def test_the_sd_fits_the_error(white_noise: Comparison) -> None:
    settled = white_noise.t >= SETTLED_S
    ratio = np.sqrt(np.mean((white_noise.ours / white_noise.sd)[settled] ** 2, axis=0))
    # one drive: a component's error is correlated over minutes
    assert (ratio > 0.5).all()
    assert (ratio < 1.5).all()
