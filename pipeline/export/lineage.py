"""Where a map comes from: what every file of it carries in its own metadata."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

from automap import __version__
from automap.io import names
from automap.records import Trajectory
from pipeline.shared.run_record import without_folder
from pipeline.shared.values import mapping

_LISTED = 50
_LATE_STAGES = ("export", "report")
_PACKAGES = ("numpy", "pyogrio", "pyproj", "scipy")


def lineage(record: dict[str, Any], name: str, trajectory: Trajectory | None) -> dict[str, Any]:
    """Run, versions and inputs of a map, from run.json as it stands.

    ``run_id`` is a digest of what the run's stages were made from: the same drive, settings
    and version give the same one. Paths of this computer are not among it.
    """
    stages = mapping(record.get("stages"))
    parts: dict[str, Any] = {
        key: mapping(stage).get("key") or mapping(stage).get("started")
        for key, stage in stages.items()
        if key not in _LATE_STAGES
    }
    merged = record.get("merged")
    folders = [str(path) for path in merged] if isinstance(merged, list) else []
    called = record.get("drives")
    drives = [str(one) for one in called] if isinstance(called, list) else []
    drives = drives or [_drive_name(folder) for folder in folders]
    if folders:
        parts = {"merged": folders, "metrics": record.get("metrics")}
    packages = mapping(record.get("packages"))
    content: dict[str, Any] = {
        "software": f"AutoMap {record.get('automap', __version__)}",
        "run_id": hashlib.sha256(
            json.dumps([name, parts], sort_keys=True, default=str).encode("utf-8", "replace")
        ).hexdigest()[:16],
        "drives": drives[:_LISTED] or [name],
        "drives_in_all": len(folders) if len(folders) > _LISTED else None,
        "recorded": _recorded(trajectory),
        "datum": "WGS-84, longitude and latitude in degrees, heights above the ellipsoid",
        "coordinate_epoch": epoch_of(trajectory),
        "settings_sha256": _digest(record.get("settings")),
        "inputs_sha256": {
            without_folder(str(k)): str(v) for k, v in mapping(record.get("inputs")).items()
        },
        "packages": {key: str(packages[key]) for key in _PACKAGES if key in packages},
    }
    return {key: value for key, value in content.items() if value not in (None, "", {}, [])}


def _drive_name(folder: str) -> str:
    """The drive that an output folder belongs to, by its name."""
    path = Path(folder)
    return path.parent.name if path.name == names.DEFAULT_OUT else path.name


def epoch_of(trajectory: Trajectory | None) -> float | None:
    """The year, with decimals, in the middle of a drive; None without GPS time."""
    import numpy as np

    from automap.timebase import gps_to_unix

    if trajectory is None:
        return None
    known = trajectory.gps_s[np.isfinite(trajectory.gps_s)]
    if len(known) == 0:
        return None
    middle = float(np.asarray(gps_to_unix(known[[0, -1]])).mean())
    when = np.datetime64(round(middle), "s")
    start = when.astype("datetime64[Y]")
    year = int(str(start))
    length = (start + 1).astype("datetime64[s]") - start.astype("datetime64[s]")
    share = float((when - start.astype("datetime64[s]")) / length)
    return round(year + share, 3)


def _recorded(trajectory: Trajectory | None) -> list[str]:
    from automap.export.clock import iso_texts, utc_of_gps

    if trajectory is None or len(trajectory) == 0:
        return []
    return [text for text in iso_texts(utc_of_gps(trajectory.gps_s[[0, -1]])) if text]


def _digest(value: Any) -> str:
    if not value:
        return ""
    text = json.dumps(value, sort_keys=True, default=str)
    return hashlib.sha256(text.encode("utf-8", "replace")).hexdigest()
