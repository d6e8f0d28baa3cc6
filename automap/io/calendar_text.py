"""Dates and times of day as people and loggers write them, by pattern."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Sequence
from functools import cache

import numpy as np

from automap.records import BoolArray, IntArray
from automap.timebase import DAY_S, UNIX_OF_GPS_EPOCH, days_since_epoch

_DATES = ("%Y-%m-%d", "%Y/%m/%d", "%Y.%m.%d", "%d.%m.%Y", "%d/%m/%Y", "%m/%d/%Y", "%d-%m-%Y",
          "%d.%m.%y", "%d/%m/%y", "%m/%d/%y", "%Y%m%d", "%d%m%y", "%y%m%d", "%d-%b-%Y", "%d %b %Y",
          "%d. %b %Y", "%b %d, %Y", "%b %d %Y", "%d-%b-%y")  # fmt: skip
_TIMES = ("%H:%M:%S", "%I:%M:%S %p", "%H-%M-%S", "%H.%M.%S", "%H:%M", "%H%M%S", "%H%M%S%f")
_AMBIGUOUS = {
    "%d/%m/%Y": "%m/%d/%Y",
    "%d/%m/%y": "%m/%d/%y",
    "%d-%m-%Y": "%m-%d-%Y",
    "%d%m%y": "%y%m%d",
}
ISO = "iso"
_MONTHS = {
    name: number
    for number, names in enumerate(
        ("jan ene gen", "feb fev", "mar mrt", "apr abr avr", "may mai mag mei", "jun giu juin",
         "jul lug juil", "aug ago aou", "sep set", "oct okt ott out", "nov", "dec dez dic"),
        start=1,
    )
    for name in names.split()
}  # fmt: skip
"""The beginnings of the months' names in English, German, French, Spanish, Italian, Portuguese and
Dutch, without accents."""
_PARTS = {
    "Y": r"(?P<Y>\d{4})",
    "y": r"(?P<y>\d{2})",
    "m": r"(?P<m>0?[1-9]|1[0-2])",
    "d": r"(?P<d>0?[1-9]|[12]\d|3[01])",
    "H": r"(?P<H>2[0-3]|[01]?\d)",
    "I": r"(?P<H>1[0-2]|0?\d)",
    "M": r"(?P<M>[0-5]?\d)",
    "S": r"(?P<S>[0-5]?\d|60)",
    "f": r"(?P<f>\d{1,9})",
    "p": r"(?P<p>[AaPp])\.?[Mm]\.?",
    "b": r"(?P<b>[^\W\d_]{3,12})\.?",
    "j": r"(?P<j>\d{1,3})",
    "z": r"(?P<z>Z|UTC|GMT|[+-]\d{2}:?\d{2})",
    "%": "%",
}
_TWO = {"m": r"(?P<m>0[1-9]|1[0-2])", "d": r"(?P<d>0[1-9]|[12]\d|3[01])",
        "H": r"(?P<H>2[0-3]|[01]\d)", "M": r"(?P<M>[0-5]\d)",
        "S": r"(?P<S>[0-5]\d|60)"}  # fmt: skip


@cache
def _compiled(pattern: str) -> re.Pattern[str]:
    """A pattern as a regular expression; seconds may have a fraction, the end a zone."""
    if pattern == ISO:
        pattern = "%Y-%m-%d %H:%M:%S"
    text, at, glued = "", 0, False
    while at < len(pattern):
        letter = pattern[at]
        if letter == "%" and pattern[at + 1 : at + 2] in _PARTS:
            code = pattern[at + 1]
            following = pattern[at + 2 : at + 3] == "%"
            text += _TWO[code] if (glued or following) and code in _TWO else _PARTS[code]
            glued = True
            at += 2
            continue
        glued = False
        text += r"(?:\s+|T)" if letter in " T" else re.escape(letter)
        at += 1
    if "f" not in re.findall(r"\?P<(\w)>", text):
        text = re.sub(r"(\(\?P<S>[^)]*\))", r"\1(?:[.,:](?P<f>\\d{1,9}))?", text)
    if "(?P<z>" in text:
        text = text.replace("(?P<z>", r"\s*(?P<z>", 1)
    elif "(?P<d>" in text and "(?P<H>" in text:
        text += r"\s*(?P<z>Z|UTC|GMT|[+-]\d{2}:?\d{2})?"
    return re.compile(rf"\s*{text}\s*$")


def pattern_of(cells: Sequence[str], share: float = 0.8) -> str | None:
    """The pattern that most of some cells follow: a date, a time of day or both; None for none."""
    filled = [cell for cell in cells if cell]
    if not filled:
        return None
    found = _first_pattern(filled, share)
    if found is not None and has_date(found) and has_time(found):
        zoned = _compiled(f"{found}%z").match
        if all(zoned(cell) is not None for cell in filled):
            return f"{found}%z"
    return found


def _first_pattern(filled: Sequence[str], share: float) -> str | None:
    both = (f"{date} {time}" for date in _DATES for time in _TIMES)
    best = None
    for pattern in (*both, *_DATES, *_TIMES):
        match = _compiled(pattern).match
        fits = sum(match(cell) is not None for cell in filled)
        if fits == len(filled):
            return pattern
        if best is None and fits >= share * len(filled):
            best = pattern
    return best


def other_reading(pattern: str) -> str | None:
    """A pattern that the same cells may follow as well, day and month or year exchanged."""
    date, _, rest = pattern.partition(" ")
    other = _AMBIGUOUS.get(date)
    return None if other is None else f"{other} {rest}".strip()


def has_date(pattern: str) -> bool:
    """Whether a pattern tells the day."""
    return pattern == ISO or bool({"d", "j"} & set(_compiled(pattern).groupindex))


def has_time(pattern: str) -> bool:
    """Whether a pattern tells the time of day."""
    return pattern == ISO or "H" in _compiled(pattern).groupindex


def filled_up(cell: str, of_day: bool) -> str:
    """A compact date or time of day with the leading zeros that a spreadsheet took off it."""
    digits, point, rest = cell.partition(".")
    if not digits.isdigit() or (point and not (of_day and rest.isdigit() and len(digits) > 2)):
        return cell
    width = (9 if len(digits) > 6 else 6) if of_day else (8 if len(digits) > 6 else 6)
    return digits.zfill(width) + point + rest


def parse_stamps(
    cells: Sequence[str], pattern: str, utc_offset_h: float
) -> tuple[IntArray, BoolArray]:
    """Nanoseconds since 1970 [n], UTC, of cells [n], and which of them could be read.

    Without a date they count from midnight and run on over the next; a zone in the cell takes
    the place of the offset.
    """
    match = _compiled(pattern).match
    names = _compiled(pattern).groupindex
    n = len(cells)
    good = np.zeros(n, bool)
    part = {key: np.zeros(n, np.int64) for key in ("year", "month", "day", "second", "ns", "zone")}
    part["zone"] += round(utc_offset_h * 3600.0)
    for row, cell in enumerate(cells):
        found = match(cell)
        if found is None:
            continue
        good[row] = True
        of = found.groupdict()
        if "Y" in names or "y" in names:
            part["year"][row] = int(of["Y"]) if "Y" in names else 2000 + int(of["y"])
        if "m" in names:
            part["month"][row] = int(of["m"])
        elif "b" in names:
            month = _month(of["b"])
            good[row] = month > 0
            part["month"][row] = max(month, 1)
        else:
            part["month"][row] = 1
        part["day"][row] = int(of.get("d") or of.get("j") or 1)
        hour = int(of.get("H") or 0)
        if "p" in names:
            hour = hour % 12 + (12 if of["p"] in "Pp" else 0)
        part["second"][row] = hour * 3600 + int(of.get("M") or 0) * 60 + int(of.get("S") or 0)
        part["ns"][row] = int((of.get("f") or "0").ljust(9, "0"))
        zone = of.get("z")
        if zone:
            part["zone"][row] = _zone_s(zone)
    seconds = part["second"] - part["zone"]
    if has_date(pattern):
        days = days_since_epoch(part["year"], part["month"], part["day"])
        seconds = seconds + days * DAY_S + UNIX_OF_GPS_EPOCH
    else:
        known = np.flatnonzero(good)
        back = np.diff(seconds[known], prepend=seconds[known][:1]) < -DAY_S // 2
        seconds[known] += DAY_S * np.cumsum(back)
    return seconds * 1_000_000_000 + part["ns"], good


def _month(name: str) -> int:
    """The number of a month by the beginning of its name, 0 for none."""
    bare = unicodedata.normalize("NFKD", name.lower())
    plain = "".join(c for c in bare if not unicodedata.combining(c))
    return _MONTHS.get(plain[:4]) or _MONTHS.get(plain[:3], 0)


def _zone_s(zone: str) -> int:
    if zone[0] not in "+-":
        return 0
    size = int(zone[1:3]) * 3600 + int(zone[-2:]) * 60
    return -size if zone[0] == "-" else size
