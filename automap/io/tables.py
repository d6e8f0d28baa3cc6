"""Intermediate tables in Parquet: inertial readings and receiver epochs.

Written by the ingest stage, read by every later one. Values are those of the records,
bit for bit (radians and SI units, which the column names state).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from automap.errors import InputError
from automap.io.arrow_columns import column_to_numpy, numpy_to_array
from automap.io.atomic import atomic_path
from automap.records import Fixes, FloatArray, ImuData, IntArray, WheelSpeed

if TYPE_CHECKING:
    import pyarrow as pa
    import pyarrow.parquet as pq

ROWS = 1 << 18
"""Rows of a long table that are written at once, 45 minutes at 100 Hz."""
_IMU_GYRO = ("gx_rad_s", "gy_rad_s", "gz_rad_s")
_IMU_ACCEL = ("ax_m_s2", "ay_m_s2", "az_m_s2")
_VECTORS = {
    "vel_ned": ("vn", "ve", "vd"),
    "sd_pos_ned": ("sd_n_m", "sd_e_m", "sd_d_m"),
    "sd_vel_ned": ("sd_vn", "sd_ve", "sd_vd"),
}
_FLOATS = ("gps_s", "lat_rad", "lon_rad", "height_m", "hdop", "geoid_sep_m")
_INTS = ("fix_type", "n_sats", "offset", "arrival_ns")


def write_columns(
    path: Path,
    columns: Mapping[str, np.ndarray],
    metadata: Mapping[str, str] | None = None,
    *,
    split: tuple[str, ...] = (),
) -> None:
    """Write named columns [n] as one Parquet file, atomically, with file metadata.

    The float columns named in ``split`` are stored with their like bytes together, which
    packs noisy signals in half the time; readers older than Parquet 2.8 do not know it.
    """
    n = max((len(values) for values in columns.values()), default=0)
    starts = range(0, max(n, 1), ROWS)
    pieces = ({k: v[a : a + ROWS] for k, v in columns.items()} for a in starts)
    write_pieces(path, pieces, metadata, split=split)


def write_row_groups(path: Path, tables: Iterable[Any], rows: int, **options: Any) -> None:
    """Write tables that come one after another, one at least, in row groups of so many rows."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    waiting: list[Any] = []
    with ExitStack() as stack:
        writer = None
        for table in tables:
            if writer is None:
                writer = stack.enter_context(pq.ParquetWriter(path, table.schema, **options))
            waiting.append(table)
            if sum(map(len, waiting)) > rows:
                whole = pa.concat_tables(waiting).combine_chunks()
                full = len(whole) - len(whole) % rows
                writer.write_table(whole.slice(0, full), rows)
                waiting = [whole.slice(full)]
        if writer is not None:
            writer.write_table(pa.concat_tables(waiting).combine_chunks(), rows)


def write_pieces(
    path: Path,
    pieces: Iterable[Mapping[str, np.ndarray]],
    metadata: Mapping[str, str] | None = None,
    *,
    split: tuple[str, ...] = (),
) -> None:
    """Write columns that come in pieces of some rows each, one at least, as ``write_columns``."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    writer: pq.ParquetWriter | None = None
    with atomic_path(path) as temporary:
        try:
            for piece in pieces:
                table = pa.table({name: numpy_to_array(values) for name, values in piece.items()})
                table = table.replace_schema_metadata(dict(metadata) if metadata else None)
                if writer is None:
                    # dictionary encoding of noise costs time and gains nothing
                    writer = pq.ParquetWriter(
                        temporary,
                        table.schema,
                        compression="zstd",
                        use_dictionary=False,
                        use_byte_stream_split=list(split),
                    )
                writer.write_table(table)
        finally:
            if writer is not None:
                writer.close()


def read_table(
    path: Path,
    required: tuple[str, ...] = (),
    numbers: Collection[str] = (),
    whole: Collection[str] = (),
) -> pa.Table:
    """Read a Parquet file; InputError when it is missing, damaged or lacks a column, or where those
    that are ``numbers``, or ``whole`` ones, hold something else."""
    with _opened(path, required, numbers, whole) as file:
        # where memory is short Arrow waits for threads that never began
        table = file.read(use_threads=False)
        check_texts(table)
        return table


def check_texts(table: pa.Table) -> None:
    """Raise ArrowInvalid where a text is no UTF-8; Arrow itself says so only where it is used."""
    import pyarrow as pa

    for column in table.columns:
        if not pa.types.is_primitive(column.type):
            column.validate(full=True)


@contextmanager
def column_by_column(
    path: Path,
    required: tuple[str, ...],
    numbers: Collection[str] = (),
    whole: Collection[str] = (),
) -> Iterator[tuple[pa.Schema, Callable[[str], pa.Table]]]:
    """The schema of a Parquet file and what reads one column of it: a long table need not be in
    memory beside what is made of it. Raises as ``read_table``."""
    with _opened(path, required, numbers, whole) as file:
        yield file.schema_arrow, lambda name: file.read(columns=[name], use_threads=False)


@contextmanager
def _opened(
    path: Path,
    required: tuple[str, ...],
    numbers: Collection[str] = (),
    whole: Collection[str] = (),
) -> Iterator[pq.ParquetFile]:
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        # pq.read_table would import the whole dataset machinery for one file
        with pq.ParquetFile(path) as file:
            there = set(file.schema_arrow.names)
            missing = [name for name in required if name not in there]
            if missing:
                raise InputError(f"{path} lacks the column {missing[0]}; run again with --force.")
            _check_kinds(path, file.schema_arrow, numbers, whole)
            yield file
        # of a long drive Arrow keeps a hundred megabytes for what it may read next
        pa.default_memory_pool().release_unused()
    except FileNotFoundError:
        raise InputError(f"{path} is missing; run the stage that writes it.") from None
    except (pa.ArrowException, OSError, ValueError) as error:
        raise InputError(
            f"{path} is not a readable Parquet file ({str(error).splitlines()[0]}); "
            "run again with --force to make it anew."
        ) from error


def _check_kinds(
    path: Path, schema: pa.Schema, numbers: Collection[str], whole: Collection[str]
) -> None:
    import pyarrow as pa

    for name in schema.names:
        if len(schema.get_all_field_indices(name)) > 1:
            raise InputError(f"{path}: holds two columns {name}; run again with --force.")
    for column in schema:
        integer = pa.types.is_integer(column.type)
        real = integer or pa.types.is_floating(column.type) or pa.types.is_boolean(column.type)
        if (column.name in whole and not integer) or (column.name in numbers and not real):
            raise InputError(
                f"{path}: the column {column.name} is of {column.type}, not of numbers; "
                "run again with --force."
            )


def floats(table: pa.Table, name: str) -> FloatArray:
    """One column as float64 [n], a copy that may be written to; nulls become NaN.

    InputError where it holds something else.
    """
    try:
        return np.array(column_to_numpy(table.column(name)), dtype=np.float64)
    except (ValueError, TypeError) as error:
        raise _no_numbers(name) from error


def ints(table: pa.Table, name: str) -> IntArray:
    """One column as int64 [n]; InputError where it holds something else."""
    try:
        with np.errstate(invalid="raise"):
            return np.array(column_to_numpy(table.column(name)), dtype=np.int64)
    except (ValueError, TypeError, FloatingPointError, OverflowError) as error:
        raise _no_numbers(name) from error


def _no_numbers(name: str) -> InputError:
    return InputError(f"the column {name} of a table holds no numbers; run again with --force.")


def vector(
    column: Callable[[str], FloatArray], names: tuple[str, ...], kind: type = np.float64
) -> FloatArray:
    """Columns as one array [n, k] of a ``kind``, each read by ``column`` and let go."""
    first = column(names[0])
    out: FloatArray = np.empty((len(first), len(names)), kind)
    with np.errstate(over="ignore"):
        out[:, 0] = first
        for i, name in enumerate(names[1:], 1):
            out[:, i] = column(name)
    return out


def _vector(table: pa.Table, names: tuple[str, ...]) -> FloatArray:
    return vector(lambda name: floats(table, name), names)


def write_imu(path: Path, imu: ImuData) -> None:
    """Write inertial readings; whether their axes are the vehicle's goes into the metadata."""
    columns: dict[str, np.ndarray] = {"t_ns": imu.t_ns}
    for names, values in ((_IMU_GYRO, imu.gyro), (_IMU_ACCEL, imu.accel)):
        columns |= {name: values[:, i] for i, name in enumerate(names)}
    if imu.temp_c is not None:
        columns["temp_c"] = imu.temp_c
    metadata = {"axes_known": "true" if imu.axes_known else "false"}
    write_columns(path, columns, metadata, split=(*_IMU_GYRO, *_IMU_ACCEL))


def read_imu(path: Path) -> ImuData:
    """Read what ``write_imu`` wrote."""
    sensors = (*_IMU_GYRO, *_IMU_ACCEL)
    kinds = ((*sensors, "temp_c"), ("t_ns",))
    with column_by_column(path, ("t_ns", *sensors), *kinds) as (schema, read):

        def column(name: str) -> FloatArray:
            return floats(read(name), name)

        return ImuData(
            t_ns=ints(read("t_ns"), "t_ns"),
            gyro=vector(column, _IMU_GYRO),
            accel=vector(column, _IMU_ACCEL),
            temp_c=column("temp_c") if "temp_c" in schema.names else None,
            axes_known=(schema.metadata or {}).get(b"axes_known", b"true") == b"true",
        )


def write_fixes(path: Path, fixes: Fixes) -> None:
    """Write receiver epochs, one row each, in the order of the record."""
    columns: dict[str, np.ndarray] = {name: getattr(fixes, name) for name in _FLOATS}
    for field, names in _VECTORS.items():
        columns |= {name: getattr(fixes, field)[:, i] for i, name in enumerate(names)}
    columns |= {name: np.asarray(getattr(fixes, name), np.int64) for name in _INTS}
    write_columns(path, columns)


def write_odometer(path: Path, wheels: WheelSpeed) -> None:
    """Write wheel speeds; columns ``t_ns`` and ``speed_m_s``."""
    write_columns(path, {"t_ns": wheels.t_ns, "speed_m_s": wheels.speed})


def read_odometer(path: Path) -> WheelSpeed:
    """Read what ``write_odometer`` wrote; InputError when it is missing or damaged."""
    table = read_table(path, ("t_ns", "speed_m_s"), ("speed_m_s",), ("t_ns",))
    return WheelSpeed(ints(table, "t_ns"), floats(table, "speed_m_s"))


def read_fixes(path: Path) -> Fixes:
    """Read what ``write_fixes`` wrote."""
    vector_names = tuple(name for names in _VECTORS.values() for name in names)
    real = (*_FLOATS, *vector_names)
    table = read_table(path, (*real, *_INTS), real, _INTS)
    values: dict[str, Any] = {name: floats(table, name) for name in _FLOATS}
    values |= {field: _vector(table, names) for field, names in _VECTORS.items()}
    values |= {name: ints(table, name) for name in _INTS}
    return Fixes(**values)
