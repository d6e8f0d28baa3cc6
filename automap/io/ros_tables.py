"""Columns of messages of any type, as a mapping says where they are."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from automap.errors import InputError
from automap.io.nmea_writer import sentence
from automap.io.ros_fields import nanoseconds, value_at, vector_parts
from automap.io.ros_mapping import Place, TableFields
from automap.io.table_form import ACCEL, DEFAULT_UNIT, GYRO, QUANTITIES, TableKind
from automap.io.table_units import UNITS, to_si
from automap.records import FloatArray, IntArray

if TYPE_CHECKING:
    from automap.io.rosbag import Bag

_DATED = ("RMC", "ZDA")
_UNTIMED = ("GSV", "GSA", "VTG")


def read_columns(bag: Bag, kind: TableKind, fields: TableFields) -> dict[str, Any]:
    """Column ``t_ns`` [n] and those of the mapping [n], in the units that a drive's table has
    where it says nothing.

    Raises InputError for a topic without messages, a field that is not there or is no number.
    """
    stamps: list[int] = []
    places = dict(fields.places)
    values: dict[str, list[float]] = {}
    for stamp, message in bag.messages(fields.topic):
        if not stamps:
            places = _expanded(message, fields)
            values = {role: [] for role in places if role != "t"}
        stamps.append(_stamp(message, stamp, fields))
        for role, column in values.items():
            column.append(_number(value_at(message, places[role].field, fields.topic), role))
    if not stamps:
        raise InputError(f"topic {fields.topic} holds no message; name another.")
    columns: dict[str, Any] = {"t_ns": np.array(stamps, np.int64)}
    for role, column in values.items():
        columns[role] = _in_default_unit(np.array(column, np.float64), kind, role, places[role])
    return columns


def read_imu_columns(bag: Bag, fields: TableFields) -> tuple[IntArray, FloatArray, FloatArray]:
    """Stamps [n], gyro and specific force [n, 3] in rad/s and m/s^2."""
    columns = read_columns(bag, "imu", fields)
    missing = [name for name in (*GYRO, *ACCEL) if name not in columns]
    if missing:
        raise InputError(
            f"the mapping of {fields.topic} lacks {', '.join(missing)}; add "
            f"--map imu.{missing[0]}={fields.topic}:FIELD."
        )
    gyro, accel = (np.column_stack([columns[name] for name in triad]) for triad in (GYRO, ACCEL))
    return columns["t_ns"], gyro, accel


def read_sentences(bag: Bag, fields: TableFields) -> tuple[IntArray, list[bytes], bool]:
    """Stamps [n] and the receiver's sentences of each message, and whether dates were added.

    Where no sentence tells the date, ZDA sentences with that of the stamps are put before them.
    """
    stamps: list[int] = []
    texts: list[str] = []
    for stamp, message in bag.messages(fields.topic):
        value = value_at(message, fields.places["nmea"].field, fields.topic)
        text = "".join(f"{line.strip()}\r\n" for line in str(value).splitlines() if line.strip())
        if text:
            stamps.append(_stamp(message, stamp, fields))
            texts.append(text)
    undated = not any(text[3:6] in _DATED for text in texts)
    if undated:
        texts = [_date(text, stamp) + text for text, stamp in zip(texts, stamps, strict=True)]
    return (
        np.array(stamps, np.int64),
        [text.encode("ascii", "replace") for text in texts],
        undated and bool(texts),
    )


def _date(text: str, stamp_ns: int) -> str:
    """A ZDA sentence of the time of day in ``text`` on the day that brings it next to the stamp."""
    fields = text.split(",")
    at = 5 if fields[0][3:6] == "GLL" else 1
    clock = fields[at] if len(fields) > at and fields[0][3:6] not in _UNTIMED else ""
    if len(clock) < 6 or not clock[:6].isdigit():
        return ""
    seconds = int(clock[:2]) * 3600 + int(clock[2:4]) * 60 + int(clock[4:6])
    unix_s = stamp_ns / 1e9
    day = np.datetime64(round((unix_s - seconds) / 86400.0), "D").astype(object)
    body = f"GPZDA,{clock},{day:%d,%m,%Y},00,00"
    return sentence(body).decode("ascii")


def _expanded(message: Any, fields: TableFields) -> dict[str, Place]:
    """The mapping with each vector as its three columns."""
    places = {}
    for role, place in fields.places.items():
        triad = {"gyro": GYRO, "accel": ACCEL}.get(role)
        if triad is None:
            places[role] = place
            continue
        parts = vector_parts(value_at(message, place.field, fields.topic))
        if parts is None:
            raise InputError(
                f"{fields.topic}:{place.field} is no vector of three; map "
                f"{', '.join(triad)} one by one."
            )
        for name, part in zip(triad, parts, strict=True):
            places[name] = Place(place.field + part, place.unit)
    return places


def _stamp(message: Any, stamp: int, fields: TableFields) -> int:
    """Nanoseconds of the mapped time, else of the header."""
    place = fields.places.get("t")
    if place is None:
        return stamp
    value = value_at(message, place.field, fields.topic)
    if hasattr(value, "nanosec"):
        return nanoseconds(value)
    factor = UNITS["time"][place.unit or "ns"]
    if isinstance(value, int | np.integer):
        return int(value) * int(factor)
    return round(_number(value, "t") * factor)


def _number(value: Any, role: str) -> float:
    try:
        return float(value)
    except (TypeError, ValueError):
        raise InputError(f"the field mapped as {role} is no number but {value!r:.60}.") from None


def _in_default_unit(values: FloatArray, kind: TableKind, role: str, place: Place) -> FloatArray:
    quantity = QUANTITIES[kind].get(role)
    if quantity is None or place.unit is None or place.unit == DEFAULT_UNIT[quantity]:
        return values
    return to_si(values, place.unit, quantity) / UNITS[quantity][DEFAULT_UNIT[quantity]]
