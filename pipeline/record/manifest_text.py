"""The manifest of a recording, written before its first byte."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from automap.io import names
from automap.io.manifest import Manifest, read_manifest
from automap.io.toml_file import toml_value
from pipeline.record.imu_format import ImuFormat

_SIZE = ("width", "height")
_OF_THE_FILES = {"file", "arrival", "arrival_time", "time", "files", "frames", "start_ns"}


def read_rig(path: Path) -> Manifest:
    """The mounting of a vehicle, as the manifest of an earlier drive (its folder or its
    drive.toml) or any file of that form states it."""
    return read_manifest(path / names.MANIFEST if path.is_dir() else path)


def manifest_text(
    name: str,
    gnss_file: str | None,
    imu: ImuFormat | None,
    cameras: Mapping[str, Mapping[str, Any]],
    rig: Manifest | None = None,
) -> str:
    """``drive.toml`` of a recording.

    What the rig says of axes, calibration, lever arms, cameras and site is taken over, what
    it says of files is not. ``cameras``: name -> files, frames, width, height.
    """
    given = {} if rig is None else rig.model_dump(by_alias=True, exclude_unset=True)
    parts = ['schema = "automap.drive/1"', f"name = {toml_value(name)}"]
    if imu is not None:
        ours = {"file": "imu.csv", "axes": imu.axes, "time": "boot_ns"}
        ours |= {"gyro_unit": imu.gyro_unit, "accel_unit": imu.accel_unit}
        if imu.sensor:
            ours["sensor"] = imu.sensor
        theirs = _without_files(given.get("imu", {}))
        for unit in ("gyro_unit", "accel_unit"):
            theirs.pop(unit, None)  # the units are the line's, whatever an earlier drive had
        parts += _section("imu", ours | theirs)
    if gnss_file is not None:
        ours = {"file": gnss_file, "arrival": "gnss_arrival.csv", "arrival_time": "boot_ns"}
        parts += _section("gnss", ours | _without_files(given.get("gnss", {})))
    for camera, files in cameras.items():
        theirs = _of_size(_without_files(given.get("video", {}).get(camera, {})), files)
        parts += _section(f"video.{camera}", {**files, "time": "boot_ns"} | theirs)
    if given.get("site"):
        parts += _section("site", given["site"])
    return "\n".join(parts) + "\n"


def _without_files(section: Mapping[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in section.items() if key not in _OF_THE_FILES}


def _of_size(section: dict[str, Any], files: Mapping[str, Any]) -> dict[str, Any]:
    """A camera's section for pictures of the size that it has now.

    The matrix goes along with a size of the same shape (pixel centres are integers); for another
    shape nobody knows what the camera cut off, and it is left out with the distortion.
    """
    kept = {key: value for key, value in section.items() if key not in ("detections", *_SIZE)}
    before = tuple(section.get(key) for key in _SIZE)
    now = tuple(files.get(key) for key in _SIZE)
    if None in now:
        return kept | {key: section[key] for key in _SIZE if key in section}
    matrix = section.get("camera_matrix")
    if matrix is None or before[0] is None or before[1] is None or before == now:
        return kept
    factor = now[0] / before[0]
    if abs(factor * before[1] - now[1]) > 1.0:
        return {k: v for k, v in kept.items() if k not in ("camera_matrix", "distortion")}
    (fx, skew, cx), (_, fy, cy), bottom = matrix
    moved = [(c + 0.5) * factor - 0.5 for c in (cx, cy)]
    rows = ((fx * factor, skew * factor, moved[0]), (0.0, fy * factor, moved[1]), bottom)
    return kept | {"camera_matrix": rows}


def _section(name: str, values: Mapping[str, Any]) -> list[str]:
    lines = [f"{key} = {toml_value(value)}" for key, value in values.items() if value is not None]
    return ["", f"[{name}]", *lines]
