"""run.json: what a run was made from and what came out of it."""

from __future__ import annotations

import platform
from collections.abc import Mapping
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any

from automap import __version__
from automap.io import names
from pipeline.shared.values import json_object, mapping
from pipeline.shared.verdicts import KEYS

SCHEMA = "automap.run/1"

PACKAGES = (
    "av",
    "llvmlite",
    "numba",
    "numpy",
    "opencv-python-headless",
    "pandas",
    "pyarrow",
    "pydantic",
    "pyogrio",
    "pyproj",
    "scipy",
    "shapely",
)


def utc_now() -> str:
    """The present time, UTC, ISO 8601 with microseconds."""
    return datetime.now(UTC).isoformat(timespec="microseconds").replace("+00:00", "Z")


def read_record(out: Path) -> dict[str, Any]:
    """The run.json of an earlier run in ``out``; empty when there is none that can be read."""
    record = json_object(out / names.RUN)
    if record.get("schema") != SCHEMA:
        return {}
    stages = {name: _sound(stage) for name, stage in mapping(record.get("stages")).items()}
    return _sound(record) | {"stages": {name: stage for name, stage in stages.items() if stage}}


def _sound(value: Any) -> dict[str, Any]:
    """A record with tables and lists where they belong, whatever a damaged file has there."""
    record = dict(mapping(value))
    for key in ("settings", "manifest", "inputs", "needs", "outputs", "metrics"):
        if key in record:
            record[key] = mapping(record[key])
    if not isinstance(record.get("warnings", []), list):
        record["warnings"] = []
    return record


def written_results(record: Mapping[str, Any]) -> dict[str, int | None]:
    """The files that the finished stages of a run wrote, with their sizes in bytes."""
    written: dict[str, int | None] = {}
    for stage in mapping(record.get("stages")).values():
        if mapping(stage).get("status") == "done":
            for name, entry in mapping(mapping(stage).get("outputs")).items():
                size = mapping(entry).get("bytes")
                written[name] = size if isinstance(size, int) else None
    return written


def unlike_record(out: Path, written: Mapping[str, int | None], name: str) -> str:
    """A sentence where the file ``name`` of OUT is not there as its run wrote it, else ""."""
    if name not in written:
        return ""
    path = out / name
    if not path.is_file():
        return f"{path} is missing, though its run wrote it; copy the whole folder again."
    if written[name] not in (None, path.stat().st_size):
        return (
            f"{path} was changed after its run, by other means than automap's; copy the whole "
            "folder again, or run the drive again."
        )
    return ""


def results_of(folder: Path) -> Path:
    """The folder of results that is meant: a drive's own where the drive is given."""
    own = folder / names.DEFAULT_OUT
    return own if (folder / names.MANIFEST).is_file() and own.is_dir() else folder


def drive_of(out: Path) -> tuple[str, Path]:
    """Name and folder of the drive that a run in ``out`` was made of, as its record says.

    Otherwise, and where the folder is not there any more, ``out``'s own name and the folder
    above it.
    """
    drive = mapping(json_object(out / names.RUN).get("drive"))
    here, path = out.resolve(), Path(str(drive.get("path") or ""))
    if path.is_file() and path.name == names.MANIFEST:
        path = path.parent
    known = bool(drive.get("path")) and path.is_dir()
    return str(drive.get("name") or here.name), path if known else here.parent


def new_record(drive: Path, name: str, command: str, settings: Mapping[str, Any]) -> dict[str, Any]:
    """The head of a record: who runs what, on what, with which versions."""
    return {
        "schema": SCHEMA,
        "automap": __version__,
        "python": platform.python_version(),
        "platform": platform.platform(),
        "packages": _package_versions(),
        "command": command,
        "drive": {"name": name, "path": str(drive.resolve())},
        "status": "running",
        "started": utc_now(),
        "settings": dict(settings),
        "inputs": {},
        "stages": {},
        **dict.fromkeys(KEYS.values()),
        "warnings": [],
        "metrics": {},
    }


def merge_stages(record: dict[str, Any]) -> None:
    """Fill the record's own inputs, verdicts, warnings and metrics from its stages, in order."""
    inputs: dict[str, Any] = {}
    warnings: list[str] = []
    metrics: dict[str, Any] = {}
    told: dict[str, Any] = dict.fromkeys(KEYS.values())
    for stage in record["stages"].values():
        inputs.update(stage.get("inputs", {}))
        warnings += [text for text in stage.get("warnings", []) if text not in warnings]
        metrics.update(stage.get("metrics", {}))
        told.update((key, stage[key]) for key in KEYS.values() if key in stage)
    record.update(inputs=inputs, **told, warnings=warnings, metrics=metrics)


def _package_versions() -> dict[str, str]:
    versions = {}
    for name in PACKAGES:
        try:
            versions[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            versions[name] = "missing"
    return versions


def country_of(record: dict[str, Any]) -> str | None:
    """The country that the drive's manifest named, or the one of all drives of a merged map."""
    if isinstance(record.get("country"), str):
        return str(record["country"])
    stages = record.get("stages")
    for stage in stages.values() if isinstance(stages, dict) else ():
        manifest = stage.get("manifest") if isinstance(stage, dict) else None
        country = manifest.get("site.country") if isinstance(manifest, dict) else None
        if isinstance(country, str):
            return country
    return None


def without_folder(name: str) -> str:
    """An input as its drive names it, and one from elsewhere by its own name alone: where it lies
    is this computer's business."""
    path = PureWindowsPath(name) if "\\" in name else PurePosixPath(name)
    return path.name if path.is_absolute() or ".." in path.parts else name
