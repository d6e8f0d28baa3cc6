"""Which fields of messages of other types are inertial readings or positions, by their names."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

import numpy as np

from automap.io.header_names import role_named, take_apart, triad_axis
from automap.io.nmea import SENTENCES
from automap.io.ros_fields import leaves
from automap.io.ros_mapping import Place, TableFields
from automap.io.table_form import ACCEL, GYRO, QUANTITIES

if TYPE_CHECKING:
    from automap.io.rosbag import Bag

_SENTENCE = re.compile(r"\s*\$(?:[A-Z]{2}(?P<kind>[A-Z]{3})|PUBX),")
_POSITION = ("lat", "lon")
_LOOKED_AT = 5
"""Messages of a topic whose texts are looked at: a receiver may begin with empty ones."""


def guess(bag: Bag, table: str, among: set[str], known: set[str]) -> TableFields | None:
    """The topic whose fields bear the names of a table's columns ("imu", "gnss"), None for none.

    Looked at are the topics ``among`` whose types are not ``known``; of several that fit it is the
    one with most messages.
    """
    look = _inertial if table == "imu" else _positions
    for topic in sorted(among, key=lambda name: -bag.topics[name][1]):
        if bag.topics[topic][0] in known:
            continue
        places = look(_first_fields(bag, topic))
        if places:
            return TableFields(topic, places)
    return None


def _first_fields(bag: Bag, topic: str) -> dict[str, list[Any]]:
    """Path -> its values in the first messages of a topic."""
    fields: dict[str, list[Any]] = {}
    for seen, (_, message) in enumerate(bag.messages(topic)):
        if seen == _LOOKED_AT:
            break
        for path, value in leaves(message):
            fields.setdefault(path, []).append(value)
    return fields


def _inertial(fields: dict[str, list[Any]]) -> dict[str, Place]:
    """Three rates and three accelerations: of several triads the one with the fewest words."""
    triads: dict[tuple[str, str, tuple[str, ...]], dict[int, str]] = {}
    for path in fields:
        parent, _, last = path.rpartition(".")
        named = f"{parent}.{'xyz'[int(last)]}" if last in ("0", "1", "2") else path
        axis = triad_axis(take_apart(named.replace(".", " ")))
        if axis is not None:
            letter, number, stem = axis
            triads.setdefault((letter, parent, stem), {})[number] = path
    places: dict[str, Place] = {}
    for letter, vector, columns in (("g", "gyro", GYRO), ("a", "accel", ACCEL)):
        whole = [(key, axes) for key, axes in triads.items() if key[0] == letter and len(axes) == 3]
        if not whole:
            return {}
        (_, parent, stem), axes = min(whole, key=lambda item: (len(item[0][2]), item[0]))
        quantity = QUANTITIES["imu"][columns[0]]
        assert quantity is not None
        unit = take_apart(" ".join(stem)).unit(quantity)
        if all(axes[i] in (f"{parent}.{'xyz'[i]}", f"{parent}.{i}") for i in range(3)):
            places[vector] = Place(parent, unit)
        else:
            places |= {column: Place(axes[i], unit) for i, column in enumerate(columns)}
    return places


def _has_place(text: str) -> bool:
    """Whether a text is a sentence that a position may be in, which an IMU's are not."""
    sentence = _SENTENCE.match(text)
    return sentence is not None and sentence["kind"] in (None, *SENTENCES)


def _positions(fields: dict[str, list[Any]]) -> dict[str, Place]:
    """A receiver's sentences, else latitude and longitude with what else is there."""
    for path, values in fields.items():
        if any(isinstance(value, str) and _has_place(value) for value in values):
            return {"nmea": Place(path)}
    places: dict[str, Place] = {}
    least: dict[str, tuple[int, int]] = {}
    for path, values in fields.items():
        if not isinstance(values[0], int | float | np.number) or isinstance(values[0], bool):
            continue
        name = take_apart(path.replace(".", " "))
        role, worse = role_named(name, "gnss") or (None, (0, 0))
        if role is None or (role in least and worse >= least[role]):
            continue
        quantity = QUANTITIES["gnss"].get(role)
        unit = name.unit(quantity) if quantity is not None else None
        if unit is None and role in _POSITION and isinstance(values[0], int | np.integer):
            unit = "1e-7 deg"
        least[role], places[role] = worse, Place(path, unit)
    return places if all(role in places for role in _POSITION) else {}
