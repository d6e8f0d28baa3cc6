"""Columns of text as bytes, put together to the lines of a file without a loop in Python.

A map of a hundred thousand signs is some fifty million characters of numbers; every line is
the same constant pieces with the values of one sign between them.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from automap.records import BoolArray, FloatArray, IntArray

Bytes = npt.NDArray[np.uint8]


@dataclass(frozen=True)
class TextColumn:
    """Texts [n]: row i is ``data[start[i] : start[i] + length[i]]``, UTF-8."""

    data: Bytes
    start: IntArray
    length: IntArray

    def __len__(self) -> int:
        return len(self.start)

    def where(self, keep: BoolArray) -> TextColumn:
        """The same texts, empty in the rows [n] that are not kept."""
        return TextColumn(self.data, self.start, np.where(keep, self.length, 0))

    def texts(self) -> list[str]:
        """The rows as Python's texts."""
        whole = self.data.tobytes()
        pairs = zip(self.start.tolist(), self.length.tolist(), strict=True)
        return [whole[a : a + n].decode() for a, n in pairs]


def constant(text: str, n: int) -> TextColumn:
    """The same text in every row."""
    data = np.frombuffer(text.encode(), np.uint8)
    return TextColumn(data, np.zeros(n, np.int64), np.full(n, len(data), np.int64))


def utf8(text: str) -> bytes:
    """UTF-8 of any text; lone surrogates (from odd file names) become question marks."""
    return text.encode("utf-8", "replace")


def text_column(
    values: Sequence[Any],
    convert: Callable[[Any], str],
    rows: Sequence[Hashable] | None = None,
    special: re.Pattern[str] | None = None,
    quote: str = "",
) -> TextColumn:
    """Each value [n] as ``convert`` writes it; values that repeat are converted once.

    ``rows`` [n] are hashable stand-ins of values that are not hashable themselves. Where all
    values are ASCII texts without a ``special`` character, ``convert`` is known to do no more
    than put them between ``quote`` marks, and is not called.
    """
    if special is not None:
        plain = _plain_column(values, special, quote)
        if plain is not None:
            return plain
    keys = values if rows is None else rows
    known: dict[Hashable, int] = {}
    parts: list[bytes] = []
    index = np.empty(len(values), np.int64)
    for i, key in enumerate(keys):
        place = known.get(key)
        if place is None:
            place = known[key] = len(parts)
            parts.append(utf8(convert(values[i])))
        index[i] = place
    length = np.array([len(part) for part in parts], np.int64)
    start = np.cumsum(length) - length
    data = np.frombuffer(b"".join(parts), np.uint8)
    return TextColumn(data, start[index], length[index])


def _plain_column(values: Sequence[Any], special: re.Pattern[str], quote: str) -> TextColumn | None:
    try:
        joined = (2 * quote).join(values)
    except TypeError:
        return None
    text = joined if not quote else "".join(values)
    if not text.isascii() or special.search(text):
        return None
    length = np.fromiter(map(len, values), np.int64, len(values)) + 2 * len(quote)
    data = np.frombuffer(f"{quote}{joined}{quote}".encode(), np.uint8)
    return TextColumn(data, np.cumsum(length) - length, length)


def fixed_column(values: FloatArray, decimals: int, missing: str = "") -> TextColumn:
    """Numbers [n] with so many decimals; ``missing`` where a value is not finite."""
    from automap.export.text_kernels import NUMBER_WIDTH, fixed_digits

    numbers = np.ascontiguousarray(values, np.float64)
    out = np.empty(len(numbers) * NUMBER_WIDTH, np.uint8)
    length = np.empty(len(numbers), np.int64)
    fixed_digits(numbers, decimals, out, length)
    return _finished(out, length, numbers, f"%.{decimals}f", missing)


def significant_column(values: FloatArray, digits: int = 6, missing: str = "") -> TextColumn:
    """Numbers [n] with so many significant digits; ``missing`` where one is not finite."""
    from automap.export.text_kernels import NUMBER_WIDTH, significant_digits

    numbers = np.ascontiguousarray(values, np.float64)
    out = np.empty(len(numbers) * NUMBER_WIDTH, np.uint8)
    length = np.empty(len(numbers), np.int64)
    significant_digits(numbers, digits, out, length)
    return _finished(out, length, numbers, f"%.{digits}g", missing)


def integer_column(values: IntArray) -> TextColumn:
    """Integers [n] in decimal."""
    from automap.export.text_kernels import NUMBER_WIDTH, integer_digits

    numbers = np.ascontiguousarray(values, np.int64)
    out = np.empty(len(numbers) * NUMBER_WIDTH, np.uint8)
    length = np.empty(len(numbers), np.int64)
    integer_digits(numbers, out, length)
    return _finished(out, length, numbers, "%d", "")


def ring_column(rings: FloatArray, decimals: int = 7) -> TextColumn:
    """Rings [n, k, 2] of finite degrees as KML writes coordinates: ``lon,lat lon,lat ...``."""
    from automap.export.text_kernels import rings_text

    # sign, three digits, point and a separator beside the decimals
    width = rings.shape[1] * 2 * (decimals + 6)
    out = np.empty(len(rings) * width, np.uint8)
    length = np.empty(len(rings), np.int64)
    rings_text(np.ascontiguousarray(rings, np.float64), decimals, out, width, length)
    return TextColumn(out, np.arange(len(rings), dtype=np.int64) * width, length)


def _finished(
    out: Bytes, length: IntArray, numbers: npt.NDArray[Any], pattern: str, missing: str
) -> TextColumn:
    """The kernel's slots, with the rows that it left to us put behind them."""
    from automap.export.text_kernels import NUMBER_WIDTH

    start = np.arange(len(length), dtype=np.int64) * NUMBER_WIDTH
    left = np.flatnonzero(length < 0)
    if len(left) == 0:
        return TextColumn(out, start, length)
    tail = [missing.encode()]
    end = len(out) + len(tail[0])
    for row in left.tolist():
        if length[row] == -1:
            start[row], length[row] = len(out), len(tail[0])
            continue
        text = (pattern % numbers[row]).encode()
        start[row], length[row] = end, len(text)
        tail.append(text)
        end += len(text)
    return TextColumn(np.concatenate([out, np.frombuffer(b"".join(tail), np.uint8)]), start, length)


def lines(pieces: Sequence[str | TextColumn], n: int) -> bytes:
    """The texts of n rows one after another: in each row the pieces in their order."""
    from automap.export.text_kernels import join_rows

    columns = [constant(p, n) if isinstance(p, str) else p for p in pieces]
    bases = np.cumsum([0, *(len(c.data) for c in columns)])
    start = np.stack([c.start + base for c, base in zip(columns, bases[:-1], strict=True)], axis=1)
    length = np.stack([c.length for c in columns], axis=1)
    out = np.empty(int(length.sum()), np.uint8)
    join_rows(np.concatenate([c.data for c in columns]), start, length, out)
    return out.tobytes()
