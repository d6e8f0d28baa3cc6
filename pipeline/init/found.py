"""What lies in a folder: tables, receiver logs, videos, and recordings of other programs."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

from automap.errors import AutoMapError, InputError
from automap.io import names
from automap.io.camera_file import SUFFIXES, CameraFile, read_camera_file
from automap.io.csv_layout import read_layout
from automap.io.header_names import take_apart
from automap.io.named_table import look_at_table
from automap.io.receiver import sniff
from automap.io.rosbag import SUFFIXES as BAGS
from automap.io.table_form import TableKind
from automap.io.table_guess import TableGuess
from automap.io.trust import refuse_links_out
from pipeline.init.archive import GYROSCOPES, TABLES, begins, is_of_sensor_logger, kind_of_archive
from pipeline.init.reasons import tells_places, why_not

_VIDEOS = (".mp4", ".mov", ".mkv", ".avi", ".m4v", ".360")
_OURS = {*names.FINISHED_TRAJECTORIES, names.BEARINGS, names.MANIFEST}
_LEFT_OUT = {names.TRUTH_DIR, names.DEFAULT_OUT}
_SNIFFED = 1 << 20
_GNSS_LOGGER = re.compile(rb"^(?:# )?(?:Raw|Fix|UncalGyro|UncalAccel),", re.MULTILINE)
_OF_CAR = frozenset(
    [
        "rpm",
        "throttle",
        "steering",
        "brake",
        "pedal",
        "gear",
        "engine",
        "odometer",
        "obd",
        "can",
        "wheel",
        "drehzahl",
        "gaspedal",
        "lenkwinkel",
        "lenkradwinkel",
        "bremse",
        "gang",
        "raddrehzahl",
        "regime",
        "volant",
        "frein",
        "volante",
        "freno",
        "marcia",
    ]
)
"""Words of what a car's own computer tells."""
_WORKBOOK = "a workbook; save each of its sheets as CSV"
_INSTEAD = {
    ".xlsx": _WORKBOOK,
    ".xlsm": _WORKBOOK,
    ".xls": _WORKBOOK,
    ".ods": _WORKBOOK,
    ".fit": "a watch's or a bicycle computer's track; save it as GPX",
    ".kml": "a drawing; save the track as GPX, with the times of its points",
    ".kmz": "a drawing; save the track as GPX, with the times of its points",
    ".mat": "MATLAB's; save its columns as CSV",
    ".parquet": "a table of columns; save it as CSV",
}
"""What to do with recordings in forms that nothing here reads, by how their names end."""
_KINDS: tuple[TableKind, ...] = ("imu", "gnss", "odometer", "arrival")


@dataclass(frozen=True)
class Table:
    """A table and how it would be read as each kind that it may be; ``of_car`` where a car's own
    computer wrote it, by what else is in it."""

    path: Path
    guesses: dict[TableKind, TableGuess]
    of_car: bool = False


@dataclass
class Found:
    """The files of a folder by what they are; ``recordings`` are those that have to be converted,
    by the kind of their import. ``archives`` hold tables; ``passed`` are files that are not used,
    with the reason."""

    tables: list[Table] = field(default_factory=list)
    logs: list[tuple[Path, str]] = field(default_factory=list)
    videos: list[Path] = field(default_factory=list)
    frames: list[Path] = field(default_factory=list)
    detections: list[Path] = field(default_factory=list)
    finished: list[Path] = field(default_factory=list)
    calibrations: dict[Path, CameraFile] = field(default_factory=dict)
    recordings: dict[str, list[Path]] = field(default_factory=dict)
    archives: list[Path] = field(default_factory=list)
    passed: dict[Path, str] = field(default_factory=dict)

    def of_kind(self, kind: TableKind) -> list[Table]:
        """The tables that may be of a kind."""
        return [table for table in self.tables if kind in table.guesses]

    @property
    def is_drive(self) -> bool:
        """Whether there is something that is read as it is."""
        return bool(self.logs or self.of_kind("imu") or self.of_kind("gnss") or self.finished)


def look(source: Path) -> Found:
    """Look at a folder, its folder ``video`` included, or at one file.

    Raises InputError where there is nothing, or it cannot be read, ConfigError where a link in the
    folder leads out of it.
    """
    if not source.exists():
        raise InputError(f"{source}: there is no such file or folder; check the path.")
    refuse_links_out(source)
    found = Found()
    whole = None if source.is_file() else _kind_of_folder(source)
    if whole is not None:
        found.recordings[whole] = [source]
        return found
    try:
        for path in _files(source):
            _add(found, path)
    except OSError as error:
        raise InputError(
            f"{error.filename or source} cannot be read ({error.strerror})."
        ) from error
    if found.is_drive:
        # a camera's own recording beside an IMU's and a receiver's is their video
        found.videos += found.recordings.pop("gopro", [])
    return found


def _files(source: Path) -> Iterable[Path]:
    if source.is_file():
        return [source]
    inside = [path for path in sorted(source.iterdir()) if not path.name.startswith(".")]
    video = source / "video"
    below = sorted(video.iterdir()) if video.is_dir() else []
    bags = [p for p in inside if p.is_dir() and (p / "metadata.yaml").is_file()]
    return [path for path in inside + below if path.is_file()] + bags


def _kind_of_folder(folder: Path) -> str | None:
    """The kind of import that a folder as a whole is for."""
    inside = {path.name for path in folder.iterdir()} if folder.is_dir() else set()
    suffixes = [Path(name).suffix.lower() for name in inside - _LEFT_OUT]
    if "processed_log" in inside:
        return "comma2k19"
    if "mav0" in inside or "imu0" in inside:
        return "euroc"
    if "oxts" in inside:
        return "kitti"
    if "metadata.yaml" in inside and any(suffix in BAGS for suffix in suffixes):
        return "rosbag"
    if ".tag" in suffixes:
        return "rtklib"
    if any(is_of_sensor_logger(begins(folder / name)) for name in inside & GYROSCOPES):
        return "sensor-logger"
    if suffixes and all(suffix in (".jpg", ".jpeg") for suffix in suffixes):
        return "mapillary"
    return None


def _add(found: Found, path: Path) -> None:
    suffix = path.suffix.lower()
    if path.name in _OURS:
        if path.name != names.MANIFEST:
            found.finished.append(path)
    elif path.is_dir() or suffix in BAGS:
        found.recordings.setdefault("rosbag", []).append(path)
    elif suffix == ".zip":
        _add_archive(found, path)
    elif suffix in _VIDEOS:
        gopro = found.recordings.setdefault("gopro", []) if _has_telemetry(path) else found.videos
        gopro.append(path)
    elif _add_calibration(found, path):
        pass
    elif path.name.endswith("_detections.csv"):
        found.detections.append(path)
    elif path.name.endswith("frames.csv"):
        found.frames.append(path)
    else:
        _add_text(found, path)


def _add_calibration(found: Found, path: Path) -> bool:
    """Take a file as a camera's calibration; False where it is none."""
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES or (suffix in TABLES and not path.name.lower().startswith("calib")):
        return False
    camera = read_camera_file(path)
    if camera is not None:
        found.calibrations[path] = camera
    return camera is not None


def _add_text(found: Found, path: Path) -> None:
    with path.open("rb") as stream:
        head = stream.read(_SNIFFED)
    if _GNSS_LOGGER.search(head) is not None:
        found.recordings.setdefault("gnss-logger", []).append(path)
        return
    kind = sniff(head)
    if kind is not None:
        found.logs.append((path, kind))
        return
    guesses: dict[TableKind, TableGuess] = {}
    for each in _KINDS if path.suffix.lower() in TABLES else ():
        try:
            guess = look_at_table(path, each)
        except AutoMapError:
            continue
        if guess.time is not None:
            guesses[each] = guess
    of_car = bool(guesses) and _is_of_car(path)
    # the speeds of fixes that cannot be read are no wheels'
    if guesses and (of_car or set(guesses) != {"odometer"} or not tells_places(path)):
        found.tables.append(Table(path, guesses, of_car))
    elif path.suffix.lower() in TABLES:
        found.passed[path] = why_not(path)
    elif path.name != "import.json" and path not in found.passed:
        unknown = "nothing is known of this kind of file"
        found.passed[path] = _INSTEAD.get(path.suffix.lower(), unknown)


def _add_archive(found: Found, path: Path) -> None:
    """A phone's recording, or tables of any other program."""
    kind = kind_of_archive(path)
    if kind == "sensor-logger":
        found.recordings.setdefault(kind, []).append(path)
    elif kind == "tables":
        found.archives.append(path)
    else:
        found.passed[path] = kind


def _is_of_car(path: Path) -> bool:
    names = read_layout(path).names
    return bool(_OF_CAR & {word for name in names for word in take_apart(name).words})


def _has_telemetry(path: Path) -> bool:
    """Whether a video has a GoPro's track: the name of its handler stands at either end."""
    with path.open("rb") as stream:
        head = stream.read(_SNIFFED)
        stream.seek(max(path.stat().st_size - 16 * _SNIFFED, 0))
        return b"gpmd" in head or b"gpmd" in stream.read(16 * _SNIFFED)
