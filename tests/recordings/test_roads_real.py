"""Signs of real drives on road layers that are made from the reference path."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
import shapely
from pyproj import Transformer

from automap.evaluation.sign_matching import match, points_of
from automap.geolocation.locate import locate_signs
from automap.io.detections_csv import read_detections_csv
from automap.io.drive import load_drive
from automap.io.frame_times import frame_times
from automap.io.sign_points import read_sign_points
from automap.io.truth_trajectory import read_truth_trajectory
from automap.mapping.road_matching import road_positions
from automap.records import DrivePath, FloatArray, Roads, Sign


@dataclass
class Case:
    """A drive: its true path in metres, located signs and where these truly are."""

    name: str
    plane: Transformer
    path: DrivePath
    xy: FloatArray
    signs: list[Sign]
    true: FloatArray
    seen: list[tuple[float, float]]


@pytest.fixture(scope="module")
def cases(shared_data: Path) -> list[Case]:
    result = []
    for folder in sorted((shared_data / "drives").glob("kitti-*")):
        drive = load_drive(folder)
        reference = read_truth_trajectory(folder / "truth" / "trajectory.csv")
        one = np.ones((len(reference), 3))
        reference = replace(
            reference, sd_pos_ned=0.3 * one, sd_vel_ned=0.02 * one, sd_rpy=0.001 * one
        )
        video = drive.videos["front"]
        assert video.detections is not None
        found = read_detections_csv(video.detections, frame_times(video)).data
        located = locate_signs(reference, [found], drive.cameras()).signs
        truth = read_sign_points(folder / "truth" / "signs.geojson")
        pairs = match(points_of(located), truth, 5.0)
        plane = Transformer.from_crs(
            "OGC:CRS84",
            f"+proj=tmerc +lat_0={np.degrees(reference.lat_rad[0])} "
            f"+lon_0={np.degrees(reference.lon_rad[0])} +k=1 +ellps=WGS84",
            always_xy=True,
        )
        seconds = reference.t_ns * 1e-9
        path = DrivePath(
            seconds,
            reference.lat_rad,
            reference.lon_rad,
            reference.rpy[:, 2],
            1.0 * one,
        )
        xy = to_plane(plane, reference.lat_rad, reference.lon_rad)
        signs = [located[k] for k in pairs.estimate]
        true = to_plane(plane, truth.lat_rad[pairs.truth], truth.lon_rad[pairs.truth])
        seen = [(s.first_seen_ns * 1e-9, s.last_seen_ns * 1e-9) for s in signs]
        result.append(Case(drive.name, plane, path, xy, signs, true, seen))
    if not result:
        pytest.skip(f"no kitti-* drives in {shared_data / 'drives'}")
    return result


def to_plane(plane: Transformer, lat: FloatArray, lon: FloatArray) -> FloatArray:
    return np.column_stack(plane.transform(np.degrees(lon), np.degrees(lat)))


def to_roads(plane: Transformer, lines: list[FloatArray]) -> Roads:
    degrees = [
        np.column_stack(plane.transform(line[:, 0], line[:, 1], direction="INVERSE"))
        for line in lines
    ]
    names = [str(k) for k in range(len(lines))]
    return Roads(degrees, names, names, np.zeros(len(lines)))


def road_lines(xy: FloatArray, rng: np.random.Generator, split_m: float) -> list[FloatArray]:
    """Lines along the path, each stretch once however often it was driven, split every so many
    metres, half of them digitised against the drive."""
    step = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(xy, axis=0), axis=1))])
    at = np.arange(0.0, step[-1], 2.0)
    points = np.column_stack([np.interp(at, step, xy[:, k]) for k in range(2)])
    lines: list[FloatArray] = []
    run: list[FloatArray] = []
    laid = np.zeros((0, 2))
    for k, point in enumerate(points):
        # the last 60 m are what the car has just left behind
        old = laid[: max(len(laid) - 30, 0)]
        again = len(old) and np.linalg.norm(old - point, axis=1).min() < 12.0
        if again and run:
            nearest = old[np.linalg.norm(old - point, axis=1).argmin()]
            lines.append(np.array([*run, nearest]))
            run = []
        elif not again:
            if not run and len(old) and k:
                run.append(old[np.linalg.norm(old - point, axis=1).argmin()])
            run.append(point)
            laid = np.vstack([laid, point])
            if 2.0 * len(run) > split_m:
                lines.append(np.array(run))
                run = [point]
    if len(run) > 1:
        lines.append(np.array(run))
    result = []
    for line in lines:
        if len(line) < 2:
            continue
        simple = shapely.get_coordinates(shapely.simplify(shapely.linestrings(line), 0.3))
        result.append(simple[::-1] if rng.random() < 0.5 else simple)
    return result


def wandering(n: int, seconds: FloatArray, rng: np.random.Generator, sd: float) -> FloatArray:
    """An error [n, 2] with a time constant of 60 s, as fused satellite positions have it."""
    keep = np.exp(-np.diff(seconds, prepend=seconds[0]) / 60.0)
    value = sd * rng.standard_normal(2)
    result = np.empty((n, 2))
    for k in range(n):
        value = keep[k] * value + sd * np.sqrt(1.0 - keep[k] ** 2) * rng.standard_normal(2)
        result[k] = value
    return result


def score(case: Case, lines: list[FloatArray], base: int, rng: np.random.Generator) -> np.ndarray:
    """Per sign whether its foot point is within 5 m of the true one along the road, and its side.

    Of ``lines`` the first ``base`` are those that were driven; the truth is by shapely, from the
    true path and the sign's true place.
    """
    error = wandering(len(case.xy), case.path.gps_s, rng, 1.0)
    wrong = case.xy + error
    lon, lat = case.plane.transform(wrong[:, 0], wrong[:, 1], direction="INVERSE")
    path = replace(case.path, lat_rad=np.radians(lat), lon_rad=np.radians(lon))
    found, _ = road_positions(path, to_roads(case.plane, lines), case.signs, case.seen)
    shapes = shapely.linestrings
    geometry = [shapes(line) for line in lines]
    result = []
    for k, position in enumerate(found):
        if position is None:
            result.append((False, False))
            continue
        near = (case.path.gps_s > case.seen[k][0] - 5) & (case.path.gps_s < case.seen[k][1] + 10)
        rows = np.flatnonzero(near)
        row = rows[np.linalg.norm(case.xy[rows] - case.true[k], axis=1).argmin()]
        car = shapely.points(case.xy[row])
        own = int(np.argmin([shapely.distance(g, car) for g in geometry[:base]]))
        place = shapely.points(case.true[k])
        foot = shapely.line_interpolate_point(
            geometry[own], shapely.line_locate_point(geometry[own], place)
        )
        told = shapely.line_interpolate_point(geometry[position.road], position.chainage_m)
        chainage = position.road < base and shapely.distance(foot, told) < 5.0
        # the side by the true path, turned where the line runs against it
        yaw = case.path.yaw_rad[row]
        apart = case.true[k] - case.xy[row]
        right = apart[0] * np.cos(yaw) - apart[1] * np.sin(yaw) > 0.0
        line = geometry[position.road]
        one, two = (
            shapely.get_coordinates(shapely.line_interpolate_point(line, m))[0]
            for m in (max(position.chainage_m - 1, 0), position.chainage_m + 1)
        )
        along = (two - one) @ [np.sin(yaw), np.cos(yaw)] > 0.0
        result.append((chainage, position.side == ("right" if right == along else "left")))
    return np.array(result, bool).reshape(-1, 2)


@pytest.mark.parametrize("layer", ["true", "shifted", "parallel"])
def test_chainage_and_side_on_layers_made_from_the_true_path(cases: list[Case], layer: str) -> None:
    rng = np.random.default_rng(8)
    rows = []
    for case in cases:
        lines = road_lines(case.xy, rng, 150.0)
        base = len(lines)
        if layer == "shifted":
            lines = [line + np.array([2.5, -2.0]) for line in lines]
        if layer == "parallel":
            beside = [shapely.offset_curve(shapely.linestrings(line), 20.0) for line in lines]
            lines += [shapely.get_coordinates(g) for g in beside if not g.is_empty]
        rows.append(score(case, lines, base, rng))
    right = np.vstack(rows).mean(axis=0)
    assert right[0] >= 0.95
    assert right[1] >= 0.95
