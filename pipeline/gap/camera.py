"""Errors of the camera, from the boxes of tracked signs along the path of the new model."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from automap.errors import AutoMapError, ConfigError
from automap.gap.camera.search import CameraGap, find_camera_gap
from automap.gap.camera.views import Boxes, boxes_of, joined, keys
from automap.io import names
from pipeline.gap.inputs import run_folder
from pipeline.settings.load import Settings, load_settings

if TYPE_CHECKING:
    from automap.io.drive import Drive
    from automap.records import Camera, Detections

LOOSE_TURN = float(np.radians(2.0))
LOOSE_TIME_S = 0.1
LOOSE_FOCAL = 0.03
"""Signs are tracked with a camera that may be off by so much, whatever the manifest says."""

Log = Callable[[str], None]


def camera_gaps(
    drives: Sequence[Path],
    holdout: Sequence[Path],
    runs: Path,
    model: Path,
    without: Collection[str],
    log: Log = lambda text: None,
) -> tuple[list[CameraGap], list[str]]:
    """Search the cameras of the drives, and sentences about drives that could not be used.

    ``model`` is the new model of IMU and receiver as a file of settings; the path comes from a
    run with it under ``runs``.
    """
    settings = load_settings(model)
    warnings: list[str] = []
    fitted = _boxes_of_drives(drives, [*drives, *holdout], runs, settings, warnings, log)
    if not fitted:
        return [], warnings
    held = _boxes_of_drives(holdout, [*drives, *holdout], runs, settings, warnings, log)
    out = []
    for camera, parts in fitted.items():
        rest = held.get(camera)
        out.append(
            find_camera_gap(
                camera, joined(parts), None if rest is None else joined(rest), without, log
            )
        )
    return out, warnings


def _boxes_of_drives(
    drives: Sequence[Path],
    every: Sequence[Path],
    runs: Path,
    settings: Settings,
    warnings: list[str],
    log: Log,
) -> dict[str, list[Boxes]]:
    """Boxes by camera, one item a drive that has any."""
    out: dict[str, list[Boxes]] = {}
    for path in drives:
        try:
            for camera, boxes in _boxes_of_drive(
                path, run_folder(path, every, runs), settings, log
            ):
                known = out.setdefault(camera, [])
                if known and not _same_camera(known[0].camera, boxes.camera):
                    warnings.append(
                        f"{path}: its camera {camera} is another one than that of the first "
                        "drive; it was left out of the search for errors of the camera"
                    )
                    continue
                known.append(boxes)
        except ConfigError:
            raise
        except AutoMapError as error:
            warnings.append(f"{path}: errors of its camera were not looked for: {error}")
    return out


def _same_camera(a: Camera, b: Camera) -> bool:
    return (a.width, a.height) == (b.width, b.height) and np.allclose(a.matrix, b.matrix, rtol=0.02)


def _boxes_of_drive(path: Path, out: Path, settings: Settings, log: Log) -> list[tuple[str, Boxes]]:
    from automap.geolocation.locate import locate_signs
    from automap.io.drive import load_drive
    from automap.io.observations_table import read_detection_rows
    from automap.io.trajectory_table import read_trajectory
    from pipeline.run.prepared import run_to
    from pipeline.run.stages.geolocate import as_known, path_quantities, rules_from

    drive = load_drive(path)
    stated = drive.cameras()
    if not stated or drive.bearings_file is not None:
        return []
    log(f"{drive.name}: path and detections for its camera")
    run_to("detect", path, out, settings)
    if not (out / names.DETECTIONS).is_file() or not (out / names.TRAJECTORY).is_file():
        return []
    _, parts = read_detection_rows(out / names.DETECTIONS)
    records = _on_trajectory(drive, out, [record for record, _ in parts if record.camera in stated])
    trajectory = read_trajectory(out / names.TRAJECTORY)
    quantities = path_quantities(out, trajectory)
    cameras, records = as_known(
        stated, [r for r in records if len(r)], settings.geolocate.fixed, quantities
    )
    if not records:
        return []
    loose = {
        n: replace(
            c,
            mount_sd=max(c.mount_sd, LOOSE_TURN),
            time_offset_sd=max(c.time_offset_sd, LOOSE_TIME_S),
        )
        for n, c in cameras.items()
    }
    rules = rules_from(settings.geolocate, drive.name, drive.vehicle)
    rules = replace(rules, estimate_camera=True, focal_sd=LOOSE_FOCAL)
    log(f"{drive.name}: tracking its signs")
    track = locate_signs(trajectory, records, loose, rules).observations.track
    found, first = [], 0
    for record in records:
        rows = slice(first, first + len(record))
        first += len(record)
        boxes = boxes_of(trajectory, cameras[record.camera], record, track[rows], quantities)
        if boxes is not None:
            found.append((record.camera, boxes))
    return found


def _on_trajectory(drive: Drive, out: Path, records: list[Detections]) -> list[Detections]:
    """Detections stamped by the trajectory's clock."""
    from automap.io.clock_json import read_clocks
    from automap.sync.stamps import in_trajectory_time

    if not (out / names.SYNC).is_file():
        return records
    clocks = read_clocks(out / names.SYNC)
    converted = []
    for record in records:
        video = drive.videos.get(record.camera)
        if video is None:
            converted.append(record)
            continue
        t_ns = in_trajectory_time(record.t_ns, video.section.time, clocks)
        converted.append(replace(record, t_ns=t_ns))
    return converted


def camera_json(gap: CameraGap) -> dict[str, Any]:
    """A camera's part of gap.json."""
    return {
        "camera": gap.camera,
        "signs": gap.signs,
        "boxes": gap.boxes,
        "gap_before": gap.gap_before,
        "gap_after": gap.gap_after,
        "unit": "nats a box, on held-out signs",
        "findings": [f.effect for f in gap.findings],
    }


def camera_lines(gaps: Sequence[CameraGap], before: Settings) -> list[str]:
    """What the new model says of the cameras, for model.toml: what was known and what was found."""
    lines: list[str] = []
    found = {gap.camera: gap.values for gap in gaps}
    for camera in dict.fromkeys([*before.geolocate.fixed, *found]):
        known = before.geolocate.fixed.get(camera, {})
        new = found.get(camera, {})
        for effect in dict(keys()):
            if effect not in known and effect not in new:
                continue
            old, more = known.get(effect, {}), new.get(effect, {})
            lines += ["", f"[geolocate.fixed.{camera}.{effect}]"]
            lines += [
                f"{p} = {old.get(p, 0.0) + more.get(p, 0.0):.9g}"
                for p in dict.fromkeys([*old, *more])
            ]
    return lines
