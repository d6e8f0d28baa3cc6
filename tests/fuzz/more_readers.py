"""Readers of formats that others write: bags, videos, layers, backgrounds, arrays, calibrations."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np

from tests.fuzz.places import ask_viewer, read_fleet, read_merged, read_results

Reader = Callable[[Path, Path], object]

SUFFIXES = {
    "bag_ros1": ".bag",
    "bag_own": ".bag",
    "bag_mcap": ".mcap",
    "video_mp4": ".mp4",
    "video_gopro": ".mp4",
    "layer_geojson": ".geojson",
    "layer_gpkg": ".gpkg",
    "layer_parquet": ".parquet",
    "layer_osm": ".osm",
    "layer_pbf": ".osm.pbf",
    "layer_csv": ".csv",
    "below_mbtiles": ".mbtiles",
    "below_pmtiles": ".pmtiles",
    "below_tiff": ".tif",
    "below_gpkg": ".gpkg",
    "finished_pos": ".pos",
    "camera_yaml": ".yaml",
}
"""Endings that readers go by."""


def _bag(path: Path, work: Path) -> object:
    from pipeline.importers.rosbag import import_rosbag

    return import_rosbag(path, work / "drive")


def _video(path: Path, work: Path) -> object:
    from automap.io.frame_times import frame_times
    from automap.io.manifest import VideoSection
    from automap.io.video import VideoInput, image_size, read_header
    from automap.io.video_decode import iter_frames

    said: list[str] = []
    video = VideoInput("front", VideoSection(start_ns=1000), (path,), None)
    times = frame_times(video)
    frames = [frame.frame for frame in iter_frames(video, warn=said.append)]
    return times, image_size([path]), frames, read_header(path)


def _gopro(path: Path, work: Path) -> object:
    from automap.io.gopro import read_gopro

    return read_gopro([path])


def _layer(path: Path, work: Path) -> object:
    from automap.errors import InputError
    from automap.io.roads_file import read_roads

    read: list[object] = []
    refusal: InputError | None = None
    for use in (lambda: read_roads(path, (-180.0, -90.0, 180.0, 90.0)), lambda: _listed(path)):
        try:
            read.append(use())
        except InputError as error:
            refusal = error
    if not read and refusal is not None:
        raise refusal
    return read


def _listed(path: Path) -> object:
    from automap.io.inventory_file import read_inventory

    return read_inventory(path, near=(np.array([0.85]), np.array([0.14])))


def _below(path: Path, work: Path) -> object:
    from automap.io.background import cut_out, open_background
    from automap.io.web_tiles import decoded
    from tests.unit.backgrounds import EAST, NORTH

    below = open_background(path)
    tiles = [below.tile(zoom, 2**zoom * 8470 // 16176, 2**zoom // 3) for zoom in (0, 13, 15)]
    lon, lat = np.linspace(EAST - 1e-3, EAST + 1e-3, 9), np.linspace(NORTH - 1e-3, NORTH + 1e-3, 9)
    seen = [decoded(data) for data in tiles if data is not None]
    return below.bounds, seen, cut_out(below, *np.meshgrid(lon, lat))


def _plain(module: str, name: str) -> Reader:
    def read(path: Path, work: Path) -> object:
        from importlib import import_module

        return getattr(import_module(module), name)(path)

    return read


def _camera(path: Path, work: Path) -> object:
    from automap.io.camera_file import read_camera_file

    return read_camera_file(path)


def _segment(path: Path, work: Path) -> object:
    """A segment of comma2k19 one of whose arrays is the damaged file."""
    from automap.io.comma2k19 import read_segment

    log, n = work / "processed_log", 40
    shapes = {"gyro_uncalibrated": (n, 3), "gyro": (n, 3), "accelerometer": (n, 3)}
    arrays: dict[Path, np.ndarray] = {}
    for name, shape in shapes.items():
        arrays[log / "IMU" / name / "value"] = np.ones(shape)
    arrays[log / "CAN/speed/value"] = np.ones((n, 1))
    arrays[log / "GNSS/live_gnss_ublox/value"] = np.tile([48.0, 8.0, 9.0, 1.5e12, 5.0, 3.0], (n, 1))
    arrays |= {place.with_name("t"): np.arange(n) * 0.1 + 9.0 for place in list(arrays)}
    pose = work / "global_pose"
    arrays[pose / "frame_times"] = np.arange(n) * 0.1 + 9.0
    arrays[pose / "frame_positions"] = np.full((n, 3), 3.7e6)
    arrays[pose / "frame_velocities"] = np.ones((n, 3))
    arrays[pose / "frame_orientations"] = np.full((n, 4), 0.5)
    for place, values in arrays.items():
        place.parent.mkdir(parents=True, exist_ok=True)
        with place.open("wb") as file:
            np.save(file, values)
    data = path.read_bytes()
    # which array it is follows from its bytes, so that a file found is a file kept
    columns = sorted(place for place, values in arrays.items() if values.ndim == 1)
    shutil.copyfile(path, columns[sum(data) % len(columns)])
    return read_segment(work)


def _kitti(path: Path, work: Path) -> object:
    """A drive of KITTI raw one of whose rows is the damaged file."""
    from automap.io.kitti_raw import read_kitti
    from tests.unit.import_data_sets import write_kitti

    drive = write_kitti(work)
    shutil.copyfile(path, drive / "oxts/data/0000000003.txt")
    return read_kitti(drive)


def _euroc(path: Path, work: Path) -> object:
    from automap.io.euroc import read_euroc
    from tests.unit.import_data_sets import write_euroc

    write_euroc(work / "r")
    for place in ("imu0/sensor.yaml", "cam0/sensor.yaml"):
        shutil.copyfile(path, work / "r/mav0" / place)
    return read_euroc(work / "r")


def _digests(path: Path, work: Path) -> object:
    from pipeline.run.digests import CACHE_FILE, DigestCache

    shutil.copyfile(path, work / CACHE_FILE)
    cache = DigestCache(work)
    cache.digest(path)
    cache.save()
    return None


MORE: dict[str, Reader] = {
    "bag_": _bag,
    "video_mp4": _video,
    "video_gopro": _gopro,
    "layer_": _layer,
    "below_": _below,
    "arrival_csv": _plain("automap.io.arrival", "read_arrival"),
    "fix_errors_csv": _plain("automap.io.fix_errors_csv", "read_fix_errors_csv"),
    "finished_pos": _plain("automap.io.trajectory_file", "read_finished"),
    "baseline_json": _plain("pipeline.regress.baseline", "read_baseline"),
    "time_tag": _plain("automap.io.rtklib_tag", "read_time_tag"),
    "crops_parquet": _plain("automap.io.crops_table", "read_crops"),
    "detections_parquet": _plain("automap.io.detections_table", "read_detections"),
    "camera_": _camera,
    "comma_array": _segment,
    "kitti_row": _kitti,
    "euroc_yaml": _euroc,
    "digests_json": _digests,
    "request": ask_viewer,
}


def more_reader(name: str) -> Reader | None:
    """The reader for a file of this harness, None where it is none of these."""
    for start, make in (
        ("results_", read_results),
        ("merged_", read_merged),
        ("fleet_", read_fleet),
    ):
        if name.startswith(start):
            return make(name)
    known = [start for start in MORE if name.startswith(start)]
    return MORE[max(known, key=len)] if known else None
