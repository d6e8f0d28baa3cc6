"""Rows of an RTKLIB solution (.pos): their epochs, and writing columns anew."""

from __future__ import annotations

import math
from datetime import UTC, datetime, timedelta

from tests.benchmarks.faults.log import changed

_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
DOP = 1.0
"""What the stated sigmas are told to be multiplied by."""
# date, time, latitude, longitude, height, Q, ns, sdn..sdun, age, ratio, vn, ve, vu, sdvn..sdvun
_LAT, _LON, _HEIGHT, _VN, _VE, _VU = 2, 3, 4, 15, 16, 17
SIGMAS = (7, 8, 9)
VELOCITY_SIGMAS = (18, 19, 20)
QUALITY = 5


def split(data: bytes) -> tuple[bytes, list[bytes]]:
    """The head, and the rows of a solution."""
    lines = data.splitlines(keepends=True)
    return lines[0], lines[1:]


def say(messages: list[bytes]) -> dict[str, float]:
    """What a row says; times are seconds since 1970 of GPS time's calendar."""
    cells = messages[0].decode().split()
    moment = datetime.strptime(f"{cells[0]} {cells[1]}", "%Y/%m/%d %H:%M:%S.%f")
    north, east, up = (float(cells[at]) for at in (_VN, _VE, _VU))
    return {
        "time": (moment.replace(tzinfo=UTC) - _EPOCH).total_seconds(),
        "lat": float(cells[_LAT]),
        "lon": float(cells[_LON]),
        "height": float(cells[_HEIGHT]),
        "geoid": math.nan,
        "speed": math.hypot(north, east),
        "course": math.degrees(math.atan2(east, north)) % 360.0,
        "climb": up,
        "dop": DOP,
    }


def write(messages: list[bytes], was: dict[str, float], now: dict[str, float]) -> list[bytes]:
    """The rows with the changed columns."""
    different = changed(was, now)
    return [_rewritten(m, different, was, now) for m in messages]


def _rewritten(
    row: bytes, different: set[str], was: dict[str, float], now: dict[str, float]
) -> bytes:
    cells = row.decode().split()
    if "time" in different:
        moment = _EPOCH + timedelta(seconds=round(now["time"], 3))
        cells[0] = f"{moment:%Y/%m/%d}"
        cells[1] = f"{moment:%H:%M:%S}.{moment.microsecond // 1000:03d}"
    # a digit more than the file has: a noised position must not stand on a grid of 1 cm
    for name, at, digits in (("lat", _LAT, 9), ("lon", _LON, 9), ("height", _HEIGHT, 4)):
        if name in different:
            cells[at] = f"{now[name]:.{digits}f}"
    if different & {"speed", "course", "climb"}:
        angle = math.radians(now["course"])
        north, east = now["speed"] * math.cos(angle), now["speed"] * math.sin(angle)
        for at, value in ((_VN, north), (_VE, east), (_VU, now["climb"])):
            cells[at] = f"{value:.5f}"
    if "dop" in different:
        for at in SIGMAS:
            cells[at] = f"{float(cells[at]) * now['dop'] / was['dop']:.4f}"
    return (" ".join(cells) + "\n").encode()


def with_sigmas(row: bytes, horizontal: float, vertical: float, velocity: float) -> bytes:
    """A row that states these sigmas (m, m, m/s), as a single solution."""
    cells = row.decode().split()
    cells[QUALITY] = "5"
    for at, value in zip(SIGMAS, (horizontal, horizontal, vertical), strict=True):
        cells[at] = f"{value:.4f}"
    for at in VELOCITY_SIGMAS:
        cells[at] = f"{velocity:.4f}"
    return (" ".join(cells) + "\n").encode()
