"""UBX NAV-PVT messages: their epochs, and writing fields anew with their check sum.

Layout: u-blox M8 receiver description, UBX-NAV-PVT (0x01 0x07).
"""

from __future__ import annotations

import math
import struct
from datetime import UTC, datetime, timedelta
from itertools import accumulate

from tests.benchmarks.faults.log import changed

_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_HEAD = 6
DOP = 1.0
"""What the stated accuracies are told to be multiplied by."""
WEEK_S = 604_800.0


def checksum(body: bytes) -> bytes:
    """Fletcher's sum over class, number, length and payload."""
    return bytes([sum(body) & 255, sum(accumulate(body)) & 255])


def valid(message: bytes) -> bool:
    """Whether a message carries its own check sum."""
    return message[:2] == b"\xb5\x62" and checksum(message[2:-2]) == message[-2:]


def split(data: bytes) -> list[bytes]:
    """Messages of a log of UBX alone."""
    messages, at = [], 0
    while at < len(data):
        length = _HEAD + int(struct.unpack_from("<H", data, at + 4)[0]) + 2
        messages.append(data[at : at + length])
        at += length
    return messages


def say(messages: list[bytes]) -> dict[str, float]:
    """What an epoch of one NAV-PVT says; times are UTC seconds since 1970."""
    get = lambda kind, at: struct.unpack_from("<" + kind, messages[0], _HEAD + at)[0]  # noqa: E731
    year, month, day, hour, minute, second = struct.unpack_from("<HBBBBB", messages[0], _HEAD + 4)
    moment = datetime(year, month, day, hour, minute, second, tzinfo=UTC)
    north, east, down = (get("i", at) * 1e-3 for at in (48, 52, 56))
    return {
        "time": (moment - _EPOCH).total_seconds() + get("i", 16) * 1e-9,
        "lat": get("i", 28) * 1e-7,
        "lon": get("i", 24) * 1e-7,
        "height": get("i", 36) * 1e-3,
        "geoid": (get("i", 32) - get("i", 36)) * 1e-3,
        "speed": math.hypot(north, east),
        "course": math.degrees(math.atan2(east, north)) % 360.0,
        "climb": -down,
        "dop": DOP,
    }


def write(messages: list[bytes], was: dict[str, float], now: dict[str, float]) -> list[bytes]:
    """The messages with the changed fields."""
    different = changed(was, now)
    return [_rewritten(m, different, was, now) for m in messages]


def _rewritten(
    message: bytes, different: set[str], was: dict[str, float], now: dict[str, float]
) -> bytes:
    data = bytearray(message)
    put = lambda kind, at, value: struct.pack_into("<" + kind, data, _HEAD + at, value)  # noqa: E731
    whole = lambda value: round(value)  # noqa: E731
    if "time" in different:
        moment = _EPOCH + timedelta(seconds=round(now["time"], 3))
        fields = moment.year, moment.month, moment.day, moment.hour, moment.minute, moment.second
        struct.pack_into("<HBBBBB", data, _HEAD + 4, *fields)
        put("i", 16, moment.microsecond * 1000)
        tow = struct.unpack_from("<I", data, _HEAD)[0] * 1e-3 + now["time"] - was["time"]
        put("I", 0, whole(tow % WEEK_S * 1e3))
    if "lat" in different:
        put("i", 28, whole(now["lat"] * 1e7))
    if "lon" in different:
        put("i", 24, whole(now["lon"] * 1e7))
    if different & {"height", "geoid"}:
        put("i", 36, whole(now["height"] * 1e3))
        put("i", 32, whole((now["height"] + now["geoid"]) * 1e3))
    if different & {"speed", "course", "climb"}:
        angle = math.radians(now["course"])
        put("i", 48, whole(now["speed"] * math.cos(angle) * 1e3))
        put("i", 52, whole(now["speed"] * math.sin(angle) * 1e3))
        put("i", 56, whole(-now["climb"] * 1e3))
        put("i", 60, whole(now["speed"] * 1e3))
        put("i", 64, whole(now["course"] * 1e5))
    if "dop" in different:
        for at in (40, 44):
            told = struct.unpack_from("<I", data, _HEAD + at)[0]
            put("I", at, whole(told * now["dop"] / was["dop"]))
    return bytes(data[:-2]) + checksum(bytes(data[2:-2]))
