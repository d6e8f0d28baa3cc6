"""What the cameras of a run saw, for a merge: heading and field of view."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from automap.errors import AutoMapError
from automap.io import names
from automap.mapping.sightings import CameraView
from automap.mapping.visibility import DEFAULT_CAMERA


def cameras_of_run(folder: Path, record: dict[str, Any]) -> tuple[CameraView, ...]:
    """The cameras by the lineage of the run, else by the drive's manifest, else a usual one.

    None where either says that there was none: such a drive missed no sign.
    """
    found = _cameras_of_record(record)
    if found is not None:
        return found
    drive = record.get("drive")
    path = drive.get("path") if isinstance(drive, dict) else None
    manifest = Path(path) / names.MANIFEST if isinstance(path, str) else None
    if manifest is not None and manifest.is_file():
        from automap.io.manifest import read_manifest

        try:
            sections = read_manifest(manifest).video.values()
        except AutoMapError:
            return (DEFAULT_CAMERA,)
        return tuple(
            _view(section.width, section.camera_matrix, section.mount_rpy_deg)
            for section in sections
        )
    return (DEFAULT_CAMERA,)


def _cameras_of_record(record: dict[str, Any]) -> tuple[CameraView, ...] | None:
    stages = record.get("stages")
    stage = stages.get("geolocate") if isinstance(stages, dict) else None
    lines = stage.get("manifest") if isinstance(stage, dict) else None
    if not isinstance(lines, dict) or not lines:
        return None
    cameras: dict[str, dict[str, Any]] = {}
    for key, value in lines.items():
        section, _, field = str(key).rpartition(".")
        if section.startswith("video."):
            cameras.setdefault(section, {})[field] = value
    return tuple(
        _view(c.get("width"), c.get("camera_matrix"), c.get("mount_rpy_deg"))
        for c in cameras.values()
    )


def _view(width: Any, matrix: Any, mount_rpy_deg: Any) -> CameraView:
    try:
        half = math.atan(0.5 * float(width) / float(matrix[0][0]))
        yaw = math.radians(float(mount_rpy_deg[2])) if mount_rpy_deg is not None else 0.0
    except (TypeError, ValueError, IndexError, ZeroDivisionError):
        return DEFAULT_CAMERA
    return CameraView(yaw, half)
