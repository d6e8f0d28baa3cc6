"""Geolocation on simulated drives, against the right association and the true camera.

    python tests/benchmarks/geolocation_simulated.py [--drives N] [--seconds S]

Clutter, wrong classes and missed views; the camera is turned by up to 5 deg and late by up to
0.3 s; the trajectory's error wanders (second-order Gauss-Markov). The bound is the error of
the same least squares given the true association and the true camera, the mean over passes
weighted alike: what remains is the trajectory's error and the boxes'.
"""

from __future__ import annotations

import argparse

import numpy as np

from automap.earth import from_local_ned, local_ned
from automap.evaluation.sign_matching import SignPoints, match, summarise_signs
from automap.frames import matrix_to_rpy, rpy_to_matrix
from automap.geolocation.landmark import SizePrior, fit_landmark
from automap.geolocation.locate import GeolocationResult, locate_signs
from automap.geolocation.views import MeasurementNoise, build_views
from automap.records import FloatArray
from tests.benchmarks.geolocation_world import ORIGIN, Difficulty, World, make_world

_PASS_NS = 20_000_000_000


def oracle(world: World) -> FloatArray:
    """Positions [m, 2] north, east at ORIGIN with association and camera given."""
    views = build_views(
        world.trajectory,
        [world.detections],
        {"front": world.true_camera},
        MeasurementNoise(pixel_sd=1.0, box_fraction=0.02),
    )
    owner = world.owner[views.row]
    places = np.full((len(world.position), 3), np.nan)
    for sign in range(len(places)):
        rows = np.flatnonzero(owner == sign)
        if len(rows):
            cuts = np.flatnonzero(np.diff(views.t_ns[rows]) > _PASS_NS) + 1
            fits = [
                fit_landmark(views, part, SizePrior(0.75, 0.2)) for part in np.split(rows, cuts)
            ]
            places[sign] = np.mean([fit.position for fit in fits], axis=0)
    lat, lon, _ = from_local_ned(places, views.origin)
    return np.asarray(local_ned(lat, lon, np.zeros(len(places)), ORIGIN))[:, :2]


def points(lat: FloatArray, lon: FloatArray, names: list[str], cov: FloatArray) -> SignPoints:
    return SignPoints(lat, lon, np.array(names, np.object_), cov, np.zeros(len(lat)))


def figures(world: World, result: GeolocationResult) -> dict[str, float]:
    """What the acceptance asks for; recall over the signs with two boxes or more."""
    seen = np.bincount(world.owner[world.owner >= 0], minlength=len(world.position)) >= 2
    lat, lon, _ = from_local_ned(world.position[seen], ORIGIN)
    names = [world.class_name[k] for k in np.flatnonzero(seen)]
    truth = points(lat, lon, names, np.full((len(lat), 2, 2), np.nan))
    found = points(
        np.array([s.lat_rad for s in result.signs]),
        np.array([s.lon_rad for s in result.signs]),
        [s.class_name for s in result.signs],
        np.array([s.cov_enu[:2, :2] for s in result.signs]).reshape(-1, 2, 2),
    )
    summary = summarise_signs(found, truth)
    pairs = match(found, truth, 15.0)
    best = np.linalg.norm(oracle(world)[seen] - world.position[seen, :2], axis=1)[pairs.truth]
    camera = result.corrections["front"]
    turned = matrix_to_rpy(rpy_to_matrix(world.camera.mount_rpy) @ rpy_to_matrix(camera.turn))
    off = np.degrees(turned - world.true_camera.mount_rpy)
    return {
        "signs": float(seen.sum()),
        "precision_3m": summary["gates"]["3"]["precision"],
        "recall_3m": summary["gates"]["3"]["recall"],
        "rms_m": float(np.sqrt(np.mean(pairs.distance_m**2))),
        "bound_rms_m": float(np.sqrt(np.mean(best**2))),
        "coverage95": summary["coverage95"],
        "class_accuracy": summary["class_accuracy"],
        "roll_error_deg": float(off[0]),
        "pitch_error_deg": float(off[1]),
        "yaw_error_deg": float(off[2]),
        "time_error_s": camera.time_s - world.true_camera.time_offset_s,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--drives", type=int, default=4)
    parser.add_argument("--seconds", type=float, default=600.0)
    arguments = parser.parse_args()
    rows = []
    for seed in range(arguments.drives):
        rng = np.random.default_rng(1000 + seed)
        difficulty = Difficulty(
            mount_deg=tuple(rng.uniform([-3, -5, -5], [3, 5, 5])),
            late_s=float(rng.uniform(-0.3, 0.3)),
            duration_s=arguments.seconds,
            twice=bool(seed % 2 == 0),
        )
        world = make_world(seed, difficulty)
        result = locate_signs(world.trajectory, [world.detections], {"front": world.camera})
        rows.append(figures(world, result))
        print(" ".join(f"{key} {value:.3f}" for key, value in rows[-1].items()), flush=True)
    weight = np.array([row["signs"] for row in rows])
    rms, bound = (
        np.sqrt(np.average([row[key] ** 2 for row in rows], weights=weight))
        for key in ("rms_m", "bound_rms_m")
    )
    print(f"all: error over bound {rms / bound:.3f}")
    for key in ("precision_3m", "recall_3m", "coverage95"):
        print(f"all: {key} {np.average([row[key] for row in rows], weights=weight):.3f}")
    for key in ("roll_error_deg", "pitch_error_deg", "yaw_error_deg", "time_error_s"):
        print(f"all: rms {key} {np.sqrt(np.mean([row[key] ** 2 for row in rows])):.4f}")


if __name__ == "__main__":
    main()
