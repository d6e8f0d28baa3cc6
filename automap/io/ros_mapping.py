"""Which field of which topic is which column of a drive's tables.

Said as ``imu.gyro=/imu:imu.angular_velocity``, with a unit as ``imu.gx=/imu:rate.x[deg/s]``, or in
a TOML file with the sections ``[imu]`` and ``[gnss]``, each with its ``topic``.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from automap.errors import ConfigError
from automap.io.table_form import ACCEL, GYRO, QUANTITIES, TableKind
from automap.io.table_units import unit_named
from automap.io.toml_file import read_toml

_OPTION = re.compile(r"(?P<table>\w+)\.(?P<role>\w+)=(?P<topic>[^:]*):(?P<field>[\w.]+)"
                     r"(?:\[(?P<unit>[^\]]*)\])?")  # fmt: skip
_TRIADS = {"gyro": GYRO, "accel": ACCEL}
_TABLES: tuple[TableKind, ...] = ("imu", "gnss")
EXAMPLE = "--map imu.gyro=/imu:angular_velocity"


@dataclass(frozen=True)
class Place:
    """A field of a topic by its path, and its unit where it is known."""

    field: str
    unit: str | None = None


@dataclass(frozen=True)
class TableFields:
    """Where the columns of one table are: ``places`` our name -> field, all of one topic.

    Our names are those of a table in ``drive.toml``; a vector's three are ``gyro`` or ``accel``,
    receiver sentences are ``nmea``, and ``t`` is the time where it is not the header's.
    """

    topic: str
    places: Mapping[str, Place]

    def __contains__(self, role: str) -> bool:
        return role in self.places


Mapped = dict[str, TableFields]


def roles(table: TableKind) -> tuple[str, ...]:
    """Names that a mapping may give for a table."""
    more = tuple(_TRIADS) if table == "imu" else ("nmea",)
    return (*more, *QUANTITIES[table], "t")


def read_options(options: Iterable[str]) -> Mapped:
    """The mapping that ``--map`` options give; ConfigError says what is wrong with one."""
    said: dict[str, list[tuple[str, str, str, str | None]]] = {}
    for text in options:
        parts = _OPTION.fullmatch(text.strip())
        if parts is None:
            raise ConfigError(f"--map {text}: write TABLE.COLUMN=TOPIC:FIELD, such as {EXAMPLE}.")
        said.setdefault(parts["table"], []).append(
            (parts["role"], parts["topic"], parts["field"], parts["unit"])
        )
    mapped = {}
    for table, entries in said.items():
        topics = list(dict.fromkeys(topic for _, topic, _, _ in entries))
        if len(topics) > 1:
            raise ConfigError(
                f"--map: {table} is taken from {' and '.join(topics)}; its fields must be of one "
                "topic."
            )
        values = {role: field + (f"[{unit}]" if unit else "") for role, _, field, unit in entries}
        mapped[table] = _checked("--map", table, topics[0], values)
    return mapped


def read_map_file(path: Path) -> Mapped:
    """The mapping of a TOML file; ConfigError with the file and the place for what is wrong."""
    mapped = {}
    for table, section in read_toml(path, "map file").items():
        if not isinstance(section, dict) or not isinstance(section.get("topic"), str):
            raise ConfigError(f'{path}: [{table}] has no topic; add topic = "/name".')
        values = {role: value for role, value in section.items() if role != "topic"}
        mapped[table] = _checked(str(path), table, section["topic"], values)
    return mapped


def _checked(where: str, table: str, topic: str, values: Mapping[str, Any]) -> TableFields:
    kind = next((known for known in _TABLES if known == table), None)
    if kind is None:
        raise ConfigError(f"{where}: there is no table {table}; known are {', '.join(_TABLES)}.")
    places = {}
    for role, value in values.items():
        known = roles(kind)
        if role not in known:
            near = difflib.get_close_matches(role, known, n=1, cutoff=0.5)
            advice = f"did you mean {near[0]}?" if near else f"known are {', '.join(known)}."
            raise ConfigError(f"{where}: {table} has no column {role}; {advice}")
        text = value if isinstance(value, str) else ""
        parts = re.fullmatch(r"([\w.]+)(?:\[([^\]]*)\])?", text.strip())
        if parts is None:
            raise ConfigError(
                f'{where}: {table}.{role} is {value!r}; write a field, such as "angular_velocity" '
                'or "rate[deg/s]".'
            )
        places[role] = Place(parts[1], _unit(where, kind, role, parts[2]))
    return TableFields(topic, places)


def _unit(where: str, table: TableKind, role: str, text: str | None) -> str | None:
    if text is None:
        return None
    column = _TRIADS[role][0] if role in _TRIADS else role
    quantity = "time" if role == "t" else QUANTITIES[table].get(column)
    unit = None if quantity is None else unit_named(text, quantity)
    if unit is None:
        raise ConfigError(f"{where}: {text!r} is no unit of {table}.{role}; correct it.")
    return unit


def as_option(table: str, fields: TableFields) -> str:
    """The mapping of a table as the options that would say the same."""
    return " ".join(
        f"--map {table}.{role}={fields.topic}:{place.field}"
        + (f"[{place.unit}]" if place.unit else "")
        for role, place in fields.places.items()
    )
