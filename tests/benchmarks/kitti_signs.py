"""Signs of the KITTI drives against their true places, with the reference trajectory.

    python tests/benchmarks/kitti_signs.py [--data DIR]

Prints the figures, and every sign outside its 95 % ellipse with what its boxes say of both places:
how far off the direction is (first view to last, deg) and how large the sign would have to
be (first view to last, m). A sign keeps its size while a car drives up to it, so a place where
it would have to shrink to a third is not the sign's. Two measurements that know nothing of one
another stand beside: the distance in the nearest view by the bearings alone, and by the height of
the box and the usual size of the other signs of the class alone. ``automap evaluate`` gives the
figures of runs with their own trajectory.

The truth's own sd of 0.7 m is taken as one sigma an axis, as its name says; the coverage with 0.7 m
for both axes together is printed too.

Signs of a class are alike in size, so their measured sizes, and with them the ranges, should differ
by what their sds say, whatever the true places are: the ratio is printed last.
"""

from __future__ import annotations

import argparse
import os
from dataclasses import replace
from pathlib import Path

import numpy as np

from automap.earth import local_ned
from automap.evaluation.sign_matching import match, points_of
from automap.geolocation.boresight import N_CAMERA
from automap.geolocation.landmark import SizePrior, fit_landmark
from automap.geolocation.locate import locate_signs
from automap.geolocation.pass_errors import solve_with_pass_errors
from automap.geolocation.views import Views, build_views
from automap.io.detections_csv import read_detections_csv
from automap.io.drive import load_drive
from automap.io.frame_times import frame_times
from automap.io.sign_points import read_sign_points
from automap.io.trajectory_csv import read_trajectory_csv
from automap.records import FloatArray, IntArray

LIMIT = -2.0 * np.log(0.05)
LEVER_ARM_SD_M = 0.3
LEVER_ARM = slice(5, 8)


def said_of(views: Views, rows: IntArray, place: FloatArray) -> str:
    """What boxes say of a place [3]: error of direction and size in the first and last view."""
    ends = rows[[0, -1]]
    q = np.einsum("nij,nj->ni", views.C_cam_ref[ends], place - views.centre[ends])
    off = np.degrees(np.arctan(views.measured[ends, 0]) - np.arctan2(q[:, 1], q[:, 0]))
    size = np.exp(views.measured[ends, 2]) * q[:, 0]
    return f"{off[0]:+.1f} to {off[1]:+.1f} deg, {size[0]:.2f} to {size[1]:.2f} m"


def by_bearings(views: Views, rows: IntArray) -> float:
    """Distance (m) along the axis of the nearest view, by bearings alone."""
    blind = replace(views, sd=views.sd * [1.0, 1.0, 1e4])
    prior = SizePrior(log_sd=5.0)
    return solve_with_pass_errors(
        blind, fit_landmark(blind, rows, prior), prior, LEVER_ARM_SD_M
    ).depth_m


def measured_size(views: Views, rows: IntArray, camera: FloatArray) -> tuple[float, float]:
    """Logarithm of a sign's size by its boxes and bearings, and its sd; ``camera`` [9, 9] the
    covariance of what was found out about the camera."""
    prior = SizePrior()
    mark = solve_with_pass_errors(views, fit_landmark(views, rows, prior), prior, LEVER_ARM_SD_M)
    by_camera = np.delete(mark.common[3, :N_CAMERA], LEVER_ARM)
    of_camera = np.delete(np.delete(camera, LEVER_ARM, 0), LEVER_ARM, 1)
    own = float(mark.covariance[3, 3] + mark.pass_covariance[3, 3])
    return float(mark.parameters[3]), float(np.sqrt(own + by_camera @ of_camera @ by_camera))


def size_ratio(sizes: dict[str, list[tuple[float, float]]]) -> tuple[float, int]:
    """Differences from the median of the others of a class over their sds: the robust scale of
    this (1.4826 times the median), and how many there are."""
    ratios = []
    for members in sizes.values():
        size, sd = np.array(members).T
        for k in range(len(members) if len(members) > 3 else 0):
            others, their_sd = np.delete(size, k), float(np.median(np.delete(sd, k)))
            # the median of n has 1.25 / sqrt(n) of the sd of one
            total = np.hypot(sd[k], 1.25 * their_sd / np.sqrt(len(others)))
            ratios.append(abs(size[k] - np.median(others)) / total)
    return 1.4826 * float(np.median(ratios)), len(ratios)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", default=os.environ.get("AUTOMAP_SHARED_DATA", "../shared/data"))
    sizes: dict[str, list[tuple[float, float]]] = {}
    outside: list[tuple[str, str, float, float, float, float]] = []
    tighter: list[bool] = []
    distances, squares, hits, lost, n_found, n_truth = [], [], 0, 0, 0, 0
    for folder in sorted((Path(parser.parse_args().data) / "drives").glob("kitti-*")):
        drive = load_drive(folder)
        video = drive.videos["front"]
        assert video.detections is not None
        found = read_detections_csv(video.detections, frame_times(video)).data
        trajectory = read_trajectory_csv(folder / "truth" / "trajectory.csv").data
        result = locate_signs(trajectory, [found], drive.cameras())
        located, truth = points_of(result.signs), read_sign_points(folder / "truth/signs.geojson")
        views = build_views(trajectory, [found], drive.cameras(), result.noise, result.corrections)
        for sign in result.signs:
            rows = np.flatnonzero(np.isin(views.row, sign.detection_rows))
            size = measured_size(views, rows, result.corrections["front"].covariance)
            sizes.setdefault(sign.class_name, []).append(size)
        pairs = match(located, truth, 15.0)
        zero = np.zeros(len(truth))
        there = local_ned(truth.lat_rad, truth.lon_rad, zero, views.origin)
        for i, j, distance in zip(pairs.estimate, pairs.truth, pairs.distance_m, strict=True):
            sign = result.signs[i]
            height = np.array([sign.height_m])
            here = local_ned(
                located.lat_rad[i : i + 1], located.lon_rad[i : i + 1], height, views.origin
            )[0]
            error = (here - there[j])[[1, 0]]
            own, known = located.cov_en[i], truth.sd_m[j] ** 2 * np.eye(2)
            square = float(error @ np.linalg.solve(own + known, error))
            squares.append(square)
            tighter.append(bool(error @ np.linalg.solve(own + 0.5 * known, error) <= LIMIT))
            if square > LIMIT:
                rows = np.flatnonzero(np.isin(views.row, sign.detection_rows))
                place = np.array([*there[j, :2], here[2]])
                nearest = int(rows[np.argmax(views.measured[rows, 2])])
                text = (
                    f"{drive.name} {sign.id} {distance:.1f} m off, {sign.n_views} views; "
                    f"located: {said_of(views, rows, here)}; true: {said_of(views, rows, place)}"
                )
                depth = [
                    float((views.C_cam_ref[nearest] @ (p - views.centre[nearest]))[0])
                    for p in (here, place)
                ]
                angle = float(np.exp(views.measured[nearest, 2]))
                outside.append((text, sign.class_name, by_bearings(views, rows), angle, *depth))
        distances += pairs.distance_m.tolist()
        hits += len(match(located, truth, 2.0))
        near = match(located, truth, 10.0).estimate
        lost += sum(s.status == "ok" and k not in near for k, s in enumerate(result.signs))
        n_found, n_truth = n_found + len(located), n_truth + len(truth)
    for text, name, bearings, angle, here_m, true_m in outside:
        size_m = float(np.exp(np.median([size for size, _ in sizes[name]])))
        print(
            f"{text}; distance located {here_m:.1f} m, by bearings alone {bearings:.1f}, "
            f"by the class's size alone {size_m / angle:.1f}, true {true_m:.1f}"
        )
    print(
        f"median error {np.median(distances):.3f} m, within 2 m {hits / n_truth:.3f} of {n_truth}, "
        f"in the 95 % ellipse {np.mean(np.array(squares) <= LIMIT):.3f} of {len(squares)} "
        f"(with 0.7 m for both axes together {np.mean(tighter):.3f}), "
        f"beyond 10 m without a flag {lost} of {n_found}"
    )
    ratio, n_sizes = size_ratio(sizes)
    print(f"sizes within a class differ by {ratio:.2f} of what their sds say ({n_sizes} signs)")


if __name__ == "__main__":
    main()
