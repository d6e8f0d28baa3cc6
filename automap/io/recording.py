"""The sensor recordings of a drive, read as far as they can be read."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from automap.errors import InputError
from automap.io.drive import Drive
from automap.io.imu_csv import ImuRecording, imu_format, read_imu_csv
from automap.records import Fixes, ImuData

if TYPE_CHECKING:
    from automap.io.receiver import ReceiverLog


@dataclass(frozen=True)
class Recording:
    """What the IMU file and the receiver log of a drive gave.

    ``imu`` comes from the IMU file, or from the receiver's own sensors when there is no such
    file (``imu_source`` "csv" or "receiver"); ``fixes`` carry arrival times where the drive
    has them. What the drive lacks, or what cannot be read, is None; ``failures`` then holds
    the sentence.
    """

    imu: ImuData | None = None
    imu_source: str | None = None
    imu_file: ImuRecording | None = None
    log: ReceiverLog | None = None
    fixes: Fixes | None = None
    failures: tuple[str, ...] = ()
    warnings: tuple[str, ...] = field(default=())


def read_recording(drive: Drive, gap_factor: float = 2.5) -> Recording:
    """Read the IMU file, the receiver log and its arrival times.

    A file that cannot be used becomes one of ``failures`` and the rest is still read; a wrong
    manifest or sensor file raises ConfigError.
    """
    failures: list[str] = []
    warnings: list[str] = []
    recording = Recording()
    if drive.imu_file is not None:
        try:
            imu_file = read_imu_csv(drive.imu_file, imu_format(drive), gap_factor)
        except InputError as error:
            failures.append(str(error))
        else:
            warnings += imu_file.warnings
            recording = replace(recording, imu=imu_file.data, imu_source="csv", imu_file=imu_file)
    if drive.gnss_file is not None:
        recording = _with_log(drive, recording, failures, warnings)
    return replace(recording, failures=tuple(failures), warnings=tuple(warnings))


def _with_log(
    drive: Drive, recording: Recording, failures: list[str], warnings: list[str]
) -> Recording:
    from automap.io.arrival import attach_arrival, read_arrival
    from automap.io.receiver import read_receiver_log

    assert drive.gnss_file is not None
    try:
        log = read_receiver_log(drive.gnss_file)
    except InputError as error:
        failures.append(str(error))
        return recording
    warnings += log.warnings
    fixes = log.fixes
    if drive.arrival_file is not None and len(fixes):
        try:
            fixes = attach_arrival(fixes, *read_arrival(drive.arrival_file))
        except InputError as error:
            failures.append(str(error))
    recording = replace(recording, log=log, fixes=fixes)
    if recording.imu is None and log.imu is not None and drive.imu_file is None:
        imu = receiver_imu(drive, log)
        if imu is not None:
            recording = replace(recording, imu=imu, imu_source="receiver")
    return recording


def receiver_imu(drive: Drive, log: ReceiverLog) -> ImuData | None:
    """The receiver's own sensors as an IMU, None when they are not six complete axes.

    Stamps are those of the log, in the clock that it gives them; axes as the manifest says,
    for the receiver is the IMU then.
    """
    own = log.imu
    if own is None or len(own.t_ns) < 2:
        return None
    C = drive.imu_axes
    gyro, accel = own.gyro, own.accel
    if C is not None:
        gyro, accel = gyro @ C.T, accel @ C.T
    return ImuData(
        t_ns=own.t_ns,
        gyro=np.ascontiguousarray(gyro),
        accel=np.ascontiguousarray(accel),
        temp_c=own.temp_c,
        axes_known=C is not None,
    )
