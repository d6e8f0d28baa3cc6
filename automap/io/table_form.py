"""What a manifest says of a table: which column is what, how it is separated, its times, units."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from automap.io.table_units import UNITS, Quantity, unit_named

TableKind = Literal["imu", "gnss", "odometer", "arrival"]

TIME_ROLES = ("t", "t_ns", "t_us", "t_ms", "t_s", "date", "time_of_day", "week", "tow")
"""What a column of times may be: a count since anything (its unit in the name, or guessed), a date
and a time of day that belong together, GPS week and time of week."""

GYRO, ACCEL = ("gx", "gy", "gz"), ("ax", "ay", "az")

QUANTITIES: dict[TableKind, dict[str, Quantity | None]] = {
    "imu": {**dict.fromkeys(GYRO, "rate"), **dict.fromkeys(ACCEL, "acceleration"),
            "temp_c": "temperature"},
    "gnss": {
        "lat": "angle", "ns": None, "lon": "angle", "ew": None, "height": "length", "msl": "length",
        "geoid_sep": "length", "h_acc": "length", "v_acc": "length", "sd_n": "length",
        "sd_e": "length", "sd_d": "length", "speed": "speed", "course": "angle", "vn": "speed",
        "ve": "speed", "vd": "speed", "vu": "speed", "speed_acc": "speed",
        "course_acc": "angle", "quality": None, "n_sats": None, "hdop": None, "arrival": "time",
    },
    "odometer": {"speed": "speed"},
    "arrival": {"offset": None},
}  # fmt: skip
"""Our names of a table's columns, and what each measures; times apart. ``ns`` and ``ew`` hold the
letters of the hemispheres where latitude and longitude have no signs."""

HEMISPHERES = {"ns": ("lat", "NS"), "ew": ("lon", "EW")}
"""Columns of letters -> the angle whose sign they are, and the letters."""

DEFAULT_UNIT: dict[Quantity, str] = {
    "rate": "rad/s",
    "acceleration": "m/s^2",
    "speed": "m/s",
    "length": "m",
    "angle": "deg",
    "temperature": "degC",
    "time": "ns",
}
"""What a column is in when neither the manifest nor its own name says."""

TIME_FORMATS = (
    *("ns", "us", "ms", "s"),
    *("unix_ns", "unix_us", "unix_ms", "unix_s"),
    *("gps_ns", "gps_us", "gps_ms", "gps_s"),
    *("iso", "excel"),
)
"""Counts since anything, since 1970 (UTC) or since 1980-01-06 (GPS time); ISO 8601; a spreadsheet's
days since 1899-12-30. Any other
format is a pattern such as ``%d.%m.%Y %H:%M:%S.%f``, applied to date and time of day together
where those are two columns."""

Separator = Literal[",", ";", "\t", "|", " "]


@dataclass(frozen=True)
class TableForm:
    """How a table is to be read; what is None or absent is guessed from the file.

    ``columns`` our name -> its name in the file, or its number counted from 1. ``units`` our
    name -> unit. ``utc_offset_h`` hours by which dates and times of day are ahead of UTC.
    """

    columns: Mapping[str, str | int] = field(default_factory=dict)
    separator: Separator | None = None
    decimal: Literal[".", ","] | None = None
    time_format: str | None = None
    units: Mapping[str, str] = field(default_factory=dict)
    utc_offset_h: float = 0.0


def roles(kind: TableKind) -> tuple[str, ...]:
    """The names that ``columns`` may give in a table of a kind."""
    return (*TIME_ROLES, *QUANTITIES[kind])


def checked_columns(columns: Mapping[str, str | int], kind: TableKind) -> dict[str, str | int]:
    """The columns as they are; ValueError names one that a table of the kind does not have."""
    known = roles(kind)
    for role, place in columns.items():
        if role not in known:
            near = difflib.get_close_matches(role, known, n=1, cutoff=0.5)
            advice = f"did you mean {near[0]}?" if near else f"known are {', '.join(known)}"
            raise ValueError(f"there is no column {role}; {advice}")
        if isinstance(place, int) and place < 1:
            raise ValueError(f"the number of column {role} is {place}; they count from 1")
        if place == "":
            raise ValueError(f"the name of column {role} is empty; give the file's own name of it")
    return dict(columns)


def checked_units(units: Mapping[str, str], kind: TableKind) -> dict[str, str]:
    """The units by our names of them; ValueError for one that the column cannot be in."""
    checked = {}
    for role, unit in units.items():
        if role in GYRO + ACCEL:
            key = "gyro_unit" if role in GYRO else "accel_unit"
            raise ValueError(f"the unit of {role} is that of its triad; write {key} = {unit!r}")
        quantity = QUANTITIES[kind].get(role)
        if quantity is None:
            measured = [name for name, known in QUANTITIES[kind].items() if known is not None]
            raise ValueError(f"{role} has no unit; those that have are {', '.join(measured)}")
        found = unit_named(unit, quantity)
        if found is None:
            raise ValueError(
                f"{unit!r} is no unit of {role}; known are {', '.join(UNITS[quantity])}"
            )
        checked[role] = found
    return checked


def checked_time_format(text: str) -> str:
    """A time format as it is; ValueError when it is none."""
    if text not in TIME_FORMATS and "%" not in text:
        raise ValueError(
            f"{text!r} is no time format; known are {', '.join(TIME_FORMATS)} and patterns such "
            "as '%d.%m.%Y %H:%M:%S.%f'"
        )
    return text
