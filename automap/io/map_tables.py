"""Tables that only a merged map has: its sightings, and where its drives looked."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import fields
from functools import lru_cache
from itertools import chain, pairwise
from pathlib import Path
from typing import Any

import numpy as np

from automap.io.atomic import atomic_path
from automap.io.tables import floats, ints, read_table, write_columns, write_row_groups
from automap.io.trajectory_table import COLUMNS, REQUIRED, from_columns, to_columns
from automap.records import DrivePath, Trajectory

SIGHTINGS = "sightings.parquet"
COVERAGE = "coverage.parquet"
TRACKS = "tracks.parquet"
_TEXTS = ("key", "drive", "drive_sign", "sign_id")
_TRACK_ROWS = 1 << 17
"""Rows of tracks that are written and read at once, 20 MB, or those of a drive."""


def write_sightings(
    path: Path, texts: Mapping[str, Sequence[str]], numbers: Mapping[str, Any]
) -> None:
    """Write one row per sighting: text columns ("" becomes null) and number columns [n]."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    columns: dict[str, Any] = {
        name: pa.array([value or None for value in values], pa.string()).dictionary_encode()
        if name != "key"
        else pa.array(values, pa.string())
        for name, values in texts.items()
    }
    columns |= {name: pa.array(np.asarray(v), from_pandas=True) for name, v in numbers.items()}
    with atomic_path(path) as temporary:
        pq.write_table(pa.table(columns), temporary, compression="zstd")


def read_members(path: Path) -> dict[str, str]:
    """The sign of every sighting of an older map, by the sighting's key; "" where it had none."""
    table = read_table(path, ("key", "sign_id"))
    return dict(
        zip(
            table["key"].to_pylist(),
            [value or "" for value in table["sign_id"].to_pylist()],
            strict=True,
        )
    )


def write_tracks(path: Path, tracks: Iterable[tuple[str, Trajectory]]) -> None:
    """Write the trajectories of several drives, with their names, one after another; no file where
    there are none."""
    write_track_tables(path, (track_table(*track) for track in tracks))


def write_track_tables(path: Path, tables: Iterator[Any]) -> None:
    """The same from the tables of the drives."""
    first = next(tables, None)
    if first is None:
        return
    with atomic_path(path) as temporary:
        write_row_groups(temporary, chain([first], tables), _TRACK_ROWS, compression="zstd")


def track_table(name: str, trajectory: Trajectory) -> Any:
    """The rows of a drive as they are stored."""
    import pyarrow as pa

    columns = {"drive": np.full(len(trajectory), name, object), **to_columns(trajectory)}
    return pa.table({key: pa.array(v, from_pandas=True) for key, v in columns.items()})


class StoredTracks(Mapping[str, Trajectory]):
    """What ``write_tracks`` of this version wrote, of which a few drives at a time are in memory.
    Those next to each other are read together."""

    def __init__(self, path: Path) -> None:
        import pyarrow.parquet as pq

        self._path = path
        self._spans: dict[str, list[tuple[int, int, int]]] = {}
        with pq.ParquetFile(path) as file:
            for group in range(file.num_row_groups):
                named = file.read_row_group(group, ["drive"], use_threads=False)["drive"]
                coded = named.combine_chunks().dictionary_encode()
                number = np.asarray(coded.indices)
                cuts = np.flatnonzero(np.diff(number, prepend=-1)).tolist()
                for lo, hi in pairwise([*cuts, len(number)]):
                    name = coded.dictionary[int(number[lo])].as_py()
                    self._spans.setdefault(name, []).append((group, lo, hi))
        self._rows = lru_cache(maxsize=1)(self._table)
        self._read = lru_cache(maxsize=1)(self._group)

    def __len__(self) -> int:
        return len(self._spans)

    def __iter__(self) -> Iterator[str]:
        return iter(self._spans)

    def __getitem__(self, name: str) -> Trajectory:
        parts = []
        for group, lo, hi in self._spans[name]:
            whole = vars(self._read(group))
            parts.append({field: values[lo:hi] for field, values in whole.items()})
        if len(parts) == 1:
            return Trajectory(**parts[0])
        return Trajectory(
            **{field: np.concatenate([part[field] for part in parts]) for field in parts[0]}
        )

    def table(self, name: str) -> Any:
        """The rows of a drive as they are stored."""
        import pyarrow as pa

        spans = self._spans[name]
        return pa.concat_tables([self._rows(group).slice(lo, hi - lo) for group, lo, hi in spans])

    def _table(self, group: int) -> Any:
        import pyarrow.parquet as pq

        with pq.ParquetFile(self._path) as file:
            return file.read_row_group(group, use_threads=False)

    def _group(self, group: int) -> Trajectory:
        table = self._rows(group)
        return from_columns(lambda name: floats(table, name), ints(table, "t_ns"))


def read_tracks(path: Path) -> dict[str, Trajectory]:
    """Read what ``write_tracks`` wrote."""
    table = read_table(path, ("drive", *REQUIRED), COLUMNS, ("t_ns",))
    there = table.column_names
    whole = from_columns(lambda name: floats(table, name), ints(table, "t_ns"), there)
    named = table["drive"].combine_chunks().dictionary_encode()
    number = np.asarray(named.indices)
    rows = np.argsort(number, kind="stable")
    edges = np.searchsorted(number[rows], np.arange(len(named.dictionary) + 1))
    return {
        name: Trajectory(*(getattr(whole, f.name)[rows[lo:hi]] for f in fields(Trajectory)))
        for name, (lo, hi) in zip(named.dictionary.to_pylist(), pairwise(edges), strict=True)
    }


def write_coverage(path: Path, coverage: DrivePath) -> None:
    """Write where cameras looked from, one row per place and direction."""
    write_columns(
        path,
        {
            "lat_deg": np.degrees(coverage.lat_rad),
            "lon_deg": np.degrees(coverage.lon_rad),
            "looking_deg": np.degrees(coverage.yaw_rad),
        },
    )


def read_coverage(path: Path) -> DrivePath:
    """Read what ``write_coverage`` wrote."""
    columns = ("lat_deg", "lon_deg", "looking_deg")
    table = read_table(path, columns, columns)
    lat, lon, looking = (np.radians(floats(table, name)) for name in columns)
    return DrivePath(np.zeros(len(lat)), lat, lon, looking, np.zeros((len(lat), 3)))
