"""The entries of a list as the signs that are compared."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from automap.errors import InputError
from automap.inventory.findings import Inventory
from automap.io.inventory_file import InventoryFile
from automap.mapping.grid import east_north
from automap.mapping.limits import MOVED_M
from automap.records import Sign
from automap.records.sign_lists import numbers_of
from automap.signs.classes import country_set, load_classes
from automap.signs.codes import classes_of, face_of, readings_of

_SHOWN = 3
"""Classes that are told of a name that stands for several."""


def _number(n: int, one: str, many: str) -> str:
    return f"{n} {one if n == 1 else many}"


def listed_signs(
    read: InventoryFile,
    country: str | None,
    path: Path,
    warnings: list[str],
    named: Iterable[str] = (),
) -> tuple[Inventory, list[int]]:
    """The list's signs that have a position, and their rows; a class that no catalogue has is that
    of the same text among those ``named`` in the map, as a detector of one's own writes them."""
    rows, codes = _entries(read, path, warnings)
    if not rows:
        raise InputError(
            f"{path}: none of its entries has a position that can be read as numbers; see whether "
            "a spreadsheet has put separators into them, or name other columns with --columns."
        )
    own = {_text(name): name for name in named if name}
    classes = [
        name or own.get(_text(code))
        for name, code in zip(classes_of(codes, country), codes, strict=True)
    ]
    _tell_unread([c for c in codes if _text(c) not in own], country, path, warnings)
    several = Counter(rows)
    place: Counter[int] = Counter()
    ids = []
    for k in rows:
        place[k] += 1
        ids.append(read.ids[k] if several[k] == 1 else f"{read.ids[k]}#{place[k]}")
    return (
        Inventory(
            ids,
            [name or "" for name in classes],
            read.lat_rad[rows],
            read.lon_rad[rows],
            read.facing_rad[rows],
            read.sd_m[rows],
        ),
        rows,
    )


def _text(name: str) -> str:
    """A class as texts are compared: whatever its letters' case and the space about it."""
    return name.strip().casefold()


def _tell_unread(codes: list[str], country: str | None, path: Path, warnings: list[str]) -> None:
    """A warning of codes and names that stand for no class, and of those for several."""
    unknown: Counter[str] = Counter()
    unsure: Counter[str] = Counter()
    for code, names in zip(codes, readings_of(codes, country), strict=True):
        if len(names) > 1:
            shown = [face_of(name) for name in names[:_SHOWN]]
            more = [f"{len(names) - _SHOWN} more"] if len(names) > _SHOWN else []
            unsure[f"{code!r}, which may be {' or '.join(shown + more)}"] += 1
        elif not names:
            unknown[repr(code)] += 1
    catalogue = f"read as {country}'s; --country names another" if country else "named by --country"
    for told, have, advice in (
        (unknown, "not known", f"The catalogue is {catalogue}."),
        (unsure, "of several classes", f"Write the class; the catalogue of codes is {catalogue}."),
    ):
        if told:
            most = "; ".join(f"{what} ({n})" for what, n in told.most_common(5))
            signs = _number(told.total(), "sign has a code", "signs have codes")
            warnings.append(
                f"{path}: {signs} {have}, such as {most}; classes are not compared there. {advice}"
            )


def no_country(folder: Path, country: str | None) -> list[str]:
    """What to say of a map whose drives name no country, where the list's is one of those whose
    set of signs is known."""
    if len(country_set(country)) == len(load_classes()):
        return []
    return [
        f"{folder}: its drives name no country, so that their faces were read among those of all. "
        f'The list is of signs of {country}: with country = "{country}" in [site] of drive.toml a '
        "new run names more of them, and tells more of what the list has wrong."
    ]


def _entries(read: InventoryFile, path: Path, warnings: list[str]) -> tuple[list[int], list[str]]:
    """Rows of the list that have a position, a row with several signs as often, and their codes;
    one that says what another has said, once."""
    rows, codes, repeated, split = [], [], [], 0
    said = set()
    for k in np.flatnonzero(np.isfinite(read.lat_rad) & np.isfinite(read.lon_rad)).tolist():
        # as OpenStreetMap parts signs; after a comma there are plates
        parts = [part.strip() for part in read.codes[k].split(";") if part.strip()] or [""]
        facing = read.facing_rad[k]
        one = (read.lat_rad[k], read.lon_rad[k], read.codes[k], facing)
        # without a direction two may be the two sides of one post
        if parts[0] and math.isfinite(facing) and one in said:
            repeated.append(read.ids[k])
            continue
        said.add(one)
        split += len(parts) > 1
        rows += [k] * len(parts)
        codes += parts
    if repeated:
        warnings.append(
            f"{path}: {_number(len(repeated), 'entry repeats', 'entries repeat')} place, class and "
            f"direction of another, such as {', '.join(repeated[:3])}; they are left out."
        )
    if split:
        warnings.append(
            f"{path}: {_number(split, 'entry names', 'entries name')} several signs, which are "
            "compared each by itself."
        )
    return rows, codes


def without_repeats(
    listed: Inventory,
    rows: Sequence[int],
    read: InventoryFile,
    signs: Sequence[Sign],
    path: Path,
    warnings: list[str],
) -> tuple[Inventory, list[int]]:
    """The list, and its rows, less entries without a direction that repeat place and class of
    another: these may be the other side of a post, and stay where the map has as many ``signs`` of
    that class near by."""
    lat, lon = numbers_of(signs, "lat_rad", "lon_rad")
    faces = np.array([face_of(s.class_name) for s in signs], np.str_)
    turned = np.isfinite(listed.facing_rad)
    met: Counter[tuple[float, float, str]] = Counter()
    kept, repeated = [], []
    for k, row in enumerate(rows):
        code = listed.class_name[k] or _text(read.codes[row])
        one = (float(listed.lat_rad[k]), float(listed.lon_rad[k]), code)
        if code and not turned[k] and met[one]:
            near = np.hypot(*east_north(lat, lon, *one[:2]).T) < MOVED_M
            if met[one] >= (near & (faces == face_of(code))).sum():
                repeated.append(listed.ids[k])
                continue
        met[one] += 1
        kept.append(k)
    if repeated:
        warnings.append(
            f"{path}: {_number(len(repeated), 'entry repeats', 'entries repeat')} place and class "
            f"of another without a direction, such as {', '.join(repeated[:3])}: the other side of "
            "a post, which nobody looked at, or the same twice; they are left out."
        )
    names = [listed.ids[k] for k in kept], [listed.class_name[k] for k in kept]
    numbers = (listed.lat_rad, listed.lon_rad, listed.facing_rad, listed.sd_m)
    return Inventory(*names, *(v[kept] for v in numbers)), [rows[k] for k in kept]


def placeless(read: InventoryFile, country: str | None) -> set[str]:
    """Classes of the entries that have no position."""
    placed = np.isfinite(read.lat_rad) & np.isfinite(read.lon_rad)
    names = classes_of(read.codes, country)
    return {name for name, there in zip(names, placed.tolist(), strict=True) if name and not there}
