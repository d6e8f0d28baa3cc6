"""Finding messages in a receiver's byte stream: UBX, NMEA 0183 and RTCM 3, in any mixture.

One pass over the bytes. A message counts only when its checksum agrees; a false start is
given up right after its sync character, so that a real message inside it is still found.

References: u-blox F9 HPG 1.32 interface description, 3.2 (UBX framing, Fletcher checksum);
NMEA 0183 v4.11, 5.3 (sentences); RTCM 10403.3, 4 (transport layer, CRC-24Q).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numba import njit

from automap.records import IntArray

Bytes = npt.NDArray[np.uint8]

MAX_PAYLOAD = 16_384
"""Longest UBX payload taken for real; the longest that u-blox documents is half of this."""

MAX_SENTENCE = 1_024
"""Longest NMEA sentence taken for real (the standard says 82, receivers exceed it)."""

MAX_KINDS = 4_096
"""Kinds of messages told apart; more than that can only be an adversary's file."""

_UNVERIFIED = np.uint64(1 << 63)
_N_STATS = 9
_MESSAGES, _KINDS, _BAD_UBX, _BAD_NMEA, _GARBAGE, _COMMENT, _CUT_AT, _CUT_NEED, _BAD_RTCM = range(
    _N_STATS
)


def _crc24q_table() -> npt.NDArray[np.uint32]:
    table = np.zeros(256, np.uint32)
    for value in range(256):
        crc = value << 16
        for _ in range(8):
            crc <<= 1
            if crc & 0x1000000:
                crc ^= 0x1864CFB
        table[value] = crc
    return table


_CRC24Q = _crc24q_table()


@njit(cache=True)
def _kind_of(
    key: np.uint64, keys: npt.NDArray[np.uint64], slots: npt.NDArray[np.int32], stats: IntArray
) -> np.int32:
    """Number of a message kind, new numbers being given in order of appearance."""
    mask = len(slots) - 1
    slot = np.int64((key * np.uint64(0x9E3779B97F4A7C15)) >> np.uint64(48)) & mask
    while slots[slot] >= 0:
        if keys[slots[slot]] == key:
            return np.int32(slots[slot])
        slot = (slot + 1) & mask
    kind = stats[_KINDS]
    if kind >= len(keys):
        return np.int32(len(keys) - 1)
    keys[kind] = key
    slots[slot] = kind
    stats[_KINDS] += 1
    return np.int32(kind)


@njit(cache=True)
def _hex_value(char: int) -> int:
    """Value of a hexadecimal digit of either case, -1 for anything else."""
    if 48 <= char <= 57:
        return int(char) - 48
    if 65 <= char <= 70:
        return int(char) - 55
    if 97 <= char <= 102:
        return int(char) - 87
    return -1


@njit(cache=True)
def _sentence_key(data: Bytes, start: int, end: int) -> np.uint64:
    """Up to eight characters of the address as a number, 0 when it is no address.

    u-blox's proprietary sentences are told apart by their first field as well.
    """
    key = np.uint64(0)
    count = 0
    i = start
    while i < end:
        c = data[i]
        if c == 44:
            break
        if not (48 <= c <= 57 or 65 <= c <= 90 or 97 <= c <= 122):
            return np.uint64(0)
        if count < 8:
            key = (key << np.uint64(8)) | np.uint64(c)
        count += 1
        i += 1
    if count < 3 or i >= end:
        return np.uint64(0)
    if key == np.uint64(0x50554258) and i + 3 <= end and data[i + 1] != 44 and data[i + 2] != 44:
        key = (key << np.uint64(16)) | (np.uint64(data[i + 1]) << np.uint64(8))
        key |= np.uint64(data[i + 2])
    return key


@njit(cache=True)
def _scan_kernel(
    data: Bytes,
    crc_table: npt.NDArray[np.uint32],
    offset: IntArray,
    length: npt.NDArray[np.int32],
    kind: npt.NDArray[np.int32],
    keys: npt.NDArray[np.uint64],
    slots: npt.NDArray[np.int32],
    stats: IntArray,
) -> None:
    n = len(data)
    garbage = 0
    garbage_at_cut = 0
    count = 0
    stats[_CUT_AT] = -1
    i = 0
    while i < n:
        c = data[i]
        size = 0
        key = np.uint64(0)
        skip = 1
        cut_need = 0
        if c == 0xB5:
            if i + 1 >= n:
                cut_need = 1
            elif data[i + 1] == 0x62:
                skip = 2
                if i + 6 > n:
                    cut_need = 8 - (n - i)
                else:
                    payload = int(data[i + 4]) | (int(data[i + 5]) << 8)
                    if payload <= MAX_PAYLOAD:
                        if i + 8 + payload > n:
                            cut_need = i + 8 + payload - n
                        else:
                            a = np.uint32(0)
                            b = np.uint32(0)
                            for j in range(i + 2, i + 6 + payload):
                                a += np.uint32(data[j])
                                b += a
                            stop = i + 6 + payload
                            if (a & 0xFF) == data[stop] and (b & 0xFF) == data[stop + 1]:
                                size = payload + 8
                                key = (np.uint64(data[i + 2]) << np.uint64(8)) | np.uint64(
                                    data[i + 3]
                                )
                            else:
                                stats[_BAD_UBX] += 1
        elif c == 36:
            check = np.uint8(0)
            j = i + 1
            limit = min(n, i + 1 + MAX_SENTENCE)
            while j < limit:
                d = data[j]
                if d == 42 or d < 32 or d > 126 or d == 36:
                    break
                check ^= d
                j += 1
            # nothing between here and j can start another message
            skip = j - i
            if j >= n:
                cut_need = 1
            elif j < limit and data[j] == 42:
                if j + 3 > n:
                    cut_need = j + 3 - n
                else:
                    high = _hex_value(data[j + 1])
                    low = _hex_value(data[j + 2])
                    address = _sentence_key(data, i + 1, j)
                    if high >= 0 and low >= 0 and address != 0:
                        if high * 16 + low == check:
                            key = address
                            size = j + 3 - i
                        else:
                            stats[_BAD_NMEA] += 1
            elif j < limit and (data[j] == 13 or data[j] == 10):
                address = _sentence_key(data, i + 1, j)
                if address != 0:
                    key = address | _UNVERIFIED
                    size = j - i
            if size > 0:
                j = i + size
                while j < n and data[j] == 13:
                    j += 1
                if j < n and data[j] == 10:
                    j += 1
                size = j - i
        elif c == 0xD3 and i + 6 <= n and data[i + 1] < 4:
            payload = (int(data[i + 1]) << 8) | int(data[i + 2])
            if payload >= 2 and i + 6 + payload <= n:
                crc = np.uint32(0)
                for j in range(i, i + 3 + payload):
                    crc = ((crc << np.uint32(8)) & np.uint32(0xFFFFFF)) ^ crc_table[
                        ((crc >> np.uint32(16)) ^ np.uint32(data[j])) & np.uint32(0xFF)
                    ]
                j = i + 3 + payload
                sent = (int(data[j]) << 16) | (int(data[j + 1]) << 8) | int(data[j + 2])
                if sent == int(crc):
                    number = (int(data[i + 3]) << 4) | (int(data[i + 4]) >> 4)
                    key = np.uint64(0xD30000 | number)
                    size = payload + 6
        elif c == 10 or c == 13:
            stats[_COMMENT] += 1
            i += 1
            continue
        elif c == 35 and (i == 0 or data[i - 1] == 10 or data[i - 1] == 13):
            j = i
            while j < n:
                d = data[j]
                if d < 32 and d != 9:
                    break
                if d == 0xB5 and j + 1 < n and data[j + 1] == 0x62:
                    break
                j += 1
            stats[_COMMENT] += j - i
            i = j
            continue

        if size > 0:
            offset[count] = i
            length[count] = size
            kind[count] = _kind_of(key, keys, slots, stats)
            count += 1
            stats[_CUT_AT] = -1
            i += size
            continue
        if cut_need > 0 and stats[_CUT_AT] < 0:
            stats[_CUT_AT] = i
            stats[_CUT_NEED] = cut_need
            garbage_at_cut = garbage
        garbage += min(skip, n - i)
        i += skip
    stats[_MESSAGES] = count
    stats[_GARBAGE] = garbage if stats[_CUT_AT] < 0 else garbage_at_cut


@njit(cache=True)
def _order_kernel(kind: npt.NDArray[np.int32], starts: IntArray, order: IntArray) -> None:
    """Counting sort: rows of each kind together, in log order within a kind."""
    fill = starts.copy()
    for row in range(len(kind)):
        k = kind[row]
        order[fill[k]] = row
        fill[k] += 1


@dataclass(frozen=True)
class Scan:
    """The messages of a byte stream.

    ``offset`` [n] first byte, ``length`` [n] bytes with header and line end, ``kind`` [n]
    index into ``names``; ``verified`` [k] is False for a kind of sentences that carried no
    checksum. ``rows`` gives the rows of one kind in log order. ``garbage_bytes`` belong to
    no message; ``comment_bytes`` are blank lines and lines that start with ``#``.
    ``cut_offset`` is where a message starts that the end of the stream cut off (-1: none),
    ``cut_missing`` the least number of bytes it lacks.
    """

    data: Bytes
    offset: IntArray
    length: npt.NDArray[np.int32]
    kind: npt.NDArray[np.int32]
    keys: tuple[int, ...]
    verified: tuple[bool, ...]
    bad_ubx: int
    bad_nmea: int
    garbage_bytes: int
    comment_bytes: int
    cut_offset: int
    cut_missing: int
    order: IntArray
    starts: IntArray

    def __len__(self) -> int:
        return len(self.offset)

    def rows(self, kind: int) -> IntArray:
        """Rows [m] of the messages of one kind, in log order."""
        return self.order[self.starts[kind] : self.starts[kind + 1]]

    def count(self, kind: int) -> int:
        """Number of messages of one kind."""
        return int(self.starts[kind + 1] - self.starts[kind])


def key_is_ubx(key: int) -> bool:
    """Whether a key is UBX class * 256 + id."""
    return key < 0x10000


def key_is_rtcm(key: int) -> bool:
    """Whether a key is 0xD30000 + RTCM message number."""
    return key >> 16 == 0xD3


def key_address(key: int) -> str:
    """Address of an NMEA key, such as ``GNGGA`` or ``PUBX00``."""
    return key.to_bytes(8, "big").lstrip(b"\0").decode("ascii")


def scan_bytes(data: bytes | Bytes) -> Scan:
    """Find every message of a byte stream in one pass.

    Time and memory grow linearly with the stream; checksums are verified.
    """
    raw = np.frombuffer(data, np.uint8) if isinstance(data, bytes | bytearray) else data.view()
    raw.flags.writeable = False  # one compiled version for every caller
    # the smallest messages have 7 bytes; memory that is never written is never occupied
    capacity = len(raw) // 7 + 1
    offset = np.empty(capacity, np.int64)
    length = np.empty(capacity, np.int32)
    kind = np.empty(capacity, np.int32)
    keys = np.zeros(MAX_KINDS, np.uint64)
    slots = np.full(4 * MAX_KINDS, -1, np.int32)
    stats = np.zeros(_N_STATS, np.int64)
    _scan_kernel(raw, _CRC24Q, offset, length, kind, keys, slots, stats)
    n, n_kinds = int(stats[_MESSAGES]), int(stats[_KINDS])
    kind = kind[:n].copy()
    starts = np.zeros(n_kinds + 1, np.int64)
    np.cumsum(np.bincount(kind, minlength=n_kinds)[:n_kinds], out=starts[1:])
    order = np.empty(n, np.int64)
    _order_kernel(kind, starts, order)
    flag = int(_UNVERIFIED)
    return Scan(
        data=raw,
        offset=offset[:n].copy(),
        length=length[:n].copy(),
        kind=kind,
        keys=tuple(int(key) & ~flag for key in keys[:n_kinds]),
        verified=tuple(not int(key) & flag for key in keys[:n_kinds]),
        bad_ubx=int(stats[_BAD_UBX]),
        bad_nmea=int(stats[_BAD_NMEA]),
        garbage_bytes=int(stats[_GARBAGE]),
        comment_bytes=int(stats[_COMMENT]),
        cut_offset=int(stats[_CUT_AT]),
        cut_missing=int(stats[_CUT_NEED]),
        order=order,
        starts=starts,
    )
