"""Which columns of a table are its times, and what form they are in."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from automap.errors import ConfigError, InputError
from automap.io.calendar_text import has_date, has_time, pattern_of
from automap.io.csv_layout import Layout
from automap.io.header_names import HeaderName, meaning
from automap.io.header_words import TIME_OR_SPEED
from automap.io.table_form import TableForm, TableKind
from automap.io.table_times import (
    TimeForm,
    contradiction,
    day_pattern,
    guessed_form,
    numbers_of,
    stated_form,
)

_SHARED, _PAIR, _WEEK = 10.0, 6.0, 7.0
"""What a candidate is worth for each word that it shares with the readings, as a date with a time
of day for fixes, and as a GPS week."""


def told_apart(layout: Layout, names: tuple[HeaderName, ...]) -> tuple[HeaderName, ...]:
    """The names with a word that is a time in one language and a speed in another as what it is.

    A unit tells, else whether its cells run on as times do.
    """

    def is_speed(at: int, name: HeaderName) -> bool:
        if name.unit("speed") is not None or name.unit("time") is not None:
            # "ms" is both, and of a time
            return name.unit("time") is None
        values = numbers_of(_cells(layout, at), layout.decimal)
        known = values[np.isfinite(values)]
        steps = np.diff(known)
        return 2 * len(known) > len(values) and bool((steps < 0.0).any() or not steps.any())

    return tuple(
        replace(name, words=tuple("speed" if w == TIME_OR_SPEED else w for w in name.words))
        if TIME_OR_SPEED in name.words and is_speed(at, name)
        else name
        for at, name in enumerate(names)
    )


def stated_time(
    layout: Layout,
    names: tuple[HeaderName, ...],
    kind: TableKind,
    form: TableForm,
    times: Mapping[str, int],
) -> TimeForm:
    """The form of times whose columns the manifest names."""
    if form.time_format is not None:
        return stated_form(form.time_format)
    if "week" in times and "tow" in times:
        return TimeForm("gps", names[times["tow"]].unit("time") or "s")
    if "date" in times and "time_of_day" in times:
        pattern = day_pattern(*(_cells(layout, times[role]) for role in ("date", "time_of_day")))
        if pattern is not None:
            return TimeForm("unix", pattern=pattern)
    elif len(times) == 1:
        (role, at), *_ = times.items()
        unit = role.removeprefix("t_") if role.startswith("t_") else None
        found = _count(layout, names[at], at, kind, unit)
        if found is not None:
            return found
    shown = ", ".join(repr(_cells(layout, at)[0]) for at in times.values() if layout.sample)
    raise ConfigError(
        f"{layout.path}: the times {shown} in {', '.join(times)} are in no form that is known; "
        "write time_format in drive.toml, such as '%d.%m.%Y %H:%M:%S.%f', and name t, or date "
        "and time_of_day, or week and tow."
    )


def _cells(layout: Layout, at: int) -> list[str]:
    return [row[at] for row in layout.sample]


def _count(
    layout: Layout, name: HeaderName, at: int, kind: TableKind, unit: str | None = None
) -> TimeForm | None:
    """The form of one column of times."""
    unit = unit or name.unit("time") or next(filter(None, map(_unit_word, name.words)), None)
    gps = bool({"gps", "gpst", "gpstime"} & set(name.words))
    return guessed_form(_cells(layout, at), layout.decimal, unit, kind, gps=gps)


def refuse_other_unit(
    layout: Layout, kind: TableKind, form: TableForm, time: TimeForm, times: Mapping[str, int]
) -> None:
    """Raise InputError where a count cannot be in the unit that its name tells.

    Whole numbers under our own ``t_ns`` are left to those who know what they stamp.
    """
    if form.time_format is not None or time.unit is None or len(times) != 1:
        return
    (at,) = times.values()
    cells, name = _cells(layout, at), layout.names[at]
    if name.strip().lower() == "t_ns" and not any("." in cell for cell in cells):
        return
    wrong = contradiction(cells, layout.decimal, time.unit, kind)
    if wrong is not None:
        raise InputError(f"{layout.path}: column {name or at + 1}: {wrong} in drive.toml.")


_CUT_OFF = re.compile(r"\d{1,2}:\d{2}(?:[.,]\d+)?")
"""08:59 or 59:58.3: what a spreadsheet shows of a time of day, and then writes."""


def _refuse_cut_off(layout: Layout, at: int) -> None:
    """Raise InputError where times of day have lost their seconds or their hours."""
    filled = [cell for cell in _cells(layout, at) if cell]
    if filled and all(_CUT_OFF.fullmatch(cell.rpartition(" ")[2]) for cell in filled):
        raise InputError(
            f"{layout.path}: the times of column {layout.names[at] or at + 1}, such as "
            f"{filled[0]!r}, have lost their seconds or their hours, as a spreadsheet writes them; "
            "give the column the format hh:mm:ss.000 and export it again."
        )


def _unit_word(word: str) -> str | None:
    return HeaderName(word, (word,), "").unit("time") if len(word) > 2 else None


def likeliest_times(
    layout: Layout,
    names: tuple[HeaderName, ...],
    kind: TableKind,
    form: TableForm,
    places: Mapping[str, int],
) -> tuple[dict[str, int], TimeForm] | None:
    """The likeliest times of a table: those named like its readings, then by what they are.

    Inertial readings and wheel speeds want one running count, fixes the receiver's own date.
    """
    about = {word for at in places.values() for word in names[at].words if len(word) > 1}
    said = [meaning(name.words, kind) for name in names]
    ideas = [each.ideas for each in said]
    free = [at for at in range(len(names)) if at not in places.values()]
    if not any(layout.names):
        return None
    candidates: list[tuple[float, dict[str, int], TimeForm]] = []

    def offer(roles: dict[str, int], time: TimeForm, worth: float) -> None:
        at = min(roles.values())
        shared = len(about & set(names[at].words))
        candidates.append(
            (_SHARED * shared + worth - 0.5 * said[at].unknown - 1e-4 * at, roles, time)
        )

    if form.time_format is not None:
        wanted = stated_form(form.time_format)
        for at in free:
            if "time" in ideas[at]:
                text = bool(np.isnan(numbers_of(_cells(layout, at), layout.decimal)).any())
                offer({"t": at}, wanted, float(text == (wanted.pattern is not None)))
        return _best(candidates)
    dates = [at for at in free if "date" in ideas[at] or _is_date(layout, at)]
    for at in free:
        if not ideas[at] & {"time", "date"} or ideas[at] & {"speed", "accuracy", "other"}:
            continue
        _refuse_cut_off(layout, at)
        pairs = ((date, _paired(layout, date, at)) for date in dates if date != at)
        paired = [(date, pattern) for date, pattern in pairs if pattern is not None]
        for date, pattern in paired:
            worth = _PAIR if kind == "gnss" else 0.5 * _PAIR
            offer({"date": date, "time_of_day": at}, TimeForm("unix", pattern=pattern), worth)
        if not paired and not (at in dates and _is_date(layout, at)):
            count = _count(layout, names[at], at, kind)
            if count is not None:
                offer({"t": at}, count, _worth(count, kind) - _repeated(layout, at, kind))
    weeks = [at for at in free if ideas[at] == {"week"}]
    for at in (at for at in free if "tow" in ideas[at] and weeks):
        time = TimeForm("gps", names[at].unit("time") or "s")
        offer({"week": weeks[0], "tow": at}, time, _WEEK)
    return _best(candidates)


def _best(
    candidates: list[tuple[float, dict[str, int], TimeForm]],
) -> tuple[dict[str, int], TimeForm] | None:
    if not candidates:
        return None
    _, roles, time = max(candidates, key=lambda candidate: candidate[0])
    return roles, time


def _paired(layout: Layout, date: int, time: int) -> str | None:
    return day_pattern(_cells(layout, date), _cells(layout, time))


def _repeated(layout: Layout, at: int, kind: TableKind) -> float:
    """How much the stamps of a column are held between rows, which those of fixes may be."""
    cells = _cells(layout, at)
    return 0.0 if kind == "gnss" or not cells else 2.0 * (1.0 - len(set(cells)) / len(cells))


def _worth(time: TimeForm, kind: TableKind) -> float:
    if time.pattern is not None:
        return {"unix": 5.0 if kind == "gnss" else 4.0}.get(time.clock, 1.0)
    return 5.0 if kind != "gnss" or time.clock != "host" else 2.0


def _is_date(layout: Layout, at: int) -> bool:
    """Whether a column's cells are dates without a time of day, and not merely numbers."""
    cells = _cells(layout, at)
    if not np.isnan(numbers_of(cells, layout.decimal)).any():
        return False
    pattern = pattern_of(cells)
    return pattern is not None and has_date(pattern) and not has_time(pattern)
