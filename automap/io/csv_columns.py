"""Columns of a CSV file by name: fast when the file is clean, forgiving when it is not."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from automap.errors import InputError
from automap.io import limits
from automap.io.csv_cells import read_cells
from automap.io.csv_layout import Layout, read_layout
from automap.io.csv_numbers import Kind
from automap.records import FloatArray, IntArray

__all__ = ["CsvColumns", "Kind", "read_chosen", "read_columns"]

_NAMES_SHOWN = 20
"""In a message; a header may have thousands."""


@dataclass(frozen=True)
class CsvColumns:
    """What a CSV file held.

    ``columns`` name -> [n]: int64, float64 (NaN where the cell was empty) or str objects.
    ``extra`` are columns nobody asked for. ``bad_rows`` were left out because a cell was
    missing, too many or no number; ``first_bad`` names the first of them with its line, and
    its column where a cell is at fault. ``line_numbers`` [n] count from 1.
    """

    path: Path
    columns: dict[str, np.ndarray]
    extra: tuple[str, ...] = ()
    bad_rows: int = 0
    blank_rows: int = 0
    first_bad: str | None = None
    line_numbers: IntArray | None = None
    header_line: int = 1
    first_line: int = 2

    def __len__(self) -> int:
        return len(next(iter(self.columns.values())))

    def line(self, row: int) -> int:
        """The line of a row, counted from 1."""
        if self.line_numbers is not None:
            return int(self.line_numbers[row])
        return self.first_line + row

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


def read_columns(
    path: Path,
    required: Mapping[str, Kind],
    optional: Mapping[str, Kind] | None = None,
    *,
    may_be_empty: bool = False,
) -> CsvColumns:
    """Read columns by name, in any order, whatever else the file has.

    Comma, semicolon, tab, bar or blanks may separate; names are compared without case. Raises
    InputError for a file that is missing, empty, binary, has no header, no rows, or lacks a
    required column. A header without rows is no error when ``may_be_empty``.
    """
    layout = read_layout(path, wanted=(*required, *(optional or {})))
    present: dict[str, int] = {}
    for at, name in enumerate(layout.names):
        if name.lower() in required and name.lower() in present:
            raise InputError(
                f"{path}: line {layout.header_line} names the column {name.lower()} twice; "
                "rename one."
            )
        present.setdefault(name.lower(), at)
    wanted = dict(required) | {k: v for k, v in (optional or {}).items() if k in present}
    if not wanted:
        raise InputError(
            f"{path}: line {layout.header_line} names neither {' nor '.join(optional or {})}; "
            f"found are {listed(layout.names)}."
        )
    missing = [name for name in required if name not in present]
    if missing:
        near = difflib.get_close_matches(missing[0], list(present)[:1000], n=1, cutoff=0.5)
        meant = f" (rename {near[0]}?)" if near and near[0] not in wanted else ""
        raise InputError(
            f"{path}: line {layout.header_line} names no column {missing[0]}{meant}; "
            f"needed are {', '.join(required)}, found are {listed(layout.names)}."
        )
    chosen = {name: (present[name], kind) for name, kind in wanted.items()}
    return read_chosen(layout, chosen, may_be_empty=may_be_empty)


def read_chosen(
    layout: Layout, chosen: Mapping[str, tuple[int, Kind]], *, may_be_empty: bool = False
) -> CsvColumns:
    """Read columns by their place in the file, counted from 0; InputError without a usable row."""
    cells = read_cells(layout, chosen)
    taken = {at for at, _ in chosen.values()}
    extra = (name for at, name in enumerate(layout.names) if name and at not in taken)
    table = CsvColumns(
        path=layout.path,
        columns=cells.columns,
        extra=tuple(dict.fromkeys(extra)),
        bad_rows=cells.bad_rows,
        blank_rows=cells.blank_rows,
        first_bad=cells.first_bad,
        line_numbers=cells.lines,
        header_line=layout.header_line,
        first_line=layout.first_line,
    )
    if len(table) == 0 and not may_be_empty:
        why = f"; the first unreadable is {table.first_bad}" if table.bad_rows else ""
        raise InputError(f"{layout.path} has a header but not one usable row{why}.")
    return table


def listed(names: tuple[str, ...]) -> str:
    """Names of columns for a message, the first of them where they are many."""
    shown = [name if len(name) <= limits.SHOWN else name[: limits.SHOWN] + "..." for name in names]
    more = f" and {len(names) - _NAMES_SHOWN} more" if len(names) > _NAMES_SHOWN else ""
    return ", ".join(shown[:_NAMES_SHOWN]) + more
