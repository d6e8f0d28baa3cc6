"""Inertial recordings as CSV, in any unit and axes that a manifest can name."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from automap.errors import ConfigError, InputError
from automap.io.axes import ImuAxes
from automap.io.csv_columns import CsvColumns
from automap.io.drive import Drive
from automap.io.even_stamps import bursts_text, straight_stamps
from automap.io.failed_reads import FAILED, failed_rows
from automap.io.imu_calibration import read_imu_calibration
from automap.io.named_table import NamedTable, read_table
from automap.io.sensor_file import SI_PER_UNIT, SensorModel, find_sensor, read_sensor
from automap.io.stamps import StampOrder, find_gaps, order_stamps
from automap.io.table_form import ACCEL, GYRO, TableForm
from automap.io.table_units import doubtful_temperature
from automap.records import BoolArray, FloatArray, ImuCalibration, ImuData, IntArray


@dataclass(frozen=True)
class ImuFormat:
    """How the readings of a file are to be understood.

    ``axes`` are those of the triads. Units as in the manifest, None for what the names of the
    columns tell, SI where they tell nothing; "counts" need a ``sensor``. A ``calibration``
    takes the place of the unit: its scale is SI per reading unit. ``table`` says which column
    is what.
    """

    axes: ImuAxes = field(default_factory=ImuAxes)
    gyro_unit: str | None = None
    accel_unit: str | None = None
    sensor: SensorModel | None = None
    calibration: ImuCalibration | None = None
    table: TableForm = field(default_factory=TableForm)


@dataclass(frozen=True)
class ImuQuality:
    """What was found in an inertial recording.

    ``rows`` in the file, ``used`` of them; ``unreadable``, ``blank``, ``not_finite`` (NaN or
    infinite), ``failed`` (the sensor did not answer), ``repeats`` (of a stamp), ``wrong_stamps``
    (out of the sequence) were left out; ``reordered`` came late and were put in their place.
    ``gaps``: stamp before, length in s. ``span_s`` from first to last stamp, ``rate_hz`` by the
    median step.
    """

    rows: int
    used: int
    unreadable: int
    blank: int
    not_finite: int
    failed: int
    repeats: int
    wrong_stamps: int
    reordered: int
    gaps: tuple[tuple[int, float], ...]
    span_s: float
    rate_hz: float


@dataclass(frozen=True)
class ImuRecording:
    """Readings in SI units with what was found on the way.

    ``notes`` say how a table without our names was understood.
    """

    data: ImuData
    quality: ImuQuality
    extra_columns: tuple[str, ...]
    warnings: tuple[str, ...]
    notes: tuple[str, ...] = ()


def imu_format(drive: Drive) -> ImuFormat:
    """The format that the manifest of a drive states; ConfigError when a file it names is
    wrong or missing."""
    section = drive.imu
    in_counts = "counts" in (section.gyro_unit, section.accel_unit)
    calibration = None
    if drive.imu_calibration is not None:
        calibration = read_imu_calibration(drive.imu_calibration)
    sensor = None
    if in_counts and section.sensor is not None:
        sensor = read_sensor(find_sensor(section.sensor, drive.path))
    if in_counts and sensor is None and calibration is None:
        raise ConfigError(
            f"{drive.manifest_file}: [imu] is in counts and its calibration file is not there; "
            "name a sensor as well."
        )
    return ImuFormat(
        drive.imu_axes,
        section.stated("gyro_unit"),
        section.stated("accel_unit"),
        sensor,
        calibration,
        section.form,
    )


def reading_units(table: NamedTable, form: ImuFormat) -> tuple[str, str]:
    """The units of gyro and accelerometer: as stated, as the table's names tell, or SI.

    Raises ConfigError where a calibration was made from a log in others.
    """
    gyro = form.gyro_unit or table.unit(GYRO) or "rad/s"
    accel = form.accel_unit or table.unit(ACCEL) or "m/s^2"
    if form.calibration is not None:
        for name, ours in (("gyro_unit", gyro), ("accel_unit", accel)):
            theirs = getattr(form.calibration, name)
            if theirs is not None and theirs != ours:
                raise ConfigError(
                    f"{table.rows.path} has {name} = {ours!r}, but its calibration was made from "
                    f"a log with {name} {theirs}; calibrate from a log in the same unit."
                )
    return gyro, accel


def read_imu_csv(
    path: Path, form: ImuFormat | None = None, gap_factor: float = 2.5
) -> ImuRecording:
    """Read ``t_ns, gx, gy, gz, ax, ay, az [, temp_c]``, in any order, to SI units; other names,
    times and units as ``form.table`` says or as they can be guessed.

    Readings come out in vehicle axes (FRD), or in those of its case where these are unknown.
    Time stamps pass unchanged, but for bursts (``even_stamps``); rows that cannot be used are left
    out and counted, and a sentence says so. ``gap_factor``: a step longer than so many median
    steps is a gap. Raises InputError when nothing usable is left.
    """
    form = ImuFormat() if form is None else form
    named = read_table(path, "imu", form.table)
    table = named.rows
    if named.t_ns is None:
        raise InputError(
            f"{path}: no column is a time; name it t_ns, or say in drive.toml which one is and "
            'what it counts: columns = { t = "..." }, time_format = "ms".'
        )
    readings = np.column_stack([named.columns[name] for name in (*GYRO, *ACCEL)])
    finite = np.asarray(np.isfinite(readings).all(axis=1))
    rows = np.flatnonzero(finite)
    if len(rows) < 2:
        raise InputError(f"{path} has fewer than two rows with finite readings; record again.")
    t_ns = named.t_ns
    even = straight_stamps(t_ns[rows], readings[rows])
    if even is not None:
        t_ns = t_ns.copy()
        t_ns[rows] = even
    written = len(rows)
    rows = rows[~_written_again(t_ns[rows], readings[rows])]
    copies = written - len(rows)
    order = order_stamps(t_ns[rows])
    if order is None:
        raise InputError(
            f"{path}: the stamps in t_ns jump back and forth thousands of times, so they are no "
            "clock; write integer nanoseconds of one monotonic clock."
        )
    kept = rows[order.keep]
    if len(kept) < 2:
        raise InputError(f"{path}: all rows bear the same t_ns; record with a running clock.")
    unread = failed_rows(readings[kept, :3], readings[kept, 3:])
    kept = kept[~unread]
    stamps, gyro_raw, accel_raw = t_ns[kept], readings[kept, :3], readings[kept, 3:]
    del readings  # of ten hours each of these is a fifth of a gigabyte
    gyro_unit, accel_unit = reading_units(named, form)
    if form.calibration is not None:
        gyro, accel = form.calibration.apply(gyro_raw, accel_raw)
    else:
        gyro = _to_si(gyro_raw, "gyro", gyro_unit, form)
        accel = _to_si(accel_raw, "accel", accel_unit, form)
    del gyro_raw, accel_raw
    gyro, accel = form.axes.apply(gyro, accel)
    temp = None
    if "temp_c" in named.columns:
        temp = _fill(named.columns["temp_c"][kept])
    doubt = None if temp is None else doubtful_temperature(str(path), temp)
    gaps = find_gaps(stamps, gap_factor)
    step_s = float(np.median(np.diff(stamps))) * 1e-9
    quality = ImuQuality(
        rows=len(table) + table.bad_rows + table.blank_rows,
        used=len(kept),
        unreadable=table.bad_rows,
        blank=table.blank_rows,
        not_finite=len(table) - written,
        failed=int(unread.sum()),
        repeats=order.repeats + copies,
        wrong_stamps=order.stepped_back + sum(p.last - p.first + 1 for p in order.lost),
        reordered=order.reordered,
        gaps=tuple(gaps),
        span_s=float(stamps[-1] - stamps[0]) * 1e-9,
        rate_hz=1.0 / step_s,
    )
    return ImuRecording(
        data=ImuData(stamps, gyro, accel, temp_c=temp, axes_known=form.axes.known),
        quality=quality,
        extra_columns=table.extra,
        warnings=tuple(
            ([] if even is None else [f"{path}: {bursts_text(quality.rate_hz, named.t_ns[rows])}"])
            + _warnings(table, rows, finite, order, quality, t_ns)
            + ([] if doubt is None else [doubt])
        ),
        notes=named.notes,
    )


def _written_again(t_ns: IntArray, readings: FloatArray) -> BoolArray:
    """Which rows [n] step back in time and copy an earlier row, stamp and readings [n, 6] alike.

    A block that a logger wrote twice is no clock that was set back: nothing is lost with it.
    """
    again = np.zeros(len(t_ns), dtype=bool)
    if not np.any(np.diff(t_ns) < 0):
        return again
    by_time = np.argsort(t_ns, kind="stable")
    same = (np.diff(t_ns[by_time]) == 0) & (np.diff(readings[by_time], axis=0) == 0.0).all(axis=1)
    again[by_time[1:][same]] = True
    return again & (t_ns < np.maximum.accumulate(t_ns))


def _to_si(reading: FloatArray, triad: str, unit: str, form: ImuFormat) -> FloatArray:
    if unit == "counts":
        if form.sensor is None:
            raise ConfigError(f"{triad} readings in counts need a sensor file.")
        return (form.sensor.gyro if triad == "gyro" else form.sensor.accel).from_counts(reading)
    return reading * SI_PER_UNIT[unit]


def _fill(temp_c: FloatArray) -> FloatArray | None:
    """Temperatures [n] with missing ones interpolated; None when there are none at all."""
    known = np.flatnonzero(np.isfinite(temp_c))
    if not len(known):
        return None
    return np.interp(np.arange(len(temp_c)), known, temp_c[known])


def _warnings(
    table: CsvColumns,
    rows: np.ndarray,
    finite: np.ndarray,
    order: StampOrder,
    quality: ImuQuality,
    t_ns: np.ndarray,
) -> list[str]:
    path = table.path
    found = table.warnings()
    if quality.not_finite:
        line = table.line(int(np.flatnonzero(~finite)[0]))
        found.append(
            f"{path}: {_count(quality.not_finite)} without a finite reading left out, the first "
            f"in line {line}"
        )
    if quality.failed:
        found.append(f"{path}: {_count(quality.failed)} {FAILED}")
    if order.repeats > 0.2 * quality.rows:
        found.append(
            f"{path}: {_count(order.repeats)} bear a t_ns that another row has; the stamps are "
            "too coarse for the rate, record finer ones"
        )
    mended = _mended(quality)
    if mended:
        found.append(f"{path}: {mended}")
    if order.stepped_back:
        found.append(
            f"{path}: the clock was set back, {_count(order.stepped_back)} left out until it "
            "caught up; use a monotonic clock"
        )
    for piece in order.lost[:5]:
        first, last = (table.line(int(rows[row])) for row in (piece.first, piece.last))
        where = f"line {first}" if first == last else f"lines {first} to {last}"
        longer = (piece.end_ns - piece.start_ns) * 1e-9
        advice = "; if they are another drive, put them in a folder of their own"
        found.append(
            f"{path}: {where} left out, the stamps ({t_ns[rows[piece.first]]} ...) do not "
            "continue those of the rest" + (advice if longer > 10.0 else "")
        )
    if len(order.lost) > 5:
        found.append(f"{path}: {len(order.lost) - 5} more stretches with wrong stamps left out")
    return found


def _mended(quality: ImuQuality) -> str:
    """Late rows, copies and gaps, which a recording over USB always has some of."""
    parts = []
    if quality.reordered:
        parts.append(f"{_count(quality.reordered)} that came late sorted in by t_ns")
    if quality.repeats:
        parts.append(f"{_count(quality.repeats)} with the t_ns of another row left out")
    if quality.gaps:
        n = len(quality.gaps)
        lengths = [length for _, length in quality.gaps]
        parts.append(
            f"{n} gap{'s' if n > 1 else ''}, the longest {max(lengths):.2f} s, "
            f"{sum(lengths):.2f} s in all"
        )
    return ", ".join(parts)


def _count(rows: int) -> str:
    return "1 row" if rows == 1 else f"{rows} rows"


def write_imu_csv(path: Path, imu: ImuData) -> None:
    """Write the readings as ``t_ns, gx, gy, gz, ax, ay, az [, temp_c]``, SI units."""
    warm = imu.temp_c
    with path.open("w", encoding="utf-8", newline="\n") as out:
        out.write("t_ns,gx,gy,gz,ax,ay,az" + ("\n" if warm is None else ",temp_c\n"))
        for i, (t, g, a) in enumerate(zip(imu.t_ns, imu.gyro, imu.accel, strict=True)):
            out.write(f"{t},{g[0]:.7f},{g[1]:.7f},{g[2]:.7f},{a[0]:.5f},{a[1]:.5f},{a[2]:.5f}")
            out.write("\n" if warm is None else f",{warm[i]:.3f}\n")
