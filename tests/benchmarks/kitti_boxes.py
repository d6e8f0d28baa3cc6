"""What hand-drawn boxes of real signs say of the model of their errors, whatever the truth is.

    python tests/benchmarks/kitti_boxes.py [--data DIR]

With the reference trajectory of the KITTI drives, for all of them and for either half:

- how the residuals of boxes scatter about the signs (over their sigmas, and in pixels), how alike
  neighbours of a track are (with what the fits took), how many views count as one, and how many
  are beyond three robust sigmas;
- the nearest box of a sign, foretold with its covariance by the farther half of its boxes: how
  often it lies where 95 % should. This asks the covariance of distance, direction and size at once;
- bearings alone against heights with the usual size: the difference over its sigma;
- sizes of one class, which should differ by what their sds say: the ratio.
"""

from __future__ import annotations

import argparse
import os
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from automap.gates import OUTSIDE_95, gate, sd_by_median
from automap.geolocation import limits
from automap.geolocation.boresight import N_CAMERA
from automap.geolocation.class_sizes import sizes_of_others, usual_sizes
from automap.geolocation.landmark import (
    Landmark,
    SizePrior,
    columns_of,
    fit_landmark,
    seen_from,
    view_sd,
)
from automap.geolocation.landmark_kernels import N_COMMON
from automap.geolocation.locate import locate_signs
from automap.geolocation.pass_errors import equations, pass_sd, solve_with_pass_errors
from automap.geolocation.views import Views, build_views
from automap.io.detections_csv import read_detections_csv
from automap.io.drive import load_drive
from automap.io.frame_times import frame_times
from automap.io.trajectory_csv import read_trajectory_csv
from automap.records import FloatArray, IntArray
from tests.benchmarks.kitti_signs import SET_ASIDE

LEVER_ARM = slice(5, 8)
OFTEN = 6
"""Signs with so many views tell of scatter, and half of them foretell the nearest."""
STEP = 1e-6


@dataclass
class Seen:
    """What the signs of some drives tell: ``residual`` [n, 3] in sigmas and ``pixels`` [n, 3]
    (heights as parts) of each sign seen often; ``foretold`` squared distances of three degrees of
    freedom; ``apart`` of one; ``sizes`` logarithm and sd of the signs of a class."""

    residual: list[FloatArray] = field(default_factory=list)
    pixels: list[FloatArray] = field(default_factory=list)
    foretold: list[float] = field(default_factory=list)
    apart: list[float] = field(default_factory=list)
    sizes: dict[str, list[tuple[float, float]]] = field(default_factory=lambda: defaultdict(list))


def solved(views: Views, rows: IntArray, prior: SizePrior) -> Landmark:
    return solve_with_pass_errors(views, fit_landmark(views, rows, prior), prior)


def foretell_nearest(views: Views, rows: IntArray, prior: SizePrior) -> float:
    """Squared distance of the last box of a sign from where the first half of its boxes expect it,
    with the errors that all of them share."""
    last = rows[-1:]
    mark = solved(views, rows[: len(rows) // 2], prior)
    N, A, shared, *_ = equations(views, mark, mark.parameters, mark.pass_bias, prior)
    known = np.maximum(pass_sd(views, mark.rows), 1e-9) ** -2.0
    whole = np.linalg.inv(np.block([[N, A], [A.T, shared[:N_COMMON, :N_COMMON] + np.diag(known)]]))

    def expected(parameters: FloatArray) -> FloatArray:
        C, centre = views.C_cam_ref[mark.anchor], views.centre[mark.anchor]
        ray = np.array([1.0, parameters[0], parameters[1]]) * np.exp(parameters[2])
        box = seen_from(views, int(last[0]), centre + C.T @ ray, parameters[3])
        assert box is not None
        return np.array([box[0], box[1], box[3] - box[2]])

    here = expected(mark.parameters)
    J = np.column_stack([(expected(mark.parameters + STEP * e) - here) / STEP for e in np.eye(4)])
    by_common = columns_of(views, last, mark.anchor, mark.parameters)[0][0]
    F = np.hstack([J, by_common])
    covariance = F @ whole @ F.T + np.diag(view_sd(views, last)[0] ** 2)
    missing = views.measured[last[0]] - here - by_common @ mark.pass_bias
    return float(missing @ np.linalg.solve(covariance, missing))


def measured_size(views: Views, rows: IntArray, camera: FloatArray) -> tuple[float, float]:
    """Logarithm of a sign's size by its boxes and bearings, and its sd; ``camera`` [9, 9] the
    covariance of what was found out about the camera."""
    mark = solved(views, rows, SizePrior())
    by_camera = np.delete(mark.common[3, :N_CAMERA], LEVER_ARM)
    of_camera = np.delete(np.delete(camera, LEVER_ARM, 0), LEVER_ARM, 1)
    own = float(mark.covariance[3, 3] + mark.pass_covariance[3, 3])
    return float(mark.parameters[3]), float(np.sqrt(own + by_camera @ of_camera @ by_camera))


def size_ratio(sizes: dict[str, list[tuple[float, float]]]) -> tuple[float, int]:
    """Differences from the median of the others of a class over their sds: the robust scale of
    this, and how many there are."""
    ratios = []
    for members in sizes.values():
        size, sd = np.array(members).T
        for k in range(len(members) if len(members) > 3 else 0):
            others, their_sd = np.delete(size, k), float(np.median(np.delete(sd, k)))
            # the median of n has 1.25 / sqrt(n) of the sd of one
            total = np.hypot(sd[k], 1.25 * their_sd / np.sqrt(len(others)))
            ratios.append((size[k] - np.median(others)) / total)
    return sd_by_median(np.array(ratios)), len(ratios)


def bearings_less_heights(views: Views, mark: Landmark, prior: SizePrior) -> float:
    """Squared difference, in sigmas, of the logarithms of a sign's distance by the crossing of its
    bearings and by the heights of its boxes; nought where either alone leads nowhere."""
    if len(mark.rows) < 2:
        return 0.0
    any_size, aside = SizePrior(log_sd=SET_ASIDE), SET_ASIDE
    parts = [
        solved(replace(views, sd=views.sd * sd), mark.rows, known)
        for sd, known in (([1.0, 1.0, aside], any_size), ([aside, aside, 1.0], prior))
    ]
    if not all(part.ok for part in parts):
        return 0.0
    off = parts[0].parameters[2] - parts[1].parameters[2]
    return float(off**2 / sum(part.depth_log_sd**2 for part in parts))


def look_at(folder: Path, into: Sequence[Seen]) -> None:
    """Add what the signs of a drive tell."""
    drive = load_drive(folder)
    video, cameras = drive.videos["front"], drive.cameras()
    assert video.detections is not None
    found = read_detections_csv(video.detections, frame_times(video)).data
    trajectory = read_trajectory_csv(folder / "truth" / "trajectory.csv").data
    result = locate_signs(trajectory, [found], cameras)
    views = build_views(trajectory, [found], cameras, result.noise, result.corrections)
    track = result.observations.track[views.row]
    usable = result.observations.used[views.row]
    tracks = [np.flatnonzero(usable & (track == k)) for k in np.unique(track[usable])]
    general = SizePrior(by_class=usual_sizes(views.class_name.tolist()))
    marks = [solved(views, rows, general) for rows in tracks]
    focal = float(cameras["front"].matrix[0, 0])
    for mark, prior in zip(marks, sizes_of_others(views, marks, general), strict=True):
        mark = solved(views, mark.rows, prior)
        size = measured_size(views, mark.rows, result.corrections["front"].covariance)
        square = bearings_less_heights(views, mark, prior)
        often = len(mark.rows) >= OFTEN
        foretold = foretell_nearest(views, mark.rows, prior) if often else np.nan
        for seen in into:
            seen.sizes[str(views.class_name[mark.rows[0]])].append(size)
            seen.apart.append(square)
            if often:
                seen.residual.append(mark.residual)
                pixels = mark.residual * views.sd[mark.rows] * [focal, focal, 1.0]
                seen.pixels.append(pixels)
                seen.foretold.append(foretold)


def say(name: str, seen: Seen) -> None:
    joined, pixels = np.concatenate(seen.residual), np.concatenate(seen.pixels)
    robust = np.array([sd_by_median(column) for column in joined.T])
    clipped = [np.clip(r, -3.0 * robust, 3.0 * robust) for r in seen.residual]
    together = sum(np.sum(r[1:] * r[:-1], axis=0) for r in clipped)
    alone = sum(np.sum(r**2, axis=0) * (len(r) - 1) / len(r) for r in clipped)
    # what the fits took makes the residuals look less alike than the errors are
    alike = together / alone + limits.ABSORBED * len(clipped) / len(joined)
    as_one = (1.0 + alike) / (1.0 - alike)
    px = [sd_by_median(column) for column in pixels.T]
    tails = np.mean(np.abs(joined) > 3.0 * robust, axis=0)
    inside = np.mean(np.array(seen.foretold) <= gate(OUTSIDE_95, 3))
    apart = np.sqrt(seen.apart)
    ratio, n_sizes = size_ratio(seen.sizes)
    print(f"{name}: {len(joined)} boxes of {len(seen.residual)} signs; right, down, height:")
    print("  scatter over its sigma", np.round(np.sqrt(np.mean(joined**2, axis=0)), 2), end=", ")
    print(f"in px {px[0]:.2f} {px[1]:.2f}, of the height {px[2]:.3f}")
    print("  neighbours alike", np.round(alike, 2), "so count as one:", np.round(as_one, 1))
    print("  beyond 3 robust sigmas", np.round(tails, 3))
    print(f"  nearest box foretold within 95 %: {inside:.3f} of {len(seen.foretold)}")
    print(
        f"  bearings less heights over the sigma: {np.sqrt(np.mean(apart**2)):.2f} (rms), "
        f"{np.mean(apart**2 > gate(OUTSIDE_95, 1)):.3f} beyond 95 %"
    )
    print(f"  sizes within a class differ by {ratio:.2f} of what their sds say ({n_sizes} signs)")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", default=os.environ.get("AUTOMAP_SHARED_DATA", "../shared/data"))
    drives = sorted((Path(parser.parse_args().data) / "drives").glob("kitti-*"))
    every, halves = Seen(), (Seen(), Seen())
    for number, folder in enumerate(drives):
        look_at(folder, [every, halves[number % 2]])
    for name, seen in (("all", every), ("1st, 3rd, ...", halves[0]), ("2nd, 4th, ...", halves[1])):
        say(name, seen)


if __name__ == "__main__":
    main()
