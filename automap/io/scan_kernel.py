"""The loop that finds messages in a byte stream; see :mod:`automap.io.byte_scan`."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from automap.io.kernel import Kernel
from automap.records import IntArray

Bytes = npt.NDArray[np.uint8]
Words = npt.NDArray[np.uint64]

MAX_PAYLOAD = 16_384
"""Longest UBX payload taken for real; the longest that u-blox documents is half of this."""

MAX_SENTENCE = 1_024
"""Longest NMEA sentence taken for real (the standard says 82, receivers exceed it)."""

N_STATS = 9
MESSAGES, KINDS, BAD_UBX, BAD_NMEA, GARBAGE, COMMENT, CUT_AT, CUT_NEED, BAD_RTCM = range(N_STATS)

RTCM = 0xD30000
"""Added to the number of an RTCM message for its key."""

PUBX = int.from_bytes(b"PUBX", "big")

_ONES = np.uint64(0x0101010101010101)
_HIGHS = np.uint64(0x8080808080808080)
_STARS = np.uint64(0x2A2A2A2A2A2A2A2A)
_DOLLARS = np.uint64(0x2424242424242424)
_BLANKS = np.uint64(0x2020202020202020)
_LOW_BYTE, _TOP_BYTE = np.uint64(255), np.uint64(56)
_HALF, _QUARTER, _EIGHTH = np.uint64(32), np.uint64(16), np.uint64(8)
_BIT, _SEVEN = np.uint64(1), np.uint64(7)


@Kernel
def _kind_of(
    key: int, keys: IntArray, slots: npt.NDArray[np.int32], stats: npt.NDArray[np.int64]
) -> int:
    """Number of a message kind, new numbers being given in order of appearance."""
    mask = len(slots) - 1
    slot = (key ^ (key >> 7) ^ (key >> 17) ^ (key >> 31)) & mask
    while slots[slot] >= 0:
        if keys[slots[slot]] == key:
            return int(slots[slot])
        slot = (slot + 1) & mask
    kind = stats[KINDS]
    if kind >= len(keys):
        return len(keys) - 1
    keys[kind] = key
    slots[slot] = kind
    stats[KINDS] += 1
    return int(kind)


@Kernel
def _sentence_key(data: Bytes, start: int, end: int) -> int:
    """Up to eight characters before the first comma as a number, 0 when they are no address.

    u-blox's proprietary sentences are told apart by their first field as well.
    """
    key = 0
    i = start
    while i < end:
        c = data[i]
        if c == 44:
            break
        if not (48 <= c <= 57 or 65 <= c <= 90 or 97 <= c <= 122):
            return 0
        if i < start + 8:
            key = key * 256 + c
        i += 1
    if i < start + 3 or i >= end:
        return 0
    if key == PUBX and i + 3 <= end and data[i + 1] != 44 and data[i + 2] != 44:
        key = key * 65536 + data[i + 1] * 256 + data[i + 2]
    return key


@Kernel
def _fletcher(body: Bytes) -> int:
    """Both checksum bytes of a UBX message, the first one low.

    The second is the sum of all first ones on the way, so every byte counts in it as often
    as there are bytes from it to the end.
    """
    first = 0
    second = 0
    n = len(body)
    for j in range(n):
        first += body[j]
        second += (n - j) * body[j]
    return (first & 255) + (second & 255) * 256


@Kernel
def _crc24q(body: Bytes, table: npt.NDArray[np.int64]) -> int:
    crc = 0
    for j in range(len(body)):
        crc = ((crc << 8) & 0xFFFFFF) ^ table[((crc >> 16) ^ body[j]) & 0xFF]
    return crc


@Kernel
def scan_kernel(
    data: Bytes,
    words: Words,
    crc_table: IntArray,
    hex_values: IntArray,
    offset: IntArray,
    length: npt.NDArray[np.int32],
    kind: npt.NDArray[np.int32],
    keys: IntArray,
    slots: npt.NDArray[np.int32],
    stats: IntArray,
) -> None:
    """Write ``offset``, ``length``, ``kind`` [m] of all messages of ``data`` [n], and ``stats``.

    ``words`` [n - 7] is the word of eight bytes from each byte on, or empty: with it eight
    bytes of a sentence are taken at once. ``hex_values`` [256] are those of digits, -1 for
    other bytes. The key of a sentence without checksum is negative.
    """
    n = len(data)
    n_words = len(words)
    garbage = 0
    garbage_at_cut = 0
    count = 0
    stats[CUT_AT] = -1
    i = 0
    while i < n:
        c = data[i]
        size = 0
        key = 0
        skip = 1
        cut_need = 0
        if c == 36:
            check = 0
            j = i + 1
            limit = min(n, i + 1 + MAX_SENTENCE)
            if n_words > 0:
                folded = _BIT ^ _BIT
                while j < n_words and j + 8 <= limit:
                    word = words[j]
                    # a star, a dollar, a byte below 32, one above 126 (Mycroft's test for zeros)
                    star = word ^ _STARS
                    dollar = word ^ _DOLLARS
                    stop = (star - _ONES) & ~star
                    stop |= (dollar - _ONES) & ~dollar
                    stop |= (word - _BLANKS) & ~word
                    stop |= word | (word + _ONES)
                    stop &= _HIGHS
                    if stop:
                        # borrows run upward, so the lowest mark is a true one
                        below = ((stop & (~stop + _BIT)) >> _SEVEN) - _BIT
                        folded ^= word & below
                        j += int(np.int64(((below & _ONES) * _ONES) >> _TOP_BYTE))
                        break
                    folded ^= word
                    j += 8
                folded ^= folded >> _HALF
                folded ^= folded >> _QUARTER
                folded ^= folded >> _EIGHTH
                check = int(np.int64(folded & _LOW_BYTE))
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
                    high = hex_values[data[j + 1]]
                    low = hex_values[data[j + 2]]
                    address = _sentence_key(data, i + 1, j)
                    if high >= 0 and low >= 0 and address != 0:
                        if high * 16 + low == check:
                            key = address
                            size = j + 3 - i
                        else:
                            stats[BAD_NMEA] += 1
            elif j < limit and (data[j] == 13 or data[j] == 10):
                address = _sentence_key(data, i + 1, j)
                if address != 0:
                    key = -address
                    size = j - i
            if size > 0:
                j = i + size
                while j < n and data[j] == 13:
                    j += 1
                if j < n and data[j] == 10:
                    j += 1
                size = j - i
        elif c == 0xB5:
            if i + 1 >= n:
                cut_need = 1
            elif data[i + 1] == 0x62:
                skip = 2
                if i + 6 > n:
                    cut_need = 8 - (n - i)
                else:
                    payload = data[i + 4] + data[i + 5] * 256
                    stop_at = i + 6 + payload
                    if payload <= MAX_PAYLOAD:
                        if stop_at + 2 > n:
                            cut_need = stop_at + 2 - n
                        elif _fletcher(data[i + 2 : stop_at]) == (
                            data[stop_at] + data[stop_at + 1] * 256
                        ):
                            size = payload + 8
                            key = data[i + 2] * 256 + data[i + 3]
                        else:
                            stats[BAD_UBX] += 1
        elif c == 0xD3 and i + 6 <= n and data[i + 1] < 4:
            payload = data[i + 1] * 256 + data[i + 2]
            if payload >= 2 and i + 6 + payload <= n:
                j = i + 3 + payload
                sent = data[j] * 65536 + data[j + 1] * 256 + data[j + 2]
                if sent == _crc24q(data[i:j], crc_table):
                    key = RTCM + data[i + 3] * 16 + data[i + 4] // 16
                    size = payload + 6
        elif c == 10 or c == 13:
            stats[COMMENT] += 1
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
            stats[COMMENT] += j - i
            i = j
            continue

        if size > 0:
            offset[count] = i
            length[count] = size
            kind[count] = _kind_of(key, keys, slots, stats)
            count += 1
            stats[CUT_AT] = -1
            i += size
            continue
        if cut_need > 0 and stats[CUT_AT] < 0:
            stats[CUT_AT] = i
            stats[CUT_NEED] = cut_need
            garbage_at_cut = garbage
        garbage += min(skip, n - i)
        i += skip
    stats[MESSAGES] = count
    stats[GARBAGE] = garbage if stats[CUT_AT] < 0 else garbage_at_cut


@Kernel
def order_kernel(kind: npt.NDArray[np.int32], fill: IntArray, order: IntArray) -> None:
    """Counting sort: rows of each kind together, in log order within a kind.

    ``fill`` [k] says where each kind starts in ``order`` and is moved on.
    """
    for row in range(len(kind)):
        k = kind[row]
        order[fill[k]] = row
        fill[k] += 1
