"""Columns of text as bytes, put together to the lines of a file without a loop in Python.

A map of a hundred thousand signs is some fifty million characters of numbers; every line is
the same constant pieces with the values of one sign between them.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from automap.records import BoolArray, FloatArray, IntArray

Bytes = npt.NDArray[np.uint8]

_CHUNK = 4096


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


def special_characters(characters: str) -> BoolArray:
    """Table [256] of bytes that need a second look: these, control characters, DEL, non-ASCII."""
    table = np.zeros(256, np.bool_)
    table[:32] = table[127:] = True
    table[list(characters.encode())] = True
    return table


def text_column(
    values: Sequence[Any],
    convert: Callable[[Any], str],
    rows: Sequence[Hashable] | None = None,
    special: BoolArray | None = None,
    quote: str = "",
) -> TextColumn:
    """Each value [n] as ``convert`` writes it; values that repeat are converted once.

    ``rows`` [n] are hashable stand-ins of values that are not hashable themselves. Where all
    values are texts without a ``special`` character, ``convert`` is known to do no more than
    put them between ``quote`` marks, and is not called.
    """
    if special is not None:
        plain = plain_column(values, special, quote)
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


def plain_column(values: Sequence[Any], special: BoolArray, quote: str = "") -> TextColumn | None:
    """Texts as they are; None where one is no text or has a special character."""
    try:
        text = "".join(values).encode("ascii")
    except (TypeError, UnicodeEncodeError):
        return None
    data = np.frombuffer(text, np.uint8)
    if special[data].any():
        return None
    length = np.fromiter(map(len, values), np.int64, len(values))
    if quote:
        data = np.frombuffer(f"{quote}{(2 * quote).join(values)}{quote}".encode(), np.uint8)
        length += 2 * len(quote)
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
    return b"".join(line_chunks(pieces, n))


def line_chunks(pieces: Sequence[str | TextColumn], n: int) -> Iterator[memoryview]:
    """The same in parts of some thousand rows, so that no second copy of all is needed."""
    from automap.export.text_kernels import join_rows

    columns = [constant(p, n) if isinstance(p, str) else p for p in _merged(pieces)]
    address = np.empty((len(columns), _CHUNK), np.int64)
    length = np.empty((len(columns), _CHUNK), np.int64)
    for first in range(0, n, _CHUNK):
        rows = min(_CHUNK, n - first)
        for k, column in enumerate(columns):
            own = slice(first, first + rows)
            address[k, :rows] = column.start[own]
            address[k, :rows] += column.data.ctypes.data
            length[k, :rows] = column.length[own]
        out = np.empty(int(length[:, :rows].sum()), np.uint8)
        join_rows(address, length, rows, out)
        yield memoryview(out)  # type: ignore[arg-type]


def _merged(pieces: Sequence[str | TextColumn]) -> list[str | TextColumn]:
    """The pieces with constants that follow one another put together."""
    merged: list[str | TextColumn] = []
    for piece in pieces:
        if isinstance(piece, str) and merged and isinstance(merged[-1], str):
            merged[-1] += piece
        else:
            merged.append(piece)
    return merged
