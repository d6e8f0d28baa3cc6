"""Cells of a CSV file to numbers: decimal signs, thousands, and what stands for nothing."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np

from automap.records import BoolArray

if TYPE_CHECKING:
    import pyarrow as pa

Kind = Literal["int", "float", "text"]

NULLS = ["", "nan", "NaN", "NAN", "-nan", "null", "NULL", "None", "NA", "N/A", "n/a", "#N/A", "#NV",
          "#DIV/0!", "#VALUE!", "#WERT!", "-", "--", "---", "?", "*"]  # fmt: skip
"""What loggers, spreadsheets and people write where nothing was measured."""
_INTEGER = r"^\s*[+-]?(\d{1,18}|[1-8]\d{18})\s*$"
_FLOAT = r"^\s*[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\s*$"
_GROUPED = {
    ".": r"^\s*[+-]?\d{1,3}(,\d{3})+(\.\d*)?\s*$",
    ",": r"^\s*[+-]?\d{1,3}(\.\d{3})+(,\d*)?\s*$",
}
"""By the decimal sign: numbers whose thousands the other sign parts."""


def convert(column: pa.ChunkedArray, kind: Kind, decimal: str) -> tuple[np.ndarray, BoolArray]:
    """A column of bytes to its kind, and which cells could be read."""
    import pyarrow as pa
    import pyarrow.compute as pc

    column = column.combine_chunks()
    if kind == "text":
        return _texts(column)
    pattern = _INTEGER if kind == "int" else _FLOAT
    if decimal == "," and kind == "float":
        pattern = pattern.replace(r"\.", ",")
    column = _ungrouped(column, decimal)
    plain = _matches(column, pattern)
    values = np.zeros(len(column), dtype=np.int64 if kind == "int" else np.float64)
    texts = pc.utf8_trim_whitespace(pc.cast(column.filter(pa.array(plain)), pa.string()))
    if decimal == "," and kind == "float":
        texts = pc.replace_substring(texts, ",", ".")
    # a plus sign is no part of Arrow's integers
    texts = pc.utf8_ltrim(texts, "+")
    values[plain] = pc.cast(texts, pa.int64() if kind == "int" else pa.float64()).to_numpy(
        zero_copy_only=False
    )
    readable = plain.copy()
    empty = np.asarray(pc.equal(pc.binary_length(column), 0).to_numpy(zero_copy_only=False))
    if kind == "float":
        values[empty] = np.nan
        readable |= empty
    for row in np.flatnonzero(~plain & ~empty):
        number = _number(column[int(row)].as_py(), decimal)
        if number is None or (kind == "int" and not abs(number) < 9e18):
            continue
        readable[row] = True
        # a stamp with a fraction loses less than a microsecond by way of a float
        values[row] = number if kind == "float" else round(number)
    return values, readable


def _matches(column: pa.Array, pattern: str) -> BoolArray:
    import pyarrow.compute as pc

    found = pc.fill_null(pc.match_substring_regex(column, pattern), False)
    return np.asarray(found.to_numpy(zero_copy_only=False), bool)


def _ungrouped(column: pa.Array, decimal: str) -> pa.Array:
    """Bytes of a column without the signs that part thousands.

    In a column with decimal commas a lone 1.234 is a thousand only where other cells show that
    points are no decimals.
    """
    import pyarrow as pa
    import pyarrow.compute as pc

    mark = "," if decimal == "." else "."
    grouped = _matches(column, _GROUPED[decimal])
    if not grouped.any():
        return column
    if mark == ".":
        both = _matches(column, r"\.\d{3}(\.|,)") | _matches(column, r"^\s*[+-]?\d+,\d*\s*$")
        if not both.any():
            return column
    bare = pc.replace_substring(column, pattern=mark.encode(), replacement=b"")
    return pc.if_else(pa.array(grouped), bare, column)


def _texts(column: pa.Array) -> tuple[np.ndarray, BoolArray]:
    readable = np.ones(len(column), dtype=bool)
    texts = np.full(len(column), "", dtype=object)
    for row, cell in enumerate(column.to_pylist()):
        try:
            texts[row] = cell.decode("utf-8").strip()
        except UnicodeDecodeError:
            readable[row] = False
    return texts, readable


def _number(cell: bytes, decimal: str) -> float | None:
    text = cell.strip().decode("ascii", "replace")
    if text in NULLS:
        return float("nan")
    if decimal == ",":
        text = text.replace(",", ".")
    try:
        # Python takes 1_000 for a number, which no logger writes
        return None if "_" in text else float(text)
    except ValueError:
        return None
