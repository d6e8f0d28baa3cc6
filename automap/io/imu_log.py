"""Inertial logs for calibration: a drive folder, a CSV with named columns, or plain numbers."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from automap.errors import ConfigError, InputError
from automap.io import names
from automap.io.even_stamps import bursts_text, straight_stamps
from automap.io.named_table import NamedTable, look_at_table, read_table
from automap.io.sensor_file import SI_PER_UNIT, SensorModel
from automap.io.stamps import order_stamps
from automap.io.table_form import ACCEL, GYRO, TableForm
from automap.io.table_units import doubtful_temperature
from automap.io.wrapped_counts import first_wrap
from automap.records import FloatArray, IntArray, RawImu

SKIP = "-"
"""Stands for a column that is not wanted."""
_ABSURD = 1e12
"""No sensor's reading in any unit, counts of 32 bits included, is as large."""


@dataclass(frozen=True)
class LogFormat:
    """How a log is to be read.

    ``columns`` names the columns of a file of plain numbers (``t_s``, ``gx`` ... ``az``,
    ``temp_c``, ``-`` for one to skip; ``x, y, z`` in files of one sensor each). ``rate_hz`` is
    for logs without a time column. None for a unit: that of the drive, else SI.
    """

    columns: tuple[str, ...] = ()
    rate_hz: float | None = None
    gyro_unit: str | None = None
    accel_unit: str | None = None
    sensor: SensorModel | None = None


@dataclass(frozen=True)
class ImuLog:
    """Readings as logged, the files they came from and what was found on the way."""

    data: RawImu
    files: tuple[Path, ...]
    warnings: tuple[str, ...] = ()


def read_imu_log(path: Path, form: LogFormat) -> ImuLog:
    """Read a drive folder, a CSV with named columns or, with ``form.columns``, plain numbers.

    Readings stay in the log's own units and axes. Raises InputError with file and place, or
    ConfigError when what was said of the columns cannot be.
    """
    if path.is_dir():
        return _read_drive(path, form)
    _require(path, form.columns, GYRO + ACCEL)
    table = _read_numbers(path, form.columns, GYRO + ACCEL)
    gyro, accel = (np.column_stack([table.columns[k] for k in triad]) for triad in (GYRO, ACCEL))
    units = replace(
        form,
        gyro_unit=form.gyro_unit or table.unit(GYRO),
        accel_unit=form.accel_unit or table.unit(ACCEL),
    )
    readings = _Readings(table.t_ns, gyro, accel, table.columns.get("temp_c"))
    warnings = [*table.rows.warnings(), *table.notes]
    return _assemble(path.name, (path,), readings, units, warnings)


def read_imu_pair(accel: Path, gyro: Path, form: LogFormat) -> ImuLog:
    """Read two files of plain numbers, one per sensor, with the same columns ``x, y, z``.

    Where the two have different stamps the gyro is interpolated to the accelerometer's.
    """
    columns = form.columns or ("t_s", "x", "y", "z")
    tables: list[NamedTable] = []
    warnings: list[str] = []
    for path, triad in ((accel, ACCEL), (gyro, GYRO)):
        _require(path, columns, ("x", "y", "z"))
        ours = dict(zip("xyz", triad, strict=True))
        table = _read_numbers(path, tuple(ours.get(name, name) for name in columns), triad)
        tables.append(table)
        warnings += table.rows.warnings()
    felt, turned = (
        np.column_stack([table.columns[name] for name in triad])
        for table, triad in zip(tables, (ACCEL, GYRO), strict=True)
    )
    t_ns, t_gyro = tables[0].t_ns, tables[1].t_ns
    if t_ns is None or t_gyro is None:
        if len(turned) != len(felt):
            raise InputError(
                f"{accel} has {len(felt)} rows and {gyro} {len(turned)}, and no time column says "
                "which belong together; export both with their time."
            )
    elif not np.array_equal(t_ns, t_gyro):
        if not max(t_ns.min(), t_gyro.min()) < min(t_ns.max(), t_gyro.max()):
            raise InputError(
                f"{accel} and {gyro} share no time; give two files of one recording, with the "
                "stamps of one clock."
            )
        order = np.argsort(t_gyro, kind="stable")
        seconds, at = (t_gyro[order] - t_ns[0]) * 1e-9, (t_ns - t_ns[0]) * 1e-9
        turned = np.column_stack(
            [np.interp(at, seconds, turned[order, axis], np.nan, np.nan) for axis in range(3)]
        )
        warnings.append(f"{gyro} has other stamps than {accel}; it is interpolated to them")
    readings = _Readings(t_ns, turned, felt, tables[0].columns.get("temp_c"))
    return _assemble(f"{accel.name} with {gyro.name}", (accel, gyro), readings, form, warnings)


def _read_numbers(path: Path, columns: tuple[str, ...], needed: tuple[str, ...]) -> NamedTable:
    """A table by the names in its header, or of ``columns`` from the first on."""
    places: dict[str, str | int] = {name: at for at, name in enumerate(columns, 1) if name != SKIP}
    table = read_table(path, "imu", TableForm(places), needed=needed, width=len(columns))
    if table.rows.bad_rows >= len(table) and columns:
        raise InputError(
            f"{path} does not hold {len(columns)} numbers a line, see {table.rows.first_bad}; "
            "correct --columns."
        )
    return table


def _require(path: Path, columns: tuple[str, ...], wanted: tuple[str, ...]) -> None:
    missing = [name for name in wanted if name not in columns]
    if missing and columns:
        raise ConfigError(
            f"{path}: --columns names no {missing[0]}; needed are {', '.join(wanted)}, with t_s, "
            "t_ms, t_us or t_ns for the time and - for a column to skip."
        )


def _read_drive(path: Path, form: LogFormat) -> ImuLog:
    from automap.io.drive import load_drive
    from automap.io.imu_csv import ImuFormat, read_imu_csv
    from automap.io.sensor_file import find_sensor, read_sensor

    if not (path / names.MANIFEST).is_file():
        raise InputError(f"{path} is no drive folder; give one with {names.MANIFEST}, or a file.")
    drive = load_drive(path)
    if drive.imu_file is None:
        raise InputError(f"{path} has no inertial log; name it under [imu] in {names.MANIFEST}.")
    # the readings as they stand: unit factors of one, the sensor's own axes
    form_of_table = drive.imu.form
    as_logged = ImuFormat(gyro_unit="rad/s", accel_unit="m/s^2", table=form_of_table)
    recording = read_imu_csv(drive.imu_file, as_logged)
    told = look_at_table(drive.imu_file, "imu", form_of_table)
    sensor = form.sensor
    if sensor is None and drive.imu.sensor is not None:
        sensor = read_sensor(find_sensor(drive.imu.sensor, path))
    stated = replace(
        form,
        gyro_unit=form.gyro_unit or drive.imu.stated("gyro_unit") or told.units.get("gx"),
        accel_unit=form.accel_unit or drive.imu.stated("accel_unit") or told.units.get("ax"),
        sensor=sensor,
    )
    data = recording.data
    raw = RawImu(data.t_ns, data.gyro, data.accel, temp_c=data.temp_c, name=path.name)
    return ImuLog(_with_units(raw, stated), (drive.imu_file,), recording.warnings)


def _refuse_wrapped(name: str, t_ns: IntArray, gyro: FloatArray, accel: FloatArray) -> None:
    """Raise where counts ran over: what was turned or felt since then is wrong."""
    for sensor, values in (("accelerometer", accel), ("gyro", gyro)):
        for i, axis in enumerate("xyz"):
            row = first_wrap(values[:, i])
            if row is not None:
                raise InputError(
                    f"{name}: the {sensor}'s {axis} axis jumps from {values[row, i]:g} to "
                    f"{values[row + 1, i]:g} at {1e-9 * (t_ns[row] - t_ns[0]):.2f} s, so its 16 "
                    "bits ran over; turn it more slowly or set a wider range, and record again."
                )


@dataclass(frozen=True)
class _Readings:
    """Stamps [n], None where there are none, readings [n, 3] and temperatures [n] or None."""

    t_ns: IntArray | None
    gyro: FloatArray
    accel: FloatArray
    temp_c: FloatArray | None


def _assemble(
    name: str, files: tuple[Path, ...], found: _Readings, form: LogFormat, warnings: list[str]
) -> ImuLog:
    n = len(found.accel)
    t_ns = found.t_ns
    if t_ns is None:
        if form.rate_hz is None:
            raise ConfigError(f"{name} has no time column; give its rate with --rate HZ.")
        t_ns = np.rint(np.arange(n) * (1e9 / form.rate_hz)).astype(np.int64)
    # NaN compares false
    good = (np.abs(np.column_stack([found.accel, found.gyro])) < _ABSURD).all(axis=1)
    rows = np.flatnonzero(good)
    if len(rows) < n:
        warnings.append(f"{name}: {n - len(rows)} rows without usable readings left out")
    if len(rows) < 2:
        raise InputError(f"{name} has fewer than two rows with usable readings; record again.")
    stamped = t_ns[rows]
    even = straight_stamps(stamped, np.column_stack([found.accel, found.gyro])[rows])
    if even is not None:
        t_ns = t_ns.copy()
        t_ns[rows] = even
        warnings.append(f"{name}: {bursts_text(1e9 / float(np.median(np.diff(even))), stamped)}")
    order = order_stamps(t_ns[rows])
    if order is None or len(order.keep) < 2:
        raise InputError(f"{name}: its time column does not run; correct --columns or its unit.")
    kept = rows[order.keep]
    _refuse_wrapped(name, t_ns[kept], found.gyro[kept], found.accel[kept])
    if len(kept) < len(rows):
        warnings.append(f"{name}: {len(rows) - len(kept)} rows with stamps out of order left out")
    doubt = None if found.temp_c is None else doubtful_temperature(name, found.temp_c[kept])
    warnings += [] if doubt is None else [doubt]
    raw = RawImu(
        t_ns=t_ns[kept] - t_ns[kept[0]],
        gyro=np.ascontiguousarray(found.gyro[kept]),
        accel=np.ascontiguousarray(found.accel[kept]),
        temp_c=None if found.temp_c is None else found.temp_c[kept],
        name=name,
    )
    return ImuLog(_with_units(raw, form), files, tuple(warnings))


def _with_units(raw: RawImu, form: LogFormat) -> RawImu:
    gyro_unit, accel_unit = form.gyro_unit or "rad/s", form.accel_unit or "m/s^2"
    sensor = form.sensor
    counts = {
        key: None if sensor is None or unit != "counts" else getattr(sensor, key)
        for key, unit in (("gyro", gyro_unit), ("accel", accel_unit))
    }
    scales: dict[str, FloatArray | None] = {}
    for key, unit in (("gyro", gyro_unit), ("accel", accel_unit)):
        triad = counts[key]
        known = None if triad is None else triad.scale
        scales[f"{key}_scale"] = known if unit == "counts" else np.full(3, SI_PER_UNIT[unit])
        scales[f"{key}_zero"] = None if triad is None else triad.zero
    return replace(raw, gyro_unit=gyro_unit, accel_unit=accel_unit, **scales)  # type: ignore[arg-type]
