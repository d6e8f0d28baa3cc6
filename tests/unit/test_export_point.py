"""The trajectory of other points of the vehicle, at other instants, of the forward filter."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from automap.earth import from_local_ned, local_ned
from automap.errors import ConfigError, InputError
from automap.export.trajectory_instants import at_instants
from automap.frames import rpy_to_matrix
from automap.io import names
from automap.io.trajectory_table import write_trajectory
from automap.lever_arm import arm_covariance, moved_to, turn_rate
from automap.records import Trajectory
from pipeline.cli.root import run_command
from pipeline.export.command import export_run
from pipeline.export.trajectory_view import TrajectoryView, lever_arm

REF = (np.radians(-35.3), np.radians(179.9999), 580.0)
T0, GPS0 = 5_000_000_000, 1_400_000_000.0
metres = st.floats(-5.0, 5.0)


def _bend(lat0: float = REF[0]) -> Trajectory:
    """A right-hand bend over the date line at 10 m/s, leaning and climbing."""
    t = np.arange(0.0, 12.0, 0.01)
    yaw = 0.3 + 0.2 * t
    ref = (lat0, *REF[1:])
    ned = np.stack([50 * (np.sin(yaw) - np.sin(0.3)), 50 * (np.cos(0.3) - np.cos(yaw)), -t], axis=1)
    lat, lon, height = from_local_ned(ned, ref)
    vel = np.stack([10 * np.cos(yaw), 10 * np.sin(yaw), np.full_like(t, -1.0)], axis=1)
    rpy = np.stack([0.05 * np.sin(t), 0.03 * np.cos(t), yaw], axis=1)
    one = np.ones((len(t), 3))
    return Trajectory(
        T0 + np.rint(t * 1e9).astype(np.int64), GPS0 + 1.00001 * t, lat, lon, height, vel,
        rpy, 0.5 * one, 0.02 * one, np.radians([0.1, 0.2, 0.5]) * one,
    )  # fmt: skip


@settings(max_examples=25)
@given(st.tuples(metres, metres, metres), st.floats(-1.2, 1.2))
def test_there_and_back_is_where_it_began(arm: tuple[float, float, float], lat0: float) -> None:
    start = _bend(lat0)
    back = moved_to(moved_to(start, arm), [-a for a in arm])
    ref = (float(start.lat_rad[0]), float(start.lon_rad[0]), 580.0)
    np.testing.assert_allclose(
        local_ned(back.lat_rad, back.lon_rad, back.height_m, ref),
        local_ned(start.lat_rad, start.lon_rad, start.height_m, ref),
        atol=2e-5,
    )
    np.testing.assert_allclose(back.vel_ned, start.vel_ned, atol=1e-9)
    assert np.all(back.sd_pos_ned >= start.sd_pos_ned - 1e-12)


def test_the_point_stands_where_the_arm_says() -> None:
    start, arm = _bend(), np.array([1.5, 0.4, -1.2])
    moved = moved_to(start, arm)
    ref = (float(start.lat_rad[0]), float(start.lon_rad[0]), float(start.height_m[0]))
    apart = local_ned(moved.lat_rad, moved.lon_rad, moved.height_m, ref) - local_ned(
        start.lat_rad, start.lon_rad, start.height_m, ref
    )
    np.testing.assert_allclose(apart, rpy_to_matrix(start.rpy) @ arm, atol=2e-5)
    assert np.abs(moved.lon_rad).max() <= np.pi


def test_an_unknown_arm_hides_where_the_point_is_and_how_fast() -> None:
    start, sd = _bend(), np.array([0.5, 0.3, 0.2])
    ref = (float(start.lat_rad[0]), float(start.lon_rad[0]), float(start.height_m[0]))
    off = []
    for arm in np.diag(sd):
        moved = moved_to(start, arm)
        place = [local_ned(p.lat_rad, p.lon_rad, p.height_m, ref) for p in (moved, start)]
        off.append(np.hstack([place[0] - place[1], moved.vel_ned - start.vel_ned]))
    turned = rpy_to_matrix(start.rpy)
    rate = np.einsum("nij,nj->ni", turned, turn_rate(start))
    expected = sum(np.einsum("ni,nj->nij", one, one) for one in off)
    np.testing.assert_allclose(arm_covariance(turned, rate, sd), expected, atol=2e-5)


def test_its_velocity_is_the_change_of_its_position() -> None:
    moved = moved_to(_bend(), [2.0, -1.0, -1.5])
    ref = (float(moved.lat_rad[0]), float(moved.lon_rad[0]), float(moved.height_m[0]))
    place = local_ned(moved.lat_rad, moved.lon_rad, moved.height_m, ref)
    inside = slice(20, -20)
    np.testing.assert_allclose(
        np.gradient(place, 0.01, axis=0)[inside], moved.vel_ned[inside], atol=2e-3
    )
    np.testing.assert_allclose(turn_rate(_bend())[inside, 2], 0.2, atol=5e-3)


def test_its_sigma_holds_that_of_the_attitude() -> None:
    """Against many drawn attitudes."""
    start = _bend()
    arm, row = np.array([3.0, 0.0, -2.0]), 600
    rng = np.random.default_rng(2)
    drawn = start.rpy[row] + rng.standard_normal((20000, 3)) * start.sd_rpy[row]
    spread = (rpy_to_matrix(drawn) @ arm).std(axis=0)
    expected = np.hypot(start.sd_pos_ned[row], spread)
    np.testing.assert_allclose(moved_to(start, arm).sd_pos_ned[row], expected, rtol=1e-3)


def test_instants_between_rows_are_met() -> None:
    fine = _bend()
    rows = np.arange(0, len(fine), 20)
    coarse = Trajectory(**{name: values[rows] for name, values in vars(fine).items()})
    asked = np.arange(1, rows[-1])[::-7]
    for found in (
        at_instants(coarse, t_ns=fine.t_ns[asked]),
        at_instants(coarse, gps_s=fine.gps_s[asked]),
    ):
        np.testing.assert_allclose(found.t_ns, fine.t_ns[asked], atol=300)
        np.testing.assert_allclose(found.gps_s, fine.gps_s[asked], atol=5e-7)
        np.testing.assert_allclose(found.lat_rad, fine.lat_rad[asked], atol=1e-10)
        np.testing.assert_allclose(found.vel_ned, fine.vel_ned[asked], atol=3e-3)
        np.testing.assert_allclose(found.rpy, fine.rpy[asked], atol=5e-4)


@pytest.mark.parametrize("where", [-0.01, 12.0])
def test_nothing_is_extrapolated(where: float) -> None:
    stamps = np.array([T0 + 10**9, T0 + round(where * 1e9)])
    with pytest.raises(InputError, match=r"1 of 2 instants lie outside.* in row 2"):
        at_instants(_bend(), t_ns=stamps)
    with pytest.raises(InputError, match="instants lie outside"):
        at_instants(_bend(), gps_s=GPS0 + 1.00001 * np.array([1.0, where]))


def test_nothing_is_made_up_in_a_gap() -> None:
    whole = _bend()
    keep = (whole.t_ns < T0 + 3 * 10**9) | (whole.t_ns > T0 + 8 * 10**9)
    gappy = Trajectory(**{name: values[keep] for name, values in vars(whole).items()})
    with pytest.raises(InputError, match="more than 3 s apart"):
        at_instants(gappy, t_ns=np.array([T0 + 5 * 10**9]))


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A finished run of a drive with an antenna and a camera."""
    (tmp_path / "drive.toml").write_text(
        'schema = "automap.drive/1"\n[gnss]\nlever_arm_m = [0.4, 0.1, -1.2]\n'
        "[video.front]\nlever_arm_m = [1.4, 0.0, -1.1]\n"
    )
    out = tmp_path / names.DEFAULT_OUT
    out.mkdir()
    write_trajectory(out / names.TRAJECTORY, _bend())
    forward = replace(_bend(), sd_pos_ned=np.full((1200, 3), 2.0))
    write_trajectory(out / names.TRAJECTORY_FILTER, forward)
    return out


def test_points_have_names(run: Path) -> None:
    np.testing.assert_array_equal(lever_arm(run, "antenna"), [0.4, 0.1, -1.2])
    np.testing.assert_array_equal(lever_arm(run, "front"), [1.4, 0.0, -1.1])
    np.testing.assert_array_equal(lever_arm(run, "1,-2,0.5"), [1.0, -2.0, 0.5])
    with pytest.raises(ConfigError, match="did you mean front"):
        lever_arm(run, "frond")
    with pytest.raises(ConfigError, match="three numbers"):
        lever_arm(run, "1,2,x")


def test_the_command_writes_what_is_asked(run: Path, tmp_path: Path) -> None:
    times = tmp_path / "times.csv"
    times.write_text(f"frame,t_ns\n0,{T0 + 1_005_000_000}\n1,{T0 + 2_000_000_000}\n")
    target = tmp_path / "poses.csv"
    words = ["export", str(run), "--format", "trajectory-csv", "--at", str(times)]
    words += ["--point", "front", "--filtered", "-o", str(target)]
    assert run_command(words) == 0
    header, *rows = target.read_text().splitlines()
    assert len(rows) == 2
    first = dict(zip(header.split(","), rows[0].split(","), strict=True))
    assert int(first["t_ns"]) == T0 + 1_005_000_000
    assert float(first["sd_n_m"]) == pytest.approx(2.0, abs=0.01)
    for form in ("pos", "tum", "kitti", "gpx"):
        assert run_command(["export", str(run), "--format", form, "--at", str(times)]) == 0
    assert (run / "trajectory.gpx").read_text().count("<trkpt") == 2


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("frame\n1\n", "neither t_ns nor gps_s"),
        ("t_ns\n5\nabc\n", "line 3.*correct it"),
        ("t_ns\nabc\n", "not one usable row"),
        ("gps_s\n1.0\n", "1 of 1 instants lie outside"),
    ],
)
def test_instants_that_cannot_be_used_are_one_sentence(run: Path, text: str, said: str) -> None:
    times = run / "times.csv"
    times.write_text(text)
    with pytest.raises(InputError, match=said):
        export_run(run, "tum", None, TrajectoryView(at=times))


def test_signs_have_no_view_and_fixes_alone_no_filter(run: Path) -> None:
    with pytest.raises(ConfigError, match="format of signs"):
        export_run(run, "geojson", None, TrajectoryView(point="antenna"))
    (run / names.TRAJECTORY_FILTER).unlink()
    with pytest.raises(InputError, match="leave --filtered out"):
        export_run(run, "tum", None, TrajectoryView(filtered=True))


def test_an_antenna_nobody_measured_is_where_it_was_found(run: Path) -> None:
    from automap.io.tables import write_columns

    manifest = run.parent / "drive.toml"
    manifest.write_text('schema = "automap.drive/1"\n')
    with pytest.raises(InputError, match="the run estimated none"):
        lever_arm(run, "antenna")
    found = {
        f"gnss_lever_arm_{a}": np.array([0.0, v]) for a, v in zip("xyz", (1, 2, 3), strict=True)
    }
    write_columns(run / names.IMU_ERRORS, {"t_ns": np.array([0, 1]), **found})
    np.testing.assert_array_equal(lever_arm(run, "antenna"), [1.0, 2.0, 3.0])
