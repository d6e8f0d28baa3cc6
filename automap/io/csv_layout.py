"""How a CSV file is laid out: its encoding, separator, decimal sign, header and first rows."""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Container, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from automap.errors import InputError
from automap.io import limits
from automap.io.table_form import Separator, TableForm
from automap.io.table_units import UNITS, unit_named

_SEPARATORS: tuple[Separator, ...] = (";", "\t", "|", ",")
_HEAD_BYTES, _HEAD_LINES = 1 << 16, 200
"""So much of a file tells its form: some seconds of an inertial log, and more than any preamble."""
_FEW_LINES = 4
"""Fewer lines agree by chance: a preamble's do, a table's go on."""
_NUMBER = re.compile(r"^[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?$")
_POINT = re.compile(r"^[+-]?(\d*|\d{1,3}(,\d{3})+)\.\d+([eE][+-]?\d+)?$")
_COMMA = re.compile(r"^[+-]?(\d*|\d{1,3}(\.\d{3})+),\d+([eE][+-]?\d+)?$")
_UTF_16 = (b"\xff\xfe", b"\xfe\xff")
_UTF_8 = b"\xef\xbb\xbf"


@dataclass(frozen=True)
class Layout:
    """A file of columns, undone as far as its header.

    ``names`` of the columns as the file writes them, "" for one without; ``header_line`` their
    line, 0 where the file has none; ``units`` a line of units below them. ``body`` is what
    follows, in UTF-8 but for garbled bytes, beginning with line ``first_line``; ``sample`` the
    cells of its first rows. ``encoding`` is "utf-8", "utf-16" or "latin-1".
    """

    path: Path
    names: tuple[str, ...]
    units: tuple[str, ...]
    separator: Separator
    decimal: Literal[".", ","]
    header_line: int
    first_line: int
    body: memoryview | bytes
    sample: tuple[tuple[str, ...], ...]
    encoding: str


def read_layout(path: Path, form: TableForm | None = None, wanted: Sequence[str] = ()) -> Layout:
    """Look at a file; what ``form`` does not say is guessed.

    A header with one of the names ``wanted`` is one wherever it stands; otherwise it is the
    first line with as many cells as the rows have. Raises InputError for a file that is
    missing, empty or no text, whose header is none, or that has more columns than any table.
    """
    form = TableForm() if form is None else form
    data, encoding = _text_bytes(path)
    head = data[:_HEAD_BYTES].decode("utf-8", "replace")
    lines = head.split("\n")[:_HEAD_LINES]
    if len(data) > _HEAD_BYTES and len(lines) < _HEAD_LINES and len(lines) > 1:
        del lines[-1]  # cut off in its middle
    if len(lines) == 1:
        end = data.find(b"\n")
        lines = [data[: end if end >= 0 else len(data)].decode("utf-8", "replace")]
    first = next((i for i, line in enumerate(lines) if line.strip()), None)
    if first is None:
        raise InputError(f"{path} begins with {len(lines)} empty lines; remove them.")
    known = {name.lower() for name in wanted}
    separator = form.separator or _separator(lines[first:], known)
    rows = [_cells(line, separator) for line in lines]
    headless = bool(form.columns) and all(isinstance(p, int) for p in form.columns.values())
    at = _header(rows, first, known, headless)
    if at is None:
        at = _first_numbers(rows, first)
        names: list[str] = [""] * _mode([len(cells) for cells in rows[at:] if cells])[0]
        header_line, below = 0, at
    else:
        names = [name.strip("\"' ") for name in rows[at]]
        names[0] = names[0].lstrip("#% ")
        header_line, below = at + 1, at + 1
        _refuse_numbers(path, names, header_line, wanted)
    if len(names) > limits.MAX_COLUMNS:
        raise InputError(
            f"{path}: line {header_line} has {len(names)} columns, more than any table; check "
            "that the file is whole and its line ends are."
        )
    if header_line and below < len(rows):
        joined = _joined(names, rows[below])
        if joined is not None:
            names, below = joined, below + 1
    units: tuple[str, ...] = ()
    filled = [cells for cells in rows[below:] if any(cells)]
    if header_line and len(filled) > 1 and _is_units(filled[0], len(names)):
        units = tuple(filled[0])
        below = rows.index(filled[0], below) + 1
        filled = filled[1:]
    names = _fitted(names, filled)
    sample = tuple(tuple(cells) for cells in filled if len(cells) == len(names))
    return Layout(
        path=path,
        names=tuple(names),
        units=units,
        separator=separator,
        decimal=form.decimal or _decimal(sample, separator),
        header_line=header_line,
        first_line=below + 1,
        body=_body(data, below, separator),
        sample=sample,
        encoding=encoding,
    )


def _text_bytes(path: Path) -> tuple[bytes, str]:
    """The file in UTF-8 with ``\\n`` in it, and the encoding that it was in."""
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        raise InputError(f"{path} is missing.") from None
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror}.") from error
    encoding = "utf-8"
    if data.startswith(_UTF_16):
        data, encoding = data.decode("utf-16", "replace").encode(), "utf-16"
    data = data.removeprefix(_UTF_8)
    if not data.strip():
        raise InputError(f"{path} is empty; record the drive again or remove the file.")
    head = data[:4096]
    if head.count(0) * 8 > len(head) or b"\0" in head.split(b"\n", 1)[0]:
        raise InputError(f"{path} is not text; export it as CSV in UTF-8.")
    if b"\n" not in data and b"\r" in data:
        data = data.replace(b"\r", b"\n")
    if encoding == "utf-8" and not _is_utf_8(data):
        data, encoding = data.decode("latin-1").encode(), "latin-1"
    return data, encoding


def _is_utf_8(data: bytes) -> bool:
    """Whether a file is in UTF-8 but for garbled bytes: its first line decides, or more than a
    few lines beyond it."""
    head = data[:_HEAD_BYTES]
    if head.isascii():
        return True
    lines = head.splitlines()[:_HEAD_LINES]
    wrong = [i for i, line in enumerate(lines) if not _decodes(line)]
    few = len(wrong) < _FEW_LINES or 20 * len(wrong) < len(lines)
    return not wrong or (wrong[0] > 0 and few)


def _decodes(line: bytes) -> bool:
    try:
        line.decode("utf-8")
    except UnicodeDecodeError as error:
        # the head may end within a letter
        return error.end >= len(line) and error.reason == "unexpected end of data"
    return True


def _cells(line: str, separator: str) -> list[str]:
    if separator == " ":
        return line.split()
    if '"' not in line:
        return [cell.strip() for cell in line.split(separator)]
    try:
        cells = next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])
    except csv.Error:
        cells = line.split(separator)
    return [cell.strip() for cell in cells]


def _separator(lines: list[str], wanted: Container[str]) -> Separator:
    """The sign that parts the first line, or the most lines, into as many cells as the rest."""
    filled = [line for line in lines if line.strip()]
    counts = {sign: [len(_cells(line, sign)) for line in filled] for sign in _SEPARATORS}
    like_first = {
        sign: sum(cells == found[0] for cells in found)
        for sign, found in counts.items()
        if found[0] > 1
    }
    for sign in like_first:
        if _names_one(_cells(filled[0], sign), wanted):
            return sign
    best: Separator = max(like_first, key=lambda sign: like_first[sign], default=" ")
    if best != " " and (2 * like_first[best] >= len(filled) or len(filled) < _FEW_LINES):
        return best
    # the first lines may speak of something else
    modes = {sign: _mode([cells for cells in found if cells > 1]) for sign, found in counts.items()}
    common = max(modes, key=lambda sign: modes[sign][1])
    return common if 2 * modes[common][1] >= len(filled) else best


def _names_one(cells: list[str], wanted: Container[str]) -> bool:
    return any(cell.strip("\"'# %").lower() in wanted for cell in cells)


def _mode(counts: list[int]) -> tuple[int, int]:
    """The most frequent of some counts, and how often it is there."""
    return Counter(counts).most_common(1)[0] if counts else (0, 0)


def _header(
    rows: list[list[str]], first: int, wanted: Container[str], headless: bool
) -> int | None:
    """The row that names the columns, None where the numbers begin at once."""
    if headless:
        start = _first_numbers(rows, first)
        above = [i for i in range(first, start) if len(rows[i]) == len(rows[start])]
        return above[-1] if above else None
    for at, cells in enumerate(rows):
        if _names_one(cells, wanted):
            return at
    usual, often = _mode([len(cells) for cells in rows if len(cells) > 1])
    if len(rows[first]) == usual or often < _FEW_LINES:
        return first
    return next(i for i, cells in enumerate(rows) if len(cells) == usual)


def _first_numbers(rows: list[list[str]], first: int) -> int:
    """The first row with a number in it."""
    for at in range(first, len(rows)):
        if rows[at] and rows[at][0][:1] not in ("#", "%") and any(map(_NUMBER.match, rows[at])):
            return at
    return first


def _refuse_numbers(path: Path, names: list[str], line: int, wanted: Iterable[str]) -> None:
    if names and all(_NUMBER.match(name) for name in names):
        first = ",".join(wanted) or "t_s,gx,gy,gz,ax,ay,az"
        raise InputError(
            f"{path}: line {line} holds numbers where the names of the columns belong; "
            f"put a first line such as {first}, or say in drive.toml which column is which, "
            "columns = { t = 1, ... }."
        )


def _joined(names: list[str], cells: list[str]) -> list[str] | None:
    """The names where the line below goes on with them, as axes below sensors do; else None.

    A name in the first line then stands over several columns: once, or in each of them.
    """
    shared = len({name for name in names if name}) < len(names)
    if not shared or len(cells) != len(names) or any(map(_NUMBER.match, cells)):
        return None
    if len(set(cells)) < 3 or _is_units(cells, len(names)):
        return None
    over, whole = "", []
    for name, cell in zip(names, cells, strict=True):
        over = name or over
        whole.append(f"{over} {cell}".strip() if cell else name)
    return whole


def _is_units(cells: list[str], columns: int) -> bool:
    """Whether a row below the header gives units: nothing in it is a number, and most is one."""
    if len(cells) != columns or any(map(_NUMBER.match, cells)):
        return False
    known = [cell for cell in cells if any(unit_named(cell, quantity) for quantity in UNITS)]
    return 2 * len(known) > columns


def _fitted(names: list[str], rows: list[list[str]]) -> list[str]:
    """The names, with one more or less where every row ends with a separator, or the header."""
    usual, often = _mode([len(cells) for cells in rows])
    if 2 * often > len(rows):
        if usual == len(names) + 1 and not any(c[-1] for c in rows if len(c) == usual):
            return [*names, ""]
        if usual == len(names) - 1 and not names[-1]:
            return names[:-1]
    return names


def _decimal(rows: Sequence[Sequence[str]], separator: str) -> Literal[".", ","]:
    cells = [cell for row in rows for cell in row]
    commas, points = (sum(map(bool, map(sign.match, cells))) for sign in (_COMMA, _POINT))
    return "," if commas > points else "."


def _body(data: bytes, below: int, separator: str) -> memoryview | bytes:
    """What follows ``below`` lines, without the blank lines at the end."""
    start = 0
    for _ in range(below):
        start = data.find(b"\n", start) + 1
        if start == 0:
            return b""
    stop = len(data)
    while stop > start and data[stop - 1] in b" \t\r\n":
        stop -= 1
    body: memoryview | bytes = memoryview(data)[start:stop]
    if separator == " ":
        body = re.sub(rb"(?m)^[ \t]+|[ \t\r]+$", b"", bytes(body))
        body = re.sub(rb"[ \t]+", b" ", body)
    return body
