"""GoPro's metadata format GPMF: keys, lengths and values, and the samples they make.

Source: GoPro's gpmf-parser, its README (structure, modifiers of a stream) and the tables of
types and FourCCs there.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from automap.records import FloatArray

_HEADER = 8

_TYPES = {
    b"b": "i1",
    b"B": "u1",
    b"d": ">f8",
    b"f": ">f4",
    b"j": ">i8",
    b"J": ">u8",
    b"l": ">i4",
    b"L": ">u4",
    b"q": ">i4",
    b"Q": ">i8",
    b"s": ">i2",
    b"S": ">u2",
}
"""Types of numbers; q and Q are fixed point with half of their bits behind the point."""
_FIXED_POINT = {b"q": 2.0**-16, b"Q": 2.0**-32}


class GpmfError(ValueError):
    """The bytes are no GPMF; the text says where."""


@dataclass(frozen=True)
class Item:
    """One key with its value: ``data`` is ``repeat`` samples of ``size`` bytes of ``kind``."""

    key: str
    kind: bytes
    size: int
    repeat: int
    data: bytes

    def text(self) -> str:
        """The value as text."""
        return self.data.split(b"\0", 1)[0].decode("latin-1").strip()

    def numbers(self, complex_type: bytes = b"") -> FloatArray:
        """Samples [repeat, k] as floats; ``complex_type`` is the TYPE of a value of kind ``?``.

        Raises GpmfError for a kind that holds no numbers.
        """
        kinds = complex_type if self.kind == b"?" else self.kind
        if self.kind == b"?":
            kinds = expand_type(complex_type)
            fields = [(f"f{i}", _number_type(kinds[i : i + 1])) for i in range(len(kinds))]
            dtype = np.dtype(fields)
            if dtype.itemsize != self.size:
                raise GpmfError(f"{self.key} has samples of {self.size} bytes, not of its TYPE")
            table = np.frombuffer(self.data, dtype, self.repeat)
            columns = [
                table[f"f{i}"].astype(np.float64) * _FIXED_POINT.get(kinds[i : i + 1], 1.0)
                for i in range(len(kinds))
            ]
            return np.column_stack(columns) if columns else np.zeros((self.repeat, 0))
        one = np.dtype(_number_type(kinds))
        per_sample, rest = divmod(self.size, one.itemsize)
        if rest or per_sample == 0:
            raise GpmfError(f"{self.key} has samples of {self.size} bytes, no whole numbers")
        values = np.frombuffer(self.data, one, per_sample * self.repeat)
        scaled = values.astype(np.float64) * _FIXED_POINT.get(kinds, 1.0)
        return scaled.reshape(self.repeat, per_sample)

    def children(self) -> list[Item]:
        """The keys inside a nested value."""
        return list(parse(self.data))


def _number_type(kind: bytes) -> str:
    if kind not in _TYPES:
        raise GpmfError(f"a value of type {kind!r} where numbers are expected")
    return _TYPES[kind]


def expand_type(text: bytes) -> bytes:
    """A TYPE such as ``ffff[3]L`` written out; trailing padding is dropped."""
    text = text.rstrip(b"\0 ")
    out = b""
    i = 0
    while i < len(text):
        if text[i : i + 1] == b"[":
            end = text.find(b"]", i)
            digits = text[i + 1 : end] if end > 0 else b""
            if not out or not digits.isdigit() or int(digits) > 4096:
                raise GpmfError("a TYPE that cannot be read")
            out += out[-1:] * (int(digits) - 1)
            i = end + 1
        else:
            out += text[i : i + 1]
            i += 1
    return out


def parse(data: bytes) -> Iterator[Item]:
    """The items of a payload in order; raises GpmfError where it does not add up."""
    at = 0
    while at + _HEADER <= len(data):
        key = data[at : at + 4]
        if key == b"\0\0\0\0":
            return  # padding at the end
        if not all(32 <= c < 127 for c in key):
            raise GpmfError(f"no key at byte {at}")
        size, repeat = data[at + 5], int.from_bytes(data[at + 6 : at + 8], "big")
        length = size * repeat
        start = at + _HEADER
        if start + length > len(data):
            raise GpmfError(f"{key.decode()} at byte {at} is longer than what is left")
        yield Item(key.decode(), data[at + 4 : at + 5], size, repeat, data[start : start + length])
        at = start + (length + 3) // 4 * 4


@dataclass(frozen=True)
class Stream:
    """One sensor's part of a payload: its samples' key, and the modifiers by their key."""

    key: str
    item: Item
    modifiers: dict[str, Item]

    def scaled(self) -> FloatArray:
        """Samples [n, k] in the stream's units, in the axes as stored."""
        complex_type = self.modifiers["TYPE"].data if "TYPE" in self.modifiers else b""
        values = self.item.numbers(complex_type)
        if "SCAL" in self.modifiers:
            divisor = self.modifiers["SCAL"].numbers().ravel()
            if len(divisor) not in (1, values.shape[1]) or not (divisor != 0).all():
                raise GpmfError(f"{self.key} has {values.shape[1]} columns and another SCAL")
            values = values / divisor
        return values

    def number(self, key: str) -> float | None:
        """The first number of a modifier, None where the stream has none."""
        item = self.modifiers.get(key)
        if item is None or item.repeat == 0:
            return None
        return float(item.numbers().ravel()[0])

    def count(self, key: str) -> int | None:
        """As ``number``, whole and unrounded."""
        item = self.modifiers.get(key)
        if item is None or item.kind not in (b"J", b"j", b"L", b"l") or not item.data:
            return None
        count = int.from_bytes(item.data[: item.size], "big")
        return count if count < 1 << 62 else None


def streams(payload: bytes) -> list[tuple[str, Stream]]:
    """Device name and stream for each stream of a payload; GpmfError for a damaged one.

    A stream's samples are its last item, the ones before modify it.
    """
    found = []
    for device in parse(payload):
        if device.key != "DEVC":
            continue
        name = ""
        for item in device.children():
            if item.key == "DVNM":
                name = item.text()
            elif item.key == "STRM":
                parts = item.children()
                if parts:
                    modifiers = {part.key: part for part in parts[:-1]}
                    found.append((name, Stream(parts[-1].key, parts[-1], modifiers)))
    return found


def axis_order(orin: str, orio: str) -> FloatArray | None:
    """C [3, 3] from the stored order of axes to the camera's X, Y, Z.

    ``orin`` names the stored axes, a small letter for a reversed one, ``orio`` the order in
    which they are wanted (GoPro: "ORIN", "ORIO", else a full MTRX). None for anything else.
    """
    if len(orin) != 3 or len(orio) != 3 or sorted(orin.upper()) != ["X", "Y", "Z"]:
        return None
    if sorted(orio.upper()) != ["X", "Y", "Z"]:
        return None
    matrix = np.zeros((3, 3))
    for row, wanted in enumerate(orio):
        for column, stored in enumerate(orin):
            if stored.upper() == wanted.upper():
                matrix[row, column] = 1.0 if stored == wanted else -1.0
    return matrix


def concatenate(parts: Sequence[Any]) -> FloatArray:
    """Arrays [k, c] one below the other; [0, 0] of none."""
    return np.asarray(np.concatenate(parts), np.float64) if parts else np.zeros((0, 0))
