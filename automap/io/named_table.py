"""A table of recordings in anybody's words, read into ours: nanoseconds and SI units."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from automap.errors import InputError
from automap.io.angle_text import SPELLED_OUT, parse_angles, signs
from automap.io.csv_columns import CsvColumns, read_chosen
from automap.io.csv_layout import Layout, read_layout
from automap.io.csv_numbers import Kind
from automap.io.table_form import (
    ACCEL,
    GYRO,
    HEMISPHERES,
    QUANTITIES,
    TIME_ROLES,
    TableForm,
    TableKind,
)
from automap.io.table_guess import TableGuess, guess_table
from automap.io.table_times import Clock, TimeForm, stamps
from automap.io.table_units import to_si
from automap.io.wrapped_counts import UNSIGNED, with_sign, without_sign
from automap.records import BoolArray, FloatArray, IntArray

OURS: dict[TableKind, tuple[str, ...]] = {
    "imu": ("t_ns", *GYRO, *ACCEL),
    "gnss": (),
    "odometer": ("t_ns", "speed_m_s"),
    "arrival": ("offset", "t_ns"),
}
"""Names in the header of a table of ours, which is read without looking further."""

_FEW = 8
"""Steps below which no order is judged: of eight even two back are a share of a quarter."""
_OUT_OF_ORDER = 0.25
"""A share of steps back that no clock has: late packets make a twentieth of them."""

_EVEN = 0.5
"""A share of steps within half of the usual one: of numbers at random it is 0.35."""

_LETTERS = {angle: (column, letters) for column, (angle, letters) in HEMISPHERES.items()}


@dataclass(frozen=True)
class NamedTable:
    """A table with our names.

    ``columns`` floats [n] in SI units, but for an inertial table's triads, which stay in
    ``units``; ``t_ns`` [n] of ``clock``, None where the table has no times. ``rows`` tells
    lines and what was left out, ``notes`` what was guessed.
    """

    columns: dict[str, FloatArray]
    t_ns: IntArray | None
    clock: Clock
    rows: CsvColumns
    units: dict[str, str]
    notes: tuple[str, ...]
    guess: TableGuess

    def __len__(self) -> int:
        return len(self.rows)

    def column(self, role: str) -> FloatArray:
        """A column [n]; NaN throughout where the table has none."""
        found = self.columns.get(role)
        return np.full(len(self), np.nan) if found is None else found

    def unit(self, roles: tuple[str, ...]) -> str | None:
        """The unit that all of some columns tell, None when they tell none or different ones."""
        told = {self.units.get(role) for role in roles}
        return told.pop() if len(told) == 1 else None


def look_at_table(path: Path, kind: TableKind, form: TableForm | None = None) -> TableGuess:
    """How a file would be read as a table of a kind, without reading all of it.

    Raises InputError where it cannot be, ConfigError where ``form`` names what it lacks.
    """
    form = TableForm() if form is None else form
    return guess_table(read_layout(path, form, OURS[kind]), kind, form)


def read_table(
    path: Path,
    kind: TableKind,
    form: TableForm | None = None,
    *,
    needed: tuple[str, ...] | None = None,
    width: int = 0,
) -> NamedTable:
    """Read a table; rows that cannot be read are left out, counted and named.

    ``needed`` columns in place of those of its kind; ``width`` is how many the file has, where
    that is known. Raises InputError and ConfigError as :func:`look_at_table`, and InputError
    without a row.
    """
    form = TableForm() if form is None else form
    layout = read_layout(path, form, OURS[kind])
    if width and len(layout.names) != width:
        raise InputError(
            f"{path} has {len(layout.names)} columns, but {width} are named; correct --columns."
        )
    guess = guess_table(layout, kind, form, needed)
    kinds: dict[str, tuple[int, Kind]] = {}
    for role, at in guess.places.items():
        if role in TIME_ROLES:
            assert guess.time is not None
            kinds[role] = (at, guess.time.kind(role))
        else:
            kinds[role] = (at, _kind(role, guess))
    table = read_chosen(layout, kinds)
    t_ns, table = _stamped(layout, table, guess, form)
    columns: dict[str, FloatArray] = {}
    for role, quantity in QUANTITIES[kind].items():
        if role not in table.columns:
            continue
        values = table.columns[role]
        unit = guess.units.get(role)
        if role in HEMISPHERES:
            continue
        if role in _LETTERS:
            values = _angles(role, values, unit, table.columns)
        if quantity is not None and unit is not None and role not in GYRO + ACCEL:
            values = to_si(values, unit, quantity)
        columns[role] = values
    notes = guess.notes
    triads = {role: columns[role] for role in GYRO + ACCEL if role in columns}
    if kind == "imu" and without_sign(triads.values()):
        columns |= {role: with_sign(values) for role, values in triads.items()}
        notes = (*notes, f"{path}: {UNSIGNED}.")
    clock: Clock = "host" if guess.time is None else guess.time.clock
    return NamedTable(columns, t_ns, clock, table, dict(guess.units), notes, guess)


def _kind(role: str, guess: TableGuess) -> Kind:
    if role in HEMISPHERES or guess.units.get(role) == SPELLED_OUT:
        return "text"
    return "int" if role == "offset" else "float"


def _angles(
    role: str, values: np.ndarray, unit: str | None, columns: Mapping[str, np.ndarray]
) -> FloatArray:
    """Latitudes or longitudes [n], in degrees where they are spelled out, with their signs."""
    column, letters = _LETTERS[role]
    angles = parse_angles(values, letters) if unit == SPELLED_OUT else values
    return np.abs(angles) * signs(columns[column], letters) if column in columns else angles


def _stamped(
    layout: Layout, table: CsvColumns, guess: TableGuess, form: TableForm
) -> tuple[IntArray | None, CsvColumns]:
    """The stamps, and the table without the rows that have none."""
    if guess.time is None:
        return None, table
    times = {role: table.columns[role] for role in guess.places if role in TIME_ROLES}
    t_ns, good = stamps(times, guess.time, form.utc_offset_h)
    empty = _without_time(times)
    if empty.any() and not empty.all():
        # rows of another sensor in the same table
        table = _taken(table, np.flatnonzero(~empty))
        times = {role: values[~empty] for role, values in times.items()}
        t_ns, good = t_ns[~empty], good[~empty]
    # bytes of a log come in their own order
    ordered = guess.kind != "arrival"
    if good.all():
        return _in_order(t_ns, table) if ordered else (t_ns, table)
    wrong = int(np.flatnonzero(~good)[0])
    first = table.line(wrong)
    cells = ", ".join(repr(str(values[wrong])) for values in times.values())
    said = f"line {first}, {_columns(layout, guess)}: {cells}"
    if not good.any():
        raise InputError(
            f"{layout.path}: no row has a time as {_spelled(guess.time)}; the first is {said}. "
            "Correct time_format or columns in drive.toml."
        )
    earlier = table.first_bad is not None and _line(table.first_bad) < first
    kept = replace(
        _taken(table, np.flatnonzero(good)),
        bad_rows=table.bad_rows + int(np.count_nonzero(~good)),
        first_bad=table.first_bad if earlier else said,
    )
    return _in_order(t_ns[good], kept) if ordered else (t_ns[good], kept)


def _without_time(times: Mapping[str, np.ndarray]) -> BoolArray:
    """Rows [n] whose cells of time are all empty."""
    empty = [
        np.array([not cell for cell in values], bool) if values.dtype == object
        else np.isnan(values) if values.dtype.kind == "f"
        else np.zeros(len(values), bool)
        for values in times.values()
    ]  # fmt: skip
    return np.asarray(np.all(empty, axis=0), bool)


def _taken(table: CsvColumns, rows: IntArray) -> CsvColumns:
    """Some rows of a table in their order."""
    lines = np.array([table.line(int(row)) for row in rows], np.int64)
    columns = {name: values[rows] for name, values in table.columns.items()}
    return replace(table, columns=columns, line_numbers=lines)


def _in_order(t_ns: IntArray, table: CsvColumns) -> tuple[IntArray, CsvColumns]:
    """Stamps and rows in the order of time, where a table was sorted by something else.

    Of the steps of a clock a few in a hundred go back, of rows in any order half, of the newest
    first nearly all. Numbers that are no clock stay as they are: sorted, they make no even steps.
    """
    steps = np.diff(t_ns)
    moved = np.count_nonzero(steps)
    if moved < _FEW or np.count_nonzero(steps < 0) < _OUT_OF_ORDER * moved:
        return t_ns, table
    # rows of one time stand in their order, or all of them backwards
    backwards = np.count_nonzero(steps > 0) < np.count_nonzero(steps < 0) / 10
    rows = np.arange(len(t_ns))[:: -1 if backwards else 1]
    rows = rows[np.argsort(t_ns[rows], kind="stable")]
    apart = np.diff(t_ns[rows])
    apart = apart[apart > 0]
    usual = np.median(apart)
    even = np.mean(np.abs(apart - usual) < 0.5 * usual) > _EVEN
    return (t_ns[rows], _taken(table, rows)) if even else (t_ns, table)


def _columns(layout: Layout, guess: TableGuess) -> str:
    places = [at for role, at in guess.places.items() if role in TIME_ROLES]
    return "column " + " and ".join(layout.names[at] or str(at + 1) for at in places)


def _spelled(time: TimeForm) -> str:
    return f'"{time.spelled}"'


def _line(first_bad: str) -> int:
    digits = first_bad.removeprefix("line ").split(",")[0].split(" ")[0].rstrip(":")
    return int(digits) if digits.isdigit() else 0
