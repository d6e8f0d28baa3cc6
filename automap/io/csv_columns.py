"""Columns of a CSV file by name: fast when the file is clean, forgiving when it is not."""

from __future__ import annotations

import difflib
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from automap.errors import InputError
from automap.io.arrow_columns import column_to_numpy
from automap.records import BoolArray, FloatArray, IntArray

if TYPE_CHECKING:
    import pyarrow as pa

Kind = Literal["int", "float", "text"]

_NULLS = ["", "nan", "NaN", "NAN", "-nan", "null", "NULL", "None", "NA", "N/A"]
_INTEGER = r"^\s*[+-]?\d{1,18}\s*$|^\s*[+-]?[1-8]\d{18}\s*$"


@dataclass(frozen=True)
class CsvColumns:
    """What a CSV file held.

    ``columns`` name -> [n]: int64, float64 (NaN where the cell was empty) or str objects.
    ``extra`` are columns nobody asked for. ``bad_rows`` were left out because a cell was
    missing, too many or no number; ``first_bad`` names the first of them with its line.
    ``lines`` [n] are the line numbers of the rows, counted from 1.
    """

    path: Path
    columns: dict[str, np.ndarray]
    extra: tuple[str, ...] = ()
    bad_rows: int = 0
    blank_rows: int = 0
    first_bad: str | None = None
    line_numbers: IntArray | None = None
    header_line: int = 1

    def __len__(self) -> int:
        return len(next(iter(self.columns.values())))

    def line(self, row: int) -> int:
        """The line of a row, counted from 1."""
        if self.line_numbers is not None:
            return int(self.line_numbers[row])
        return self.header_line + 1 + row

    def floats(self, name: str) -> FloatArray:
        """A column as float64 [n]; NaN throughout when the file has no such column."""
        values = self.columns.get(name)
        if values is None:
            return np.full(len(self), np.nan)
        return np.ascontiguousarray(values, dtype=np.float64)

    def warnings(self) -> list[str]:
        """One sentence on the rows that were left out, if any."""
        if not self.bad_rows:
            return []
        rows = "1 row was" if self.bad_rows == 1 else f"{self.bad_rows} rows were"
        return [f"{self.path}: {rows} left out as unreadable, the first in {self.first_bad}"]


@dataclass(frozen=True)
class _Layout:
    names: list[str]
    delimiter: str
    decimal: str
    header_line: int
    body: memoryview | bytes


def read_columns(
    path: Path,
    required: Mapping[str, Kind],
    optional: Mapping[str, Kind] | None = None,
    *,
    may_be_empty: bool = False,
) -> CsvColumns:
    """Read columns by name, in any order, whatever else the file has.

    Comma, semicolon, tab or blanks may separate; names are compared without case. Raises
    InputError for a file that is missing, empty, binary, has no header, no rows, or lacks a
    required column. A header without rows is no error when ``may_be_empty``.
    """
    layout = _layout(path, required)
    present = {name.lower(): name for name in layout.names}
    wanted = dict(required) | {k: v for k, v in (optional or {}).items() if k in present}
    if not wanted:
        raise InputError(
            f"{path}: line {layout.header_line} names neither {' nor '.join(optional or {})}; "
            f"found are {', '.join(layout.names)}."
        )
    missing = [name for name in required if name not in present]
    if missing:
        near = difflib.get_close_matches(missing[0], list(present), n=1, cutoff=0.5)
        meant = f" (rename {near[0]}?)" if near and near[0] not in wanted else ""
        raise InputError(
            f"{path}: line {layout.header_line} names no column {missing[0]}{meant}; "
            f"needed are {', '.join(required)}, found are {', '.join(layout.names)}."
        )
    extra = tuple(name for key, name in present.items() if key not in wanted)
    columns = _fast(layout, wanted, present)
    if columns is not None:
        table = CsvColumns(path, columns, extra, header_line=layout.header_line)
    else:
        table = _careful(path, layout, wanted, present, extra)
    if len(table) == 0 and not may_be_empty:
        why = f"; the first unreadable is {table.first_bad}" if table.bad_rows else ""
        raise InputError(f"{path} has a header but not one usable row{why}.")
    return table


def _layout(path: Path, required: Mapping[str, Kind]) -> _Layout:
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        raise InputError(f"{path} is missing.") from None
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror}.") from error
    data = data.removeprefix(b"\xef\xbb\xbf")
    if not data.strip():
        raise InputError(f"{path} is empty; record the drive again or remove the file.")
    if b"\0" in data[:4096]:
        raise InputError(f"{path} is not text; export it as CSV in UTF-8.")
    start, line = 0, 1
    while data[start : start + 1] in (b"\n", b"\r"):
        line += data[start : start + 1] == b"\n"
        start += 1
    end = data.find(b"\n", start)
    end = len(data) if end < 0 else end
    header = data[start:end].decode("utf-8", "replace").strip().lstrip("#% ")
    stop = len(data)
    while stop > end and data[stop - 1] in b" \t\r\n":
        stop -= 1
    body: memoryview | bytes = memoryview(data)[end + 1 : stop]
    delimiter = next((mark for mark in ",;\t" if mark in header), " ")
    names = header.split() if delimiter == " " else [n.strip() for n in header.split(delimiter)]
    names = [name.strip("\"' ") for name in names]
    if names and all(re.match(r"^[+-]?\d*\.?\d+(e[+-]?\d+)?$", name, re.I) for name in names):
        raise InputError(
            f"{path}: line {line} holds numbers where the names of the columns belong; "
            f"put a first line such as {','.join(required)}."
        )
    lowered = [name.lower() for name in names]
    twice = next((name for name in lowered if lowered.count(name) > 1 and name in required), None)
    if twice:
        raise InputError(f"{path}: line {line} names the column {twice} twice; rename one.")
    # pyarrow wants distinct names; unneeded doubles get a number
    names = [n if n.lower() not in lowered[:i] else f"{n}.{i}" for i, n in enumerate(names)]
    decimal = "."
    sample = bytes(body[:200])
    if delimiter == ";" and b"," in sample and b"." not in sample:
        decimal = ","
    if delimiter == " ":
        body = re.sub(rb"(?m)^[ \t]+|[ \t\r]+$", b"", bytes(body))
        body = re.sub(rb"[ \t]+", b" ", body)
    return _Layout(names, delimiter, decimal, line, body)


def _fast(
    layout: _Layout, wanted: Mapping[str, Kind], present: Mapping[str, str]
) -> dict[str, np.ndarray] | None:
    """All columns in one go, or None when any cell resists."""
    import pyarrow as pa
    import pyarrow.csv

    types = {"int": pa.int64(), "float": pa.float64(), "text": pa.string()}
    options = pa.csv.ConvertOptions(
        include_columns=[present[name] for name in wanted],
        column_types={present[name]: types[kind] for name, kind in wanted.items()},
        null_values=_NULLS,
        decimal_point=layout.decimal,
    )
    try:
        table = pa.csv.read_csv(
            pa.BufferReader(pa.py_buffer(layout.body)),
            read_options=pa.csv.ReadOptions(column_names=layout.names),
            parse_options=pa.csv.ParseOptions(delimiter=layout.delimiter, ignore_empty_lines=False),
            convert_options=options,
        )
    except pa.ArrowInvalid:
        return None
    columns: dict[str, np.ndarray] = {}
    for name, kind in wanted.items():
        column = table.column(present[name])
        if kind == "int" and column.null_count:
            return None
        columns[name] = _to_numpy(column, kind)
    return columns


def _to_numpy(column: pa.ChunkedArray, kind: Kind) -> np.ndarray:
    if kind == "text":
        return np.array([value or "" for value in column.to_pylist()], dtype=object)
    dtype = np.int64 if kind == "int" else np.float64
    return np.array(column_to_numpy(column), dtype=dtype)


def _careful(
    path: Path,
    layout: _Layout,
    wanted: Mapping[str, Kind],
    present: Mapping[str, str],
    extra: tuple[str, ...],
) -> CsvColumns:
    """Row by row in effect: bad rows are counted and left out, the first one is named."""
    import pyarrow as pa
    import pyarrow.csv

    short: list[tuple[int, str]] = []

    def skip(row: Any) -> str:
        short.append((int(row.number), str(row.text)))
        return "skip"

    table = (
        pa.csv.read_csv(
            pa.BufferReader(pa.py_buffer(layout.body)),
            # only one thread numbers the rows
            read_options=pa.csv.ReadOptions(column_names=layout.names, use_threads=False),
            parse_options=pa.csv.ParseOptions(
                delimiter=layout.delimiter, ignore_empty_lines=False, invalid_row_handler=skip
            ),
            convert_options=pa.csv.ConvertOptions(
                column_types=dict.fromkeys(layout.names, pa.string()), check_utf8=False
            ),
        )
        if len(layout.body)
        else pa.table({name: pa.array([], pa.string()) for name in layout.names})
    )
    n_lines = table.num_rows + len(short)
    numbers = np.setdiff1d(np.arange(1, n_lines + 1), [number for number, _ in short])
    table = table.combine_chunks()
    blank = np.ones(table.num_rows, dtype=bool)
    for name in layout.names:
        blank &= _empty(table.column(name))
    good = ~blank
    columns: dict[str, np.ndarray] = {}
    for name, kind in wanted.items():
        columns[name], readable = _convert(table.column(present[name]), kind, layout.decimal)
        good &= readable
    bad = [(number, text) for number, text in short if text.strip()]
    for row in np.flatnonzero(~good & ~blank):
        cells = [_text(table.column(name)[int(row)]) for name in layout.names]
        bad.append((int(numbers[row]), layout.delimiter.join(cells)))
    bad.sort()
    first = None
    if bad:
        number, text = bad[0]
        shown = text if len(text) <= 80 else text[:77] + "..."
        first = f"line {layout.header_line + number}: {shown!r}"
    return CsvColumns(
        path,
        {name: values[good] for name, values in columns.items()},
        extra,
        bad_rows=len(bad),
        blank_rows=int(blank.sum()) + sum(1 for _, text in short if not text.strip()),
        first_bad=first,
        line_numbers=layout.header_line + numbers[good],
        header_line=layout.header_line,
    )


def _text(cell: pa.Scalar) -> str:
    # bytes that are no UTF-8 must not stop the message about them
    return str(cell.as_buffer().to_pybytes().decode("utf-8", "replace")) if cell.is_valid else ""


def _empty(column: pa.ChunkedArray) -> BoolArray:
    import pyarrow.compute as pc

    return np.asarray(pc.equal(pc.binary_length(column), 0).to_numpy(zero_copy_only=False), bool)


def _convert(column: pa.ChunkedArray, kind: Kind, decimal: str) -> tuple[np.ndarray, BoolArray]:
    """A column of texts to its kind, and which cells could be read."""
    import pyarrow as pa
    import pyarrow.compute as pc

    if kind != "text" and decimal == ".":
        try:
            trimmed = pc.utf8_trim_whitespace(column)
            nulls = pc.is_in(trimmed, pa.array(_NULLS))
            target = pa.int64() if kind == "int" else pa.float64()
            values = pc.cast(pc.if_else(nulls, pa.scalar(None, pa.string()), trimmed), target)
        except pa.ArrowInvalid:
            pass
        else:
            missing = np.asarray(values.is_null().to_numpy(zero_copy_only=False), bool)
            if kind == "int":
                return values.fill_null(0).to_numpy(), ~missing
            return _to_numpy(values, kind), np.ones(len(missing), dtype=bool)
    texts = [_text(cell).strip() for chunk in column.chunks for cell in chunk]
    if kind == "text":
        return np.array(texts, dtype=object), np.ones(len(texts), dtype=bool)
    return _parse([text.replace(decimal, ".") for text in texts], kind)


def _parse(texts: list[str], kind: Kind) -> tuple[np.ndarray, BoolArray]:
    """Cell by cell, for a column that has at least one that is no number."""
    readable = np.ones(len(texts), dtype=bool)
    values = np.zeros(len(texts), dtype=np.int64 if kind == "int" else np.float64)
    for row, text in enumerate(texts):
        if kind == "float" and text in _NULLS:
            values[row] = np.nan
        elif kind == "int" and re.match(_INTEGER, text):
            values[row] = int(text)
        else:
            number = _float(text)
            readable[row] = number is not None and (kind == "float" or abs(number) < 9e18)
            if readable[row] and number is not None:
                # a stamp with a fraction loses less than a microsecond by way of a float
                values[row] = number if kind == "float" else round(number)
    return values, readable


def _float(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None
