"""Damage for files, drawn at random: bytes, cells of tables, numbers of text, framed messages."""

from __future__ import annotations

import random
import re
from collections.abc import Callable

_NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")
# what broke a reader once: ends of ranges, no numbers, and numbers too long for a machine word
_VALUES = (
    *(b"0", b"-1", b"1e308", b"-1e308", b"1e-320", b"NaN", b"inf", b"-inf", b"null", b"[]", b"{}"),
    *(b"9223372036854775807", b"-9223372036854775808", b"1" * 309, b"9" * 5000, b"", b'"', b"\xff"),
    *("١".encode(), b"true", b"[[1, 2], [3]]", b"90", b"-180.0000001", b"\\u0000"),
)
_SYNC = b"\xb5\x62"
_MOST = 1 << 16  # bytes; what grows beyond teaches no more and takes the time of many


def _bit(data: bytearray, draw: random.Random) -> None:
    data[draw.randrange(len(data))] ^= 1 << draw.randrange(8)


def _byte(data: bytearray, draw: random.Random) -> None:
    data[draw.randrange(len(data))] = draw.choice((0, 255, 10, 13, 34, 44, draw.randrange(256)))


def _cut(data: bytearray, draw: random.Random) -> None:
    del data[draw.randrange(len(data)) :]


def _remove(data: bytearray, draw: random.Random) -> None:
    start = draw.randrange(len(data))
    del data[start : start + draw.choice((1, 4, 32, 256))]


def _repeat(data: bytearray, draw: random.Random) -> None:
    start = draw.randrange(len(data))
    part = data[start : start + draw.choice((1, 16, 200))]
    data[start:start] = part * draw.choice((1, 3, 40))


def _number(data: bytearray, draw: random.Random) -> None:
    # of the text round one place: all numbers of a picture take longer than its reader
    place = draw.randrange(len(data))
    found = list(_NUMBER.finditer(data, max(0, place - 1024), place + 1024))
    if found:
        start, end = draw.choice(found).span()
        data[start:end] = draw.choice(_VALUES)


def _cell(data: bytearray, draw: random.Random) -> None:
    rows = data.split(b"\n")
    row = draw.randrange(len(rows))
    cells = rows[row].split(b",")
    place = draw.randrange(len(cells))
    match draw.randrange(3):
        case 0:
            cells[place] = bytearray(draw.choice(_VALUES))
        case 1:
            del cells[place]
        case _:
            cells.insert(place, cells[draw.randrange(len(cells))])
    rows[row] = bytearray(b",").join(cells)
    data[:] = b"\n".join(rows)


def _lines(data: bytearray, draw: random.Random) -> None:
    rows = data.split(b"\n")
    a, b = draw.randrange(len(rows)), draw.randrange(len(rows))
    rows[a], rows[b] = rows[b], rows[a]
    data[:] = draw.choice((b"\n", b"\n", b"\r\n", b"\r")).join(rows)


_KINDS: tuple[Callable[[bytearray, random.Random], None], ...] = (
    *(_bit, _byte, _cut, _remove, _repeat, _number, _number, _cell, _cell, _lines),
)


def mended(data: bytes) -> bytes:
    """The same with right checksums in NMEA sentences and UBX frames, so that readers go on."""
    out = bytearray(data)
    for found in re.finditer(rb"\$([^$*\r\n]*)\*(?=..)", data):
        check = 0
        for byte in found[1]:
            check ^= byte
        out[found.end() : found.end() + 2] = b"%02X" % check
    start = out.find(_SYNC)
    while start >= 0:
        end = start + 6 + int.from_bytes(out[start + 4 : start + 6], "little")
        if end + 2 <= len(out):
            a = b = 0
            for byte in out[start + 2 : end]:
                a = (a + byte) & 255
                b = (b + a) & 255
            out[end : end + 2] = bytes((a, b))
        start = out.find(_SYNC, max(start + 2, end if end + 2 <= len(out) else 0))
    return bytes(out)


def damaged(data: bytes, draw: random.Random) -> bytes:
    """``data`` with one to five damages; half of all with right checksums."""
    out = bytearray(data)
    for _ in range(draw.randint(1, 5)):
        if not out:
            break
        draw.choice(_KINDS)(out, draw)
        del out[max(_MOST, len(data)) :]
    return mended(bytes(out)) if draw.random() < 0.5 else bytes(out)
