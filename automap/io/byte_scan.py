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

from automap.io import scan_kernel as sk
from automap.io.kernel import worth_compiling
from automap.io.scan_kernel import Bytes, Words
from automap.records import IntArray

MAX_KINDS = 4_096
"""Kinds of messages told apart; more than that can only be an adversary's file."""


def _crc24q_table() -> IntArray:
    table = np.zeros(256, np.int64)
    for value in range(256):
        crc = value << 16
        for _ in range(8):
            crc <<= 1
            if crc & 0x1000000:
                crc ^= 0x1864CFB
        table[value] = crc
    return table


def _hex_table() -> IntArray:
    table = np.full(256, -1, np.int64)
    for value, (small, large) in enumerate(
        zip(b"0123456789abcdef", b"0123456789ABCDEF", strict=True)
    ):
        table[small] = table[large] = value
    return table


_CRC24Q = _crc24q_table()
_HEX = _hex_table()


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
    keys = np.zeros(MAX_KINDS, np.int64)
    slots = np.full(4 * MAX_KINDS, -1, np.int32)
    stats = np.zeros(sk.N_STATS, np.int64)
    sk.scan_kernel.run(
        len(raw), raw, _words(raw), _CRC24Q, _HEX, offset, length, kind, keys, slots, stats
    )
    n, n_kinds = int(stats[sk.MESSAGES]), int(stats[sk.KINDS])
    kind = kind[:n].copy()
    starts = np.zeros(n_kinds + 1, np.int64)
    np.cumsum(np.bincount(kind, minlength=n_kinds)[:n_kinds], out=starts[1:])
    order = np.empty(n, np.int64)
    sk.order_kernel.run(len(raw), kind, starts.copy(), order)
    return Scan(
        data=raw,
        offset=offset[:n].copy(),
        length=length[:n].copy(),
        kind=kind,
        keys=tuple(abs(int(key)) for key in keys[:n_kinds]),
        verified=tuple(bool(key > 0) for key in keys[:n_kinds]),
        bad_ubx=int(stats[sk.BAD_UBX]),
        bad_nmea=int(stats[sk.BAD_NMEA]),
        garbage_bytes=int(stats[sk.GARBAGE]),
        comment_bytes=int(stats[sk.COMMENT]),
        cut_offset=int(stats[sk.CUT_AT]),
        cut_missing=int(stats[sk.CUT_NEED]),
        order=order,
        starts=starts,
    )


def _words(raw: Bytes) -> Words:
    """The eight bytes from each byte [n] on as a number [n - 7], for the compiled kernel alone."""
    count = len(raw) - 7 if worth_compiling(len(raw)) else 0
    return np.ndarray((max(count, 0),), np.uint64, raw, strides=(1,))
