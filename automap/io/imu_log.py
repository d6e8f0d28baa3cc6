"""Inertial logs for calibration: a drive folder, a CSV with named columns, or plain numbers."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from automap.errors import ConfigError, InputError
from automap.io import names
from automap.io.csv_columns import read_columns
from automap.io.number_columns import read_numbers
from automap.io.sensor_file import SI_PER_UNIT, SensorModel
from automap.io.stamps import TIME_COLUMNS, order_stamps
from automap.records import FloatArray, IntArray, RawImu

_GYRO = ("gx", "gy", "gz")
_ACCEL = ("ax", "ay", "az")
SKIP = "-"
"""Stands for a column that is not wanted."""
_ABSURD = 1e12
"""No sensor's reading in any unit, counts of 32 bits included, is as large."""
_LONGEST_NS = 1e18


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
    if form.columns:
        numbers = read_numbers(path, len(form.columns))
        columns = {
            name: numbers.values[:, i] for i, name in enumerate(form.columns) if name != SKIP
        }
        _require(path, columns, _GYRO + _ACCEL)
        return _assemble(path.name, (path,), columns, form, list(numbers.warnings))
    optional = {**dict.fromkeys(TIME_COLUMNS, "float"), "t_ns": "int", "temp_c": "float"}
    table = read_columns(path, dict.fromkeys(_GYRO + _ACCEL, "float"), optional)  # type: ignore[arg-type]
    return _assemble(path.name, (path,), table.columns, form, table.warnings())


def read_imu_pair(accel: Path, gyro: Path, form: LogFormat) -> ImuLog:
    """Read two files of plain numbers, one per sensor, with the same columns ``x, y, z``.

    Where the two have different stamps the gyro is interpolated to the accelerometer's.
    """
    columns = form.columns or ("t_s", "x", "y", "z")
    tables: list[dict[str, FloatArray]] = []
    warnings: list[str] = []
    for path in (accel, gyro):
        numbers = read_numbers(path, len(columns))
        table = {name: numbers.values[:, i] for i, name in enumerate(columns) if name != SKIP}
        _require(path, table, ("x", "y", "z"))
        tables.append(table)
        warnings += numbers.warnings
    joined = {k: v for k, v in tables[0].items() if k in TIME_COLUMNS or k == "temp_c"}
    joined.update(zip(_ACCEL, (tables[0][k] for k in "xyz"), strict=True))
    time = next((k for k in columns if k in TIME_COLUMNS), None)
    n = len(tables[0]["x"])
    if time is None and len(tables[1]["x"]) != n:
        raise InputError(
            f"{accel} has {n} rows and {gyro} {len(tables[1]['x'])}, and no time column says "
            "which belong together; export both with their time."
        )
    same = time is None or np.array_equal(tables[0][time], tables[1][time])
    for name, axis in zip(_GYRO, "xyz", strict=True):
        values = tables[1][axis]
        if not same and time is not None:
            _require_overlap(accel, gyro, tables[0][time], tables[1][time])
            order = np.argsort(tables[1][time], kind="stable")
            values = np.interp(
                tables[0][time], tables[1][time][order], values[order], np.nan, np.nan
            )
        joined[name] = values
    if not same:
        warnings.append(f"{gyro} has other stamps than {accel}; it is interpolated to them")
    return _assemble(f"{accel.name} with {gyro.name}", (accel, gyro), joined, form, warnings)


def _require_overlap(accel: Path, gyro: Path, t_accel: FloatArray, t_gyro: FloatArray) -> None:
    both = [t[np.isfinite(t)] for t in (t_accel, t_gyro)]
    begin = max(t.min(initial=np.inf) for t in both)
    if not begin < min(t.max(initial=-np.inf) for t in both):
        raise InputError(
            f"{accel} and {gyro} share no time; give two files of one recording, with the stamps "
            "of one clock."
        )


def _require(path: Path, columns: dict[str, FloatArray], wanted: tuple[str, ...]) -> None:
    missing = [name for name in wanted if name not in columns]
    if missing:
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
    recording = read_imu_csv(drive.imu_file, ImuFormat())
    sensor = form.sensor
    if sensor is None and drive.imu.sensor is not None:
        sensor = read_sensor(find_sensor(drive.imu.sensor, path))
    stated = replace(
        form,
        gyro_unit=form.gyro_unit or drive.imu.gyro_unit,
        accel_unit=form.accel_unit or drive.imu.accel_unit,
        sensor=sensor,
    )
    data = recording.data
    raw = RawImu(data.t_ns, data.gyro, data.accel, temp_c=data.temp_c, name=path.name)
    return ImuLog(_with_units(raw, stated), (drive.imu_file,), recording.warnings)


def _assemble(
    name: str,
    files: tuple[Path, ...],
    columns: dict[str, np.ndarray],
    form: LogFormat,
    warnings: list[str],
) -> ImuLog:
    accel = np.column_stack([columns[k] for k in _ACCEL]).astype(np.float64)
    gyro = np.column_stack([columns[k] for k in _GYRO]).astype(np.float64)
    t_ns = _stamps(name, columns, len(accel), form.rate_hz)
    # NaN compares false
    good = (np.abs(np.column_stack([accel, gyro])) < _ABSURD).all(axis=1) & (t_ns >= 0)
    rows = np.flatnonzero(good)
    if len(rows) < len(accel):
        warnings.append(f"{name}: {len(accel) - len(rows)} rows without usable readings left out")
    if len(rows) < 2:
        raise InputError(f"{name} has fewer than two rows with usable readings; record again.")
    order = order_stamps(t_ns[rows])
    if order is None or len(order.keep) < 2:
        raise InputError(f"{name}: its time column does not run; correct --columns or its unit.")
    kept = rows[order.keep]
    if len(kept) < len(rows):
        warnings.append(f"{name}: {len(rows) - len(kept)} rows with stamps out of order left out")
    temp = columns.get("temp_c")
    raw = RawImu(
        t_ns=t_ns[kept],
        gyro=np.ascontiguousarray(gyro[kept]),
        accel=np.ascontiguousarray(accel[kept]),
        temp_c=None if temp is None else np.asarray(temp, np.float64)[kept],
        name=name,
    )
    return ImuLog(_with_units(raw, form), files, tuple(warnings))


def _stamps(name: str, columns: dict[str, np.ndarray], n: int, rate: float | None) -> IntArray:
    """Nanoseconds [n]; -1 where there is no stamp."""
    time = next((k for k in TIME_COLUMNS if k in columns), None)
    if time is None:
        if rate is None:
            raise ConfigError(f"{name} has no time column; give its rate with --rate HZ.")
        return np.asarray(np.rint(np.arange(n) * (1e9 / rate)), dtype=np.int64)
    values = columns[time]
    if values.dtype == np.int64:
        return np.asarray(values - int(values.min()), dtype=np.int64)
    finite = np.isfinite(values)
    if not finite.any():
        raise InputError(f"{name}: the column {time} holds no number; correct --columns.")
    since = np.where(finite, values - values[finite].min(), -1.0) * TIME_COLUMNS[time]
    return np.asarray(np.rint(np.where(since < _LONGEST_NS, since, -1.0)), dtype=np.int64)


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
