"""Drives at and over the north pole, where longitude, north and the cosine of the latitude end."""

from __future__ import annotations

from collections.abc import Collection
from datetime import timedelta
from pathlib import Path

import numpy as np
import pytest

from automap.io.trajectory_table import read_trajectory
from pipeline.cli.root import run_command
from tests.unit.broken_drive import rows
from tests.unit.input_drive import (
    BOOT_NS,
    RATE_HZ,
    START,
    angle,
    motion,
    sentence,
    write_drive,
)

SECONDS = 30
_RADIUS = 6_399_594.0
"""Of the curvature of WGS84 at a pole, a^2 / b, m."""


def drive_at_pole(folder: Path, start_m: float, at_pole: Collection[int] = ()) -> Path:
    """The drive of formulas from ``start_m`` metres before the pole towards it; the epochs
    ``at_pole`` are written as latitude 90, longitude 0, as receivers do without a fix."""
    write_drive(folder, 'file = "imu.csv"', 'file = "gnss.nmea"\narrival = "gnss_arrival.csv"')
    rows("imu.csv", lambda lines: lines[: 1 + SECONDS * RATE_HZ])(folder)
    move, text, arrival = motion(), "", ["offset,t_ns"]
    for epoch in range(SECONDS):
        row = epoch * RATE_HZ
        stamp = START + timedelta(seconds=epoch)
        arrival.append(f"{len(text)},{BOOT_NS + round((epoch + 0.07) * 1e9)}")
        # in the plane that touches the pole, x along the meridian of 180 degrees
        x, y = move.north[row] - start_m, move.east[row]
        lat = 90.0 - np.degrees(np.hypot(x, y) / _RADIUS)
        lon = np.degrees(np.arctan2(y, -x))
        course = np.degrees(move.yaw[row] - np.arctan2(-y, -x)) % 360.0
        if epoch in at_pole:
            lat, lon = 90.0, 0.0
        place = f"{angle(lat, 2)},N,{angle(abs(lon), 3)},{'E' if lon >= 0.0 else 'W'}"
        time = stamp.strftime("%H%M%S.00")
        knots = move.speed[row] / 0.514444
        rmc = f"GNRMC,{time},A,{place},{knots:.3f},{course:.2f},{stamp:%d%m%y},,,A"
        text += sentence(rmc) + sentence(f"GNGGA,{time},{place},1,12,0.8,5.0,M,20.0,M,,")
    (folder / "gnss.nmea").write_text(text)
    (folder / "gnss_arrival.csv").write_text("\n".join(arrival) + "\n")
    return folder


def fused(drive: Path, capsys: pytest.CaptureFixture[str]) -> tuple[int, str]:
    """Exit code and words of a run to the path."""
    code = run_command(["run", str(drive), "--to", "fuse"])
    told = capsys.readouterr()
    text = " ".join((told.out + told.err).split())
    assert "unexpectedly" not in text
    assert "Warning:" not in told.err
    return code, text


@pytest.mark.slow
def test_a_position_at_the_pole_is_none(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Some programs write latitude 90 where they have no fix: the path goes on without it."""
    code, text = fused(drive_at_pole(tmp_path / "drive", 2e5, {12, 13}), capsys)
    assert code == 0
    assert "2 positions at latitude 0, longitude 0 or at a pole are no fixes" in text
    trajectory = read_trajectory(tmp_path / "drive" / "_automap" / "trajectory.parquet")
    t = (trajectory.t_ns - trajectory.t_ns[0]) * 1e-9
    truth = motion()
    # 2e5 m before the pole the curve of a circle of latitude is 0.4 m in 400 m
    north = (trajectory.lat_rad - trajectory.lat_rad[0]) * _RADIUS
    wanted = np.interp(t, truth.t, truth.north)
    assert np.max(np.abs(north - (wanted - wanted[0]))) < 5.0


def test_a_log_that_is_at_the_pole_throughout_has_no_fix(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, text = fused(drive_at_pole(tmp_path / "drive", 2e5, range(SECONDS)), capsys)
    assert code == 3
    assert "never had a fix in 30 epochs" in text


@pytest.mark.slow
def test_a_drive_over_the_pole_is_a_path_or_is_called_unusable(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """North turns round within metres there: what the filter cannot follow it may not call good."""
    code, text = fused(drive_at_pole(tmp_path / "drive", 180.0), capsys)
    assert code == 0
    trajectory = read_trajectory(tmp_path / "drive" / "_automap" / "trajectory.parquet")
    assert np.all(np.isfinite(trajectory.lat_rad))
    assert np.all(np.isfinite(trajectory.lon_rad))
    assert np.max(np.abs(trajectory.lat_rad)) <= 0.5 * np.pi
    # where it truly was, in the plane
    t = (trajectory.t_ns - trajectory.t_ns[0]) * 1e-9
    truth = motion()
    from_pole = (0.5 * np.pi - trajectory.lat_rad) * _RADIUS
    x, y = -from_pole * np.cos(trajectory.lon_rad), from_pole * np.sin(trajectory.lon_rad)
    off = np.hypot(
        x - np.interp(t, truth.t, truth.north - 180.0), y - np.interp(t, truth.t, truth.east)
    )
    assert np.median(off) < 5.0 or "verdict good" not in text


def test_bearings_at_the_pole_are_a_result_or_a_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "drive.toml").write_text('schema = "automap.drive/1"\n')
    (tmp_path / "bearings.csv").write_text("lat_deg,lon_deg,bearing_deg\n90,0,0\n89.99,0,10\n")
    code = run_command(["run", str(tmp_path)])
    told = capsys.readouterr()
    assert code in (0, 2, 3)
    assert "unexpectedly" not in told.out + told.err
