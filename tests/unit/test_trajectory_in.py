"""A finished trajectory of another program: RTKLIB's .pos, and what its file leaves out."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from automap.earth import from_local_ned
from automap.errors import InputError
from automap.export.trajectory_formats import rtklib_pos
from automap.frames import wrap_pi
from automap.io import names
from automap.io.trajectory_file import read_finished
from automap.io.trajectory_table import read_trajectory
from automap.records import Trajectory
from pipeline.check.command import check_drive
from pipeline.cli.root import run_command

REF = (np.radians(-35.3), np.radians(149.1), 580.0)
GPS0 = 1_400_000_000.0


def _drive_and_turn(hold_s: float = 10.0) -> Trajectory:
    """10 m/s north for 10 s, a halt, then 10 m/s east: it turned while nobody looked."""
    t = np.arange(0.0, 20.0 + hold_s, 0.2)
    north = (t < 10.0).astype(float)
    east = (t >= 10.0 + hold_s).astype(float)
    vel = 10.0 * np.stack([north, east, np.zeros_like(t)], axis=1)
    lat, lon, height = from_local_ned(np.cumsum(vel, axis=0) * 0.2, REF)
    one = np.ones((len(t), 3))
    return Trajectory(
        np.rint(t * 1e9).astype(np.int64), GPS0 + t, lat, lon, height, vel,
        np.zeros((len(t), 3)), 0.3 * one, 0.2 * one, 0.01 * one,
    )  # fmt: skip


@pytest.fixture
def pos(tmp_path: Path) -> Path:
    path = tmp_path / "trajectory.pos"
    path.write_text(rtklib_pos(_drive_and_turn()))
    return path


def test_a_solution_passes_with_its_own_figures(pos: Path) -> None:
    true = _drive_and_turn()
    finished = read_finished(pos)
    data = finished.data
    assert finished.time == "gps_s"
    np.testing.assert_allclose(data.gps_s, true.gps_s, atol=6e-4)
    np.testing.assert_array_equal(data.t_ns, np.rint(data.gps_s * 1e9))
    np.testing.assert_allclose(data.lat_rad, true.lat_rad, atol=1e-11)
    np.testing.assert_allclose(data.vel_ned, true.vel_ned, atol=1e-4)
    np.testing.assert_allclose(data.sd_pos_ned, 0.3)
    np.testing.assert_allclose(data.sd_vel_ned, 0.2)
    assert [text for text in finished.warnings if "attitude" in text]


def test_heading_is_the_course_and_held_at_standstill(pos: Path) -> None:
    data = read_finished(pos).data
    t = data.gps_s - data.gps_s[0]
    yaw, sd = np.degrees(data.rpy[:, 2]), np.degrees(data.sd_rpy[:, 2])
    np.testing.assert_allclose(yaw[t < 19.9], 0.0, atol=1e-3)
    np.testing.assert_allclose(yaw[t > 20.1], 90.0, atol=1e-3)
    # two degrees of slip, and 0.2 m/s in 10 m/s
    np.testing.assert_allclose(sd[t < 9.9], np.hypot(2.0, np.degrees(0.02)), rtol=1e-3)
    # it turned by 90 degrees at some instant of the halt
    standing = (t > 10.1) & (t < 19.9)
    np.testing.assert_allclose(sd[standing], np.hypot(90.0 / np.sqrt(3.0), 2.3), rtol=1e-3)


def test_course_is_not_sought_in_noise(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    true = _drive_and_turn(hold_s=20.0)
    standing = np.hypot(true.vel_ned[:, 0], true.vel_ned[:, 1]) < 1.0
    true.vel_ned[standing] = rng.normal(0.0, 0.8, (int(standing.sum()), 3))
    true.sd_vel_ned[:] = 0.8
    path = tmp_path / "t.pos"
    path.write_text(rtklib_pos(true))
    data = read_finished(path).data
    off = np.abs(wrap_pi(data.rpy[standing, 2]))
    assert np.all(off < 4.0 * data.sd_rpy[standing, 2])


def test_a_solution_without_velocity_or_sigma_is_completed(tmp_path: Path) -> None:
    lines = ["% GPST latitude(deg) longitude(deg) height(m) Q ns"]
    step = np.degrees(10.0 / 6378137.0)
    lines += [f"2300 {100 + i}.000 0.0 {10 + i * step:.12f} 5.0 1 9" for i in range(10)]
    path = tmp_path / "trajectory.pos"
    path.write_text("\n".join(lines) + "\n")
    finished = read_finished(path)
    np.testing.assert_allclose(finished.data.vel_ned, [[0, 10, 0]] * 10, atol=1e-4)
    np.testing.assert_allclose(finished.data.sd_pos_ned, 0.1)
    np.testing.assert_allclose(np.degrees(finished.data.rpy[:, 2]), 90.0, atol=1e-3)
    assert len(finished.warnings) == 3


@pytest.mark.parametrize("text", ["", "% GPST only a header\n", "no trajectory at all\n"])
def test_what_is_no_solution_is_one_sentence(text: str, tmp_path: Path) -> None:
    path = tmp_path / "trajectory.pos"
    path.write_text(text)
    with pytest.raises(InputError, match=r"trajectory\.pos"):
        read_finished(path)


def test_a_drive_of_a_solution_alone_runs(pos: Path, tmp_path: Path) -> None:
    drive = tmp_path / "drive"
    drive.mkdir()
    pos.rename(drive / "trajectory.pos")
    (drive / "drive.toml").write_text(
        'schema = "automap.drive/1"\n[gnss]\nlever_arm_m = [0.4, 0.0, -1.0]\n'
    )
    text = check_drive(drive).text()
    assert "rows; used instead of the IMU and the receiver" in text
    assert "lever_arm_m is not applied" in text
    out = tmp_path / "out"
    assert run_command(["run", str(drive), "-o", str(out)]) == 0
    trajectory = read_trajectory(out / names.TRAJECTORY)
    assert len(trajectory) == len(_drive_and_turn())
    np.testing.assert_allclose(trajectory.gps_s[0], GPS0, atol=1e-3)
    assert "no complete attitude" in json.dumps(json.loads((out / names.RUN).read_text()))


def test_csv_comes_before_pos(pos: Path, tmp_path: Path) -> None:
    from automap.io.drive import load_drive

    (tmp_path / "drive.toml").write_text('schema = "automap.drive/1"\n')
    assert load_drive(tmp_path).trajectory_file == pos
    (tmp_path / "trajectory.csv").write_text("t_ns,lat_deg,lon_deg\n")
    assert load_drive(tmp_path).trajectory_file == tmp_path / "trajectory.csv"
