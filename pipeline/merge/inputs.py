"""What ``automap merge`` reads of each run: where the drive looked, and how surely."""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from automap.errors import AutoMapError, InputError
from automap.export.clock import clock_from_trajectory
from automap.io import names
from automap.mapping.grid import east_north
from automap.mapping.sightings import DriveSigns
from automap.records import ClockModel, DrivePath, FloatArray, IntArray, Trajectory
from pipeline.merge.cameras import cameras_of_run
from pipeline.merge.distinct import Candidate, candidate
from pipeline.merge.doubles import marks_of
from pipeline.merge.signs import sign_columns
from pipeline.shared.run_record import country_of, drive_of, unlike_record, written_results
from pipeline.shared.values import json_object

if TYPE_CHECKING:
    import pyarrow as pa

STEP_M = 4.0
"""The path is thinned to a row every so many metres."""
_PATH_COLUMNS = ("t_ns", "gps_s", "lat_deg", "lon_deg", "yaw_deg", "sd_n_m", "sd_e_m", "sd_d_m")
_SLACK_S = 10.0

_NO_RECORDINGS = (".onnx", ".toml")
"""Models and calibrations: a run with others is of the same recording."""


@dataclass(frozen=True)
class RunSigns:
    """A run ready to be merged: its ``folder``, ``signs``, sentences about what is missing, the
    country that its drive names (None unknown), and what speaks for it among other runs of its
    recording."""

    folder: Path
    signs: DriveSigns
    warnings: tuple[str, ...]
    country: str | None
    candidate: Candidate


def read_run(folder: Path) -> RunSigns:
    """Read one output folder.

    Raises InputError when it is no output of a run, or a map that was merged already.
    """
    if not folder.is_dir():
        raise InputError(f"{folder}: no such output folder; give folders that automap run wrote.")
    if (folder / names.MERGE).is_file():
        raise InputError(
            f"{folder} is a merged map; give the output folders it was made of, and the map "
            "itself with --previous."
        )
    warnings: list[str] = []
    record = json_object(folder / names.RUN)
    if not record and (folder / names.RUN).is_file():
        warnings.append(
            f"{folder / names.RUN} is damaged: cameras, country and what names the recording are "
            "not known; run again with --force."
        )
    table = _trajectory(folder, warnings)
    clock = None if table is None else _clock_of(table)
    if clock is None:
        clock = _clock(folder)
    columns = sign_columns(folder, clock, warnings)
    written = written_results(record)
    unlike = (unlike_record(folder, written, n) for n in (names.SIGNS_RAW, names.TRAJECTORY))
    warnings += [text for text in unlike if text]
    path = None if table is None else _path(table)
    cameras = cameras_of_run(folder, record)
    if path is None and len(columns["ids"]):
        warnings.append(
            f"{folder}: without a trajectory nothing tells what its signs' errors have in common, "
            "nor what it should have seen."
        )
    if not len(columns["ids"]) and not cameras:
        warnings.append(f"{folder}: it has neither signs nor a camera, and says nothing of signs.")
    stamps = _detection_stamps(folder / names.OBSERVATIONS, warnings)
    if path is not None:
        path = _while_filmed(folder, path, clock, stamps)
    _set_times(columns, path)
    start = _start(path, columns)
    if not np.isfinite(start):
        warnings.append(f"{folder}: its clock is not tied to GPS time, so its signs have no date.")
    signs = DriveSigns(
        name=drive_of(folder)[0],
        start_gps_s=start,
        path=path,
        cameras=cameras,
        key=_recording_key(record),
        **columns,
    )
    marks = marks_of(folder, clock, stamps)
    known = candidate(str(folder), signs.key, marks, record.get("verdict"), folder)
    return RunSigns(folder, signs, tuple(warnings), country_of(record), known)


def _recording_key(record: dict[str, Any]) -> str:
    """A name of the recording made from the digests of what the run read; "" when unknown."""
    inputs = record.get("inputs")
    if not isinstance(inputs, dict) or not inputs:
        return ""
    digests = sorted(
        str(value.get("sha256", value) if isinstance(value, dict) else value)
        for name, value in inputs.items()
        if not name.endswith(_NO_RECORDINGS)
    )
    if not digests:
        return ""
    return hashlib.sha256("\n".join(digests).encode()).hexdigest()[:16]


def _clock(folder: Path) -> ClockModel | None:
    from automap.io.clock_json import read_clock

    try:
        return read_clock(folder / names.SYNC)
    except AutoMapError:
        return None


def _trajectory(folder: Path, warnings: list[str]) -> pa.Table | None:
    """Rows of the trajectory that the signs rest on, some metres apart."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    for name in (names.TRAJECTORY_ADJUSTED, names.TRAJECTORY):
        path = folder / name
        if not path.is_file():
            continue
        try:
            with pq.ParquetFile(path) as file:
                table = _as_numbers(file.read(list(_PATH_COLUMNS), use_threads=False))
        except (pa.ArrowException, OSError, ValueError) as error:
            warnings.append(f"{path} is left out: {str(error).splitlines()[0]}")
            continue
        missing = [c for c in _PATH_COLUMNS if c not in table.column_names]
        if missing:
            warnings.append(f"{path} is left out: it lacks the column {missing[0]}.")
        elif len(table) > 1:
            return _thinned(table)
    return None


def _as_numbers(table: pa.Table) -> pa.Table:
    """Every column as real numbers, stamps as whole ones; ArrowException where one is not."""
    import pyarrow as pa

    kinds = [(n, pa.int64() if n == "t_ns" else pa.float64()) for n in table.column_names]
    return table.cast(pa.schema([pa.field(name, kind, kind != pa.int64()) for name, kind in kinds]))


def _thinned(table: pa.Table) -> pa.Table:
    lat = np.radians(np.asarray(table["lat_deg"].to_numpy(), np.float64))
    lon = np.radians(np.asarray(table["lon_deg"].to_numpy(), np.float64))
    good = np.flatnonzero((np.abs(lat) <= np.pi) & (np.abs(lon) <= 3.0 * np.pi))
    if len(good) < 2:
        return table.slice(0, 0)
    east = np.diff(np.unwrap(lon[good])) * np.cos(lat[good][1:])
    gone = np.concatenate([[0.0], np.cumsum(6.371e6 * np.hypot(east, np.diff(lat[good])))])
    keep = np.concatenate([[True], np.diff(np.floor(gone / STEP_M)) > 0])
    keep[-1] = True
    return table.take(good[keep])


def _clock_of(table: pa.Table) -> ClockModel | None:
    n = len(table)
    if n < 2:
        return None
    blank = np.zeros(n)
    three = np.zeros((n, 3))
    t_ns = np.asarray(table["t_ns"].to_numpy(), np.int64)
    gps_s = np.asarray(table["gps_s"].to_numpy(), np.float64)
    return clock_from_trajectory(
        Trajectory(t_ns, gps_s, blank, blank, blank, three, three, three, three, three)
    )


def _path(table: pa.Table) -> DrivePath:
    def column(name: str) -> FloatArray:
        return np.asarray(table[name].to_numpy(), np.float64)

    return DrivePath(
        gps_s=column("gps_s"),
        lat_rad=np.radians(column("lat_deg")),
        lon_rad=np.radians(column("lon_deg")),
        yaw_rad=np.radians(column("yaw_deg")),
        sd_enu=np.column_stack([column("sd_e_m"), column("sd_n_m"), column("sd_d_m")]),
    )


def even_path(track: Trajectory) -> DrivePath:
    """A track's rows as those of a run's path are: some metres apart, however slow the drive was,
    or however coarse the track is."""
    from automap.earth import metres_per_radian

    north, east = metres_per_radian(track.lat_rad, 0.0)
    lon = np.unwrap(track.lon_rad)
    step = np.hypot(np.diff(track.lat_rad) * north[1:], np.diff(lon) * east[1:])
    gone = np.concatenate([[0.0], np.cumsum(step)])
    at = np.arange(0.0, gone[-1] + STEP_M, STEP_M)
    lat, lon, yaw = (
        np.interp(at, gone, v) for v in (track.lat_rad, lon, np.unwrap(track.rpy[:, 2]))
    )
    return DrivePath(np.zeros(len(at)), lat, lon, yaw, np.zeros((len(at), 3)))


def _while_filmed(
    folder: Path, path: DrivePath, clock: ClockModel | None, stamps: IntArray | None
) -> DrivePath:
    """The path while the cameras saw anything at all, by the first and last detection.

    Its sds are kept for all times: only the heading is struck out, so that nothing is in view
    from there.
    """
    if stamps is not None and len(stamps) == 0 and _searched_nothing(folder):
        # a video that could not be read
        yaw = np.full_like(path.yaw_rad, np.nan)
        return DrivePath(path.gps_s, path.lat_rad, path.lon_rad, yaw, path.sd_enu)
    if clock is None or stamps is None or len(stamps) == 0:
        return path
    first, last = clock.gps_s(np.array([stamps.min(), stamps.max()]))
    outside = (path.gps_s < first - _SLACK_S) | (path.gps_s > last + _SLACK_S)
    yaw = np.where(outside, np.nan, path.yaw_rad)
    return DrivePath(path.gps_s, path.lat_rad, path.lon_rad, yaw, path.sd_enu)


def _searched_nothing(folder: Path) -> bool:
    """Whether the run says that it searched no picture; False where it says nothing."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        with pq.ParquetFile(folder / names.SEARCHED) as file:
            return bool(file.metadata.num_rows == 0)
    except (pa.ArrowException, OSError, ValueError):
        return False


def _detection_stamps(path: Path, warnings: list[str]) -> IntArray | None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        with pq.ParquetFile(path) as file:
            column = file.read(["t_ns"], use_threads=False)["t_ns"].drop_null()
            return np.asarray(column.cast(pa.int64()).to_numpy(), np.int64)
    except FileNotFoundError:
        return None
    except (pa.ArrowException, OSError, KeyError, ValueError) as error:
        warnings.append(
            f"{path} is left out: {str(error).splitlines()[0]} From when to when the cameras saw "
            "anything is not known."
        )
        return None


def _set_times(columns: dict[str, Any], path: DrivePath | None) -> None:
    """Give signs that no frame showed, as a reviewer put them on the map, the time when the path
    came nearest, or without a path that of the nearest sign that has one."""
    lat, lon, last = (columns[n] for n in ("lat_rad", "lon_rad", "last_gps_s"))
    known = np.isfinite(last) & np.isfinite(lat) & np.isfinite(lon)
    where = (lat[known], lon[known], last[known])
    if path is not None and (timed := np.isfinite(path.gps_s)).any():
        where = (path.lat_rad[timed], path.lon_rad[timed], path.gps_s[timed])
    for k in np.flatnonzero(~np.isfinite(last) & np.isfinite(lat)) if len(where[2]) else ():
        nearest = int(np.nanargmin(np.hypot(*east_north(where[0], where[1], lat[k], lon[k]).T)))
        columns["first_gps_s"][k] = last[k] = where[2][nearest]


def _start(path: DrivePath | None, columns: dict[str, Any]) -> float:
    times = columns["first_gps_s"] if path is None else path.gps_s
    known = times[np.isfinite(times)]
    return float(known.min()) if len(known) else math.nan
