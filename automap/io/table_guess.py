"""Which column of a table is what: as the manifest says, else by the names in its header."""

from __future__ import annotations

import difflib
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from time import time as now

import numpy as np

from automap.errors import ConfigError, InputError
from automap.io.angle_text import SPELLED_OUT, are_signs, is_spelled_out
from automap.io.calendar_text import filled_up, other_reading, parse_stamps
from automap.io.csv_columns import listed
from automap.io.csv_layout import Layout
from automap.io.csv_numbers import NULLS
from automap.io.header_names import HeaderName, meaning, role_named, take_apart, triad_axis
from automap.io.table_form import (
    ACCEL,
    DEFAULT_UNIT,
    GYRO,
    HEMISPHERES,
    QUANTITIES,
    TIME_ROLES,
    TableForm,
    TableKind,
)
from automap.io.table_time_guess import (
    likeliest_times,
    refuse_other_unit,
    stated_time,
    told_apart,
)
from automap.io.table_times import TimeForm, guessed_form, numbers_of
from automap.io.table_units import UNITS
from automap.timebase import gps_to_unix

_NUMERIC = re.compile(r"[-+]?[\d.,]*\d[\d.,]*([eE][-+]?\d+)?")

_SINCE_1970 = re.compile("unix|utc|posix|epoch")
_MINUTES = {"min", "mins", "minute", "minutes", "minuten", "minuti", "minutos", "minuut"}

NEEDED: dict[TableKind, tuple[str, ...]] = {
    "imu": (*GYRO, *ACCEL),
    "gnss": ("lat", "lon"),
    "odometer": ("speed",),
    "arrival": ("offset",),
}


DATES_DOUBT = 'the dates could be "{}" as well; write time_format if so'
"""Of dates whose day and month may be either, with the other pattern."""


@dataclass(frozen=True)
class TableGuess:
    """How a table is read: ``places`` of our columns, counted from 0; ``units`` of those that
    have one (of gyro and accelerometer only where the table tells it), of which nothing tells
    the ``assumed``; ``time`` None where there are no times. ``notes`` say what was guessed, the
    ``doubts`` what may well be otherwise; ``form`` writes all of it as a manifest would.
    """

    kind: TableKind
    places: Mapping[str, int]
    units: Mapping[str, str]
    time: TimeForm | None
    notes: tuple[str, ...]
    form: TableForm
    assumed: frozenset[str] = frozenset()
    doubts: tuple[str, ...] = ()


def guess_table(
    layout: Layout, kind: TableKind, form: TableForm, needed: tuple[str, ...] | None = None
) -> TableGuess:
    """Find the columns of a table, of which ``needed`` (those of its kind) must be there.

    Raises InputError, which says what to write into the manifest, where one that is needed is
    not found, and ConfigError where the manifest names one that the file does not have.
    """
    names = told_apart(layout, tuple(take_apart(name) for name in layout.names))
    stated = {role: _place(layout, names, role, place) for role, place in form.columns.items()}
    places = {role: at for role, at in stated.items() if role not in TIME_ROLES}
    if kind == "gnss":
        places |= {k: v for k, v in _hemispheres(layout, places).items() if k not in places}
    places |= {k: v for k, v in _by_name(layout, names, kind, places).items() if k not in places}
    if kind == "imu":
        places |= {k: v for k, v in _triads(names).items() if k not in places}
    if kind == "gnss" and not form.columns:
        _refuse_parted(layout, names)
    missing = [role for role in needed or NEEDED[kind] if role not in places]
    if missing:
        raise InputError(_not_found(layout, kind, missing))
    times = {role: at for role, at in stated.items() if role in TIME_ROLES}
    time, notes = None, []
    if times:
        time = stated_time(layout, names, kind, form, times)
    else:
        found = likeliest_times(layout, names, kind, form, places)
        if found is not None:
            times, time = found
    if time is not None:
        refuse_other_unit(layout, kind, form, time, times)
    places = {role: at for role, at in places.items() if at not in times.values()} | times
    told = _units(names, layout, kind, form, places)
    units = {
        role: told.get(role) or DEFAULT_UNIT[quantity]
        for role, quantity in QUANTITIES[kind].items()
        if role in places and quantity is not None and (role in told or role not in GYRO + ACCEL)
    }
    assumed = frozenset(units) - frozenset(told)
    guess = TableGuess(kind, places, units, time, (), form, assumed)
    notes += _notes(layout, guess, stated)
    doubts = _doubts(layout, guess)
    notes += [f"{layout.path}: {doubt}" for doubt in doubts]
    return replace(
        guess, notes=tuple(notes), form=_written(layout, guess, form), doubts=tuple(doubts)
    )


def _place(layout: Layout, names: tuple[HeaderName, ...], role: str, place: str | int) -> int:
    """Where a column is that the manifest names."""
    if isinstance(place, int):
        if place > len(layout.names):
            raise ConfigError(
                f"{layout.path} has {len(layout.names)} columns, and columns.{role} = {place} in "
                "drive.toml is beyond them; correct the number."
            )
        return place - 1
    plain, words = place.strip().lower(), take_apart(place).words
    for found in (
        [at for at, name in enumerate(names) if name.text == place],
        [at for at, name in enumerate(names) if name.text.strip().lower() == plain],
        [at for at, name in enumerate(names) if name.words == words],
    ):
        if found:
            return found[0]
    near = difflib.get_close_matches(place, [n for n in layout.names if n][:1000], n=1, cutoff=0.5)
    advice = f"did you mean {near[0]!r}?" if near else f"found are {listed(layout.names)}."
    raise ConfigError(
        f"{layout.path}: line {layout.header_line} names no column {place!r}, which drive.toml "
        f"gives for {role}; {advice}"
    )


def _by_name(
    layout: Layout, names: tuple[HeaderName, ...], kind: TableKind, stated: Mapping[str, int]
) -> dict[str, int]:
    """Columns by the ideas in their names; the one with the fewest words beside them wins. One of
    words, as a fix called "RTK" or satellites "9 / 12", is none."""
    best: dict[str, tuple[tuple[int, int], int]] = {}
    for at, name in enumerate(names):
        found = role_named(name, kind)
        if found is not None and at not in stated.values():
            role, worse = found
            if role not in NEEDED[kind] and not _are_numbers(layout, at):
                continue
            best[role] = min(best.get(role, (worse, at)), (worse, at))
    return {role: at for role, (_, at) in best.items()}


def _are_numbers(layout: Layout, at: int) -> bool:
    """Whether most cells of a column that are not empty may be numbers."""
    filled = [row[at] for row in layout.sample if row[at] not in NULLS]
    return 2 * sum(map(bool, map(_NUMERIC.fullmatch, filled))) >= len(filled)


def _hemispheres(layout: Layout, stated: Mapping[str, int]) -> dict[str, int]:
    """The columns in which nothing but letters of hemispheres stands, whatever their names."""
    found: dict[str, int] = {}
    for at in range(len(layout.names)):
        cells = [row[at] for row in layout.sample]
        for role, (_, letters) in HEMISPHERES.items():
            if at not in stated.values() and role not in found and are_signs(cells, letters):
                found[role] = at
    return found


def _triads(names: tuple[HeaderName, ...]) -> dict[str, int]:
    """The first whole triad of each inertial sensor, those that a phone derives last; else as much
    of one as there is."""
    groups: dict[tuple[str, tuple[str, ...]], dict[int, int]] = {}
    for at, name in enumerate(names):
        found = triad_axis(name)
        if found is not None:
            sensor, axis, stem = found
            groups.setdefault((sensor, stem), {}).setdefault(axis, at)
    places: dict[str, int] = {}
    for sensor, roles in (("g", GYRO), ("a", ACCEL)):
        of_one = [
            ((-len(axes), "motion" in stem, min(axes.values())), axes)
            for (of, stem), axes in groups.items()
            if of == sensor
        ]
        if of_one:
            axes = min(of_one, key=lambda group: group[0])[1]
            places |= {roles[axis]: at for axis, at in axes.items()}
    return places


def _refuse_parted(layout: Layout, names: tuple[HeaderName, ...]) -> None:
    """Raise InputError where degrees and minutes stand in columns of their own."""
    for at, name in enumerate(names):
        if not _MINUTES & set(name.words):
            continue
        of = meaning(tuple(w for w in name.words if w not in _MINUTES), "gnss").ideas
        if of in ({"lat"}, {"lon"}):
            raise InputError(
                f"{layout.path}: column {layout.names[at]} holds the minutes of an angle whose "
                "degrees stand in another; write each in one column, degrees + minutes / 60."
            )


def _not_found(layout: Layout, kind: TableKind, missing: list[str]) -> str:
    lacking = "t, " if kind == "imu" else ""
    return (
        f"{layout.path}: line {layout.header_line} names no column {missing[0]}, nor one that "
        f"means it; needed are {lacking}{', '.join(NEEDED[kind])}, found are "
        f"{listed(layout.names)}. Say in drive.toml which is which: "
        f'columns = {{ {missing[0]} = "..." }}.'
    )


def _units(
    names: tuple[HeaderName, ...],
    layout: Layout,
    kind: TableKind,
    form: TableForm,
    places: Mapping[str, int],
) -> dict[str, str]:
    """The units that the manifest, a column's name, the line below it or its cells tell."""
    units: dict[str, str] = {}
    for role, quantity in QUANTITIES[kind].items():
        if role not in places or quantity is None:
            continue
        at = places[role]
        told = names[at].unit(quantity)
        if told is None and layout.units:
            told = HeaderName("", (), layout.units[at]).unit(quantity)
        if role in ("lat", "lon") and is_spelled_out(
            [row[at] for row in layout.sample], "NS" if role == "lat" else "EW"
        ):
            told = SPELLED_OUT
        if told is None and role == "arrival":
            cells = [row[at] for row in layout.sample]
            count = guessed_form(cells, layout.decimal, None, "imu")
            told = None if count is None else count.unit
        told = form.units.get(role) or told
        if told is not None:
            units[role] = told
    return units


def _notes(layout: Layout, guess: TableGuess, stated: Mapping[str, int]) -> list[str]:
    """What was guessed, in sentences; nothing of a table with our own names."""
    notes = []
    found = [
        f"{role} is {layout.names[at] or at + 1!r}"
        + (f" in {guess.units[role]}" if role in guess.units and role not in guess.assumed else "")
        for role, at in guess.places.items()
        if role not in stated and not _is_ours(layout.names[at], role)
    ]
    if found:
        notes.append(f"{layout.path}: by the names of its columns {', '.join(found)}")
    time = guess.time
    ours = {layout.names[at].strip().lower() for at in guess.places.values()} & {"t_ns", "gps_s"}
    if time is not None and guess.form.time_format is None and not ours:
        what = {"unix": ", UTC", "gps": ", GPS time", "host": "", "day": ", without a date"}
        notes.append(f'{layout.path}: times are read as "{time.spelled}"{what[time.clock]}')
    if layout.decimal == "," and guess.form.decimal is None:
        notes.append(f"{layout.path}: decimal commas, cells apart by {layout.separator!r}")
    if layout.encoding != "utf-8":
        notes.append(f"{layout.path}: it is in {layout.encoding}")
    return notes


def _doubts(layout: Layout, guess: TableGuess) -> list[str]:
    """What else times and heights could be, where neither manifest nor table says."""
    doubts = []
    time = guess.time
    if time is not None and time.pattern is not None and guess.form.time_format is None:
        other = other_reading(time.pattern)
        if other is not None and _both_fit(layout, guess, other):
            doubts.append(DATES_DOUBT.format(other))
    ours = {layout.names[at].strip().lower() for at in guess.places.values()} & {"t_ns", "gps_s"}
    if time is not None and not ours and guess.form.time_format is None:
        doubts += _other_epoch(layout, guess, time)
    high = [role for role in ("height", "msl") if role in guess.assumed]
    if high and not ours:
        doubts.append(f'heights are taken as m; write units = {{ {high[0]} = "ft" }} if they are')
    return doubts


def _other_epoch(layout: Layout, guess: TableGuess, time: TimeForm) -> list[str]:
    """That counts since 1970 would be GPS time of a day that has been, where nothing says which."""
    if time.clock != "unix" or time.unit is None or time.excel or "t" not in guess.places:
        return []
    at = guess.places["t"]
    values = numbers_of([row[at] for row in layout.sample], layout.decimal)
    known = values[np.isfinite(values)]
    if not len(known) or _SINCE_1970.search(layout.names[at].lower()):
        return []
    unix_s = float(known[0]) * UNITS["time"][time.unit] * 1e-9
    gps_s = float(gps_to_unix(unix_s))
    if gps_s > now():
        return []
    here, other = (datetime.fromtimestamp(t, UTC).date() for t in (unix_s, gps_s))
    return [
        f"times are taken as since 1970, of {here}; in GPS time they are of {other}: write "
        f'time_format = "gps_{time.unit}" if so'
    ]


def _both_fit(layout: Layout, guess: TableGuess, other: str) -> bool:
    at = guess.places.get("date", guess.places.get("t", 0))
    cells = [filled_up(row[at], of_day=False) for row in layout.sample]
    pattern = other.partition(" ")[0] if "date" in guess.places else other
    return bool(parse_stamps(cells, pattern, 0.0)[1].all())


def _is_ours(name: str, role: str) -> bool:
    """Whether a column bears our own name, its unit with it."""
    return name.strip().lower() in {
        role,
        "t_ns",
        f"{role}_deg",
        f"{role}_m",
        f"{role}_m_s",
        f"{role}_ns",
    }


def _written(layout: Layout, guess: TableGuess, form: TableForm) -> TableForm:
    """The form with all that was guessed filled in, so that a manifest can say it."""
    once = {name for name in layout.names if name and layout.names.count(name) == 1}
    time_format = form.time_format
    if guess.time is not None and time_format is None and "week" not in guess.places:
        time_format = guess.time.spelled
    usual = {role: DEFAULT_UNIT[q] for role, q in QUANTITIES[guess.kind].items() if q is not None}
    return replace(
        form,
        columns={
            role: layout.names[at] if layout.names[at] in once else at + 1
            for role, at in guess.places.items()
        },
        separator=layout.separator,
        decimal=layout.decimal,
        time_format=time_format,
        units={
            role: unit
            for role, unit in guess.units.items()
            if role not in GYRO + ACCEL and unit != usual[role]
        },
    )
