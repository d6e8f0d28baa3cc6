"""The cells of a CSV file as columns: in one go when the file is clean, else row by row in effect.

A row that cannot be read is left out, counted and named; it never costs the file.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from automap.io import limits
from automap.io.arrow_columns import column_to_numpy
from automap.io.csv_layout import Layout
from automap.io.csv_numbers import NULLS, Kind, convert
from automap.records import BoolArray, IntArray

if TYPE_CHECKING:
    import pyarrow as pa


_BLANK = b" \t"


@dataclass(frozen=True)
class Cells:
    """Columns [n] by the caller's names; ``lines`` [n] of the rows, None when none is missing.

    ``bad_rows`` were left out; ``first_bad`` names the first with its line, and its column
    where a cell is at fault.
    """

    columns: dict[str, np.ndarray]
    lines: IntArray | None = None
    bad_rows: int = 0
    blank_rows: int = 0
    first_bad: str | None = None


def read_cells(layout: Layout, wanted: Mapping[str, tuple[int, Kind]]) -> Cells:
    """Columns by their place (from 0) and kind: int64, float64 (NaN where empty) or str objects."""
    columns = _fast(layout, wanted)
    return Cells(columns) if columns is not None else _careful(layout, wanted)


def _fast(layout: Layout, wanted: Mapping[str, tuple[int, Kind]]) -> dict[str, np.ndarray] | None:
    """All columns in one go, or None when any cell resists."""
    import pyarrow as pa

    types = {"int": pa.int64(), "float": pa.float64(), "text": pa.string()}
    try:
        table = _parsed(layout, layout.body, {at: types[kind] for at, kind in wanted.values()})
    except pa.ArrowInvalid:
        return None
    columns: dict[str, np.ndarray] = {}
    for name, (at, kind) in wanted.items():
        column = table.column(_key(at))
        if kind == "int" and column.null_count:
            return None
        columns[name] = _to_numpy(column, kind)
    return columns


def _key(at: int) -> str:
    return f"c{at}"


def _parsed(
    layout: Layout, body: bytes | memoryview, types: Mapping[int, pa.DataType], largest: int = 0
) -> pa.Table:
    import pyarrow as pa
    import pyarrow.csv

    if not len(body):
        return pa.table({_key(at): pa.array([], kind) for at, kind in types.items()})

    def read(threads: bool) -> pa.Table:
        return pa.csv.read_csv(
            pa.BufferReader(pa.py_buffer(body)),
            read_options=pa.csv.ReadOptions(
                use_threads=threads,
                column_names=[_key(at) for at in range(len(layout.names))],
                block_size=max(1 << 20, 2 * largest),
            ),
            parse_options=pa.csv.ParseOptions(delimiter=layout.separator, ignore_empty_lines=False),
            convert_options=pa.csv.ConvertOptions(
                include_columns=[_key(at) for at in types],
                column_types={_key(at): kind for at, kind in types.items()},
                null_values=NULLS,
                decimal_point=layout.decimal,
            ),
        )

    try:
        return read(True)
    except (pa.ArrowInvalid, pa.ArrowCancelled):
        raise
    except pa.ArrowException:
        # its threads have lost a chunk of a sound file "for an unknown reason"; one loses none
        return read(False)


def _to_numpy(column: pa.ChunkedArray, kind: Kind) -> np.ndarray:
    if kind == "text":
        return np.array([value or "" for value in column.to_pylist()], dtype=object)
    dtype = np.int64 if kind == "int" else np.float64
    return np.array(column_to_numpy(column), dtype=dtype)


@dataclass(frozen=True)
class _Rows:
    """Where the rows of a body begin and end [n], and what each holds."""

    body: bytes
    start: IntArray
    end: IntArray
    cells: IntArray
    blank: BoolArray
    quoted: BoolArray
    whole: BoolArray

    def text(self, row: int) -> str:
        piece = self.body[self.start[row] : min(self.end[row], self.start[row] + 4 * limits.SHOWN)]
        return piece.decode("utf-8", "replace")


def _rows(layout: Layout) -> _Rows:
    """The rows of a body: how many cells each has, whether it is blank or can be parsed."""
    body = bytes(layout.body)
    if b"\r" in body:
        body = body.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    letters = np.frombuffer(body, np.uint8)
    end = np.append(np.flatnonzero(letters == ord("\n")), len(body)).astype(np.int64)
    start = np.concatenate([[0], end[:-1] + 1]).astype(np.int64)

    def count(mark: int | bytes) -> IntArray:
        at = np.flatnonzero(letters == (mark if isinstance(mark, int) else mark[0]))
        return np.asarray(np.searchsorted(at, end) - np.searchsorted(at, start), np.int64)

    marks = count(layout.separator.encode())
    quotes = count(b'"')
    others = sum(count(mark) for mark in _BLANK if chr(mark) != layout.separator)
    blank = marks + others == end - start
    whole = end - start <= limits.MAX_ROW_BYTES
    for control in (b"\0", b"\x1a"):
        if control in body:
            whole &= count(control) == 0
    cells = marks + 1
    for row in np.flatnonzero((quotes > 0) & whole):
        found = _quoted(body[start[row] : end[row]], layout.separator)
        cells[row] = found
    whole &= cells == len(layout.names)
    for row in np.flatnonzero(~whole & ~blank):
        if body[start[row] : start[row] + 1] in (b"#", b"%"):
            blank[row] = True
    return _Rows(body, start, end, cells, blank, quotes > 0, whole & ~blank)


def _quoted(row: bytes, separator: str) -> int:
    """Cells of a row with quotes in it; 0 when they do not pair."""
    if row.count(b'"') % 2:
        return 0
    try:
        return len(next(csv.reader([row.decode("utf-8", "replace")], delimiter=separator)))
    except (csv.Error, StopIteration):
        return 0


def _careful(layout: Layout, wanted: Mapping[str, tuple[int, Kind]]) -> Cells:
    """Rows that cannot be parsed are cut out first, then the cells of the rest are judged."""
    import pyarrow as pa

    rows = _rows(layout)
    places = sorted({at for at, _ in wanted.values()})
    try:
        table = _parsed_rows(layout, rows, places)
    except pa.ArrowInvalid:
        # quotes are read in more than one way; what is left parses in one
        rows = replace(rows, whole=rows.whole & ~rows.quoted)
        table = _parsed_rows(layout, rows, places)
    number = np.flatnonzero(rows.whole)
    good = np.ones(len(number), dtype=bool)
    columns: dict[str, np.ndarray] = {}
    fault: dict[int, str] = {}
    for name, (at, kind) in wanted.items():
        column = table.column(_key(at))
        columns[name], readable = convert(column, kind, layout.decimal)
        for row in np.flatnonzero(~readable & good)[:1]:
            cell = column[int(row)].as_py()
            title = layout.names[at] or str(at + 1)
            fault[int(row)] = f", column {title}: {_shown(cell.decode('utf-8', 'replace'))}"
        good &= readable
    garbled = np.flatnonzero(~rows.whole & ~rows.blank)
    first = _first_bad(layout, rows, number, good, fault, garbled)
    return Cells(
        {name: values[good] for name, values in columns.items()},
        lines=layout.first_line + number[good],
        bad_rows=len(garbled) + int(np.count_nonzero(~good)),
        blank_rows=int(np.count_nonzero(rows.blank)),
        first_bad=first,
    )


def _parsed_rows(layout: Layout, rows: _Rows, places: list[int]) -> pa.Table:
    """Columns of bytes of the rows that are whole; ArrowInvalid when there are not so many."""
    import pyarrow as pa

    cut = np.flatnonzero(~rows.whole)
    edges = np.concatenate([[-1], cut, [len(rows.start)]])
    body = b"".join(
        rows.body[rows.start[a + 1] : rows.end[b - 1] + 1] for a, b in pairwise(edges) if b - a > 1
    )
    largest = int((rows.end - rows.start)[rows.whole].max(initial=0))
    table = _parsed(layout, body, dict.fromkeys(places, pa.binary()), largest)
    if table.num_rows != np.count_nonzero(rows.whole):
        raise pa.ArrowInvalid("rows ran together")
    return table


def _first_bad(
    layout: Layout,
    rows: _Rows,
    number: IntArray,
    good: BoolArray,
    fault: Mapping[int, str],
    garbled: IntArray,
) -> str | None:
    wrong = np.flatnonzero(~good)[:1]
    if len(wrong) and (not len(garbled) or number[wrong[0]] < garbled[0]):
        return f"line {layout.first_line + int(number[wrong[0]])}{fault[int(wrong[0])]}"
    if not len(garbled):
        return None
    row = int(garbled[0])
    size = int(rows.end[row] - rows.start[row])
    if size > limits.MAX_ROW_BYTES:
        why = f" ({size} bytes)"
    elif rows.cells[row] != len(layout.names):
        count = int(rows.cells[row])
        why = f" ({count} cell{'s'[: count != 1]} in place of {len(layout.names)})"
    else:
        why = ""
    return f"line {layout.first_line + row}{why}: {_shown(rows.text(row))}"


def _shown(text: str) -> str:
    text = text.strip()
    return repr(text if len(text) <= limits.SHOWN else text[: limits.SHOWN - 3] + "...")
