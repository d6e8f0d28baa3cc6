"""RTKLIB's time tags: when each byte of a logged stream came in.

Source: RTKLIB's stream.c (``writefile``, ``readfile``): a head of 64 bytes that ends with the
tick of the start, then its time (4 bytes of GPS seconds as Unix counts them, 8 bytes of their
fraction), then for each write the ticks since the start (4 bytes, ms) and the length of the
file after it (4 bytes, or 8 where RTKLIB was built with long positions).
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from automap.errors import InputError
from automap.records import IntArray
from automap.timebase import UNIX_OF_GPS_EPOCH

_MARK = b"TIMETAG RTKLIB"
_HEAD = 64
_BODY = _HEAD + 12


@dataclass(frozen=True)
class TimeTag:
    """Arrival of a stream: bytes from ``offset`` [n] on came in at ``t_ns`` [n].

    ``t_ns`` counts the logging computer's ticks, the same for all streams that it logged;
    ``start_gps_s`` is what its clock said at the start; ``length`` of the stream as logged.
    """

    offset: IntArray
    t_ns: IntArray
    start_gps_s: float
    length: int


def read_time_tag(path: Path) -> TimeTag:
    """Read a tag; InputError when it is none or damaged.

    An entry that was cut off at the end is left out.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror}); check the file.") from error
    if not data.startswith(_MARK) or len(data) < _BODY + 8:
        raise InputError(
            f"{path} is no time tag of RTKLIB, or it holds no times; log the stream again with "
            "time tags on (str2str: file.ubx::T)."
        )
    (tick,) = struct.unpack_from("<I", data, _HEAD - 4)
    seconds, fraction = struct.unpack_from("<Id", data, _HEAD)
    for width, layout in ((8, "<u4"), (12, "<u8")):
        entries = _entries(data[_BODY:], width, layout)
        if len(entries[0]) and np.all(np.diff(entries[1]) >= 0) and entries[1][0] > 0:
            break
    else:
        raise InputError(
            f"{path}: the positions run backwards, so the tag is damaged or of another file; "
            "copy stream and tag together again."
        )
    ticks, ends = entries
    if np.any(np.diff(ticks) < 0):
        raise InputError(f"{path}: the times run backwards; the tag is damaged, copy it again.")
    # a write is known by the length after it: its first byte is the end of the one before
    first = np.concatenate([[0], ends[:-1]])
    distinct = np.diff(first, prepend=-1) > 0
    start = fraction if np.isfinite(fraction) and 0.0 <= fraction < 1.0 else 0.0
    return TimeTag(
        offset=first[distinct],
        t_ns=(ticks[distinct] + tick) * 1_000_000,
        start_gps_s=float(seconds) + start - UNIX_OF_GPS_EPOCH,
        length=int(ends[-1]),
    )


def _entries(body: bytes, width: int, position: str) -> tuple[IntArray, IntArray]:
    kind = np.dtype([("tick", "<u4"), ("end", position)])
    rows = np.frombuffer(body[: len(body) // width * width], kind)
    return rows["tick"].astype(np.int64), rows["end"].astype(np.int64)
