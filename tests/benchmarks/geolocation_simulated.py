"""Geolocation on simulated drives, against the right association and the true camera.

    python tests/benchmarks/geolocation_simulated.py [--drives N] [--first SEED] [--seconds S]
        [--path-sd M] [--alike R] [--freedom N] [--odd SHARE]

Clutter, wrong classes and missed views; the camera is turned by up to 5 deg and late by up to
0.3 s; the trajectory's error wanders (second-order Gauss-Markov). The bound is that of Cramer
and Rao for every sign by itself, given association, camera and the statistics of all errors;
the oracle is the estimate that reaches it, on the same boxes and trajectory. Where the
trajectory itself is metres off, so is the oracle: its precision and recall stand beside ours.
The camera's turn against the trajectory has a bound too (``mounting_bound.py``), since the
trajectory's own mean attitude error looks like a turn.
"""

from __future__ import annotations

import argparse

import numpy as np

from automap.earth import from_local_ned, local_ned
from automap.evaluation.sign_matching import match, points_of, summarise_signs
from automap.frames import matrix_to_rpy, rpy_to_matrix
from automap.gates import OUTSIDE_95, gate
from automap.geolocation.landmark import SizePrior
from automap.geolocation.locate import locate_signs
from automap.geolocation.result import GeolocationResult
from automap.geolocation.views import MeasurementNoise, build_views
from automap.records import BoolArray, FloatArray, SignPoints
from tests.benchmarks.geolocation_world import (
    ORIGIN,
    Difficulty,
    World,
    make_world,
    true_points,
)
from tests.benchmarks.mounting_bound import mounting_bound

_SIZE = SizePrior()


def _measured_by_place(q: FloatArray) -> FloatArray:
    """Derivative [n, 3, 3] of right, down and log height by the place [n, 3] in camera axes."""
    J = np.zeros((len(q), 3, 3))
    J[:, 0, 0], J[:, 0, 1] = -q[:, 1] / q[:, 0] ** 2, 1.0 / q[:, 0]
    J[:, 1, 0], J[:, 1, 2] = -q[:, 2] / q[:, 0] ** 2, 1.0 / q[:, 0]
    J[:, 2, 0] = -1.0 / q[:, 0]
    return J


def oracle(world: World, d: Difficulty) -> tuple[FloatArray, FloatArray]:
    """The best linear estimate of each sign: errors [m, 2] north, east and covariances [m, 2, 2].

    Association, camera and all statistics are given, those of the trajectory's error (constant
    through a pass, independent after minutes) among them; every sign by itself. The
    covariance is the bound of Cramer and Rao at the true place, the error is this drive's.
    """
    views = build_views(
        world.trajectory, [world.detections], {"front": world.true_camera}, MeasurementNoise()
    )
    focal = float(world.true_camera.matrix[0, 0])
    owner = world.owner[views.row]
    lat, lon, height = from_local_ned(world.position, ORIGIN)
    place = local_ned(lat, lon, height, views.origin)
    error = np.full((len(place), 2), np.nan)
    covariance = np.full((len(place), 2, 2), np.nan)
    position_sd = np.array([d.position_sd, d.position_sd, d.height_sd])
    attitude_sd = np.radians([d.tilt_sd, d.tilt_sd, d.yaw_sd])
    for sign in range(len(place)):
        rows = np.flatnonzero(owner == sign)
        n = len(rows)
        if n == 0:
            continue
        C = views.C_cam_ref[rows]
        q = np.einsum("nij,nj->ni", C, place[sign] - views.centre[rows])
        by_camera = _measured_by_place(q)
        by_place = by_camera @ C
        C_cb = views.C_cam_body[rows]
        q_body = np.einsum("nji,nj->ni", C_cb, q)
        by_attitude = by_camera @ C_cb @ _cross(q_body)
        tall = focal * world.size[sign] / q[:, 0]
        box = np.hypot(d.box_px, d.box_share * tall)
        R = np.diag(np.column_stack([box / focal, box / focal, box / tall]).ravel() ** 2)
        apart = np.abs(views.t_ns[rows, None] - views.t_ns[None, rows]) * 1e-9 * 2.0 / d.tau_s
        alike = (1.0 + apart) * np.exp(-apart)
        for J, sd in ((by_place, position_sd), (by_attitude, attitude_sd)):
            scaled = J * sd
            both = np.einsum("iak,jbk,ij->iajb", scaled, scaled, alike)
            R += both.reshape(3 * n, 3 * n)
        H = np.zeros((3 * n, 4))
        H[:, :3] = by_place.reshape(3 * n, 3)
        H[2::3, 3] = 1.0
        expected = np.column_stack([q[:, 1:] / q[:, :1], np.log(world.size[sign] / q[:, 0])])
        missing = (views.measured[rows] - expected).ravel()
        weighted = np.linalg.solve(R, np.column_stack([H, missing]))
        N = H.T @ weighted[:, :4]
        N[3, 3] += _SIZE.log_sd**-2
        g = H.T @ weighted[:, 4]
        g[3] -= np.log(world.size[sign] / _SIZE.size_m) / _SIZE.log_sd**2
        cov = np.linalg.inv(N)
        error[sign], covariance[sign] = (cov @ g)[:2], cov[:2, :2]
    return error, covariance


def oracle_points(world: World, seen: BoolArray, error: FloatArray) -> SignPoints:
    """The oracle's signs: those ``seen`` [n], with their errors [m, 2] north, east."""
    place = world.position[seen] + np.column_stack([error, np.zeros(len(error))])
    lat, lon, _ = from_local_ned(place, ORIGIN)
    n = len(place)
    names = np.array(world.class_name, np.object_)[seen]
    return SignPoints(
        np.asarray(lat), np.asarray(lon), names, np.full((n, 2, 2), np.nan), np.zeros(n)
    )


def _cross(v: FloatArray) -> FloatArray:
    """Matrices [n, 3, 3] of the cross product with v [n, 3]."""
    M = np.zeros((len(v), 3, 3))
    M[:, 0, 1], M[:, 0, 2], M[:, 1, 2] = -v[:, 2], v[:, 1], -v[:, 0]
    return M - np.swapaxes(M, 1, 2)


def figures(world: World, result: GeolocationResult, d: Difficulty) -> dict[str, float]:
    """What the acceptance asks for; recall over the signs with two boxes or more."""
    seen = np.bincount(world.owner[world.owner >= 0], minlength=len(world.position)) >= 2
    truth = true_points(world)
    found = points_of(result.signs)
    summary = summarise_signs(found, truth)
    pairs = match(found, truth, 15.0)
    all_best, all_bound = oracle(world, d)
    best, bound = (values[seen][pairs.truth] for values in (all_best, all_bound))
    tilt = (world.trajectory.rpy - world.true.rpy + np.pi) % (2.0 * np.pi) - np.pi
    tilt_at_boxes = np.degrees(tilt[np.searchsorted(world.true.t_ns, world.detections.t_ns) - 1])
    camera = result.corrections["front"]
    turned = matrix_to_rpy(rpy_to_matrix(world.camera.mount_rpy) @ rpy_to_matrix(camera.turn))
    off = np.degrees(turned - world.true_camera.mount_rpy)
    least, _ = mounting_bound(world, d)
    told = oracle_points(world, seen, all_best[seen])
    return {
        "signs": float(seen.sum()),
        "precision_3m": summary["gates"]["3"]["precision"],
        "recall_3m": summary["gates"]["3"]["recall"],
        "oracle_recall_3m": len(match(told, truth, 3.0)) / len(truth),
        "rms_m": float(np.sqrt(np.mean(pairs.distance_m**2))),
        "oracle_rms_m": float(np.sqrt(np.mean(np.sum(best**2, axis=1)))),
        "bound_rms_m": float(np.sqrt(np.mean(np.trace(bound, axis1=1, axis2=2)))),
        "coverage95": summary["coverage95"],
        "long_half_axis_m": float(
            np.sqrt(gate(OUTSIDE_95, 2) * np.median(np.linalg.eigvalsh(found.cov_en)[:, -1]))
        ),
        "class_accuracy": summary["class_accuracy"],
        "roll_error_deg": float(off[0]),
        "pitch_error_deg": float(off[1]),
        "yaw_error_deg": float(off[2]),
        "roll_bound_deg": float(np.degrees(least[0])),
        "pitch_bound_deg": float(np.degrees(least[1])),
        "yaw_bound_deg": float(np.degrees(least[2])),
        "trajectory_yaw_error_deg": float(tilt_at_boxes[:, 2].mean()),
        "both_roll_errors_deg": float(off[0] + tilt_at_boxes[:, 0].mean()),
        "both_pitch_errors_deg": float(off[1] + tilt_at_boxes[:, 1].mean()),
        "both_yaw_errors_deg": float(off[2] + tilt_at_boxes[:, 2].mean()),
        "time_error_s": camera.time_s - world.true_camera.time_offset_s,
        "time_bound_s": float(least[3]),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--drives", type=int, default=4)
    parser.add_argument("--first", type=int, default=0, help="seed of the first drive")
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--path-sd", type=float, default=1.0, help="of the trajectory, m an axis")
    parser.add_argument("--alike", type=float, default=0.0)
    parser.add_argument("--freedom", type=float, default=np.inf)
    parser.add_argument("--odd", type=float, default=0.0)
    arguments = parser.parse_args()
    rows = []
    for seed in range(arguments.first, arguments.first + arguments.drives):
        rng = np.random.default_rng(1000 + seed)
        difficulty = Difficulty(
            mount_deg=tuple(rng.uniform([-3, -5, -5], [3, 5, 5])),
            late_s=float(rng.uniform(-0.3, 0.3)),
            duration_s=arguments.seconds,
            twice=bool(seed % 2 == 0),
            position_sd=arguments.path_sd,
            height_sd=1.5 * arguments.path_sd,
            box_alike=arguments.alike,
            box_freedom=arguments.freedom,
            odd_sizes=arguments.odd,
        )
        world = make_world(seed, difficulty)
        result = locate_signs(world.trajectory, [world.detections], {"front": world.camera})
        rows.append(figures(world, result, difficulty))
        print(" ".join(f"{key} {value:.3f}" for key, value in rows[-1].items()), flush=True)
    weight = np.array([row["signs"] for row in rows])
    rms, best, bound = (
        np.sqrt(np.average([row[key] ** 2 for row in rows], weights=weight))
        for key in ("rms_m", "oracle_rms_m", "bound_rms_m")
    )
    print(f"all: error over the oracle's {rms / best:.3f}, over the bound {rms / bound:.3f}")
    for key in (
        "precision_3m",
        "recall_3m",
        "oracle_recall_3m",
        "coverage95",
        "long_half_axis_m",
    ):
        print(f"all: {key} {np.average([row[key] for row in rows], weights=weight):.3f}")
    for key in (
        "roll_error_deg",
        "pitch_error_deg",
        "yaw_error_deg",
        "roll_bound_deg",
        "pitch_bound_deg",
        "yaw_bound_deg",
        "both_roll_errors_deg",
        "both_pitch_errors_deg",
        "both_yaw_errors_deg",
        "time_error_s",
        "time_bound_s",
    ):
        print(f"all: rms {key} {np.sqrt(np.mean([row[key] ** 2 for row in rows])):.4f}")


if __name__ == "__main__":
    main()
