"""Drives of a scene, and output folders of runs that are made from them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from merge_scene import Errors, drive_through, street

from automap.io import names
from automap.io.atomic import write_json
from automap.io.clock_json import write_clock
from automap.io.review_json import append_action
from automap.io.signs_table import read_signs, write_signs
from automap.io.trajectory_table import write_trajectory
from automap.mapping.sightings import DriveSigns
from automap.records import ReviewAction, Sign, Trajectory
from pipeline.merge.signs import GPS_CLOCK

DAY_S = 86400.0
CALM = Errors(clutter=0.0, missed=0.03, wrong_class=0.0)
PATH = np.array([[-1.5, -40.0], [-1.5, 340.0]])


def passes(count: int, standing: list[np.ndarray] | None = None) -> list[DriveSigns]:
    """Drives through one short street, days apart."""
    rng = np.random.default_rng(11)
    town = street(rng, 300.0, 15.0)
    return [
        drive_through(
            rng, town, PATH, 12.0, f"d{number}", 1.45e9 + DAY_S * number, CALM,
            None if standing is None else standing[number],
        )[0]
        for number in range(count)
    ]  # fmt: skip


def write_run(folder: Path, drive: DriveSigns, inputs: str = "") -> Path:
    """What a run of the drive would have left: signs, trajectory, clock and lineage."""
    folder.mkdir(parents=True)
    write_signs(
        folder / names.SIGNS_RAW,
        [
            Sign(
                id=drive.ids[k],
                class_name=str(drive.class_name[k]),
                lat_rad=drive.lat_rad[k],
                lon_rad=drive.lon_rad[k],
                height_m=drive.height_m[k],
                cov_enu=drive.cov_enu[k],
                confidence=drive.confidence[k],
                n_views=int(drive.n_views[k]),
                first_seen_ns=round(drive.first_gps_s[k] * 1e9),
                last_seen_ns=round(drive.last_gps_s[k] * 1e9),
                height_above_road_m=drive.height_above_road_m[k],
                facing_sd_rad=drive.facing_sd_rad[k],
                sd_above_road_m=drive.sd_above_road_m[k],
                facing_rad=drive.facing_rad[k],
                size_m=drive.size_m[k],
                side=str(drive.side[k]),
                existence=float("nan") if drive.existence is None else drive.existence[k],
                drives=(drive.name,),
            )
            for k in range(len(drive))
        ],
    )
    path = drive.path
    if path is not None:
        n = len(path)
        three = np.zeros((n, 3))
        write_trajectory(
            folder / names.TRAJECTORY,
            Trajectory(
                t_ns=np.rint(path.gps_s * 1e9).astype(np.int64),
                gps_s=path.gps_s,
                lat_rad=path.lat_rad,
                lon_rad=path.lon_rad,
                height_m=np.full(n, 580.0),
                vel_ned=three,
                rpy=np.column_stack([np.zeros((n, 2)), path.yaw_rad]),
                sd_pos_ned=path.sd_enu[:, [1, 0, 2]],
                sd_vel_ned=three,
                sd_rpy=three,
            ),
        )
    write_clock(folder / names.SYNC, GPS_CLOCK)
    manifest = {
        "video.front.width": 1280,
        "video.front.camera_matrix": [[900.0, 0, 640], [0, 900.0, 360], [0, 0, 1]],
        "video.front.mount_rpy_deg": [0.0, 0.0, 0.0],
    }
    write_json(
        folder / names.RUN,
        {
            "schema": "automap.run/1",
            "drive": {"name": drive.name, "path": str(folder)},
            "inputs": {"imu.csv": inputs or drive.name},
            "stages": {"geolocate": {"manifest": manifest}},
        },
    )
    return folder


def review(folder: Path, time: str = "2026-11-23T10:00:00Z", kind: str = "reject") -> None:
    """Reject the first sign of a run, or what else ``kind`` says, if it has signs."""
    table = folder / names.SIGNS_RAW
    seen: tuple[str, str, float, float] = ("s1", "", float("nan"), float("nan"))
    if table.is_file():
        sign = read_signs(table)[0]
        lon, lat = np.degrees([sign.lon_rad, sign.lat_rad])
        seen = (sign.id, sign.class_name, float(lon), float(lat))
    name, class_name, lon, lat = seen
    append_action(folder / names.REVIEW, ReviewAction("a1", time, name, kind, class_name, lon, lat))
