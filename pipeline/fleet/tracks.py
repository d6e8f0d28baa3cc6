"""Tracks of very many drives and the heights of the sea at their signs, for one map.

To read a drive's whole result takes a second, and a map is made again every night. So what a map of
any size takes over is kept beside the cells, a small file a drive, read from its result once.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from automap.io import names
from automap.io.atomic import atomic_path
from automap.io.json_text import parse_json
from automap.io.map_tables import TRACKS, write_tracks
from automap.records import BoolArray, FloatArray, Trajectory
from pipeline.fleet.contents import result_folder, version
from pipeline.fleet.own_names import OwnNames
from pipeline.fleet.store import Entry, Store
from pipeline.merge.cell_steps import members
from pipeline.merge.cell_store import read_drives
from pipeline.merge.whole import MANY_DRIVES, drive_essentials

KEPT = "tracks"
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
) -> FloatArray:
    """Mean height of the geoid at each sign [m] of the cells ``homes``, NaN where none of the
    drives tells it or it is not ``in_map``; tracks, of ``MOST_ROWS`` rows in all, go into the map
    ``out`` as they are read, in the order of the drives' starts."""
    drives = read_drives(cells)
    order = np.argsort(drives.rank).tolist()
    files = {k: keep_track(store, cells, drives.key[k], entries[drives.key[k]]) for k in order}
    every = -(-sum(map(_rows, files.values())) // MOST_ROWS)
    named = None
    heights: dict[int, list[float]] = {}

    def tracks() -> Iterator[tuple[str, Trajectory]]:
        nonlocal named
        for k in order:
            each = _read(files[k])
            if each.geoid_m:
                named = named or OwnNames(members(cells, homes), in_map)
                own = named.of(k)
                for name, height in each.geoid_m.items():
                    if name in own:
                        heights.setdefault(own[name], []).append(height)
            if each.track is not None:
                yield drives.name[k], _every(each.track, every)

    write_tracks(out / TRACKS, tracks())
    geoid = np.full(len(in_map), np.nan)
    for sign, told in heights.items():
        geoid[sign] = np.mean(told)
    return geoid


def _every(track: Trajectory, step: int) -> Trajectory:
    if step <= 1:
        return track
    rows = np.union1d(np.arange(0, len(track), step), [len(track) - 1])
    return Trajectory(**{name: values[rows] for name, values in vars(track).items()})


def _rows(path: Path) -> int:
    """Of the track that is kept."""
    with np.load(path, allow_pickle=False) as file:
        return len(file["t_ns"]) if "t_ns" in file else 0


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
