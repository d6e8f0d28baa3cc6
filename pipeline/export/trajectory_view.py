"""Which trajectory of a run is exported: of which point, at which instants, which pass."""

from __future__ import annotations

import difflib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from automap.errors import AutoMapError, ConfigError, InputError
from automap.export.trajectory_instants import at_instants
from automap.io import names
from automap.lever_arm import moved_to
from automap.records import FARTHEST_ARM_M, FloatArray, IntArray, Trajectory
from pipeline.shared.run_record import drive_of


@dataclass(frozen=True)
class TrajectoryView:
    """What of the trajectory is wanted.

    ``at`` a CSV with the instants, None for the trajectory's own rows; ``point`` "imu",
    "antenna", a camera's name or "x,y,z"; ``filtered`` the forward filter's.
    """

    at: Path | None = None
    point: str = "imu"
    filtered: bool = False

    @property
    def is_plain(self) -> bool:
        """Whether it is the trajectory as it stands in OUT."""
        return self.at is None and self.point == "imu" and not self.filtered


def viewed(out: Path, trajectory: Trajectory, view: TrajectoryView) -> Trajectory:
    """The trajectory of ``out`` as the view wants it.

    Raises ConfigError for a point that is not known, InputError for instants that cannot be read
    or lie outside, and where the run has no forward filter's trajectory.
    """
    if view.filtered:
        trajectory = _filtered(out)
    trajectory = moved_to(trajectory, lever_arm(out, view.point))
    if view.at is None:
        return trajectory
    t_ns, gps_s = read_instants(view.at)
    try:
        return at_instants(trajectory, t_ns, gps_s)
    except InputError as error:
        raise InputError(f"{view.at}: {error}") from None


def _filtered(out: Path) -> Trajectory:
    from automap.io.trajectory_table import read_trajectory

    path = out / names.TRAJECTORY_FILTER
    if not path.is_file():
        raise InputError(
            f"{path} is not there: only the fusion of an IMU with GPS has a forward filter's "
            "trajectory; leave --filtered out."
        )
    return read_trajectory(path)


def read_instants(path: Path) -> tuple[IntArray | None, FloatArray | None]:
    """Column ``t_ns`` (the trajectory's stamps) or else ``gps_s`` [n] of a CSV.

    Raises InputError for a file without either, or with a row that has no number there.
    """
    from automap.io.csv_columns import read_columns

    table = read_columns(path, {}, {"t_ns": "int", "gps_s": "float"})
    bad = table.warnings()
    gps_s = table.floats("gps_s")
    if bad or ("t_ns" not in table.columns and not np.isfinite(gps_s).all()):
        raise InputError(f"{bad[0] if bad else f'{path} has a row without a time'}; correct it.")
    if "t_ns" in table.columns:
        return np.asarray(table.columns["t_ns"], dtype=np.int64), None
    return None, gps_s


def lever_arm(out: Path, point: str) -> FloatArray:
    """Metres [3] forward, right, down from the IMU to a point, by name or as "x,y,z".

    Names other than "imu" are those of the drive's manifest; an antenna whose place the manifest
    does not give is where the fusion found it. Raises ConfigError for an unknown point.
    """
    if point == "imu":
        return np.zeros(3)
    if "," not in point:
        return _named_arm(out, point)
    try:
        arm = np.array([float(part) for part in point.split(",")])
    except ValueError:
        arm = np.full(3, np.nan)
    if arm.shape != (3,) or not np.isfinite(arm).all():
        raise ConfigError(f"--point {point}: write three numbers, as 0.4,0.1,-1.2 (metres).")
    if np.abs(arm).max() > FARTHEST_ARM_M:
        raise ConfigError(
            f"--point {point} is no point of a vehicle: it lies farther than "
            f"{FARTHEST_ARM_M:g} m from the IMU; the numbers are metres forward, right, down."
        )
    return arm


def _named_arm(out: Path, point: str) -> FloatArray:
    from automap.io.manifest import read_manifest

    _, folder = drive_of(out)
    try:
        manifest = read_manifest(folder / names.MANIFEST)
    except AutoMapError as error:
        raise InputError(
            f"--point {point} needs the drive's manifest ({error}); give the point as x,y,z."
        ) from None
    if point == "antenna":
        if manifest.gnss.lever_arm_m is not None:
            return np.array(manifest.gnss.lever_arm_m)
        return _estimated_antenna(out, folder)
    if point in manifest.video:
        return np.array(manifest.video[point].lever_arm_m)
    known = ["imu", "antenna", *manifest.video]
    near = difflib.get_close_matches(point, known, n=1, cutoff=0.5)
    advice = f"did you mean {near[0]}?" if near else f"known are {', '.join(known)}, or x,y,z."
    raise ConfigError(f"--point {point}: the drive has no such point; {advice}")


def _estimated_antenna(out: Path, folder: Path) -> FloatArray:
    from automap.io.tables import floats, read_table

    path = out / names.IMU_ERRORS
    columns = tuple(f"gnss_lever_arm_{axis}" for axis in "xyz")
    try:
        table = read_table(path, columns)
        return np.array([floats(table, name)[-1] for name in columns])
    except (InputError, IndexError):
        raise InputError(
            f"{folder / names.MANIFEST} gives no lever_arm_m and the run estimated none; add it "
            "to [gnss], or give the point as x,y,z."
        ) from None
