"""One street driven several times: how the merged map betters with every pass.

    python tests/benchmarks/geolocation_passes.py [--passes N] [--streets N] [--seconds S]

Every pass has a trajectory error, camera errors, boxes and clutter of its own
(``geolocation_world``); its signs are located from boxes and trajectory alone and merged.
"""

from __future__ import annotations

import argparse

import numpy as np

from automap.evaluation.sign_matching import match, points_of, summarise_signs
from automap.geolocation.locate import locate_signs
from automap.mapping.limits import LEAST_EXISTENCE
from automap.mapping.merge import merge_drives
from automap.mapping.sightings import CameraView, DriveSigns
from automap.records import DrivePath, FloatArray, Sign, SignPoints, Trajectory
from tests.benchmarks.geolocation_world import Difficulty, World, make_world, true_points

DAY_S = 86400.0
_PATH_ROWS = 25


def of_drive(name: str, day: int, world: World, signs: list[Sign]) -> DriveSigns:
    """What a pass brings to the map."""

    def column(key: str) -> FloatArray:
        return np.array([getattr(s, key) for s in signs], np.float64)

    def seen(key: str) -> FloatArray:
        t_ns = np.array([getattr(s, key) for s in signs], np.float64)
        first = world.trajectory
        return np.asarray(first.gps_s[0] + (t_ns - first.t_ns[0]) * 1e-9 + day * DAY_S)

    path: Trajectory = world.trajectory
    rows = np.arange(0, len(path), _PATH_ROWS)
    half = float(np.arctan(0.5 * world.camera.width / world.camera.matrix[0, 0]))
    return DriveSigns(
        name=name,
        start_gps_s=float(path.gps_s[0]) + day * DAY_S,
        ids=tuple(s.id for s in signs),
        class_name=np.array([s.class_name for s in signs], np.object_),
        lat_rad=column("lat_rad"),
        lon_rad=column("lon_rad"),
        height_m=column("height_m"),
        cov_enu=np.array([s.cov_enu for s in signs]).reshape(-1, 3, 3),
        confidence=column("confidence"),
        n_views=np.array([s.n_views for s in signs], np.int64),
        first_gps_s=seen("first_seen_ns"),
        last_gps_s=seen("last_seen_ns"),
        height_above_road_m=column("height_above_road_m"),
        facing_sd_rad=column("facing_sd_rad"),
        sd_above_road_m=column("sd_above_road_m"),
        facing_rad=column("facing_rad"),
        size_m=column("size_m"),
        side=np.array([s.side for s in signs], np.object_),
        status=np.array([s.status for s in signs], np.object_),
        path=DrivePath(
            gps_s=path.gps_s[rows] + day * DAY_S,
            lat_rad=path.lat_rad[rows],
            lon_rad=path.lon_rad[rows],
            yaw_rad=path.rpy[rows, 2],
            sd_enu=path.sd_pos_ned[rows][:, [1, 0, 2]],
        ),
        cameras=(CameraView(yaw_rad=0.0, half_angle_rad=half),),
        key=name,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--passes", type=int, default=5)
    parser.add_argument("--streets", type=int, default=2)
    parser.add_argument("--seconds", type=float, default=300.0)
    arguments = parser.parse_args()
    single, together = [], []
    for seed in range(arguments.streets):
        drives = []
        truth = SignPoints(*(np.zeros(0) for _ in range(5)))
        for day in range(arguments.passes):
            rng = np.random.default_rng([2000 + seed, day])
            difficulty = Difficulty(
                mount_deg=tuple(rng.uniform([-3, -5, -5], [3, 5, 5])),
                late_s=float(rng.uniform(-0.3, 0.3)),
                duration_s=arguments.seconds,
                twice=False,
            )
            world = make_world(seed, difficulty, errors_seed=day)
            signs = locate_signs(
                world.trajectory, [world.detections], {"front": world.camera}
            ).signs
            drives.append(of_drive(f"pass-{day}", day, world, signs))
            here = true_points(world)
            truth = here if len(here) > len(truth) else truth
            single.append(match(points_of(signs), here, 15.0).distance_m)
        merged = merge_drives(drives)
        kept = [
            s for s, e in zip(merged.signs, merged.existence, strict=True) if e >= LEAST_EXISTENCE
        ]
        summary = summarise_signs(points_of(kept), truth)
        together.append(match(points_of(kept), truth, 15.0).distance_m)

        alone = np.median(np.concatenate(single[-len(drives) :]))
        print(
            f"street {seed}: one pass median {alone:.2f} m, "
            f"{len(drives)} passes {np.median(together[-1]):.2f} m, in the 95 % ellipse "
            f"{summary['coverage95']:.3f}, {len(kept)} signs of {len(truth)}, "
            f"recall {summary['gates']['3']['recall']:.3f} at 3 m",
            flush=True,
        )
    print(
        f"all: one pass median {np.median(np.concatenate(single)):.2f} m, "
        f"{arguments.passes} passes {np.median(np.concatenate(together)):.2f} m"
    )


if __name__ == "__main__":
    main()
