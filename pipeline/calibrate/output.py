"""What a calibration writes: the calibration file, the report, corrected logs."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from automap.records import ImuCalibration

if TYPE_CHECKING:
    from automap.io.imu_log import ImuLog

FILE = "imu_calibration.toml"
REPORT = "calibration.html"
Sections = dict[str, dict[str, Any]]


@dataclass(frozen=True)
class Outcome:
    """What a calibration wrote, in one sentence and a list, and what it warned of."""

    summary: str
    files: tuple[Path, ...]
    warnings: tuple[str, ...]


def conditions(kind: str, logs: list[ImuLog], gravity: float | None) -> dict[str, Any]:
    """Under which conditions a calibration was made, and from which inputs."""
    temperatures = [log.data.temp_c for log in logs if log.data.temp_c is not None]
    temperature = None
    if temperatures:
        joined = np.concatenate(temperatures)
        joined = joined[np.isfinite(joined)]
        if len(joined):
            temperature = joined
    return {
        "kind": kind,
        "gravity": gravity,
        "gyro_unit": logs[0].data.gyro_unit,
        "accel_unit": logs[0].data.accel_unit,
        "temperature_c": None if temperature is None else float(temperature.mean()),
        "temperature_span_c": None if temperature is None else float(np.ptp(temperature)),
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "seconds": sum(float(log.data.t_s[-1]) for log in logs),
        "inputs": {
            str(entry["name"]): entry["sha256"]
            for entry in (digest_entry(path) for log in logs for path in log.files)
        },
    }


def digest_entry(path: Path) -> dict[str, str]:
    """Name and digest of an input."""
    return {"name": path.name, "sha256": hashlib.sha256(path.read_bytes()).hexdigest()}


def write(
    out: Path,
    sections: Sections,
    page: str,
    logs: list[ImuLog],
    calibration: ImuCalibration | None,
) -> tuple[Path, ...]:
    """Write sections, report and, with ``calibration``, the corrected logs."""
    from automap.io.atomic import make_folder, write_text
    from automap.io.imu_calibration import write_imu_calibration

    make_folder(out)
    files = [out / FILE, out / REPORT]
    write_imu_calibration(files[0], sections)
    write_text(files[1], page)
    if calibration is not None:
        for number, log in enumerate(logs):
            stem = log.files[0].stem if len(logs) == 1 else f"{number + 1}_{log.files[0].stem}"
            files.append(_write_corrected(out / f"{stem}_corrected.csv", log, calibration))
    return tuple(files)


def _write_corrected(path: Path, log: ImuLog, calibration: ImuCalibration) -> Path:
    """The log in rad/s and m/s^2, in the accelerometer's axes, as a drive can use it."""
    from automap.io.atomic import atomic_path

    raw = log.data
    gyro, accel = calibration.apply(raw.gyro, raw.accel)
    heads = ["t_ns", "gx", "gy", "gz", "ax", "ay", "az"]
    columns = [gyro, accel]
    if raw.temp_c is not None:
        heads.append("temp_c")
        columns.append(raw.temp_c[:, None])
    values = np.column_stack(columns).tolist()
    with atomic_path(path) as temporary, temporary.open("w", encoding="utf-8") as stream:
        stream.write(",".join(heads) + "\n")
        for t, row in zip(raw.t_ns.tolist(), values, strict=True):
            stream.write(f"{t}," + ",".join(f"{v:.9g}" for v in row) + "\n")
    return path
