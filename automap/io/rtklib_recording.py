"""A folder logged by RTKLIB (str2str, RTKNAVI): a receiver's stream, an IMU's lines, tags.

The IMU's lines carry its own clock, the tags that of the computer that logged both streams.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from automap.errors import ConfigError, InputError
from automap.io.rtklib_tag import TimeTag, read_time_tag
from automap.io.table_units import UNITS
from automap.records import FloatArray, IntArray

_TIMES = ("t_ns", "t_us", "t_ms", "t_s")
_SENSORS = ("gx", "gy", "gz", "ax", "ay", "az")
_TAIL = 0.01
"""Part of a stream that may be missing at its end, where a copy was cut short."""
_RECEIVER = (".ubx", ".nmea", ".gps", ".log")
_LINES = (".csv", ".txt", ".imu")


@dataclass(frozen=True)
class RtklibFiles:
    """The files of one recording; None where there is no such file."""

    receiver: Path | None
    receiver_tag: Path | None
    imu: Path | None
    imu_tag: Path | None
    solution: Path | None


@dataclass(frozen=True)
class ImuLines:
    """An IMU's log: ``stamp_ns`` [n] of its own clock, ``readings`` [n, 6] gyro, accelerometer
    in its units, ``end`` [n] the byte after each line, ``left_out`` lines that are none;
    ``number`` [n] of each line from 1, ``size`` of the file and its ``lines`` in all."""

    stamp_ns: IntArray
    readings: FloatArray
    end: IntArray
    left_out: int
    number: IntArray
    size: int
    lines: int


def find_files(source: Path) -> RtklibFiles:
    """The streams, tags and solution in the folder ``source``, by their suffixes.

    Raises InputError when there is no stream, or more than one of a kind.
    """
    if not source.is_dir():
        raise InputError(
            f"{source} is no folder; give the folder that holds the receiver's log, the IMU's log "
            "and their .tag files."
        )
    files = sorted(path for path in source.iterdir() if path.is_file())

    def only(suffixes: Sequence[str], what: str) -> Path | None:
        found = [path for path in files if path.suffix.lower() in suffixes]
        if len(found) > 1:
            some = ", ".join(path.name for path in found[:4])
            raise InputError(
                f"{source} holds more than one {what} ({some}); leave one recording in a folder."
            )
        return found[0] if found else None

    def tag_of(path: Path | None) -> Path | None:
        if path is None:
            return None
        tag = path.with_name(path.name + ".tag")
        return tag if tag.is_file() else None

    receiver, imu = only(_RECEIVER, "receiver log"), only(_LINES, "IMU log")
    solution = only((".pos",), "solution")
    if receiver is None and solution is None:
        raise InputError(
            f"{source} holds no receiver log ({', '.join(_RECEIVER)}) and no .pos solution; give "
            "the folder of an RTKLIB recording."
        )
    return RtklibFiles(receiver, tag_of(receiver), imu, tag_of(imu), solution)


def read_imu_lines(path: Path, columns: Sequence[str]) -> ImuLines:
    """Read lines of plain numbers whose ``columns`` are named (``t_ms``, ``gx``, ... or ``-``).

    A line that has not so many numbers (the first and last of a stream are often cut) is left
    out. Raises ConfigError for columns that make no IMU, InputError when hardly a line is one.
    """
    times = [name for name in columns if name in _TIMES]
    missing = [name for name in _SENSORS if name not in columns]
    if (
        len(times) != 1
        or missing
        or len(set(columns) - {"-"}) != len([*filter("-".__ne__, columns)])
    ):
        raise ConfigError(
            f"--columns {','.join(columns)}: name each of {', '.join(_SENSORS)} and one of "
            f"{', '.join(reversed(_TIMES))} once, and - for a column to pass over."
        )
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror}); check the file.") from error
    order = [columns.index(name) for name in (*times, *_SENSORS)]
    rows: list[list[float]] = []
    ends: list[int] = []
    numbers: list[int] = []
    left_out = 0
    at = 0
    for number, line in enumerate(data.split(b"\n"), start=1):
        at += len(line) + 1
        if not line.strip() or line.lstrip()[:1] in (b"#", b"%"):
            continue
        cells = line.replace(b";", b",").replace(b"\t", b",").split(b",")
        try:
            if len(cells) != len(columns) or at > len(data):
                raise ValueError
            row = [float(cells[i]) for i in order]
            if not np.isfinite(row).all():
                raise ValueError
        except ValueError:
            left_out += 1
            continue
        rows.append(row)
        ends.append(at)
        numbers.append(number)
    if len(rows) < max(4, left_out):
        raise InputError(
            f"{path}: {len(rows)} of {len(rows) + left_out} lines have the {len(columns)} numbers "
            f"{','.join(columns)}; name the columns of this log with --columns."
        )
    table = np.array(rows)
    stamp_ns = np.rint(table[:, 0] * UNITS["time"][times[0].removeprefix("t_")]).astype(np.int64)
    return ImuLines(
        stamp_ns,
        table[:, 1:],
        np.array(ends, np.int64),
        left_out,
        np.array(numbers, np.int64),
        len(data),
        data.count(b"\n") + (not data.endswith(b"\n")),
    )


def as_logged(lines: ImuLines, tag: TimeTag) -> ImuLines | None:
    """The lines with the positions that they had in the stream, None where that cannot be.

    A log that was copied as text may have lost the carriage return of every line since.
    """
    lost = tag.length - lines.size
    if lost <= 0:
        return lines
    if abs(lost - lines.lines) <= 1:
        return replace(lines, end=lines.end + lines.number, size=tag.length)
    return lines if lost < _TAIL * lines.size else None


def line_arrivals(lines: ImuLines, tag: TimeTag, path: Path) -> IntArray:
    """When each of the IMU's lines [n] came in, on the logging computer's clock.

    Raises InputError where the tag is of a stream of another length.
    """
    placed = as_logged(lines, tag)
    if placed is None:
        raise InputError(
            f"{path} has {lines.size} bytes and its tag is of a stream of {tag.length}; copy log "
            "and tag together again."
        )
    row = np.searchsorted(tag.offset, placed.end - 1, side="right") - 1
    return tag.t_ns[np.maximum(row, 0)]


def read_tag(path: Path | None) -> TimeTag | None:
    """The tag of a stream, None where it has none."""
    return None if path is None else read_time_tag(path)
