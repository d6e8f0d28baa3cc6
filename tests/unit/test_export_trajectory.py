"""The trajectory in other tools' formats, read back."""

from __future__ import annotations

from dataclasses import replace
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from automap.earth import from_local_ned
from automap.export import trajectory_formats
from automap.export.sign_columns import sign_columns
from automap.export.trajectory_formats import (
    gpx_track,
    kitti_poses,
    rtklib_pos,
    trajectory_csv,
    tum_poses,
)
from automap.io.receiver import read_receiver_bytes
from automap.records import Trajectory
from tests.unit.export_inputs import sign

REF = (np.radians(-35.3), np.radians(149.1), 580.0)


@pytest.fixture
def circle() -> Trajectory:
    """A quarter circle to the right, level, 10 m/s, radius 100 m."""
    t = np.arange(0.0, 15.0, 0.1)
    yaw = 0.3 + 0.1 * t
    ned = np.stack(
        [100 * (np.sin(yaw) - np.sin(0.3)), -100 * (np.cos(yaw) - np.cos(0.3)), -0.2 * t], axis=1
    )
    lat, lon, height = from_local_ned(ned, REF)
    zeros = np.zeros_like(t)
    vel = np.stack([10 * np.cos(yaw), 10 * np.sin(yaw), zeros - 0.2], axis=1)
    one = np.ones((len(t), 3))
    return Trajectory(
        np.rint(t * 1e9).astype(np.int64), 1.4e9 + t, lat, lon, height, vel,
        np.stack([zeros, zeros, yaw], axis=1), 0.5 * one, 0.02 * one, 0.01 * one,
    )  # fmt: skip


def test_rtklib_solution_reads_back(circle: Trajectory) -> None:
    fixes = read_receiver_bytes(rtklib_pos(circle).encode(), "out.pos").fixes
    assert len(fixes) == len(circle)
    np.testing.assert_allclose(fixes.gps_s, circle.gps_s, atol=6e-4)
    np.testing.assert_allclose(fixes.lat_rad, circle.lat_rad, atol=1e-11)
    np.testing.assert_allclose(fixes.height_m, circle.height_m, atol=1e-4)
    np.testing.assert_allclose(fixes.vel_ned, circle.vel_ned, atol=1e-4)
    np.testing.assert_allclose(fixes.sd_pos_ned, circle.sd_pos_ned, atol=1e-4)


def test_tum_poses_drive_where_they_point(circle: Trajectory) -> None:
    rows = np.array([line.split() for line in tum_poses(circle).splitlines()], dtype=float)
    np.testing.assert_allclose(rows[:, 0], circle.gps_s, atol=1e-5)
    forward = Rotation.from_quat(rows[:, 4:]).apply([1.0, 0.0, 0.0])
    step = np.gradient(rows[:, 1:4], 0.1, axis=0)
    step /= np.linalg.norm(step, axis=1, keepdims=True)
    # east, north, up: the vehicle moves along its own forward axis, climbing a little
    assert np.einsum("ij,ij->i", forward[2:-2], step[2:-2]).min() > 0.999
    assert rows[-1, 3] > rows[0, 3]


def test_kitti_poses_start_at_identity_and_keep_distances(circle: Trajectory) -> None:
    rows = np.array([line.split() for line in kitti_poses(circle).splitlines()], dtype=float)
    poses = rows.reshape(-1, 3, 4)
    np.testing.assert_allclose(poses[0], np.eye(3, 4), atol=1e-8)
    length = np.linalg.norm(np.diff(poses[:, :, 3], axis=0), axis=1).sum()
    assert length == pytest.approx(10.0 * 14.9, rel=1e-3)
    # camera axes: forward is z, and a right turn goes to positive x
    assert poses[5, 2, 3] > 4.0
    assert poses[-1, 0, 3] > 50.0


def test_csv_has_every_column_and_row(circle: Trajectory) -> None:
    lines = trajectory_csv(replace(circle, slip_sd=np.array(0.01))).splitlines()
    assert lines[0].startswith("t_ns,gps_s,lat_deg,lon_deg,height_m,vn,ve,vd,roll_deg")
    assert len(lines) == len(circle) + 1
    first = dict(zip(lines[0].split(","), lines[1].split(","), strict=True))
    assert float(first["lat_deg"]) == pytest.approx(-35.3, abs=1e-9)
    assert float(first["sd_slip_deg"]) == pytest.approx(np.degrees(0.01), abs=1e-5)


def test_gpx_is_well_formed_and_sparse(circle: Trajectory) -> None:
    root = ElementTree.fromstring(gpx_track(circle, "<drive> & co"))
    space = {"g": "http://www.topografix.com/GPX/1/1"}
    name = root.find("g:trk/g:name", space)
    assert name is not None
    assert name.text == "<drive> & co"
    points = root.findall("g:trk/g:trkseg/g:trkpt", space)
    assert 15 <= len(points) <= 17
    assert float(points[0].attrib["lon"]) == pytest.approx(149.1, abs=1e-8)


def test_heights_of_gpx_are_above_the_sea_or_none(circle: Trajectory) -> None:
    space = {"g": "http://www.topografix.com/GPX/1/1"}
    geoid = np.where(np.arange(len(circle)) < len(circle) // 2, 48.25, np.nan)
    signs = sign_columns([sign(1), sign(2)])
    signs.values["height_msl_m"] = np.array([signs.height_m[0] - 30.5, np.nan])
    root = ElementTree.fromstring(gpx_track(circle, "x", 0.0, signs, None, geoid))
    points = root.findall("g:trk/g:trkseg/g:trkpt", space)
    assert len(points) == len(circle)
    for row, point in enumerate(points):
        height = point.findtext("g:ele", None, space)
        above = point.findtext("g:geoidheight", None, space)
        assert (height is None) == (above is None) == bool(np.isnan(geoid[row]))
        if height is not None and above is not None:
            assert float(height) + float(above) == pytest.approx(circle.height_m[row], abs=2e-3)
            assert float(above) == pytest.approx(48.25)
    one, other = root.findall("g:wpt", space)
    assert float(one.findtext("g:geoidheight", "", space)) == pytest.approx(30.5, abs=1e-3)
    assert other.find("g:ele", space) is None
    # in the order of GPX's schema
    assert [c.tag.split("}")[1] for c in one][:3] == ["ele", "geoidheight", "name"]
    assert [c.tag.split("}")[1] for c in points[0]] == ["ele", "time", "geoidheight"]


@pytest.mark.parametrize("text_of", [trajectory_csv, rtklib_pos, tum_poses, kitti_poses])
def test_stretches_of_a_trajectory_make_the_text_of_the_whole(
    circle: Trajectory, text_of: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = text_of(circle)
    monkeypatch.setattr(trajectory_formats, "_ROWS", len(circle) // 4)
    parts = [text_of(part, before) for part, before in trajectory_formats.stretches(circle)]
    assert len(parts) > 3
    assert "".join(parts) == whole
