"""NMEA sentences: their epochs, and writing fields anew with the check sum that belongs to them."""

from __future__ import annotations

import re
from datetime import UTC, datetime, timedelta
from functools import reduce
from operator import xor

import numpy as np

from tests.benchmarks.faults.log import changed

KNOT = 1852.0 / 3600.0
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_SENTENCE = re.compile(rb"\$[^\r\n]*\r?\n")


def checksum(body: str) -> str:
    """XOR of the characters between $ and *, two hexadecimal digits."""
    return f"{reduce(xor, body.encode(), 0):02X}"


def valid(sentence: bytes) -> bool:
    """Whether a sentence carries its own check sum."""
    body, _, told = sentence.decode().strip()[1:].partition("*")
    return checksum(body) == told


def split(data: bytes) -> list[bytes]:
    """Sentences of a log, line ends included."""
    return _SENTENCE.findall(data)


def epochs(sentences: list[bytes]) -> list[list[bytes]]:
    """Sentences that carry the same time of day, in the order of the log."""
    groups: list[list[bytes]] = []
    last = ""
    for sentence in sentences:
        time = _cells(sentence)[1]
        if time != last:
            groups.append([])
            last = time
        groups[-1].append(sentence)
    return groups


def say(messages: list[bytes]) -> dict[str, float]:
    """What an epoch with a GGA and an RMC says; times are UTC seconds since 1970."""
    by_kind = {_cells(m)[0][-3:]: _cells(m) for m in messages}
    rmc, gga = by_kind["RMC"], by_kind["GGA"]
    day = datetime.strptime(rmc[9], "%d%m%y").replace(tzinfo=UTC)
    clock = rmc[1]
    second = int(clock[:2]) * 3600 + int(clock[2:4]) * 60 + float(clock[4:])
    return {
        "time": (day - _EPOCH).total_seconds() + second,
        "lat": _degrees(gga[2], gga[3]),
        "lon": _degrees(gga[4], gga[5]),
        "height": float(gga[9]),
        "geoid": float(gga[11]),
        "speed": float(rmc[7]) * KNOT,
        "course": float(rmc[8]) if rmc[8] else np.nan,
        "climb": np.nan,
        "dop": float(gga[8]),
    }


def write(messages: list[bytes], was: dict[str, float], now: dict[str, float]) -> list[bytes]:
    """The sentences with the changed fields in the digits of the old ones."""
    different = changed(was, now)
    return [_rewritten(m, different, now) for m in messages]


def _rewritten(sentence: bytes, different: set[str], now: dict[str, float]) -> bytes:
    body, _, rest = sentence.decode()[1:].partition("*")
    cells, end = body.split(","), rest[2:]
    kind = cells[0][-3:]
    if "time" in different:
        _put_time(cells, kind, now["time"])
    at = {"RMC": 3, "GGA": 2}.get(kind)
    if at is not None:
        if "lat" in different:
            cells[at], cells[at + 1] = _angle(now["lat"], "NS", cells[at])
        if "lon" in different:
            cells[at + 2], cells[at + 3] = _angle(now["lon"], "EW", cells[at + 2])
    places = {"GGA": {"dop": 8, "height": 9, "geoid": 11}, "RMC": {"speed": 7, "course": 8}}
    for name, cell in places.get(kind, {}).items():
        if name in different:
            value = now[name] / KNOT if name == "speed" else now[name]
            cells[cell] = _number(value, cells[cell])
    text = ",".join(cells)
    return f"${text}*{checksum(text)}{end}".encode()


def _cells(sentence: bytes) -> list[str]:
    return sentence.decode().strip()[1:].partition("*")[0].split(",")


def _degrees(text: str, side: str) -> float:
    point = text.index(".")
    value = float(text[: point - 2]) + float(text[point - 2 :]) / 60.0
    return -value if side in "SW" else value


def _digits(like: str) -> int:
    return len(like.partition(".")[2])


def _number(value: float, like: str) -> str:
    if not like:
        return f"{value:.1f}"
    # some receivers write leading zeros
    width = len(like) if like[0] == "0" and like[1:2].isdigit() else 0
    return f"{value:0{width}.{_digits(like)}f}"


def _angle(degrees: float, sides: str, like: str) -> tuple[str, str]:
    digits = _digits(like)
    minutes = round(abs(degrees) * 60.0, digits)
    whole, part = divmod(minutes, 60.0)
    width = 2 if sides == "NS" else 3
    part_text = f"{part:0{3 + digits}.{digits}f}"
    return f"{int(whole):0{width}d}{part_text}", sides[0] if degrees >= 0 else sides[1]


def _put_time(cells: list[str], kind: str, time: float) -> None:
    digits = _digits(cells[1])
    moment = _EPOCH + timedelta(seconds=round(time, digits))
    second = moment.second + moment.microsecond * 1e-6
    cells[1] = f"{moment:%H%M}{second:0{3 + digits}.{digits}f}"
    if kind == "RMC":
        cells[9] = f"{moment:%d%m%y}"
    if kind == "ZDA":
        cells[2:5] = [f"{moment:%d}", f"{moment:%m}", f"{moment:%Y}"]
