"""Checksums of inertial sensors' lines and frames."""

from __future__ import annotations

import zlib
from collections.abc import Callable

from pipeline.record.messages import fletcher


def _xor8(data: bytes) -> int:
    value = 0
    for byte in data:
        value ^= byte
    return value


def _crc16(data: bytes, start: int) -> int:
    """CRC of polynomial x^16 + x^12 + x^5 + 1, high bit first."""
    crc = start
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ 0x1021) & 0xFFFF if crc & 0x8000 else crc << 1 & 0xFFFF
    return crc


def _crc16_modbus(data: bytes) -> int:
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ 0xA001 if crc & 1 else crc >> 1
    return crc


CHECKSUMS: dict[str, tuple[int, Callable[[bytes], int]]] = {
    "sum8": (1, lambda data: sum(data) & 0xFF),
    "negative-sum8": (1, lambda data: -sum(data) & 0xFF),
    "xor8": (1, _xor8),
    "sum16": (2, lambda data: sum(data) & 0xFFFF),
    "fletcher8": (2, lambda data: int.from_bytes(fletcher(data), "little")),
    "crc16-ccitt": (2, lambda data: _crc16(data, 0xFFFF)),
    "crc16-xmodem": (2, lambda data: _crc16(data, 0)),
    "crc16-modbus": (2, _crc16_modbus),
    "crc32": (4, lambda data: zlib.crc32(data) & 0xFFFFFFFF),
}
"""By name: bytes that it takes, and its value over bytes.

``fletcher8`` is that of RFC 1145 as UBX has it, ``crc16-ccitt`` starts at 0xFFFF and
``crc16-xmodem`` at 0, ``crc32`` is that of zip and Ethernet.
"""
