"""Checks of the inertial recording."""

from __future__ import annotations

import numpy as np

from automap.evaluation import one_sensor, plausibility
from automap.evaluation.plausibility import Finding
from automap.io.csv_columns import listed
from automap.io.drive import Drive
from automap.io.recording import Recording
from automap.records import ImuData
from pipeline.check import limits
from pipeline.check.axes import CODE, SCALE_CODE, WeighedAxes, seen_motion, weigh_axes
from pipeline.check.same_drive import (
    OTHER_CODE,
    UNKNOWN_CODE,
    driven_span,
    other_drive,
    usable_receiver,
)
from pipeline.check.steadiness import check as steadiness
from pipeline.check.steadiness import offset
from pipeline.check.turned import pieces_of, turned_meanwhile

LEFT_OUT = ("imu_sparse", OTHER_CODE)
"""Codes of findings with which a drive goes on without its IMU."""
ABSENT = Finding(
    "warning",
    "no IMU recording",
    "the trajectory will come from the fixes alone, smoothed; add imu.csv if there is one",
)


def sparse(imu: ImuData) -> Finding | None:
    """A warning for readings that are too few to be of use, else None."""
    rate = 1e9 / float(np.median(np.diff(imu.t_ns))) if len(imu) > 1 else 0.0
    if len(imu) >= limits.FEW_READINGS and rate >= limits.SPARSE_HZ:
        return None
    return Finding(
        "warning",
        f"{len(imu)} readings, {rate:.2g} Hz, are too few to be used",
        "the drive goes on with the receiver alone; record at 50 Hz or more",
        "imu_sparse",
    )


def check(drive: Drive, recording: Recording) -> tuple[list[Finding], WeighedAxes | None]:
    """What the readings look like: amount, rate, gaps, units, gravity, clock; and their axes, None
    where the unit is wrong already."""
    imu = recording.imu
    assert imu is not None
    rate = 1e9 / float(np.median(np.diff(imu.t_ns)))
    span = float(imu.t_ns[-1] - imu.t_ns[0]) * 1e-9
    source = "" if recording.imu_source == "csv" else " of the receiver's own sensors"
    temperature = ", with temperature" if imu.temp_c is not None else ""
    findings = [
        Finding("ok", f"{len(imu)} readings{source}, {rate:.1f} Hz, {span:.1f} s{temperature}")
    ]
    if rate < limits.SLOW_HZ:
        findings.append(
            Finding("warning", f"{rate:.1f} Hz is slow for a car", "record at 50 Hz or more")
        )
    if recording.imu_file is not None:
        long = [gap for gap in recording.imu_file.quality.gaps if gap[1] > limits.LONG_GAP_S]
        if long:
            at, length = max(long, key=lambda gap: gap[1])
            findings.append(
                Finding(
                    "warning",
                    f"{len(long)} of the gaps are longer than {limits.LONG_GAP_S:g} s; the "
                    f"longest, {length:.1f} s, after t_ns {at}",
                    "the path drifts there, and over 3 s it is that of the fixes; look for a slow "
                    "disk or a loose cable",
                )
            )
        # of a table that is the receiver's log as well others are read
        if recording.imu_file.extra_columns and drive.imu_file != drive.gnss_file:
            columns = listed(recording.imu_file.extra_columns)
            findings.append(Finding("info", f"columns that nothing reads: {columns}"))
    stamps = plausibility.stamp_unit(rate)
    findings += [] if stamps is None else [stamps]
    receiver = usable_receiver(drive, recording)
    driven = driven_span(imu, receiver)
    # what is of two sensors is wrong in most other ways too
    other = one_sensor.two_in_turn(imu) or one_sensor.other_from(imu, *driven)
    if other is not None:
        return [*findings, other], None
    unit = plausibility.accel_unit(imu.accel, rate)
    findings += [unit, plausibility.gyro_size(imu.gyro)]
    findings += plausibility.stuck_readings(drive.imu_axes.as_read(imu))
    if unit.severity != "ok":
        return findings, None
    fixes, clock, wrong, *_ = receiver
    if wrong is not None:
        findings.append(Finding("error", wrong, code=UNKNOWN_CODE))
    seen = seen_motion(imu, fixes, clock)
    pieces = pieces_of(imu, fixes, clock, seen)
    # one file is of one drive
    apart = recording.imu_source == "csv" and drive.imu_file != drive.gnss_file
    if apart and drive.gnss_file is not None:
        other = other_drive(imu, receiver, seen, pieces, drive.gnss_file.name)
        if other is not None:
            return [*findings, other], None
    turned = turned_meanwhile(imu, fixes, seen, pieces)
    if turned is not None:
        return [*findings, turned], None
    weighed = weigh_axes(drive, recording, seen)
    if any(found.code == SCALE_CODE for found in weighed.findings):
        other = one_sensor.gyro_unit_from(imu, *driven)
        if other is not None:
            return [*findings, other], None
    if any(found.code == CODE and found.severity == "error" for found in weighed.findings):
        # turns about an axis that is another tell nothing of a clock
        return [*findings, *weighed.findings], weighed
    off = offset(weighed.imu, fixes, clock)
    if off is not None:
        return [*findings, off], None
    return [*findings, *steadiness(weighed.imu, fixes, clock), *weighed.findings], weighed


def is_harmless(recording: Recording, text: str) -> bool:
    """Whether a warning of the reader speaks of what every recording has a little of."""
    if recording.imu_file is None or (" gap" not in text and " t_ns" not in text):
        return False
    quality = recording.imu_file.quality
    longest = max((length for _, length in quality.gaps), default=0.0)
    left_out = quality.rows - quality.used
    return longest <= limits.LONG_GAP_S and left_out <= limits.LEFT_OUT_SHARE * quality.rows
