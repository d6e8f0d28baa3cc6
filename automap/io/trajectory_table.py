"""Trajectories as Parquet: the result file ``trajectory.parquet`` and its kin.

Degrees and metres in the file, radians and metres in the record.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator
from pathlib import Path

import numpy as np

from automap.errors import InputError
from automap.io.tables import ROWS, column_by_column, floats, ints, vector, write_pieces
from automap.records import FloatArray, Trajectory

HIGHEST_M = 1e6
"""Of a position, by far more than aircraft reach; what is beyond is none on Earth."""
_FASTEST = 299_792_458.0
"""m/s, of light."""
_LATEST_GPS_S = 1e10
COLUMNS = (
    "t_ns",
    "gps_s",
    "lat_deg",
    "lon_deg",
    "height_m",
    "vn",
    "ve",
    "vd",
    "roll_deg",
    "pitch_deg",
    "yaw_deg",
    "sd_n_m",
    "sd_e_m",
    "sd_d_m",
    "sd_vn",
    "sd_ve",
    "sd_vd",
    "sd_roll_deg",
    "sd_pitch_deg",
    "sd_yaw_deg",
    "sd_slip_deg",
)
"""Names and order of the columns, as in the contract."""
REQUIRED = COLUMNS[:-1]
"""Those without which a file is no trajectory."""


def to_columns(trajectory: Trajectory) -> dict[str, np.ndarray]:
    """The record [n] as named columns in file units, in the order of ``COLUMNS``: of eight bytes,
    however many the record has, since tables of several drives are joined."""
    rpy_deg = np.degrees(trajectory.rpy)
    sd_rpy_deg = np.degrees(trajectory.sd_rpy)
    values = (
        trajectory.t_ns,
        trajectory.gps_s,
        np.degrees(trajectory.lat_rad),
        np.degrees(trajectory.lon_rad),
        trajectory.height_m,
        *trajectory.vel_ned.T,
        *rpy_deg.T,
        *trajectory.sd_pos_ned.T,
        *trajectory.sd_vel_ned.T,
        *sd_rpy_deg.T,
        np.degrees(trajectory.slip_sd),
    )
    t_ns, *others = zip(COLUMNS, values, strict=True)
    return dict([t_ns, *((name, np.asarray(column, np.float64)) for name, column in others)])


def from_columns(
    column: Callable[[str], FloatArray], t_ns: np.ndarray, there: Collection[str] = COLUMNS
) -> Trajectory:
    """A record from ``column(name) -> [n]`` in file units of the columns that are ``there``, and
    int64 stamps [n]."""

    def angles(*names: str) -> FloatArray:
        degrees = vector(column, names)
        return np.asarray(np.radians(degrees, out=degrees))

    def short(*names: str) -> FloatArray:
        # seven digits are more than is known of them, and half the memory of long drives
        return vector(column, names, np.float32)

    def slip() -> FloatArray:
        if "sd_slip_deg" not in there:
            return np.array(np.nan)
        every = column("sd_slip_deg")
        same = np.array_equal(every[1:], every[:-1], equal_nan=True)
        return np.radians(every[0] if same and len(every) else every)

    return Trajectory(
        t_ns=np.ascontiguousarray(t_ns, np.int64),
        gps_s=column("gps_s"),
        lat_rad=np.radians(column("lat_deg")),
        lon_rad=np.radians(column("lon_deg")),
        height_m=column("height_m"),
        vel_ned=short("vn", "ve", "vd"),
        rpy=angles("roll_deg", "pitch_deg", "yaw_deg"),
        sd_pos_ned=short("sd_n_m", "sd_e_m", "sd_d_m"),
        sd_vel_ned=short("sd_vn", "sd_ve", "sd_vd"),
        sd_rpy=np.radians(short("sd_roll_deg", "sd_pitch_deg", "sd_yaw_deg")),
        slip_sd=slip(),
    )


def write_trajectory(path: Path, trajectory: Trajectory | Iterable[Trajectory]) -> None:
    """Write a trajectory, or its stretches, atomically with the columns of the contract."""
    pieces = _cut(trajectory) if isinstance(trajectory, Trajectory) else trajectory
    write_pieces(path, (to_columns(piece) for piece in pieces))


def _cut(whole: Trajectory) -> Iterator[Trajectory]:
    for a in range(0, max(len(whole), 1), ROWS):
        yield whole.at(slice(a, a + ROWS))


def read_trajectory(path: Path) -> Trajectory:
    """Read what ``write_trajectory`` wrote; InputError when it is missing or damaged."""
    with column_by_column(path, REQUIRED, COLUMNS, ("t_ns",)) as (schema, read):
        trajectory = from_columns(
            lambda name: floats(read(name), name), ints(read("t_ns"), "t_ns"), schema.names
        )
    if len(trajectory) and not _is_plausible(trajectory):
        raise InputError(f"{path} holds no positions on Earth; run the drive again with --force.")
    return trajectory


def _is_plausible(trajectory: Trajectory) -> bool:
    """Whether a position is known and no row lies beyond what can be; rows may have gaps."""
    most = (
        (trajectory.lat_rad, 0.5 * np.pi + 1e-9),
        (trajectory.height_m, HIGHEST_M),
        (trajectory.gps_s, _LATEST_GPS_S),
        (trajectory.vel_ned, _FASTEST),
    )
    # reduced without a copy; what is unknown is none of these
    beyond = any(
        np.fmax.reduce(values, axis=None) > limit or np.fmin.reduce(values, axis=None) < -limit
        for values, limit in most
    )
    return bool(np.isfinite(trajectory.lat_rad).any() and not beyond)
