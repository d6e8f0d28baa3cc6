"""Signs of the KITTI drives against their true places.

    python tests/benchmarks/kitti_signs.py [--data DIR] [--runs RUNS]

With the reference trajectory; with ``--runs`` also the maps that ``automap run DRIVE -o RUNS/NAME``
made with trajectories of their own. Prints the figures, and every sign outside its 95 % ellipse
with what its boxes say of both places: how far off the direction is (first view to last, deg) and
how large the sign would have to be (first view to last, m). A sign keeps its size while a car
drives up to it, and a direction is good to some tenths of a degree.

True places are said to be good to 0.7 m, taken as one sigma an axis. Some are not: a place is
called contradicted where the bearings alone of a sign's boxes, from the reference trajectory, cross
elsewhere, by more than chance allows one time in a thousand. The figures stand for all signs,
and for those whose place is not contradicted, each for all drives and for either half of them.
``kitti_boxes.py`` asks the covariances without any true place.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from automap.earth import local_ned
from automap.evaluation.sign_matching import match, points_of
from automap.gates import OUTSIDE_95, gate
from automap.geolocation.landmark import SizePrior, fit_landmark
from automap.geolocation.locate import locate_signs
from automap.geolocation.pass_errors import solve_with_pass_errors
from automap.geolocation.sightings import make_sighting
from automap.geolocation.views import Views, build_views
from automap.io.detections_csv import read_detections_csv
from automap.io.drive import load_drive
from automap.io.frame_times import frame_times
from automap.io.sign_points import read_sign_points
from automap.io.trajectory_csv import read_trajectory_csv
from automap.records import FloatArray, IntArray, Sign, SignPoints

PAIR_M, LOST_M, NEAR_M = 15.0, 10.0, 2.0
CONTRADICTED = 1e-3
SET_ASIDE = 100.0
"""Factor on sigmas that leaves a measurement without a say: 0.2 deg become 20."""


@dataclass(frozen=True)
class Pair:
    """A located sign and its true place: ``square`` of the error over both covariances, ``ce95_m``
    of the sign alone, ``place`` the true one's number in its drive."""

    half: int
    drive: str
    place: int
    distance_m: float
    square: float
    ce95_m: float
    status: str


def said_of(views: Views, rows: IntArray, place: FloatArray) -> str:
    """What boxes say of a place [3]: error of direction and size in the first and last view."""
    ends = rows[[0, -1]]
    q = np.einsum("nij,nj->ni", views.C_cam_ref[ends], place - views.centre[ends])
    off = np.degrees(np.arctan(views.measured[ends, 0]) - np.arctan2(q[:, 1], q[:, 0]))
    size = np.exp(views.measured[ends, 2]) * q[:, 0]
    return f"{off[0]:+.1f} to {off[1]:+.1f} deg, {size[0]:.2f} to {size[1]:.2f} m"


def by_bearings(views: Views, rows: IntArray, camera: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Place [3] of a sign by the bearings of its boxes alone, and its covariance [3, 3]; ``camera``
    [9, 9] of what was found out about the camera."""
    blind = replace(views, sd=views.sd * [1.0, 1.0, SET_ASIDE])
    prior = SizePrior(log_sd=SET_ASIDE)
    mark = solve_with_pass_errors(blind, fit_landmark(blind, rows, prior), prior)
    return mark.position, make_sighting(blind, mark, [camera]).covariance


def pairs_of(
    signs: SignPoints, status: Sequence[str], truth: SignPoints, half: int, drive: str
) -> list[Pair]:
    found = match(signs, truth, PAIR_M)
    result = []
    for i, j, distance in zip(found.estimate, found.truth, found.distance_m, strict=True):
        origin = (float(truth.lat_rad[j]), float(truth.lon_rad[j]), 0.0)
        error = local_ned(signs.lat_rad[i : i + 1], signs.lon_rad[i : i + 1], np.zeros(1), origin)
        east_north = error[0, [1, 0]]
        both = signs.cov_en[i] + truth.sd_m[j] ** 2 * np.eye(2)
        square = float(east_north @ np.linalg.solve(both, east_north))
        longest = float(np.sqrt(gate(OUTSIDE_95, 2) * np.linalg.eigvalsh(signs.cov_en[i])[-1]))
        result.append(Pair(half, drive, int(j), distance, square, longest, str(status[i])))
    return result


def with_reference(folder: Path, half: int) -> tuple[list[Pair], set[tuple[str, int]]]:
    """Pairs of a drive with its reference trajectory, and the true places that are contradicted;
    prints those outside."""
    drive = load_drive(folder)
    video, cameras = drive.videos["front"], drive.cameras()
    assert video.detections is not None
    found = read_detections_csv(video.detections, frame_times(video)).data
    trajectory = read_trajectory_csv(folder / "truth" / "trajectory.csv").data
    result = locate_signs(trajectory, [found], cameras)
    views = build_views(trajectory, [found], cameras, result.noise, result.corrections)
    truth = read_sign_points(folder / "truth" / "signs.geojson")
    signs = points_of(result.signs)
    pairs = pairs_of(signs, [s.status for s in result.signs], truth, half, drive.name)
    there = local_ned(truth.lat_rad, truth.lon_rad, np.zeros(len(truth)), views.origin)
    matched = match(signs, truth, PAIR_M)
    contradicted = set()
    for i, pair in zip(matched.estimate, pairs, strict=True):
        sign: Sign = result.signs[i]
        rows = np.flatnonzero(np.isin(views.row, sign.detection_rows))
        crossing, cov = by_bearings(views, rows, result.corrections["front"].covariance)
        error = (crossing - there[pair.place])[:2]
        both = cov[:2, :2] + truth.sd_m[pair.place] ** 2 * np.eye(2)
        square = float(error @ np.linalg.solve(both, error))
        if square > gate(CONTRADICTED, 2):
            contradicted.add((drive.name, pair.place))
        if pair.square > gate(OUTSIDE_95, 2):
            where = np.array([[sign.lat_rad], [sign.lon_rad], [sign.height_m]])
            here = local_ned(*where, views.origin)[0]
            place = np.array([*there[pair.place, :2], here[2]])
            print(
                f"{drive.name} {sign.id} {pair.distance_m:.1f} m off, {sign.n_views} views; "
                f"located: {said_of(views, rows, here)}; true: {said_of(views, rows, place)}; "
                f"bearings alone are {np.hypot(*error):.1f} m and {np.sqrt(square):.1f} sigmas "
                "from the true place"
            )
    return pairs, contradicted


def of_run(run: Path, folder: Path, half: int) -> list[Pair]:
    import json

    features = json.loads((run / "signs.geojson").read_text(encoding="utf-8"))["features"]
    truth = read_sign_points(folder / "truth" / "signs.geojson")
    status = [str(feature["properties"]["status"]) for feature in features]
    return pairs_of(read_sign_points(run / "signs.geojson"), status, truth, half, folder.name)


def say(name: str, pairs: list[Pair], contradicted: set[tuple[str, int]]) -> None:
    for which in ("all", "1st, 3rd, ...", "2nd, 4th, ..."):
        half = [p for p in pairs if which == "all" or p.half == ("1", "2").index(which[0])]
        fair = [p for p in half if (p.drive, p.place) not in contradicted]
        distance = [p.distance_m for p in half]
        inside, fairly = (
            np.mean([p.square <= gate(OUTSIDE_95, 2) for p in g]) for g in (half, fair)
        )
        lost = sum(p.distance_m > LOST_M and p.status == "ok" for p in half)
        print(
            f"{name}, {which}: {len(half)} signs, median error {np.median(distance):.2f} m, within "
            f"{NEAR_M:g} m {np.mean(np.array(distance) <= NEAR_M):.3f}, in the 95 % ellipse "
            f"{inside:.3f}; without the {len(half) - len(fair)} contradicted places {fairly:.3f}; "
            f"median half axis of the ellipses {np.median([p.ce95_m for p in half]):.2f} m; "
            f"beyond {LOST_M:g} m without a flag {lost}"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", default=os.environ.get("AUTOMAP_SHARED_DATA", "../shared/data"))
    parser.add_argument("--runs", type=Path)
    arguments = parser.parse_args()
    contradicted: set[tuple[str, int]] = set()
    reference: list[Pair] = []
    own: list[Pair] = []
    folders = sorted((Path(arguments.data) / "drives").glob("kitti-*"))
    for number, folder in enumerate(folders):
        pairs, wrong = with_reference(folder, number % 2)
        reference += pairs
        contradicted |= wrong
        if arguments.runs:
            own += of_run(arguments.runs / folder.name, folder, number % 2)
    say("reference trajectory", reference, contradicted)
    if own:
        say("own trajectories", own, contradicted)


if __name__ == "__main__":
    main()
