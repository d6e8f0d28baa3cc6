"""Where the cameras of a map's drives looked, for the next comparison."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from automap.mapping.visibility import Passage
from automap.records import DrivePath, FloatArray, IntArray
from pipeline.merge.cell_files import covered_file, is_done, path_stamp, write_columns
from pipeline.merge.cell_store import Drives, tracks_in

_CELL_RAD = 8.0 / 6.371e6
_SECTORS = 16


def coverage_of(drives: Iterable[Passage]) -> DrivePath:
    """Where cameras looked from and which way, thinned to cells of 8 m and 16 directions."""
    none = np.zeros(0)
    parts = [(np.zeros(0, np.int64), none, none, none)]
    for drive in drives:
        if drive.path is None:
            continue
        filmed = np.isfinite(drive.path.yaw_rad)
        lat, lon = drive.path.lat_rad[filmed], drive.path.lon_rad[filmed]
        for camera in drive.cameras:
            looking = drive.path.yaw_rad[filmed] + camera.yaw_rad
            cell = _cells(lat, lon, looking)
            cell, first = np.unique(cell, return_index=True)
            parts.append((cell, lat[first], lon[first], looking[first]))
    cell, lat, lon, looking = (np.concatenate([part[k] for part in parts]) for k in range(4))
    _, first = np.unique(cell, return_index=True)
    first.sort()
    zero: FloatArray = np.zeros(len(first))
    return DrivePath(zero, lat[first], lon[first], looking[first], np.zeros((len(first), 3)))


def _cells(lat: FloatArray, lon: FloatArray, looking: FloatArray) -> IntArray:
    """One number for each place and direction."""
    row = np.floor(lat / _CELL_RAD).astype(np.int64)
    column = np.floor(lon * np.cos(row * _CELL_RAD) / _CELL_RAD).astype(np.int64)
    sector = np.floor((looking % (2 * np.pi)) / (2 * np.pi) * _SECTORS).astype(np.int64)
    return np.asarray((row * 2**24 + column) * _SECTORS + sector, np.int64)


def cover(folder: Path, drives: Drives, cell: int) -> tuple[DrivePath, float]:
    """The coverage of a cell of a store and when it was passed last, GPS seconds (NaN never): what
    is kept of it where no path there is new."""
    path, stamp = covered_file(folder, cell), path_stamp(folder, cell)
    if not is_done(path, stamp):
        tracks = tracks_in(folder, drives, cell)
        found = coverage_of(tracks)
        times = [t.path.gps_s.max() for t in tracks if t.path is not None]
        write_columns(
            path, stamp=np.array(stamp), lat=found.lat_rad, lon=found.lon_rad, yaw=found.yaw_rad,
            last=np.array(max(times, default=np.nan)),
        )  # fmt: skip
    with np.load(path, allow_pickle=False) as file:
        n = len(file["lat"])
        looked = DrivePath(np.zeros(n), file["lat"], file["lon"], file["yaw"], np.zeros((n, 3)))
        return looked, float(file["last"])
