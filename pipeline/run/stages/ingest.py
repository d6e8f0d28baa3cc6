"""Stage ingest: the recordings of a drive in SI units, vehicle axes and one table each."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from automap.errors import InputError
from automap.io import names
from pipeline.run.stage import Stage, StageContext

if TYPE_CHECKING:
    from automap.io.drive import Drive
    from automap.io.recording import Recording

_MAX_GAPS = 1000


def run(context: StageContext) -> None:
    """Write imu.parquet, fixes.parquet (each where the drive has such data) and ingest.json.

    A file that cannot be used is a warning as long as the drive has another source of
    positions. Raises InputError at what ``automap check`` calls an error.
    """
    from automap.io.atomic import write_json
    from automap.io.recording import read_recording
    from automap.io.tables import write_fixes, write_imu
    from pipeline.check.judge import judge, stop_or_tell
    from pipeline.check.same_drive import OTHER_CODE

    drive = context.drive
    recording = read_recording(drive, context.settings.ingest.gap_factor)
    summary: dict[str, Any] = {"drive": drive.name, "imu": None, "gnss": None, "trajectory": None}
    for text in (*drive.warnings, *recording.warnings):
        context.warn(text)
    judged = judge(drive, recording)
    stop_or_tell(judged.found, InputError, context.warn)
    parts = []
    if drive.trajectory_file is not None:
        summary["trajectory"] = _check_trajectory(context, drive.trajectory_file)
        parts.append("finished trajectory")
    if judged.imu is not None and recording.imu is not None:
        write_imu(context.work / names.IMU, judged.imu)
        summary["imu"] = _imu_summary(drive, recording)
        if judged.mended is not None:
            summary["imu"]["mended_accel_axes"] = judged.mended.accel.tolist()
            summary["imu"]["mended_gyro_axes"] = judged.mended.gyro.tolist()
        context.metric("imu_rate_hz", summary["imu"]["rate_hz"])
        parts.append(f"{len(recording.imu)} IMU rows at {summary['imu']['rate_hz']:.0f} Hz")
    if recording.fixes is not None:
        summary["gnss"] = _gnss_summary(drive, recording)
        fixed = summary["gnss"]["fixes"]
        context.metric("fixes", fixed)
        parts.append(f"{fixed} fixes")
        if fixed:
            write_fixes(context.work / names.FIXES, recording.fixes)
    if drive.odometer_file is not None:
        _ingest_odometer(context, drive.odometer_file, recording, parts)
    summary["other_drive"] = judged.told(OTHER_CODE)
    summary["warnings"] = context.warnings
    write_json(context.work / names.INGEST, summary)
    context.result = ", ".join(parts) or "bearings only"


def _ingest_odometer(
    context: StageContext, path: Path, recording: Recording, parts: list[str]
) -> None:
    """Wheel speeds help where they are good; a bad file is left out with a warning."""
    from automap.io.odometer_csv import read_odometer_csv
    from automap.io.tables import write_odometer
    from pipeline.check.judge import GOES_ON
    from pipeline.check.wheels import untied

    try:
        found = read_odometer_csv(path, context.drive.manifest.odometer.form)
    except InputError as error:
        context.warn(f"{str(error).rstrip('.')}; {GOES_ON}")
        return
    wheels = found.data
    for text in found.warnings:
        context.warn(text)
    loose = untied(context.drive, recording)
    if loose is not None:
        context.warn(f"{path}: {loose.sentence()}")
        return
    write_odometer(context.work / names.ODOMETER, wheels)
    parts.append(f"{len(wheels)} wheel speeds")


def _check_trajectory(context: StageContext, path: Path) -> dict[str, Any]:
    from automap.io.trajectory_file import read_finished

    finished = read_finished(path)
    for text in finished.warnings:
        context.warn(text)
    return {"file": path.name, "rows": len(finished.data), "time": finished.time}


def _imu_summary(drive: Drive, recording: Recording) -> dict[str, Any]:
    import numpy as np

    from automap.io.recording import imu_time

    imu = recording.imu
    assert imu is not None
    summary: dict[str, Any] = {
        "source": recording.imu_source,
        "time": imu_time(drive, recording),
        "used": len(imu),
        "axes_known": imu.axes_known,
        "first_ns": int(imu.t_ns[0]),
        "last_ns": int(imu.t_ns[-1]),
        "span_s": float(imu.t_ns[-1] - imu.t_ns[0]) * 1e-9,
        "rate_hz": 1e9 / float(np.median(np.diff(imu.t_ns))),
        "temperature": imu.temp_c is not None,
    }
    if recording.imu_file is not None:
        quality = recording.imu_file.quality
        for name in ("rows", "unreadable", "blank", "not_finite", "failed", "repeats"):
            summary[name] = getattr(quality, name)
        summary["wrong_stamps"] = quality.wrong_stamps
        summary["reordered"] = quality.reordered
        summary["gap_count"] = len(quality.gaps)
        longest = sorted(quality.gaps, key=lambda gap: -gap[1])[:_MAX_GAPS]
        summary["gaps"] = [{"after_ns": at, "length_s": length} for at, length in sorted(longest)]
        summary["extra_columns"] = recording.imu_file.extra_columns
    return summary


def _gnss_summary(drive: Drive, recording: Recording) -> dict[str, Any]:
    import numpy as np

    from automap.records import NO_TIME, FixType
    from automap.timebase import gps_to_iso

    fixes, log = recording.fixes, recording.log
    assert fixes is not None
    assert log is not None
    kinds, counts = np.unique(fixes.fix_type, return_counts=True)
    dated = fixes.gps_s[np.isfinite(fixes.gps_s)]
    return {
        "kind": log.kind,
        "epochs": len(fixes),
        "fixes": int(np.count_nonzero(fixes.fix_type >= FixType.TWO_D)),
        "fix_types": {FixType(k).name: int(n) for k, n in zip(kinds, counts, strict=True)},
        "messages": log.messages,
        "bad_checksums": log.bad_checksums,
        "garbage_bytes": log.garbage_bytes,
        "truncated": log.truncated,
        "first_utc": gps_to_iso(float(dated.min())) if len(dated) else None,
        "last_utc": gps_to_iso(float(dated.max())) if len(dated) else None,
        "arrival": bool(np.any(fixes.arrival_ns != NO_TIME)),
        "with_arrival": int(np.count_nonzero(fixes.arrival_ns != NO_TIME)),
    }


def _inputs(drive: Drive) -> list[Path]:
    files = (
        drive.imu_file,
        drive.imu_calibration,
        sensor_input(drive),
        drive.gnss_file,
        drive.arrival_file,
        drive.odometer_file,
        drive.trajectory_file,
    )
    return [path for path in files if path is not None]


def sensor_input(drive: Drive) -> Path | None:
    """The sensor file that turns this drive's counts into units, None when none is needed."""
    if drive.imu.sensor is None or "counts" not in (drive.imu.gyro_unit, drive.imu.accel_unit):
        return None
    from automap.io.sensor_file import find_sensor

    return find_sensor(drive.imu.sensor, drive.path)


STAGE = Stage(
    name="ingest",
    version=20,
    run=run,
    inputs=_inputs,
    needs=(),
    outputs=(names.IMU, names.FIXES, names.ODOMETER, names.INGEST),
    settings=("ingest",),
    # the antenna's place changes nothing here, but the names of files in any section may
    manifest=None,
    blind=True,
)
