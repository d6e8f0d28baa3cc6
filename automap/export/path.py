"""The driven path as few points with what a map shows of them."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass, fields

import numpy as np

from automap.export.clock import TimeArray, utc_of_gps
from automap.export.sign_columns import wrap_degrees
from automap.export.simplify import keep_indices
from automap.records import FloatArray, IntArray, Trajectory

THIN_RATE_HZ = 10.0
POINT_LIMIT = 20_000


@dataclass(frozen=True)
class Path:
    """Points [n] of a trajectory: ``row`` in it, longitude, latitude (deg), ellipsoidal height
    (m), ``rpy_deg`` [n, 3], speed (m/s), horizontal sigma (m, north and east together),
    vertical sigma, host stamp and UTC (NaT when unknown); ``drives`` the name and the number of
    points of each drive, in their order, where there are several."""

    row: IntArray
    lon_deg: FloatArray
    lat_deg: FloatArray
    height_m: FloatArray
    rpy_deg: FloatArray
    speed_m_s: FloatArray
    sd_h_m: FloatArray
    sd_d_m: FloatArray
    t_ns: IntArray
    utc: TimeArray
    drives: tuple[tuple[str, int], ...] = ()

    def __len__(self) -> int:
        return len(self.row)

    @property
    def pieces(self) -> list[tuple[str, slice]]:
        """Each drive's name ("" of the only one) and its points."""
        edges = np.cumsum([0, *(n for _, n in self.drives or (("", len(self)),))]).tolist()
        names = [name for name, _ in self.drives or (("", 0),)]
        return [
            (name, slice(a, b))
            for name, (a, b) in zip(names, itertools.pairwise(edges), strict=True)
        ]

    @property
    def runs(self) -> list[slice]:
        """Points between which the path does not jump from one end of the map to the other, nor
        from one drive to another."""
        return [
            slice(piece.start + run.start, piece.start + run.stop)
            for _, piece in self.pieces
            for run in split_at_date_line(self.lon_deg[piece])
        ]

    def part(self, rows: slice) -> Path:
        """Some points of it, of one drive."""
        values = {f.name: getattr(self, f.name)[rows] for f in fields(self) if f.name != "drives"}
        return Path(**values)


def joined_paths(paths: Mapping[str, Path]) -> Path:
    """The paths of several drives, by name, as one."""
    columns = {
        f.name: np.concatenate([getattr(path, f.name) for path in paths.values()])
        for f in fields(Path)
        if f.name != "drives"
    }
    return Path(**columns, drives=tuple((name, len(path)) for name, path in paths.items()))


def simplified_path(
    trajectory: Trajectory, tolerance_m: float = 0.1, max_step_s: float = 10.0
) -> Path:
    """Rows of a trajectory that show its course to ``tolerance_m`` in space at any time.

    At least one row every ``max_step_s``, at most some 20,000 in all; rows without a
    position are left out.
    """
    from automap.earth import metres_per_radian

    good = np.flatnonzero(np.isfinite(trajectory.lat_rad) & np.isfinite(trajectory.lon_rad))
    if len(good) == 0:
        return _take(trajectory, good)
    seconds = (trajectory.t_ns[good] - trajectory.t_ns[good[0]]) * 1e-9
    # at most ten rows a second take part; the last row always does
    slot = np.floor(seconds * THIN_RATE_HZ)
    thin = np.flatnonzero(np.diff(slot, prepend=-1.0) > 0)
    thin = np.union1d(thin, [len(good) - 1])
    rows, seconds = good[thin], seconds[thin]
    lat, lon, height = (
        trajectory.lat_rad[rows],
        np.unwrap(trajectory.lon_rad[rows]),
        np.nan_to_num(trajectory.height_m[rows]),
    )
    north, east = metres_per_radian(lat, height)
    metres = np.column_stack(
        [(lat - lat[0]) * north[0], (lon - lon[0]) * east[0], height - height[0]]
    )
    kept = keep_indices(seconds, metres, tolerance_m, POINT_LIMIT)
    paced = np.flatnonzero(np.diff(np.floor(seconds / max_step_s), prepend=-1.0) > 0)
    if len(kept) + len(paced) <= POINT_LIMIT:
        kept = np.union1d(kept, paced)
    return _take(trajectory, rows[kept])


def _take(trajectory: Trajectory, rows: IntArray) -> Path:
    sd = trajectory.sd_pos_ned[rows]
    return Path(
        row=rows,
        lon_deg=wrap_degrees(np.degrees(trajectory.lon_rad[rows])),
        lat_deg=np.degrees(trajectory.lat_rad[rows]),
        height_m=trajectory.height_m[rows],
        rpy_deg=np.degrees(trajectory.rpy[rows]),
        speed_m_s=np.sqrt((np.nan_to_num(trajectory.vel_ned[rows]) ** 2).sum(axis=1)),
        sd_h_m=np.hypot(sd[:, 0], sd[:, 1]),
        sd_d_m=sd[:, 2],
        t_ns=trajectory.t_ns[rows],
        utc=utc_of_gps(trajectory.gps_s[rows]),
    )


def split_at_date_line(lon_deg: FloatArray) -> list[slice]:
    """Runs of points [n] between which the path does not jump from one end of the map to
    the other."""
    cuts = np.flatnonzero(np.abs(np.diff(lon_deg)) > 180.0) + 1
    edges = [0, *cuts.tolist(), len(lon_deg)]
    return [slice(a, b) for a, b in itertools.pairwise(edges) if b > a]
