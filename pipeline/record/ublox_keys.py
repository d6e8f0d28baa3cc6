"""Numbers of u-blox messages and configuration keys, and how keys are packed.

Reference: u-blox F9 HPG 1.32 interface description (UBX-22008968), 3.10 and 5.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator

MON_VER, ACK, NAK = 0x0A04, 0x0501, 0x0500
CFG_PRT, CFG_MSG, CFG_RATE = 0x0600, 0x0601, 0x0608
CFG_VALSET, CFG_VALGET = 0x068A, 0x068B
NAV_PVT, NAV_SOL, NAV_POSLLH, NAV_VELNED, NAV_TIMEGPS = 0x0107, 0x0106, 0x0102, 0x0112, 0x0120
NAV_DOP = 0x0104
RXM_RAWX, RXM_SFRBX, RXM_RAW, RXM_SFRB = 0x0215, 0x0213, 0x0210, 0x0211

KEY_RATE_MEAS, KEY_RATE_NAV = 0x30210001, 0x30210002
MSGOUT = {NAV_PVT: 0x20910006, RXM_RAWX: 0x209102A4, RXM_SFRBX: 0x20910231}
"""Keys of a message's output rate on I2C; those of the other ports follow by number."""
PORTS = {"UART1": 1, "UART2": 2, "USB": 3}
BAUD_KEYS = {"UART1": 0x40520001, "UART2": 0x40530001}
UBX_OUT = {"UART1": 0x10740001, "UART2": 0x10760001, "USB": 0x10780001}
RAM = 0
_WIDTH = {1: "<B", 2: "<B", 3: "<H", 4: "<I", 5: "<Q"}


def valset_payload(values: dict[int, int]) -> bytes:
    """Payload of UBX-CFG-VALSET for the working memory."""
    parts = [struct.pack("<BBH", 0, 1 << RAM, 0)]
    parts += [struct.pack("<I", key) + struct.pack(width(key), v) for key, v in values.items()]
    return b"".join(parts)


def width(key: int) -> str:
    """How the value of a key is packed; its size stands in bits 28 to 30."""
    return _WIDTH[key >> 28 & 7]


def key_values(data: bytes) -> Iterator[tuple[int, int]]:
    at = 0
    while at + 4 < len(data):
        key = int(struct.unpack_from("<I", data, at)[0])
        form = _WIDTH.get(key >> 28 & 7)
        if form is None or at + 4 + struct.calcsize(form) > len(data):
            return
        yield key, int(struct.unpack_from(form, data, at + 4)[0])
        at += 4 + struct.calcsize(form)
