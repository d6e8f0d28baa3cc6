"""u-blox UBX messages: layouts, names, and vectorised decoding.

A decoded table has a column for each field, named and scaled to integers as the receiver
sends them, and ``offset``, the byte offset of the message in the stream; one row a message.
:func:`physical` gives a field in its unit as float64.

References: u-blox 5 receiver protocol specification (GPS.G5-X-07036), u-blox 8/M8 receiver
description (UBX-13003221), u-blox F9 HPG 1.32 interface description (UBX-22008968).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from automap.io.byte_scan import Scan, key_is_ubx, scan_bytes
from automap.io.scan_kernel import Bytes
from automap.io.ubx_layouts import LAYOUTS, Layout
from automap.records import FloatArray, IntArray

_ESTIMATES = ("hAcc", "vAcc", "pAcc", "sAcc")
"""Accuracies: one of all bits, 4295 km, is none."""
_BLOCK = 4096
"""Messages taken apart at once, few enough to stay in the processor's cache."""


@dataclass(frozen=True)
class Table:
    """Messages of one type: a column [m] for each field."""

    columns: dict[str, npt.NDArray[Any]]

    def __getitem__(self, field: str) -> npt.NDArray[Any]:
        return self.columns[field]

    def __len__(self) -> int:
        return len(self.columns["offset"])


ESF_MEAS, ESF_RAW = 0x1002, 0x1003


def _payloads(data: Bytes, start: IntArray, size: int) -> npt.NDArray[np.void]:
    """``size`` bytes of the stream from each ``start`` [m], as items of no type."""
    # an item at every byte, of which the wanted ones are copied whole
    return np.ndarray((max(len(data) - size + 1, 0),), f"V{size}", data, strides=(1,))[start]


def _of_length(
    data: Bytes, start: IntArray, length: npt.NDArray[np.int32], dtype: np.dtype[np.void]
) -> npt.NDArray[np.void]:
    """Payloads [m] of ``length`` [m] as ``dtype``: cut, or filled with zeros, to its size."""
    size = dtype.itemsize
    if (length >= size).all():
        return _payloads(data, start, size).view(dtype)
    raw = np.zeros((len(start), size), np.uint8)
    for known in np.unique(np.minimum(length, size)):
        rows = np.flatnonzero(np.minimum(length, size) == known)
        part = _payloads(data, start[rows], int(known))
        raw[rows, :known] = part.view(np.uint8).reshape(len(rows), int(known))
    return raw.view(dtype)[:, 0]


def decode_table(scan: Scan, rows: IntArray, layout: Layout) -> tuple[Table, int]:
    """Messages of one type [m], and how many were too short for it."""
    dtype = layout.dtype
    length = scan.length[rows] - 8
    good = length >= (layout.shortest or dtype.itemsize)
    n_short = len(rows) - int(np.count_nonzero(good))
    if n_short:
        rows, length = rows[good], length[good]
    offset = scan.offset[rows]
    columns = {name: np.empty(len(rows), dtype[name]) for name in dtype.names or ()}
    for first in range(0, len(rows), _BLOCK):
        part = slice(first, first + _BLOCK)
        block = _of_length(scan.data, offset[part] + 6, length[part], dtype)
        for name, column in columns.items():
            column[part] = block[name]
    return Table({"offset": offset, **columns}), n_short


def decode_esf(scan: Scan, rows: IntArray, key: int) -> Table:
    """Readings of ESF-MEAS or ESF-RAW messages, one row each, in log order.

    ``tag`` is the time tag (ms in ESF-MEAS, counts in ESF-RAW), ``header`` the first word of
    ESF-RAW or the flags and source id of ESF-MEAS, ``value`` a signed 24-bit count of the kind
    ``type``. Rows are ordered by message and by place within it. A calibrated time tag at the
    end of an ESF-MEAS message is no reading and left out.
    """
    offset = scan.offset[rows]
    payload = scan.length[rows].astype(np.int64) - 8
    head, step = (8, 4) if key == ESF_MEAS else (4, 8)
    good = payload >= head
    offset, payload = offset[good], payload[good]
    header = _payloads(scan.data, offset + 6, head).view("<u4").reshape(-1, head // 4)
    room = (payload - head) // step
    if key == ESF_MEAS:
        # numMeas is zero in old firmware, which filled the message to its end
        calibrated = (header[:, 1] >> 3) & 1
        told = ((header[:, 1] >> 11) & 31).astype(np.int64)
        count = np.where(told > 0, np.minimum(told, room), np.maximum(room - calibrated, 0))
    else:
        count = room
    message = np.repeat(np.arange(len(offset)), count)
    first = np.cumsum(count) - count
    place = np.arange(len(message)) - first[message]
    start = offset[message] + 6 + head + step * place
    words = _payloads(scan.data, start, step).view("<u4").reshape(-1, step // 4)
    low = (words[:, 0] & 0xFFFFFF).astype(np.int32)
    return Table(
        {
            "offset": offset[message],
            "tag": words[:, 1].copy() if key == ESF_RAW else header[message, 0],
            "header": header[message, 0] if key == ESF_RAW else header[message, 1],
            "type": (words[:, 0] >> 24 & (63 if key == ESF_MEAS else 255)).astype(np.uint8),
            "value": low - ((low & 0x800000) << 1),
        }
    )


def decode_scan(scan: Scan) -> tuple[dict[str, Table], dict[str, int]]:
    """All known UBX messages of a scanned stream, and how many of each were too short."""
    by_key = {layout.key: name for name, layout in LAYOUTS.items()}
    tables: dict[str, Table] = {}
    short: dict[str, int] = {}
    for kind, key in enumerate(scan.keys):
        if not key_is_ubx(key):
            continue
        if key in by_key:
            name = by_key[key]
            tables[name], n_short = decode_table(scan, scan.rows(kind), LAYOUTS[name])
            if n_short:
                short[name] = n_short
        elif key in (ESF_MEAS, ESF_RAW):
            name = "ESF-MEAS" if key == ESF_MEAS else "ESF-RAW"
            tables[name] = decode_esf(scan, scan.rows(kind), key)
    return tables, short


def decode_ubx(data: bytes | Bytes) -> dict[str, Table]:
    """Tables of every known UBX message in a byte stream, by name (``NAV-PVT``, ...)."""
    return decode_scan(scan_bytes(data))[0]


def physical(
    name: str, table: Table, field: str, rows: IntArray | slice | None = None
) -> FloatArray:
    """A field [m] of a table of type ``name`` in its unit (s, deg, m, m/s) as float64, NaN for an
    accuracy that the receiver does not know.

    With ``rows`` only those.
    """
    scale = next(scale for known, _, scale in LAYOUTS[name].fields if known == field)
    column = table[field]
    counts = column if rows is None else column[rows]
    with np.errstate(invalid="ignore"):  # a signalling NaN is a NaN like any other
        values = counts.astype(np.float64)
    if field in _ESTIMATES:
        values[counts == np.iinfo(counts.dtype).max] = np.nan
    if scale != 1.0:
        # dividing by the exact power of ten rounds correctly, multiplying would not
        values /= round(1.0 / scale)
    return values
