"""The merge of a store, step by step: every step is a function of one cell, and done once only.

``group`` in the order of ``turns``, then ``weigh`` of every cell that ``standing`` names, and with
what all of them tell of errors, ``levels_of``, ``place`` of them. A step writes a file for
its cell with a digest of what it took, and is left out where that digest is as it was: after new
drives only cells change that have something new in them or near.
"""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from automap.mapping.adjustment import rough_places
from automap.mapping.association import renumbered
from automap.mapping.by_cells import group_cell
from automap.mapping.cell_merge import PLACE_MARGIN_M, place_signs
from automap.mapping.cells import cell_of, colour_of
from automap.mapping.drive_levels import drive_squares, error_levels
from automap.mapping.existence import Chances
from automap.mapping.limits import FARTHEST_M, HALO_M
from automap.records import FloatArray, IntArray
from pipeline.merge.cell_files import (
    FORMAT,
    read_columns,
    restamp,
    stamp_of,
    step_file,
    text_of,
    write_columns,
)
from pipeline.merge.cell_parts import parts
from pipeline.merge.cell_store import (
    GROUPS,
    PATHS,
    PLACED,
    SIGHTINGS,
    SQUARES,
    Drives,
    Near,
    near_cells,
    occupied,
    read_drives,
    read_near,
)

VIEW_MARGIN_M = FARTHEST_M + 5.0
"""Round a cell, where a path may have its signs in view, and a little for the Earth's shape."""


def turns(folder: Path) -> list[list[int]]:
    """Cells that hold something, in turns: those of a turn may be grouped at once."""
    found: dict[int, list[int]] = {}
    for cell in occupied(folder).tolist():
        found.setdefault(colour_of(cell), []).append(cell)
    return [found[colour] for colour in sorted(found)]


def group(folder: Path, cell: int) -> bool:
    """Group the sightings of one cell; False where nothing had changed."""
    cells = near_cells(folder, cell, HALO_M)
    before = [k for k in cells.tolist() if colour_of(k) < colour_of(cell)]
    path = step_file(folder, GROUPS, cell)
    stamp = stamp_of(
        parts(folder, SIGHTINGS, cells), [step_file(folder, GROUPS, k) for k in before]
    )
    if text_of(path, "stamp") == stamp:
        return False
    near = read_near(folder, read_drives(folder), cell, HALO_M)
    taken, _ = _members(folder, before)
    s = near.sightings
    free = ~np.isin(near.name, taken)
    digest = hashlib.sha256((FORMAT + near.digest()).encode() + free.tobytes()).hexdigest()
    if text_of(path, "digest") == digest and restamp(path, stamp):
        return False
    told = {"digest": np.array(digest), "stamp": np.array(stamp)}
    own = cell_of(s.lat, s.lon) == cell
    if not own.any():
        write_columns(path, **told, name=taken[:0], sign=taken[:0], home=taken[:0])
        return True
    found = group_cell(s, own, free)
    rows = np.flatnonzero(found >= 0)
    sign = renumbered(found[rows])
    lat, lon = rough_places(s.at(rows), sign) if len(rows) else (s.lat[:0], s.lon[:0])
    home = np.unique(cell_of(lat, lon))
    write_columns(path, **told, name=near.name[rows], sign=sign, home=home)
    return True


def standing(folder: Path) -> list[int]:
    """Cells that signs stand in."""
    homes = [read_columns(path)["home"] for path in sorted((folder / GROUPS).glob("*.npz"))]
    return np.unique(np.concatenate(homes)).tolist() if homes else []


def weigh(folder: Path, cell: int) -> bool:
    """Take the squares of the drives' errors in one cell; False where nothing had changed."""
    cells = near_cells(folder, cell, HALO_M)
    groups = [step_file(folder, GROUPS, k) for k in cells.tolist()]
    stamp = stamp_of(parts(folder, SIGHTINGS, cells), groups)
    path = step_file(folder, SQUARES, cell)
    if text_of(path, "stamp") == stamp:
        return False
    near, sign = grouped(folder, read_drives(folder), cell)
    rows = np.flatnonzero(sign >= 0)
    drive, squares = drive_squares(near.sightings.at(rows), renumbered(sign[rows]), cell)
    write_columns(path, stamp=np.array(stamp), drive=near.drive[drive], squares=squares)
    return True


def levels_of(folder: Path, cells: Sequence[int]) -> tuple[FloatArray, FloatArray]:
    """The levels, and factors [d, 3] of all drives on them, by the squares of all cells."""
    told = (read_columns(step_file(folder, SQUARES, cell)) for cell in cells)
    pairs = ((each["drive"], each["squares"]) for each in told)
    return error_levels(pairs, len(read_drives(folder)))


def place(folder: Path, cell: int, levels: FloatArray, factors: FloatArray) -> bool:
    """Place the signs of one cell; False where nothing had changed. ``factors`` [d, 3] of all
    drives on the levels."""
    cells = near_cells(folder, cell, HALO_M)
    files = parts(folder, SIGHTINGS, cells) + parts(folder, PATHS, cells)
    stamp = stamp_of(files, [step_file(folder, GROUPS, k) for k in cells.tolist()])
    stamp += repr(levels.tolist())
    weighed = [step_file(folder, SQUARES, k) for k in cells.tolist()]
    drives = [read_columns(path)["drive"] for path in weighed if path.is_file()]
    own = factors[[k for k in sorted({*map(int, np.concatenate(drives))}) if k < len(factors)]]
    stamp += hashlib.sha256(own.tobytes()).hexdigest()
    path = step_file(folder, PLACED, cell)
    if text_of(path, "stamp") == stamp:
        return False
    near, sign = grouped(folder, read_drives(folder), cell, VIEW_MARGIN_M)
    own = factors[near.drive]
    took = FORMAT + near.digest() + repr(levels.tolist())
    whole = hashlib.sha256(took.encode() + sign.tobytes() + own.tobytes())
    if text_of(path, "digest") == whole.hexdigest() and restamp(path, stamp):
        return False
    placed = place_signs(near.sightings, sign, near.tracks, levels, own, cell)
    a, b, s = placed.attributes, placed.adjusted, placed.sightings
    seen = b.drive_count[:, 0] > 0
    write_columns(
        path, digest=np.array(whole.hexdigest()), stamp=np.array(stamp),
        founder=near.drive[s.drive[placed.founder]] << 32 | s.row[placed.founder],
        founder_id=_texts(s.id[placed.founder]),
        member=near.drive[s.drive] << 32 | s.row, member_sign=placed.sign,
        member_id=_texts(s.id), member_class=_texts(np.array(s.classes, object)[s.code]),
        member_place=np.column_stack([s.lat, s.lon, s.height]), member_offset=b.offset,
        lat=b.lat, lon=b.lon, height=b.height, cov_enu=b.cov_enu,
        class_name=_texts(np.array(s.classes, object)[a.code]),
        class_share=a.class_share, n_views=a.n_views,
        first_gps_s=a.first_gps_s, last_gps_s=a.last_gps_s,
        height_above_road_m=a.height_above_road_m, sd_above_road_m=a.sd_above_road_m,
        facing_rad=a.facing_rad, facing_sd_rad=a.facing_sd_rad, size_m=a.size_m,
        side=_texts(a.side), status=_texts(a.status), confidence=a.confidence,
        class_probability=a.class_probability, group_probability=a.group_probability,
        path_offset_m=a.path_offset_m, contrast=a.contrast, contrast_sd=a.contrast_sd,
        contrast_note=_texts(a.contrast_note), seen_share=a.seen_share, n_looked=a.n_looked,
        n_back_views=a.n_back_views,
        own_variance=placed.own_variance, n_drives=np.array([len(d) for d in a.drives], np.int64),
        seen_by=near.drive[np.array([k for d in a.drives for k in d], np.int64)],
        pair_sign=placed.pairs.sign, pair_drive=near.drive[placed.pairs.drive],
        pair_seen=placed.pairs.seen, pair_told=placed.pairs.told,
        drive=near.drive[seen], drive_offset=b.drive_offset[seen], drive_sd=b.drive_sd[seen],
        drive_count=b.drive_count[seen],
    )  # fmt: skip
    return True


@dataclass(frozen=True)
class Homes:
    """Of each of the cells [c] that signs stand in what its places were made of, and the ``edges``
    [c + 1] between their signs."""

    digest: Sequence[str]
    edges: Sequence[int]


def placed_cells(folder: Path, cells: Sequence[int]) -> tuple[dict[str, Any], Chances, Homes]:
    """Columns of all signs [m] of some cells, ``seen_by`` of their ``n_drives`` drives each, one
    after another, the pairs of a sign and a drive, by drives' numbers, and what of the cells."""
    wanted = (
        "founder", "founder_id", "lat", "lon", "height", "cov_enu", "class_name", "class_share",
        "n_views", "first_gps_s", "last_gps_s", "height_above_road_m", "sd_above_road_m",
        "facing_rad", "facing_sd_rad", "size_m", "side", "status", "confidence", "own_variance",
        "class_probability", "group_probability", "path_offset_m", "contrast", "contrast_sd",
        "contrast_note", "seen_share", "n_looked", "n_back_views", "n_drives", "seen_by",
    )  # fmt: skip
    found: dict[str, list[Any]] = {name: [] for name in wanted}
    told = ("pair_sign", "pair_drive", "pair_seen", "pair_told")
    pairs: list[list[Any]] = [
        [np.zeros(0, kind)] for kind in (np.int64, np.int64, np.bool_, np.float64)
    ]
    count, digests, edges = 0, [], [0]
    for cell in cells:
        path = step_file(folder, PLACED, cell)
        with np.load(path, allow_pickle=False) as file:
            digests.append(str(file["digest"]))
            for name in wanted:
                found[name].append(_short(file[name]))
            for column, name in zip(pairs, told, strict=True):
                column.append(file[name] + count if name == "pair_sign" else file[name])
            count += len(found["lat"][-1])
            edges.append(count)
    columns = {name: np.concatenate(v) if v else np.zeros(0) for name, v in found.items()}
    return columns, Chances(*(np.concatenate(column) for column in pairs)), Homes(digests, edges)


class Members:
    """Sightings [n] of the signs of a cell, of which a column is read when it is asked for."""

    def __init__(self, columns: Mapping[str, Any], count: int) -> None:
        self._columns, self._count = columns, count

    @cached_property
    def name(self) -> IntArray:
        """The number of the drive in the upper half, and the row there in the lower one."""
        return np.asarray(self._columns["member"], np.int64)

    @property
    def drive(self) -> IntArray:
        """Number of the drive."""
        return self.name >> 32

    @property
    def row(self) -> IntArray:
        """Row there."""
        return self.name & 0xFFFFFFFF

    @cached_property
    def sign(self) -> IntArray:
        """The sign by its place among those of all cells."""
        return np.asarray(self._columns["member_sign"] + self._count, np.int64)

    @cached_property
    def id(self) -> np.ndarray:
        """Texts, as the drive has them."""
        return np.asarray(self._columns["member_id"])

    @cached_property
    def class_name(self) -> np.ndarray:
        """Texts, as the drive has them."""
        return np.asarray(self._columns["member_class"])

    @cached_property
    def place(self) -> FloatArray:
        """Latitude, longitude, height [n, 3] in rad, rad, m."""
        return np.asarray(self._columns["member_place"], np.float64)

    @cached_property
    def offset(self) -> FloatArray:
        """East, north, up [n, 3] in m of the drive there."""
        return np.asarray(self._columns["member_offset"], np.float64)


def members(folder: Path, cells: Sequence[int]) -> Iterator[Members]:
    """The sightings of one cell after another, in the order of ``placed_cells``; each to be used
    before the next one is asked for."""
    count = 0
    for cell in cells:
        with np.load(step_file(folder, PLACED, cell), allow_pickle=False) as file:
            yield Members(file, count)
            count += len(file["lat"])


def drive_offsets(
    folder: Path, cells: Sequence[int], number_of_drives: int
) -> tuple[FloatArray, FloatArray]:
    """Mean offset [d, 3] of each drive's sightings in some cells and its standard deviation, not
    less than the truth of it; NaN for a drive without any."""
    sums, sds, counts = np.zeros((3, number_of_drives, 3))
    for cell in cells:
        with np.load(step_file(folder, PLACED, cell), allow_pickle=False) as file:
            drive, count = file["drive"], file["drive_count"]
            sums[drive] += count * file["drive_offset"]
            sds[drive] += count * file["drive_sd"]
            counts[drive] += count
    seen = counts > 0
    counts = np.where(seen, counts, np.nan)
    return sums / counts, sds / counts


def _texts(values: Iterable[Any]) -> np.ndarray:
    return np.array([str(value) for value in values], np.str_)


def _short(column: np.ndarray) -> np.ndarray:
    """Texts, which very many signs have in common, as one object each; numbers as they are."""
    if column.dtype.kind != "U":
        return column
    return np.array([*map(sys.intern, column.tolist()), None], object)[:-1]


def grouped(
    folder: Path, drives: Drives, cell: int, path_margin_m: float | None = None
) -> tuple[Near, IntArray]:
    """What the places of a cell's signs are told from, and whose each sighting is (-1)."""
    near = read_near(folder, drives, cell, PLACE_MARGIN_M, path_margin_m)
    names, signs = _members(folder, near_cells(folder, cell, HALO_M).tolist())
    order = np.argsort(names)
    at = np.minimum(np.searchsorted(names[order], near.name), max(len(names) - 1, 0))
    if not len(names):
        return near, np.full(len(near.name), -1, np.int64)
    known = names[order][at] == near.name
    return near, np.where(known, signs[order][at], -1)


def _members(folder: Path, cells: Sequence[int]) -> tuple[IntArray, IntArray]:
    """Names of the sightings that cells have grouped, and numbers of their signs."""
    names, signs, count = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)], 0
    for cell in cells:
        path = step_file(folder, GROUPS, cell)
        if path.is_file():
            found = read_columns(path)
            names.append(found["name"])
            signs.append(found["sign"] + count)
            count += int(found["sign"].max(initial=-1)) + 1
    return np.concatenate(names), np.concatenate(signs)
