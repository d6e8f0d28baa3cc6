"""Text files of plain numbers in columns without names."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from automap.errors import InputError
from automap.records import FloatArray


@dataclass(frozen=True)
class NumberColumns:
    """Numbers [n, k] and one sentence on the lines that could not be read, if any."""

    values: FloatArray
    warnings: tuple[str, ...] = ()


def read_numbers(path: Path, columns: int) -> NumberColumns:
    """Read a file with ``columns`` numbers a line, apart by blanks, tabs, commas or semicolons.

    Lines that start with # or % are comments. Lines that do not hold so many numbers are left
    out and counted. Raises InputError when none, or fewer than half of them, do.
    """
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        raise InputError(f"{path} is missing.") from None
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror}.") from error
    if b"\0" in data[:4096]:
        raise InputError(f"{path} is not text; export it as columns of numbers.")
    text = data.decode("utf-8", "replace").translate(str.maketrans(",;\t", "   "))
    lines = text.splitlines()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            values = np.loadtxt(lines, comments=["#", "%"], ndmin=2)
    except (ValueError, UserWarning):
        return _line_by_line(path, lines, columns)
    if values.shape[1] != columns:
        raise InputError(
            f"{path} has {values.shape[1]} columns, but {columns} are named; correct --columns."
        )
    return NumberColumns(values)


def _line_by_line(path: Path, lines: list[str], columns: int) -> NumberColumns:
    rows, bad, first = [], 0, ""
    for number, line in enumerate(lines, 1):
        words = line.split()
        if not words or words[0][0] in "#%":
            continue
        try:
            row = [float(word) for word in words]
        except ValueError:
            row = []
        if len(row) == columns:
            rows.append(row)
        else:
            bad += 1
            first = first or f"line {number}: {line.strip()[:60]!r}"
    if not rows and not bad:
        raise InputError(f"{path} is empty; record again.")
    if bad >= len(rows):
        raise InputError(
            f"{path} does not hold {columns} numbers a line, see {first}; correct --columns."
        )
    count = "1 line was" if bad == 1 else f"{bad} lines were"
    return NumberColumns(
        np.array(rows, dtype=np.float64),
        (f"{path}: {count} left out as unreadable, the first in {first}",),
    )
