"""The sensor recordings of a drive, read as far as they can be read."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from automap.errors import InputError
from automap.io.axes import ImuAxes
from automap.io.drive import Drive
from automap.io.imu_csv import ImuRecording, imu_format, read_imu_csv
from automap.io.log_date import find_date
from automap.io.stamps import order_stamps
from automap.records import NO_TIME, Fixes, FixType, ImuData
from automap.timebase import gps_to_iso

if TYPE_CHECKING:
    from automap.io.esf import ReceiverImu
    from automap.io.receiver import ReceiverLog


_NO_DOP = 99.0
"""Two figures before the point hold no more: 99.9 and 99.99 stand for unknown."""


@dataclass(frozen=True)
class Recording:
    """What the IMU file and the receiver log of a drive gave.

    ``imu`` comes from the IMU file, or from the receiver's own sensors when there is no such
    file (``imu_source`` "csv" or "receiver"); ``fixes`` carry arrival times where the drive
    has them. What the drive lacks, or what cannot be read, is None; ``failures`` then holds
    the sentence. ``notes`` say how tables without our names were understood.
    """

    imu: ImuData | None = None
    imu_source: str | None = None
    imu_file: ImuRecording | None = None
    log: ReceiverLog | None = None
    fixes: Fixes | None = None
    failures: tuple[str, ...] = ()
    warnings: tuple[str, ...] = field(default=())
    notes: tuple[str, ...] = ()


def read_recording(drive: Drive, gap_factor: float = 2.5) -> Recording:
    """Read the IMU file, the receiver log and its arrival times.

    A file that cannot be used becomes one of ``failures`` and the rest is still read; a wrong
    manifest or sensor file raises ConfigError.
    """
    failures: list[str] = []
    warnings: list[str] = []
    notes: list[str] = []
    recording = Recording()
    if drive.imu_file is not None:
        try:
            imu_file = read_imu_csv(drive.imu_file, imu_format(drive), gap_factor)
        except InputError as error:
            failures.append(str(error))
        else:
            warnings += imu_file.warnings
            notes += imu_file.notes
            recording = replace(recording, imu=imu_file.data, imu_source="csv", imu_file=imu_file)
    if drive.gnss_file is not None:
        recording = _with_log(drive, recording, failures, warnings, notes)
    return replace(
        recording, failures=tuple(failures), warnings=tuple(warnings), notes=tuple(notes)
    )


def _with_log(
    drive: Drive,
    recording: Recording,
    failures: list[str],
    warnings: list[str],
    notes: list[str],
) -> Recording:
    from automap.io.arrival import attach_arrival, read_arrival

    assert drive.gnss_file is not None
    try:
        log = read_drive_log(drive)
    except InputError as error:
        failures.append(str(error))
        return recording
    warnings += [f"{drive.gnss_file}: {text}" for text in log.warnings]
    notes += log.notes
    fixes = log.fixes
    if drive.arrival_file is not None and len(fixes):
        try:
            arrival = read_arrival(drive.arrival_file, drive.gnss.arrival_table.form)
        except InputError as error:
            failures.append(str(error))
        else:
            fixes = attach_arrival(fixes, arrival)
            warnings += arrival.warnings
            notes += arrival.notes
            if not np.any(fixes.arrival_ns != NO_TIME):
                warnings.append(
                    f"{drive.arrival_file}: the arrival times belong to none of the epochs and "
                    "are not used; offset counts the bytes of the log from 0"
                )
    if log.period_s is not None:
        log, fixes = _with_date(drive, recording, log, fixes, warnings)
    fixes = without_placeholders(fixes, str(drive.gnss_file), warnings)
    recording = replace(recording, log=log, fixes=fixes)
    if recording.imu is None and log.imu is not None and drive.imu_file is None:
        imu = receiver_imu(drive, log.imu, fixes)
        if imu is not None:
            recording = replace(recording, imu=imu, imu_source="receiver")
            warnings.append(
                f"{drive.gnss_file}: the receiver's own sensors ({log.imu.source}) serve as the "
                f"IMU, tied to GPS time to {log.imu.tie_sd_s:g} s"
            )
    return recording


def _with_date(
    drive: Drive, recording: Recording, log: ReceiverLog, fixes: Fixes, warnings: list[str]
) -> tuple[ReceiverLog, Fixes]:
    """A log without a date, and its fixes, with the date that something else tells."""
    assert drive.gnss_file is not None
    assert log.period_s is not None
    readings = None if recording.imu is None else (drive.imu.time, recording.imu.t_ns)
    names = (drive.gnss_file, drive.gnss_file.resolve().parent, drive.path.resolve())
    found = find_date(fixes, log.period_s, drive.gnss.arrival_time, readings, names)
    said = f"{drive.gnss_file}: nothing in the log tells the date or GPS week"
    if found is None:
        warnings.append(f"{said}: times count from the first day or week of 1980")
        return log, fixes
    gps_s = fixes.gps_s + found.shift_s
    day = gps_to_iso(float(gps_s[np.isfinite(gps_s)][0]))[:10]
    warnings.append(f"{said}; it is {day} (UTC) by {found.source}")
    own = log.imu
    if own is not None and own.gps_s is not None:
        own = replace(own, gps_s=own.gps_s + found.shift_s)
    log_fixes = replace(log.fixes, gps_s=log.fixes.gps_s + found.shift_s)
    return replace(log, imu=own, fixes=log_fixes), replace(fixes, gps_s=gps_s)


def without_placeholders(fixes: Fixes, name: str, warnings: list[str]) -> Fixes:
    """Fixes without those at latitude and longitude zero or at a pole, which programs write where
    they have none, nor with a dilution that is one throughout; a sentence that begins with
    ``name`` goes to ``warnings`` for each."""
    stated = fixes.hdop[(fixes.hdop > 0.0) & (fixes.fix_type != FixType.NONE)]
    if len(stated) and (stated >= _NO_DOP).all():
        warnings.append(
            f"{name}: HDOP is {stated.min():g} or more throughout, as receivers write where they "
            "compute none; it is taken as unknown"
        )
        fixes = replace(fixes, hdop=np.full_like(fixes.hdop, np.nan))
    zero = (fixes.lat_rad == 0.0) & (fixes.lon_rad == 0.0)
    pole = np.abs(fixes.lat_rad) >= 0.5 * np.pi
    none = (zero | pole) & (fixes.fix_type != FixType.NONE)
    if not none.any():
        return fixes
    warnings.append(
        f"{name}: {np.count_nonzero(none)} positions at latitude 0, longitude 0 or at a pole are "
        "no fixes and are left out"
    )
    return replace(
        fixes,
        fix_type=np.where(none, FixType.NONE, fixes.fix_type),
        lat_rad=np.where(none, np.nan, fixes.lat_rad),
        lon_rad=np.where(none, np.nan, fixes.lon_rad),
        height_m=np.where(none, np.nan, fixes.height_m),
        vel_ned=np.where(none[:, None], np.nan, fixes.vel_ned),
    )


def read_drive_log(drive: Drive) -> ReceiverLog:
    """The receiver's log of a drive, which may be the very table that holds the readings: then
    the stamps of the readings tell when each fix came. Raises InputError."""
    from automap.io.fix_table import row_stamps
    from automap.io.receiver import read_receiver_log

    assert drive.gnss_file is not None
    written = None
    if drive.imu_file is not None and drive.imu_file.resolve() == drive.gnss_file.resolve():
        written = row_stamps(drive.imu_file, drive.imu.form)
    return read_receiver_log(
        drive.gnss_file,
        form=drive.gnss.form,
        written=written,
        accept_manual="gnss_quality" in drive.manifest.accept,
    )


def receiver_imu(drive: Drive, own: ReceiverImu, fixes: Fixes) -> ImuData | None:
    """The receiver's own sensors as an IMU, None when nothing ties them to GPS time.

    Stamps are in the clock of the arrival times where the drive has those, otherwise
    nanoseconds of GPS time; either way good to ``own.tie_sd_s``. Axes as the manifest says,
    for the receiver is the IMU then; where it says nothing they are unknown.
    """
    if own.gps_s is None:
        return None
    stamps_s = own.gps_s
    known = (fixes.arrival_ns != NO_TIME) & np.isfinite(fixes.gps_s)
    if np.any(known):
        stamps_s = own.gps_s + float(np.median(fixes.arrival_ns[known] * 1e-9 - fixes.gps_s[known]))
    t_ns = np.rint(stamps_s * 1e9).astype(np.int64)
    order = order_stamps(t_ns)
    if order is None or len(order.keep) < 2:
        return None
    rows = order.keep
    said = {"axes", "accel_axes", "gyro_axes"} & drive.imu.model_fields_set
    axes = drive.imu_axes if said else ImuAxes(known=False)
    gyro, accel = axes.apply(own.gyro[rows], own.accel[rows])
    return ImuData(
        t_ns=t_ns[rows],
        gyro=gyro,
        accel=accel,
        temp_c=None if own.temp_c is None else own.temp_c[rows],
        axes_known=axes.known,
    )


def imu_time(drive: Drive, recording: Recording) -> str:
    """The clock of the IMU's stamps: "boot_ns", "gps_ns" or "unix_ns"."""
    if recording.imu_source != "receiver":
        return drive.imu.time
    fixes = recording.fixes
    arrived = fixes is not None and bool(np.any(fixes.arrival_ns != NO_TIME))
    return drive.gnss.arrival_time if arrived else "gps_ns"
