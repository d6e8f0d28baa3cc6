"""The manifest of a recording, written before its first byte."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from automap.io import names
from automap.io.manifest import Manifest, read_manifest
from automap.recording.imu_format import ImuFormat

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
    parts = ['schema = "automap.drive/1"', f"name = {_value(name)}"]
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
        theirs = _without_files(given.get("video", {}).get(camera, {}))
        theirs.pop("detections", None)
        parts += _section(f"video.{camera}", {**files, "time": "boot_ns"} | theirs)
    if given.get("site"):
        parts += _section("site", given["site"])
    return "\n".join(parts) + "\n"


def _without_files(section: Mapping[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in section.items() if key not in _OF_THE_FILES}


def _section(name: str, values: Mapping[str, Any]) -> list[str]:
    lines = [f"{key} = {_value(value)}" for key, value in values.items() if value is not None]
    return ["", f"[{name}]", *lines]


def _value(value: Any) -> str:
    """A value as TOML writes it; its strings, numbers and arrays are those of JSON."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_value(item) for item in value) + "]"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    return repr(value)
