"""Errors against truth, matching of signs, requirements, and the evaluate command's logic."""

from __future__ import annotations

import itertools
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from geolocation_scene import ORIGIN, drive_path
from hypothesis import given, settings
from hypothesis import strategies as st

from automap.earth import from_local_ned, local_ned
from automap.errors import ConfigError, InputError
from automap.evaluation.sign_matching import match, summarise_signs
from automap.evaluation.trajectory_errors import (
    path_length,
    raw_fix_errors,
    summarise_trajectory,
    trajectory_errors,
)
from automap.frames import rpy_to_matrix
from automap.interpolation import poses_at
from automap.io import names
from automap.io.tables import write_fixes
from automap.io.trajectory_table import to_columns, write_trajectory
from automap.records import NO_TIME, Fixes, SignPoints, Trajectory
from pipeline.evaluate.command import evaluate_run
from pipeline.evaluate.requirements import check_requirements


def every(trajectory: Trajectory, step: slice) -> Trajectory:
    return Trajectory(**{n: getattr(trajectory, n)[step] for n in Trajectory.__dataclass_fields__})


def points(
    ne: np.ndarray, class_name: str = "a", sd: float = 0.0, cov: float = np.nan
) -> SignPoints:
    ne = np.asarray(ne, np.float64).reshape(-1, 2)
    lat, lon, _ = from_local_ned(np.column_stack([ne, np.zeros(len(ne))]), (*ORIGIN[:2], 0.0))
    return SignPoints(
        lat_rad=np.reshape(lat, len(ne)),
        lon_rad=np.reshape(lon, len(ne)),
        class_name=np.full(len(ne), class_name, np.object_),
        cov_en=np.tile(cov * np.eye(2), (len(ne), 1, 1)),
        sd_m=np.full(len(ne), sd),
    )


# --- interpolation


def test_interpolation_follows_a_curve_between_coarse_rows() -> None:
    fine = drive_path(duration_s=20.0, turn_rate=0.3)
    coarse = every(fine, slice(None, None, 50))
    poses = poses_at(coarse, fine.t_ns[:1900])
    error = trajectory_errors(coarse, every(fine, slice(0, 1900))).error
    assert poses.covered.all()
    assert np.abs(error[:, :3]).max() < 2e-3
    assert np.abs(error[:, 6:9]).max() < 1e-6


def test_times_outside_and_in_long_gaps_are_not_covered() -> None:
    path = drive_path(duration_s=20.0)
    rows = np.r_[0:500, 1500:2000]
    broken = every(path, rows)
    query = path.t_ns[0] + np.array([-1, 2, 7, 16, 25]) * np.int64(1e9)
    poses = poses_at(broken, query)
    assert poses.covered.tolist() == [False, True, False, True, False]
    assert np.isnan(poses.lat_rad[[0, 2, 4]]).all()


def test_interpolation_across_the_date_line() -> None:
    path = drive_path(duration_s=4.0, turn_rate=0.0)
    lon = np.pi - 1e-6 + (path.lon_rad - path.lon_rad[0])
    wrapped = (lon + np.pi) % (2 * np.pi) - np.pi
    over = replace(path, lon_rad=wrapped)
    assert wrapped.min() < -3.0 < 3.0 < wrapped.max()
    middle = (over.t_ns[:-1] + over.t_ns[1:]) // 2
    poses = poses_at(over, middle)
    off = (poses.lon_rad - 0.5 * (lon[:-1] + lon[1:]) + np.pi) % (2 * np.pi) - np.pi
    assert np.abs(off).max() < 1e-12


# --- trajectory errors


def test_known_shifts_come_out_as_rms() -> None:
    truth = drive_path()
    shift = replace(
        truth,
        height_m=truth.height_m + 2.0,
        vel_ned=truth.vel_ned + np.array([0.1, -0.2, 0.3]),
        rpy=truth.rpy + np.radians([1.0, -2.0, 359.0]),
        sd_pos_ned=np.full((len(truth), 3), 2.0),
    )
    result = summarise_trajectory(trajectory_errors(shift, truth))
    assert result["position_rms_m"]["d"] == pytest.approx(2.0, abs=1e-6)
    assert result["position_rms_m"]["horizontal"] == pytest.approx(0.0, abs=1e-6)
    assert result["velocity_rms"]["e"] == pytest.approx(0.2)
    assert result["attitude_rms_deg"]["yaw"] == pytest.approx(1.0, abs=1e-6)
    assert result["attitude_mean_deg"]["yaw"] == pytest.approx(-1.0, abs=1e-6)
    assert result["sigma_ratio"]["d"] == pytest.approx(1.0, abs=1e-6)
    assert result["distance_m"] == pytest.approx(12.0 * 40.0, rel=1e-3)
    assert result["n_not_covered"] == 0


def test_honest_sigmas_give_ratios_and_nees_as_expected() -> None:
    rng = np.random.default_rng(0)
    truth = drive_path()
    noisy = replace(
        truth,
        height_m=truth.height_m - rng.normal(0, 0.5, len(truth)),
        vel_ned=truth.vel_ned + rng.normal(0, 0.02, (len(truth), 3)),
        rpy=truth.rpy + rng.normal(0, 0.001, (len(truth), 3)),
    )
    result = summarise_trajectory(trajectory_errors(noisy, truth))
    for name in ("d", "vn", "ve", "vd", "roll", "pitch", "yaw"):
        assert result["sigma_ratio"][name] == pytest.approx(1.0, abs=0.05)
    # seven components were disturbed with their sigma, north and east not at all
    assert result["nees_dof"] == 9
    assert result["nees_mean"] == pytest.approx(7.0, abs=0.3)


def test_truth_with_few_columns_and_by_gps_time() -> None:
    path = drive_path()
    bare = replace(
        every(path, slice(0, None, 20)),
        t_ns=np.full(200, NO_TIME),
        height_m=np.full(200, np.nan),
        vel_ned=np.full((200, 3), np.nan),
        rpy=np.full((200, 3), np.nan),
    )
    result = summarise_trajectory(trajectory_errors(path, bare))
    assert result["position_rms_m"]["horizontal"] == pytest.approx(0.0, abs=1e-6)
    assert result["position_rms_m"]["d"] is None
    assert result["attitude_rms_deg"]["yaw"] is None
    assert result["n_compared"] == 200


def test_epochs_without_an_estimate_are_counted() -> None:
    path = drive_path()
    errors = trajectory_errors(every(path, slice(1000, 3000)), path)
    assert errors.n_not_covered == 2000
    assert errors.span_s == pytest.approx(19.99)


def fixes_of(path: Trajectory, rows: np.ndarray, arm: np.ndarray) -> Fixes:
    """Fixes of an antenna ``arm`` [3] m from the path, the first of which is none."""
    offset = rpy_to_matrix(path.rpy[rows]) @ arm
    place = local_ned(path.lat_rad[rows], path.lon_rad[rows], path.height_m[rows], ORIGIN)
    lat, lon, height = from_local_ned(place + offset, ORIGIN)
    n = len(rows)
    return Fixes(
        gps_s=path.gps_s[rows],
        lat_rad=lat,
        lon_rad=lon,
        height_m=height,
        vel_ned=np.zeros((n, 3)),
        sd_pos_ned=np.ones((n, 3)),
        sd_vel_ned=np.ones((n, 3)),
        fix_type=np.r_[0, np.full(n - 1, 3)].astype(np.int64),
        n_sats=np.full(n, 9),
        hdop=np.ones(n),
        geoid_sep_m=np.zeros(n),
        offset=np.zeros(n, np.int64),
        arrival_ns=np.full(n, NO_TIME),
    )


def test_raw_fixes_are_reduced_by_the_lever_arm() -> None:
    path = drive_path()
    rows = np.arange(0, 4000, 100)
    arm = np.array([2.0, 0.0, 0.0])
    n, fixes = len(rows), fixes_of(path, rows, arm)
    error = raw_fix_errors(fixes, path, arm)
    assert len(error) == n - 1  # the epoch without a fix is not one
    assert np.abs(error).max() < 1e-3
    assert np.abs(raw_fix_errors(fixes, path, np.zeros(3))).max() > 1.0


def test_path_length_of_a_standstill_is_zero() -> None:
    path = drive_path(speed=0.0, turn_rate=0.0)
    assert path_length(path) == pytest.approx(0.0, abs=1e-6)


# --- matching


def best_by_trial(cost: np.ndarray, gate: float) -> float:
    """Least total cost of any one-to-one assignment, an unmatched row costing the gate."""
    n, m = cost.shape
    best = np.inf
    for columns in itertools.product(range(-1, m), repeat=n):
        used = [c for c in columns if c >= 0]
        if len(set(used)) != len(used):
            continue
        total = sum(gate if c < 0 else cost[r, c] for r, c in enumerate(columns))
        best = min(best, total)
    return best


@settings(max_examples=40)
@given(
    st.lists(st.tuples(st.floats(-8, 8), st.floats(-8, 8)), min_size=1, max_size=4),
    st.lists(st.tuples(st.floats(-8, 8), st.floats(-8, 8)), min_size=1, max_size=4),
    st.floats(1.0, 12.0),
)
def test_matching_is_the_best_of_all(
    a: list[tuple[float, float]], b: list[tuple[float, float]], gate: float
) -> None:
    one, other = np.array(a), np.array(b)
    distance = np.linalg.norm(one[:, None] - other[None], axis=2)
    distance[distance > gate] = gate
    pairs = match(points(one), points(other), gate)
    total = pairs.distance_m.sum() + gate * (len(one) - len(pairs))
    assert total == pytest.approx(best_by_trial(distance, gate), abs=1e-2)
    assert len(set(pairs.estimate)) == len(set(pairs.truth)) == len(pairs)


def test_matching_is_one_to_one_and_class_blind() -> None:
    truth = points([[0, 0], [20, 0]], "a")
    found = points([[0.5, 0], [1, 0], [20, 3]], "b")
    result = summarise_signs(found, truth)
    assert result["gates"]["1"] == {"recall": 0.5, "precision": pytest.approx(1 / 3)}
    assert result["gates"]["5"] == {"recall": 1.0, "precision": pytest.approx(2 / 3)}
    assert result["median_error_m"] == pytest.approx(1.75, abs=1e-3)
    assert result["class_accuracy"] == 0.0


def test_coverage_adds_the_error_of_the_truth() -> None:
    found = points([[2.0, 0.0]], cov=0.1)
    assert summarise_signs(found, points([[0, 0]], sd=0.0))["coverage95"] == 0.0
    assert summarise_signs(found, points([[0, 0]], sd=1.0))["coverage95"] == 1.0


def test_calibrated_covariances_cover_95_percent() -> None:
    rng = np.random.default_rng(4)
    grid = np.stack(np.meshgrid(np.arange(40), np.arange(25)), axis=-1).reshape(-1, 2) * 50.0
    found = points(grid + rng.normal(0, 1.0, grid.shape), cov=0.64)
    coverage = summarise_signs(found, points(grid, sd=0.6))["coverage95"]
    assert coverage == pytest.approx(0.95, abs=0.025)


@pytest.mark.parametrize(("n_found", "n_truth"), [(0, 0), (0, 3), (3, 0)])
def test_empty_maps(n_found: int, n_truth: int) -> None:
    grid = np.arange(3.0)[:, None] * [100.0, 0.0]
    result = summarise_signs(points(grid[:n_found]), points(grid[:n_truth]))
    assert result["gates"]["5"]["recall"] == (0.0 if n_truth else None)
    assert result["gates"]["5"]["precision"] == (0.0 if n_found else None)
    assert result["median_error_m"] is None
    json.dumps(result, allow_nan=False)


# --- requirements


def test_requirements() -> None:
    result = {"position_rms_m": {"horizontal": 1.1, "d": None}, "signs": {"gates": {"5": {"r": 1}}}}
    assert (
        check_requirements(result, ["position_rms_m.horizontal<1.25", "signs.gates.5.r>=1"]) == []
    )
    assert check_requirements(result, ["position_rms_m.horizontal<1.0"]) == [
        "position_rms_m.horizontal is 1.1, required < 1."
    ]
    assert "not known" in check_requirements(result, ["position_rms_m.d<9"])[0]


@pytest.mark.parametrize("text", ["", "a", "a<", "a=1", "position_rms_m<x", "a<1<2"])
def test_malformed_requirements(text: str) -> None:
    with pytest.raises(ConfigError, match="not understood"):
        check_requirements({"a": 1.0, "position_rms_m": 1.0}, [text])


def test_unknown_key_names_the_nearest() -> None:
    with pytest.raises(ConfigError, match=r"nearest known key is position_rms_m\.horizontal"):
        check_requirements({"position_rms_m": {"horizontal": 1.0}}, ["position_rms.horizontal<1"])


# --- evaluate a run


@pytest.fixture
def run_folder(tmp_path: Path) -> Path:
    """A drive with truth and a run in its default folder."""
    path = drive_path()
    truth = tmp_path / "drive" / names.TRUTH_DIR
    truth.mkdir(parents=True)
    columns = to_columns(every(path, slice(0, None, 10)))
    keep = ("t_ns", "lat_deg", "lon_deg", "height_m")
    lines = [",".join(keep)]
    lines += [
        ",".join(repr(v.item()) for v in row)
        for row in zip(*(columns[k] for k in keep), strict=True)
    ]
    (truth / names.TRUTH_TRAJECTORY).write_text("\n".join(lines) + "\n")
    out = truth.parent / names.DEFAULT_OUT
    out.mkdir()
    write_trajectory(out / names.TRAJECTORY, replace(path, height_m=path.height_m + 1.0))
    return out


def geojson(ne: list[list[float]], **properties: object) -> str:
    p = points(np.array(ne))
    features = [
        {
            "type": "Feature",
            "geometry": {"type": "Point", "coordinates": [np.degrees(lon), np.degrees(lat)]},
            "properties": {"class": "a", **properties},
        }
        for lat, lon in zip(p.lat_rad, p.lon_rad, strict=True)
    ]
    return json.dumps({"type": "FeatureCollection", "features": features})


def test_evaluate_writes_what_it_returns(run_folder: Path) -> None:
    truth = run_folder.parent / names.TRUTH_DIR
    (truth / names.TRUTH_SIGNS).write_text(geojson([[0, 0], [50, 0]], sd_m=0.7))
    found = geojson([[0, 1], [50, 4]], cov_ee_m2=1.0, cov_en_m2=0.0, cov_nn_m2=1.0)
    (run_folder / names.SIGNS_GEOJSON).write_text(found)
    result = evaluate_run(run_folder)
    assert json.loads((run_folder / names.EVALUATION).read_text()) == result
    assert result["position_rms_m"]["d"] == pytest.approx(1.0, abs=1e-6)
    assert result["velocity_rms"]["n"] is None
    assert result["signs"]["gates"]["2"] == {"recall": 0.5, "precision": 0.5}
    assert result["signs"]["coverage95"] == 0.5
    assert evaluate_run(run_folder, truth_sd=3.0)["signs"]["coverage95"] == 1.0


def test_a_truth_of_another_place_is_told(run_folder: Path) -> None:
    fixes = fixes_of(drive_path(), np.arange(0, 4000, 100), np.zeros(3))
    write_fixes(run_folder / names.FIXES, fixes)
    assert "warnings" not in evaluate_run(run_folder)
    truth = run_folder.parent / names.TRUTH_DIR / names.TRUTH_TRAJECTORY
    header, *lines = truth.read_text().splitlines()
    moved = [line.split(",") for line in lines]
    moved = [[t, str(float(lat) + 1e-3), lon, height] for t, lat, lon, height in moved]
    truth.write_text("\n".join([header, *(",".join(cells) for cells in moved)]) + "\n")
    (told,) = evaluate_run(run_folder)["warnings"]
    assert "path and fixes both lie far off the truth, 111 and 111 m: check that it is" in told


def test_evaluate_finds_the_drive_by_the_run_record(run_folder: Path, tmp_path: Path) -> None:
    elsewhere = tmp_path / "elsewhere"
    run_folder.rename(elsewhere)
    drive = {"name": "drive", "path": str(tmp_path / "drive")}
    (elsewhere / names.RUN).write_text(json.dumps({"drive": drive}))
    assert evaluate_run(elsewhere)["n_compared"] == 400


def test_evaluate_without_truth_says_so(run_folder: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no truth found"):
        evaluate_run(run_folder, tmp_path)
    with pytest.raises(InputError, match="no such output folder"):
        evaluate_run(tmp_path / "nowhere")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is empty"),
        ("t_ns,lat_deg\n1,2\n", "names no column lon_deg"),
        ("lat_deg,lon_deg\n1,2\n", "lacks t_ns or gps_s"),
        ("t_ns,lat_deg,lon_deg\n1,2,east\n", "line 2, column lon_deg: 'east'"),
        ("t_ns,lat_deg,lon_deg\n1,2,3\n", "no epoch of the truth"),
        ("t_ns,lat_deg,lon_deg\n", "not one usable row"),
    ],
)
def test_broken_truth_is_one_sentence(run_folder: Path, text: str, message: str) -> None:
    (run_folder.parent / names.TRUTH_DIR / names.TRUTH_TRAJECTORY).write_text(text)
    with pytest.raises(InputError, match=message):
        evaluate_run(run_folder)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[]",
        '{"features": 3}',
        '{"features": [1]}',
        '{"features": [{"geometry": {"type": "LineString", "coordinates": [[1, 2]]}}]}',
        '{"features": [{"geometry": {"type": "Point", "coordinates": [10, 95]}}]}',
        '{"features": [{"geometry": {"type": "Point", "coordinates": []}}]}',
    ],
)
def test_broken_truth_signs_are_one_sentence(run_folder: Path, text: str) -> None:
    (run_folder.parent / names.TRUTH_DIR / names.TRUTH_SIGNS).write_text(text)
    (run_folder / names.SIGNS_GEOJSON).write_text(geojson([[0, 0]]))
    with pytest.raises(InputError, match=r"signs\.geojson"):
        evaluate_run(run_folder)
