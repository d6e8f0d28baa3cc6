"""A recorded drive in memory: read from its folder, changed by a fault, written as a folder."""

from __future__ import annotations

import re
import shutil
import tomllib
from dataclasses import dataclass, replace
from pathlib import Path
from types import ModuleType

import numpy as np

from automap.interpolation import poses_at_gps
from automap.records import Trajectory
from automap.timebase import unix_to_gps
from tests.benchmarks.faults import nmea_log, pos_log, ubx_log
from tests.benchmarks.faults.log import Fixes, Floats, Ints, Log
from tests.benchmarks.faults.readings import Readings

NS = 1_000_000_000
# 1980-01-06 in seconds since 1970
GPS_START_S = 315_964_800.0
FORMATS: dict[str, ModuleType] = {".nmea": nmea_log, ".ubx": ubx_log, ".pos": pos_log}


@dataclass
class Recording:
    """A drive's manifest, readings, receiver's log and truth.

    ``path`` the fixes' true positions by the truth, at the epochs of ``log`` as recorded:
    latitude, longitude in deg, height in m above the ellipsoid [n, 3], NaN outside.
    """

    name: str
    manifest: str
    imu: Readings
    log: Log
    log_name: str
    arrival_name: str | None
    truth: Trajectory
    gps_of_imu: tuple[int, float] | None

    @property
    def kind(self) -> str:
        """``nmea``, ``ubx`` or ``pos``."""
        return Path(self.log_name).suffix[1:]

    @property
    def begin_s(self) -> float:
        """GPS time of the first fix."""
        return float(self.log.gps_s[0])

    @property
    def length_s(self) -> float:
        """Seconds from the first to the last fix."""
        return float(self.log.gps_s[-1] - self.log.gps_s[0])

    @property
    def path(self) -> Floats:
        """True latitude, longitude (deg) and height (m) at the epochs [n, 3]."""
        poses = poses_at_gps(self.truth, self.log.gps_s)
        degrees = np.degrees([poses.lat_rad, poses.lon_rad])
        return np.column_stack([*degrees, poses.height_m])

    def stamp(self, gps_s: float) -> int:
        """Stamp of the IMU's clock at a GPS time."""
        if self.gps_of_imu is None:
            return round(gps_s * NS)
        t_ns, at = self.gps_of_imu
        return t_ns + round((gps_s - at) * NS)

    def copy(self) -> Recording:
        """One that can be changed without changing this."""
        imu = replace(self.imu, lines=list(self.imu.lines))
        return replace(self, imu=imu, log=self.log.take(np.arange(len(self.log))))

    def state_axes(self, axes: str) -> None:
        """Say in the manifest how the IMU is mounted; ``axes`` as TOML."""
        self.manifest = re.sub(r"(?m)^axes = .*$", f"axes = {axes}", self.manifest)

    def cut(self, seconds: float) -> None:
        """Leave out what lies later than this after the first fix."""
        end = self.begin_s + seconds
        self.imu.keep(self.imu.t_ns <= self.stamp(end))
        self.log = self.log.take(np.flatnonzero(self.log.gps_s <= end))
        self.truth = part_of(self.truth, self.truth.gps_s <= end)

    def write_to(self, folder: Path) -> None:
        """Write the drive; an earlier one is replaced."""
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        (folder / "drive.toml").write_text(self.manifest, encoding="utf-8")
        (folder / "imu.csv").write_text(self.imu.text(), encoding="utf-8")
        data, arrivals = self.log.data()
        (folder / self.log_name).write_bytes(data)
        if self.arrival_name:
            rows = "".join(f"{at},{t_ns}\n" for at, t_ns in arrivals)
            (folder / self.arrival_name).write_text("offset,t_ns\n" + rows, encoding="utf-8")


def read_recording(folder: Path, truth: Trajectory) -> Recording:
    """Read a drive of one IMU file and one receiver log; the video is left out."""
    text = (folder / "drive.toml").read_text(encoding="utf-8")
    told = tomllib.loads(text)
    imu, gnss = told["imu"], told["gnss"]
    units = imu.get("gyro_unit", "rad/s"), imu.get("accel_unit", "m/s^2")
    readings = Readings.parse((folder / imu["file"]).read_text(encoding="utf-8"), *units)
    log = read_log(folder / gnss["file"], folder / gnss["arrival"] if "arrival" in gnss else None)
    of_gps = imu.get("time") == "gps_ns"
    tie = None if of_gps else (int(truth.t_ns[0]), float(truth.gps_s[0]))
    # boxes say nothing of the path, and the stage that takes them does not run
    lines, taken = [], True
    for line in text.splitlines():
        if line.startswith("["):
            taken = not line.startswith("[video")
        if taken:
            lines.append(line)
    manifest = "\n".join(lines) + "\n"
    return Recording(
        folder.name, manifest, readings, log, gnss["file"], gnss.get("arrival"), truth, tie
    )


def read_log(path: Path, arrival: Path | None) -> Log:
    """Read a receiver's log; with arrival times there is a line of them for every epoch."""
    form, data = FORMATS[path.suffix], path.read_bytes()
    head = b""
    if form is nmea_log:
        groups = nmea_log.epochs(nmea_log.split(data))
    elif form is ubx_log:
        groups = [[message] for message in ubx_log.split(data)]
    else:
        head, rows = pos_log.split(data)
        groups = [[row] for row in rows]
    if head + b"".join(b"".join(group) for group in groups) != data:
        raise ValueError(f"{path}: it holds bytes that are no message of its kind.")
    told = [form.say(group) for group in groups]
    was = Fixes(**{name: np.array([row[name] for row in told]) for name in told[0]})
    # RTKLIB's calendar is that of GPS time, the others' that of UTC
    first = float(was.time[0])
    gps = first - GPS_START_S if form is pos_log else float(unix_to_gps(first))
    return Log(groups, _arrivals(arrival, groups), was, form.write, gps - first, head)


def part_of(trajectory: Trajectory, rows: np.ndarray) -> Trajectory:
    """Rows of a trajectory."""
    values = {name: getattr(trajectory, name) for name in trajectory.__dataclass_fields__}
    whole = len(trajectory)
    cut = {k: v[rows] if np.ndim(v) and len(v) == whole else v for k, v in values.items()}
    return Trajectory(**cut)


def _arrivals(path: Path | None, groups: list[list[bytes]]) -> Ints:
    if path is None:
        return np.full(len(groups), -1, np.int64)
    table = np.loadtxt(path, np.int64, delimiter=",", skiprows=1)
    starts = np.cumsum([0, *(sum(map(len, group)) for group in groups)])[:-1]
    if not np.array_equal(table[:, 0], starts):
        raise ValueError(f"{path}: its offsets are not those of the epochs.")
    return np.asarray(table[:, 1])
