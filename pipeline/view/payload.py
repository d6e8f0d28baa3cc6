"""Columns for the page as one block of bytes, which it reads without parsing numbers."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from automap.export.uncertainty import principal_axes
from automap.gates import OUTSIDE_95, gate
from automap.io.web_tiles import to_world
from pipeline.view.signs import SignTable

_TYPES = {"float64": "f8", "float32": "f4", "uint32": "u4", "uint16": "u2", "uint8": "u1"}


def packed(header: Mapping[str, Any], arrays: Mapping[str, npt.NDArray[Any]]) -> bytes:
    """Length of the header (uint32, little endian), the header as JSON, then the arrays.

    The header lists every array's name, type, offset from the end of the header's block and
    length; each array begins at a multiple of eight bytes.
    """
    blocks: list[bytes] = []
    listed = []
    offset = 0
    for name, values in arrays.items():
        data = np.ascontiguousarray(values).astype(values.dtype.newbyteorder("<")).tobytes()
        listed.append(
            {"name": name, "type": _TYPES[values.dtype.name], "at": offset, "n": len(values)}
        )
        pad = -len(data) % 8
        blocks.append(data + b"\0" * pad)
        offset += len(data) + pad
    text = json.dumps({**header, "arrays": listed}, allow_nan=False).encode()
    text += b" " * (-(len(text) + 4) % 8)
    return len(text).to_bytes(4, "little") + text + b"".join(blocks)


def sign_payload(signs: SignTable) -> bytes:
    """All signs as the page's map needs them; a sign without a position has x NaN."""
    x, y = to_world(signs.lon_deg, signs.lat_deg)
    x[~np.isfinite(y)] = np.nan
    major, minor, azimuth = principal_axes(signs.cov_ee_m2, signs.cov_en_m2, signs.cov_nn_m2)
    scale = np.sqrt(gate(OUTSIDE_95, 2))
    header = {
        "n": len(signs),
        "ids": [_writable(text) for text in signs.ids],
        "classes": [_writable(text) for text in signs.classes],
        "statuses": [_writable(text) for text in signs.statuses],
        "drives": [_writable(text) for text in signs.drives],
    }
    with np.errstate(over="ignore"):
        # what no sign has is infinite in half of the digits
        small = {
            name: values.astype(np.float32)
            for name, values in (
                ("confidence", signs.confidence),
                ("existence", signs.existence),
                ("facing", signs.facing_deg),
                ("major", scale * major),
                ("minor", scale * minor),
                ("azimuth", azimuth),
            )
        }
    return packed(
        header,
        {
            "x": x,
            "y": y,
            "class": signs.class_index.astype(np.uint32),
            "status": signs.status_index.astype(np.uint32),
            **small,
            "drive_starts": signs.drive_starts.astype(np.uint32),
            "drive_members": signs.drive_members.astype(np.uint32),
        },
    )


def _writable(text: str) -> str:
    # lone surrogates (from odd file names) cannot be written as UTF-8
    return text.encode("utf-8", "replace").decode("utf-8")
