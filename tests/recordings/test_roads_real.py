"""Signs of real drives, by their fused paths, on road layers made from the reference path."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import shapely
from pyogrio.raw import write
from pyproj import Transformer

from automap.evaluation.sign_matching import match, points_of
from automap.io.sign_points import read_sign_points
from automap.io.truth_trajectory import read_truth_trajectory
from automap.records import DrivePath, FloatArray
from pipeline.export.roads import signs_on_roads
from pipeline.run.registry import load_stages
from pipeline.run.runner import Request, run_drive
from pipeline.settings.load import load_settings
from pipeline.shared.products import RunProducts, load_products
from tests.recordings.test_kitti_signs import SHORT


@dataclass
class Case:
    """A drive: its true path in metres, what a run made of it, and where the signs truly are."""

    name: str
    plane: Transformer
    path: DrivePath
    xy: FloatArray
    products: RunProducts
    true: FloatArray


@pytest.fixture(scope="module")
def cases(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> list[Case]:
    """Short kitti drives, their paths fused from their own recordings."""
    return all_ran(shared_data, tmp_path_factory.mktemp("kitti"), short=True)


@pytest.fixture(scope="module")
def long_cases(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> list[Case]:
    """The others."""
    return all_ran(shared_data, tmp_path_factory.mktemp("kitti"), short=False)


def all_ran(shared_data: Path, root: Path, short: bool) -> list[Case]:
    """Runs of the short kitti drives or of all others."""
    folders = sorted((shared_data / "drives").glob("kitti-*"))
    folders = [folder for folder in folders if (folder.name in SHORT) is short]
    if not folders:
        pytest.skip(f"no kitti-* drives in {shared_data / 'drives'}")
    return [ran(folder, root) for folder in folders]


def ran(folder: Path, root: Path) -> Case:
    """A drive's run and truth."""
    stages = ("ingest", "sync", "fuse", "detect", "geolocate")
    request = Request(load_stages(stages), stages, load_settings())
    out = root / folder.name
    assert run_drive(folder, out, request).exit_code == 0
    return case_of(folder, out)


def case_of(folder: Path, out: Path) -> Case:
    """A run's located signs within 5 m of true ones, beside the truth."""
    reference = read_truth_trajectory(folder / "truth" / "trajectory.csv")
    truth = read_sign_points(folder / "truth" / "signs.geojson")
    products = load_products(out)
    located = products.signs or []
    pairs = match(points_of(located), truth, 5.0)
    products.signs = [located[k] for k in pairs.estimate]
    plane = Transformer.from_crs(
        "OGC:CRS84",
        f"+proj=tmerc +lat_0={np.degrees(reference.lat_rad[0])} "
        f"+lon_0={np.degrees(reference.lon_rad[0])} +k=1 +ellps=WGS84",
        always_xy=True,
    )
    places = reference.lat_rad, reference.lon_rad
    yaw, sd = reference.rpy[:, 2], np.ones((len(reference), 3))
    path = DrivePath(reference.gps_s, *places, yaw, sd)
    true = to_plane(plane, truth.lat_rad[pairs.truth], truth.lon_rad[pairs.truth])
    return Case(folder.name, plane, path, to_plane(plane, *places), products, true)


def to_plane(plane: Transformer, lat: FloatArray, lon: FloatArray) -> FloatArray:
    return np.column_stack(plane.transform(np.degrees(lon), np.degrees(lat)))


def write_roads(path: Path, plane: Transformer, lines: list[FloatArray]) -> Path:
    """The lines as a GeoPackage, in degrees, each with its number as id."""
    degrees = [
        np.column_stack(plane.transform(line[:, 0], line[:, 1], direction="INVERSE"))
        for line in lines
    ]
    numbers = [np.array([str(k) for k in range(len(lines))], object)]
    wkb = np.asarray(shapely.to_wkb([shapely.linestrings(line) for line in degrees]), object)
    write(path, geometry=wkb, field_data=numbers, fields=["road_id"], driver="GPKG",
          geometry_type="LineString", crs="EPSG:4326")  # fmt: skip
    return path


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


def score(case: Case, lines: list[FloatArray], base: int, file: Path) -> np.ndarray:
    """Per sign whether its foot point is within 5 m of the true one along the road, and its side.

    Of ``lines`` the first ``base`` are those that were driven; the truth is by shapely, from the
    true path and the sign's true place.
    """
    rows, _ = signs_on_roads(case.products, write_roads(file, case.plane, lines))
    by_sign = {row["sign_id"]: row for row in rows}
    clock = case.products.clock
    assert clock is not None
    geometry = [shapely.linestrings(line) for line in lines]
    result = []
    for sign, true in zip(case.products.signs or [], case.true, strict=True):
        row = by_sign.get(sign.id)
        if row is None:
            result.append((False, False))
            continue
        first, last = clock.gps_s(np.array([sign.first_seen_ns, sign.last_seen_ns]))
        near = np.flatnonzero((case.path.gps_s > first - 5) & (case.path.gps_s < last + 10))
        at = near[np.linalg.norm(case.xy[near] - true, axis=1).argmin()]
        car, place = shapely.points(case.xy[at]), shapely.points(true)
        own = int(np.argmin([shapely.distance(g, car) for g in geometry[:base]]))
        foot = shapely.line_interpolate_point(
            geometry[own], shapely.line_locate_point(geometry[own], place)
        )
        line, along_m = geometry[int(row["road_id"])], float(row["chainage_m"])
        told = shapely.line_interpolate_point(line, along_m)
        chainage = int(row["road_id"]) < base and shapely.distance(foot, told) < 5.0
        # the side by the true path, turned where the line runs against it
        yaw = case.path.yaw_rad[at]
        apart = true - case.xy[at]
        right = apart[0] * np.cos(yaw) - apart[1] * np.sin(yaw) > 0.0
        one, two = (
            shapely.get_coordinates(shapely.line_interpolate_point(line, m))[0]
            for m in (max(along_m - 1, 0), along_m + 1)
        )
        along = (two - one) @ [np.sin(yaw), np.cos(yaw)] > 0.0
        result.append((chainage, row["road_side"] == ("right" if right == along else "left")))
    return np.array(result, bool).reshape(-1, 2)


LAYERS = ("true", "shifted", "parallel")


@pytest.mark.slow
@pytest.mark.parametrize("layer", LAYERS)
def test_chainage_and_side_on_layers_made_from_the_true_path(
    cases: list[Case], layer: str, tmp_path: Path
) -> None:
    check(cases, layer, tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("layer", LAYERS)
def test_chainage_and_side_on_layers_of_all_drives(
    cases: list[Case], long_cases: list[Case], layer: str, tmp_path: Path
) -> None:
    check([*cases, *long_cases], layer, tmp_path)


def check(cases: list[Case], layer: str, tmp_path: Path) -> None:
    """Nineteen of twenty signs are on the right road at the right place, and on the right side."""
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
        rows.append(score(case, lines, base, tmp_path / f"{case.name}.gpkg"))
    right = np.vstack(rows).mean(axis=0)
    assert right[0] >= 0.95
    assert right[1] >= 0.95
