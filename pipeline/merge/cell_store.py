"""A folder of sightings by cells: what drives brought, and what each cell needs of it."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from automap.io.atomic import atomic_path
from automap.io.cell_tables import read_points, write_points
from automap.io.tables import read_table
from automap.mapping.cells import beside, cell_named, cell_of, groups, meets, quadkey, squares
from automap.mapping.identity import drive_key
from automap.mapping.sightings import UNTOLD, CameraView, DriveSigns, Sightings, stack_sightings
from automap.mapping.visibility import STRIDE
from automap.records import DrivePath, FloatArray, IntArray
from automap.records.signs import BY_SIZE
from pipeline.merge.cell_parts import pack, parts

if TYPE_CHECKING:
    import pyarrow as pa

DRIVES, SIGHTINGS, PATHS = "drives", "sightings", "paths"
GROUPS, SQUARES, PLACED, COVERED = "groups", "squares", "placed", "covered"
_WIDE = {"own": ("own_ee", "own_en", "own_nn"), "shared_sd": ("shared_e", "shared_n", "shared_u")}
_PLAIN = (
    "row", "time_s", "lat", "lon", "height", "per_lat", "per_lon", "own_u", "facing",
    "confidence", "id", "n_views", "first_gps_s", "last_gps_s", "height_above_road_m",
    "sd_above_road_m", "facing_sd_rad", "size_m", "side", "status", "class_probability",
    "group_probability", "existence", "path_offset_m", "contrast", "contrast_sd", "contrast_note",
    "seen_share", "n_looked", "n_back_views", *BY_SIZE,
)  # fmt: skip


@dataclass(frozen=True)
class Track:
    """What a drive did near a cell."""

    path: DrivePath | None
    cameras: Sequence[CameraView]


@dataclass(frozen=True)
class Drives:
    """Drives [d] in the order in which they were added: ``key``, ``name``, ``start_gps_s``,
    ``cameras``, and ``rank`` [d] their place by start, name and key."""

    key: Sequence[str]
    name: Sequence[str]
    start_gps_s: FloatArray
    cameras: Sequence[tuple[CameraView, ...]]
    rank: IntArray

    def __len__(self) -> int:
        return len(self.key)


@dataclass(frozen=True)
class Near:
    """Sightings [n] near a cell, their drives numbered anew in the order of the map; ``drive`` [d]
    the number of each in the store, and ``tracks`` [d]. ``name`` [n] numbers sightings once."""

    sightings: Sightings
    drive: IntArray
    tracks: Sequence[Track]
    name: IntArray

    def digest(self) -> str:
        """Of all that a cell's merge takes from here."""
        whole = hashlib.sha256()
        for field, values in vars(self.sightings).items():
            if field in ("id", "side", "status", "contrast_note", "classes"):
                whole.update("\0".join(map(str, values)).encode("utf-8", "replace"))
            else:
                whole.update(np.ascontiguousarray(values).tobytes())
        for values in (self.drive, self.name):
            whole.update(np.ascontiguousarray(values).tobytes())
        for track in self.tracks:
            whole.update(repr(track.cameras).encode())
            if track.path is not None:
                whole.update(track.path.lat_rad.tobytes() + track.path.lon_rad.tobytes())
                whole.update(track.path.yaw_rad.tobytes() + track.path.gps_s.tobytes())
        return whole.hexdigest()


def add_drives(folder: Path, drives: Sequence[DriveSigns]) -> set[int]:
    """Put drives that it has not into the store; returns the cells that they touch.

    Their table is written last: what an attempt that did not come so far left is removed. One
    process at a time.
    """
    first = len(read_drives(folder))
    batch = f"{first:08d}"
    for kind in (SIGHTINGS, PATHS):
        for left in (folder / kind).glob(f"cell=*/{batch}.parquet"):
            left.unlink()
    sightings = stack_sightings(drives)
    number = first + sightings.drive
    columns: dict[str, Any] = {name: getattr(sightings, name) for name in _PLAIN}
    for name, wide in _WIDE.items():
        columns |= {part: getattr(sightings, name)[:, k] for k, part in enumerate(wide)}
    names = np.array(sightings.classes, np.object_)
    columns |= {"drive": number, "place": np.arange(len(number)), "class": names[sightings.code]}
    cells = _write_parts(folder / SIGHTINGS, batch, columns, sightings.lat, sightings.lon)
    paths = [(first + k, drive.path) for k, drive in enumerate(drives) if drive.path is not None]
    if paths:
        # in view is what every STRIDE-th row shows
        kept = [(k, np.arange(0, len(path), STRIDE), path) for k, path in paths]
        columns = {
            "drive": np.concatenate([np.full(len(rows), k) for k, rows, _ in kept]),
            "place": np.concatenate([rows for _, rows, _ in kept]),
        } | {
            name: np.concatenate([getattr(path, name)[rows] for _, rows, path in kept])
            for name in ("gps_s", "lat_rad", "lon_rad", "yaw_rad")
        }
        cells |= _write_parts(
            folder / PATHS, batch, columns, columns["lat_rad"], columns["lon_rad"]
        )
    _write_drives(folder / DRIVES / f"{batch}.parquet", drives)
    for cell in cells:
        # stores of earlier versions lack columns
        pack(folder, SIGHTINGS, cell, UNTOLD)
        pack(folder, PATHS, cell)
    return cells


def _write_parts(
    folder: Path, batch: str, columns: Mapping[str, Any], lat: FloatArray, lon: FloatArray
) -> set[int]:
    good = np.flatnonzero(np.isfinite(lat) & np.isfinite(lon))
    home = cell_of(lat[good], lon[good])
    order = np.argsort(home, kind="stable")
    cells = set()
    for cell, at in groups(home[order]):
        rows = good[order[at]]
        part = {name: values[rows] for name, values in columns.items()}
        path = folder / f"cell={quadkey(cell)}" / f"{batch}.parquet"
        write_points(path, part, lat[rows], lon[rows])
        cells.add(cell)
    return cells


def _write_drives(path: Path, drives: Sequence[DriveSigns]) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    views = [[[c.yaw_rad, c.half_angle_rad] for c in drive.cameras] for drive in drives]
    table = pa.table(
        {
            "key": [drive_key(drive) for drive in drives],
            "name": [drive.name for drive in drives],
            "start_gps_s": [drive.start_gps_s for drive in drives],
            "cameras": [json.dumps(view) for view in views],
        }
    )
    with atomic_path(path) as temporary:
        pq.write_table(table, temporary)


def read_drives(folder: Path) -> Drives:
    """All drives of the store."""
    files = sorted((folder / DRIVES).glob("*.parquet"))
    state = [file.stat() for file in files]
    return _drives(tuple((f, s.st_size, s.st_mtime_ns) for f, s in zip(files, state, strict=True)))


@lru_cache(maxsize=1)
def _drives(files: tuple[tuple[Path, int, int], ...]) -> Drives:
    """The drives of files as they were at a time: every step of every cell asks for them."""
    key: list[str] = []
    name: list[str] = []
    start: list[float] = []
    cameras: list[tuple[CameraView, ...]] = []
    for path, _, _ in files:
        table = read_table(path, ("key", "name", "start_gps_s", "cameras"))
        key += table["key"].to_pylist()
        name += table["name"].to_pylist()
        start += table["start_gps_s"].to_pylist()
        for text in table["cameras"].to_pylist():
            cameras.append(tuple(CameraView(*view) for view in json.loads(text)))
    times = np.array(start, np.float64)
    unknown = ~np.isfinite(times)
    order = sorted(
        range(len(key)),
        key=lambda k: (bool(unknown[k]), 0.0 if unknown[k] else times[k], name[k], key[k]),
    )
    rank = np.empty(len(key), np.int64)
    rank[order] = np.arange(len(key))
    return Drives(key, name, times, cameras, rank)


def occupied(folder: Path) -> IntArray:
    """Cells that hold sightings or paths, ascending."""
    names = {path.name for kind in (SIGHTINGS, PATHS) for path in (folder / kind).glob("cell=*")}
    return np.array(sorted(cell_named(name.partition("=")[2]) for name in names), np.int64)


def near_cells(folder: Path, cell: int, margin_m: float) -> IntArray:
    """Cells that hold something and may reach within a margin of one, itself among them; those of
    all the world are listed near a pole alone, where all of them may."""
    candidates = beside(cell, margin_m)
    if candidates is None:
        return occupied(folder)
    there = [
        k
        for k in candidates
        if any((folder / kind / f"cell={quadkey(k)}").is_dir() for kind in (SIGHTINGS, PATHS))
    ]
    return np.array(there, np.int64)


def read_near(
    folder: Path, drives: Drives, cell: int, margin_m: float, path_margin_m: float | None = None
) -> Near:
    """What lies within ``margin_m`` of a cell; with ``path_margin_m`` the paths within that too."""
    cells = near_cells(folder, cell, margin_m)
    points = parts(folder, SIGHTINGS, cells)
    seen = read_points(points, _cut("lat", "lon", cell, margin_m, drives), UNTOLD)
    tracks: dict[str, Any] = {}
    if path_margin_m is not None:
        cut = _cut("lat_rad", "lon_rad", cell, path_margin_m, drives)
        tracks = read_points(parts(folder, PATHS, cells), cut)
    empty = np.zeros(0, np.int64)
    ranks = drives.rank[seen["drive"]] if seen else empty
    track_ranks = drives.rank[tracks["drive"]] if tracks else empty
    local = np.union1d(ranks, track_ranks)
    by_rank = np.argsort(drives.rank)
    number = np.asarray(by_rank[local], np.int64)
    if not seen:
        return Near(stack_sightings([]), number, [], empty)
    classes, code = np.unique(seen["class"].astype(str), return_inverse=True)
    wide = {name: np.column_stack([seen[p] for p in ps]) for name, ps in _WIDE.items()}
    drive = np.searchsorted(local, ranks)
    sightings = Sightings(
        drive=drive,
        first=np.searchsorted(drive, np.arange(len(local) + 1)),
        code=code.astype(np.int64),
        classes=tuple(str(name) for name in classes),
        **wide,
        **{name: seen[name] for name in _PLAIN},
    )
    edges = np.searchsorted(track_ranks, local), np.searchsorted(track_ranks, local, "right")
    passed = []
    for k, (lo, hi) in enumerate(zip(*(e.tolist() for e in edges), strict=True)):
        path = None
        if hi > lo:
            at = slice(lo, hi)
            path = DrivePath(
                tracks["gps_s"][at], tracks["lat_rad"][at], tracks["lon_rad"][at],
                tracks["yaw_rad"][at], np.zeros((hi - lo, 3)),
            )  # fmt: skip
        passed.append(Track(path, drives.cameras[int(number[k])]))
    name = seen["drive"].astype(np.int64) << 32 | seen["row"].astype(np.int64)
    return Near(sightings, number, passed, name)


def tracks_in(folder: Path, drives: Drives, cell: int) -> list[Track]:
    """Where the drives that the store lists looked from in a cell, drive by drive."""
    cut = _cut("lat_rad", "lon_rad", cell, 0.0, drives)
    paths = read_points(parts(folder, PATHS, [cell]), cut)
    return [
        Track(
            DrivePath(
                paths["gps_s"][at], paths["lat_rad"][at], paths["lon_rad"][at],
                paths["yaw_rad"][at], np.zeros((len(paths["gps_s"][at]), 3)),
            ),
            drives.cameras[number],
        )
        for number, at in (groups(paths["drive"]) if paths else ())
    ]  # fmt: skip


def _cut(
    lat: str, lon: str, cell: int, margin_m: float, drives: Drives
) -> Callable[[pa.Table], IntArray]:
    """Which rows of a table lie within the margin of the cell, by the drives' ranks and along each
    drive."""

    def which(table: pa.Table) -> IntArray:
        around = squares(table[lat].to_numpy(), table[lon].to_numpy(), margin_m)
        rows = np.flatnonzero(meets(cell, around))
        drive, place = (table[name].to_numpy()[rows] for name in ("drive", "place"))
        known = np.flatnonzero(drive < len(drives))
        return rows[known[np.lexsort((place[known], drives.rank[drive[known]]))]]

    return which
