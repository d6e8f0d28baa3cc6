"""Stage ingest: the recordings of a drive in SI units, vehicle axes and one table each."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from automap.errors import InputError
from automap.io import names
from pipeline.run.stage import Stage, StageContext

if TYPE_CHECKING:
    from automap.evaluation.plausibility import Finding
    from automap.io.drive import Drive
    from automap.io.recording import Recording
    from pipeline.check.axes import WeighedAxes

_MAX_GAPS = 1000


def run(context: StageContext) -> None:
    """Write imu.parquet, fixes.parquet (each where the drive has such data) and ingest.json.

    A file that cannot be used is a warning as long as the drive has another source of
    positions. Raises InputError when it has none, and for readings in a wrong unit or wrong axes.
    """
    from automap.io.atomic import write_json
    from automap.io.recording import read_recording
    from automap.io.tables import write_fixes, write_imu

    drive = context.drive
    recording = read_recording(drive, context.settings.ingest.gap_factor)
    summary: dict[str, Any] = {"drive": drive.name, "imu": None, "gnss": None, "trajectory": None}
    for text in (*drive.warnings, *drive.camera_warnings(), *recording.warnings):
        context.warn(text)
    failures = list(recording.failures)
    usable = drive.bearings_file is not None
    parts = []
    if drive.trajectory_file is not None:
        summary["trajectory"] = _check_trajectory(context, drive.trajectory_file, failures)
        usable |= summary["trajectory"] is not None
        parts.append("finished trajectory")
    if recording.imu is not None:
        weighed = _plausible_readings(context, recording)
        write_imu(context.work / names.IMU, weighed.imu)
        summary["imu"] = _imu_summary(drive, recording)
        if weighed.mended is not None:
            summary["imu"]["mended_accel_axes"] = weighed.mended.accel.tolist()
            summary["imu"]["mended_gyro_axes"] = weighed.mended.gyro.tolist()
        context.metric("imu_rate_hz", summary["imu"]["rate_hz"])
        parts.append(f"{len(recording.imu)} IMU rows at {summary['imu']['rate_hz']:.0f} Hz")
    if recording.fixes is not None:
        summary["gnss"] = _gnss_summary(drive, recording)
        fixed = summary["gnss"]["fixes"]
        context.metric("fixes", fixed)
        parts.append(f"{fixed} fixes")
        usable |= fixed > 0
        if fixed:
            write_fixes(context.work / names.FIXES, recording.fixes)
        else:
            failures.append(
                f"{drive.gnss_file}: the receiver never had a fix in "
                f"{len(recording.fixes)} epochs; give it an open sky before driving."
            )
    if drive.odometer_file is not None:
        _ingest_odometer(context, drive.odometer_file, failures, parts)
    if not usable:
        raise InputError(_without_positions(drive, failures))
    for text in failures:
        context.warn(f"{text.rstrip('.')}; the drive goes on without it")
    summary["warnings"] = context.warnings
    write_json(context.work / names.INGEST, summary)
    context.result = ", ".join(parts) or "bearings only"


def _ingest_odometer(
    context: StageContext, path: Path, failures: list[str], parts: list[str]
) -> None:
    """Wheel speeds help where they are good; a bad file is left out with a warning."""
    from automap.io.odometer_csv import read_odometer_csv
    from automap.io.tables import write_odometer

    try:
        found = read_odometer_csv(path, context.drive.manifest.odometer.form)
    except InputError as error:
        failures.append(str(error))
        return
    wheels = found.data
    for text in found.warnings:
        context.warn(text)
    write_odometer(context.work / names.ODOMETER, wheels)
    parts.append(f"{len(wheels)} wheel speeds")


def _without_positions(drive: Drive, failures: list[str]) -> str:
    """Why nothing of the drive can be placed: what is wrong with its sources of positions."""
    sources = (drive.gnss_file, drive.trajectory_file)
    reasons = [text for path in sources for text in failures if path and text.startswith(str(path))]
    if reasons:
        return reasons[0]
    return (
        f"{drive.path} has no receiver log, and without GPS nothing can be placed on a map; add "
        "gnss.ubx, gnss.nmea or gnss.pos, or a finished trajectory.csv or trajectory.pos."
    )


def _plausible_readings(context: StageContext, recording: Recording) -> WeighedAxes:
    """The readings as they are to be used.

    A wrong unit, wrong axes or a dead sensor spoil everything after it: stop here, with the advice.
    """
    import numpy as np

    from automap.evaluation import plausibility
    from pipeline.check.axes import weigh_axes

    drive, imu = context.drive, recording.imu
    assert imu is not None
    rate_hz = 1e9 / float(np.median(np.diff(imu.t_ns)))
    source = drive.imu_file if recording.imu_source == "csv" else drive.gnss_file

    def tell(findings: Iterable[Finding]) -> None:
        for finding in findings:
            if finding.severity == "error":
                raise InputError(f"{source}: {finding.sentence()}.")
            if finding.severity == "warning":
                context.warn(f"{source}: {finding.sentence()}")

    stamps = plausibility.stamp_unit(rate_hz)
    tell([] if stamps is None else [stamps])
    tell([plausibility.accel_unit(imu.accel, rate_hz), *plausibility.stuck_readings(imu)])
    weighed = weigh_axes(drive, recording)
    tell(weighed.findings)
    return weighed


def _check_trajectory(
    context: StageContext, path: Path, failures: list[str]
) -> dict[str, Any] | None:
    from automap.io.trajectory_file import read_finished

    try:
        finished = read_finished(path)
    except InputError as error:
        failures.append(str(error))
        return None
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
        for name in ("rows", "unreadable", "blank", "not_finite", "repeats", "wrong_stamps"):
            summary[name] = getattr(quality, name)
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
    version=4,
    run=run,
    inputs=_inputs,
    needs=(),
    outputs=(names.IMU, names.FIXES, names.ODOMETER, names.INGEST),
    settings=("ingest",),
    # the manifest's sections on the camera and the antenna's place change nothing here, but
    # the names of files in any section may
    manifest=None,
)
