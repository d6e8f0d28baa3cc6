"""Tracks of very many drives and the heights of the sea at their signs, for one map.

To read a drive's whole result takes a second, and a map is made again every night. So what a map of
any size takes over is kept beside the cells, a small file a drive, read from its result once. Those
of ten thousand drives are five gigabytes: rows that the older map has it gives to the next one.
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from automap.export.pieces import index_file
from automap.io import names
from automap.io.atomic import atomic_path, write_json
from automap.io.json_text import parse_json
from automap.io.map_tables import TRACKS, StoredTracks, track_table, write_track_tables
from automap.records import BoolArray, FloatArray, Trajectory
from pipeline.fleet.contents import result_folder, version
from pipeline.fleet.own_names import OwnNames
from pipeline.fleet.store import Entry, Store
from pipeline.merge.cell_steps import members
from pipeline.merge.cell_store import read_drives
from pipeline.merge.whole import MANY_DRIVES, drive_essentials
from pipeline.shared.values import json_object, mapping

KEPT, LIST = "tracks", "tracks.json"
MOST_ROWS = 2_000_000
"""Rows of all tracks: as many are some 400 MB while they are written."""
_READ = (
    names.RUN, names.SYNC, names.SIGNS_RAW, names.TRAJECTORY_ADJUSTED, names.TRAJECTORY,
    names.FIXES, names.REVIEW,
)  # fmt: skip


@dataclass(frozen=True)
class Kept:
    """A drive's ``track`` in GPS time, None without one, and the height of the geoid, m, at its
    signs by their ids."""

    track: Trajectory | None
    geoid_m: dict[str, float]


def gather_tracks(
    store: Store,
    cells: Path,
    entries: Mapping[str, Entry],
    homes: Sequence[int],
    in_map: BoolArray,
    out: Path,
    older: Path | None = None,
) -> FloatArray:
    """Mean height of the geoid at each sign [m] of the cells ``homes``, NaN where none of the
    drives tells it or it is not ``in_map``; tracks, of ``MOST_ROWS`` rows in all, go into the map
    ``out`` as they are read, in the order of the drives' starts, from an ``older`` map where it has
    the same."""
    drives = read_drives(cells)
    order = np.argsort(drives.rank).tolist()
    listed = _listed(store, cells, {key: entries[key] for key in drives.key})
    every = _step(sum(each.rows for each in listed.values()))
    made_of = {drives.name[k]: listed[drives.key[k]].version for k in order}
    rows_before = _rows_before(older, every, made_of)
    named = None
    heights: dict[int, list[float]] = {}

    def tables() -> Iterator[Any]:
        nonlocal named
        for k in order:
            key, name = drives.key[k], drives.name[k]
            rows = rows_before(name)
            if listed[key].heights or (listed[key].rows and rows is None):
                each = _read(keep_track(store, cells, key, entries[key]))
                if each.geoid_m:
                    named = named or OwnNames(members(cells, homes), in_map)
                    own = named.of(k)
                    for sign, height in each.geoid_m.items():
                        if sign in own:
                            heights.setdefault(own[sign], []).append(height)
                if rows is None and each.track is not None and len(each.track):
                    rows = track_table(name, _every(each.track, every))
            if rows is not None:
                yield rows

    write_track_tables(out / TRACKS, tables())
    if (out / TRACKS).is_file():
        told = {"every": every, "crc": _crc(out / TRACKS), "drives": made_of}
        write_json(index_file(out / TRACKS), told)
    geoid = np.full(len(in_map), np.nan)
    for sign, own_m in heights.items():
        geoid[sign] = np.mean(own_m)
    return geoid


def _rows_before(
    older: Path | None, every: int, made_of: Mapping[str, str]
) -> Callable[[str], Any]:
    """What gives the rows of a drive by its name as an older map has them, None where it has none
    of this result, or other ones."""
    told = {} if older is None else json_object(index_file(older / TRACKS))
    with suppress(OSError):
        if (
            older is not None
            and told.get("every") == every
            and told.get("crc") == _crc(older / TRACKS)
        ):
            before, stored = mapping(told.get("drives")), StoredTracks(older / TRACKS)
            same = {name for name in stored if before.get(name) == made_of.get(name)}
            return lambda name: stored.table(name) if name in same else None
    return lambda name: None


def _crc(path: Path) -> int:
    """Of a file: what has changed on the disk is not handed on."""
    crc = 0
    with path.open("rb") as stream:
        while block := stream.read(1 << 20):
            crc = zlib.crc32(block, crc)
    return crc


def _step(rows: int) -> int:
    """Of how many rows one is taken, so that of so many no more than ``MOST_ROWS`` are: rounded up
    to two binary digits behind the first. It changes with a fifth more drives, not every few nights
    and with it the tracks of all."""
    step = 1
    while rows > step * MOST_ROWS:
        step += max(1 << step.bit_length() - 1 >> 2, 1)
    return step


def _every(track: Trajectory, step: int) -> Trajectory:
    if step <= 1:
        return track
    rows = np.union1d(np.arange(0, len(track), step), [len(track) - 1])
    return Trajectory(**{name: values[rows] for name, values in vars(track).items()})


class _Listed(NamedTuple):
    """Of a drive the result that what is kept is of, and how many rows and heights these are."""

    version: str
    rows: int
    heights: int


def _listed(store: Store, cells: Path, entries: Mapping[str, Entry]) -> dict[str, _Listed]:
    """What is kept of the drives, by their keys: to open ten thousand files takes longer than to
    read one list."""
    known, found = json_object(cells / LIST), {}
    for key, entry in entries.items():
        told = known.get(key)
        if isinstance(told, list) and len(told) == 3 and told[0] == version(entry):
            found[key] = _Listed(*told)
            continue
        with np.load(keep_track(store, cells, key, entry), allow_pickle=False) as file:
            rows = len(file["t_ns"]) if "t_ns" in file else 0
            found[key] = _Listed(version(entry), rows, len(parse_json(str(file["geoid_m"]))))
    write_json(cells / LIST, found)
    return found


def _read(path: Path) -> Kept:
    with np.load(path, allow_pickle=False) as file:
        columns = {f.name: file[f.name] for f in fields(Trajectory) if f.name in file}
        return Kept(
            Trajectory(**columns) if columns else None,
            parse_json(str(file["geoid_m"])),
        )


def keep_track(store: Store, cells: Path, key: str, entry: Entry) -> Path:
    """The file of what is kept of a drive, made where it is not of its last result.

    Raises InputError for a result that cannot be read.
    """
    path = cells / KEPT / f"{key}.npz"
    wanted = version(entry)
    if path.is_file():
        with np.load(path, allow_pickle=False) as file:
            if str(file["version"]) == wanted:
                return path
    with result_folder(store, entry, _READ) as folder:
        track, geoid_m = drive_essentials(folder)
    with atomic_path(path) as temporary, temporary.open("wb") as stream:
        np.savez(
            stream,
            version=np.array(wanted),
            geoid_m=np.array(json.dumps(geoid_m)),
            **({} if track is None else vars(track)),
        )
    return path


def has_tracks(store: Store, drives: int) -> bool:
    """Whether the map of so many drives has their tracks and heights from what is kept of them, and
    nothing else of their results."""
    return drives > MANY_DRIVES or store.place.folder is None


def left_out(remote: bool) -> str:
    """What a map of an object store, or of more than ``MANY_DRIVES``, has not, and why."""
    why = (
        "an object store would have to send them all for every map"
        if remote
        else f"of more than {MANY_DRIVES} drives they are gigabytes, read again for every map"
    )
    return f"Pictures and observations stay in the drives' folders: {why}."
