"""A drive folder: which files it has and what its manifest says of them."""

from __future__ import annotations

import difflib
import errno
import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from automap.errors import ConfigError, InputError
from automap.io import limits, names
from automap.io.axes import ImuAxes, imu_axes
from automap.io.manifest import (
    GnssSection,
    ImuSection,
    Manifest,
    SiteSection,
    VehicleSection,
    VideoSection,
    read_manifest,
)
from automap.io.receiver_file import find_receiver
from automap.io.sensor_file import find_sensor
from automap.io.trust import check_inside
from automap.io.video import VideoInput, image_size
from automap.records import (
    DISTORTION_SD,
    UNKNOWN_DISTORTION_SD,
    UNKNOWN_FOCAL_SD,
    Camera,
    FloatArray,
    usual_matrix,
)

_GNSS_FILES = ("gnss.ubx", "gnss.nmea", "gnss.pos", "gnss.csv", "fixes.csv")
_ODOMETER_FILE = "odometer.csv"
_ARRIVAL_FILE = "gnss_arrival.csv"
_VIDEO_DIR = "video"
_VIDEO_SUFFIXES = (".mp4", ".mov", ".mkv", ".avi", ".m4v", ".ts", ".360")


@dataclass(frozen=True)
class Drive:
    """A drive folder as found: a path is None where the drive has no such file.

    ``warnings`` holds one sentence for every file of minor importance (arrival times,
    calibration, video) that the manifest names and the folder lacks; the drive goes on with
    what there is.
    """

    path: Path
    name: str
    manifest: Manifest
    imu_file: Path | None = None
    imu_calibration: Path | None = None
    gnss_file: Path | None = None
    arrival_file: Path | None = None
    odometer_file: Path | None = None
    trajectory_file: Path | None = None
    bearings_file: Path | None = None
    truth_dir: Path | None = None
    videos: dict[str, VideoInput] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()

    @property
    def manifest_file(self) -> Path:
        """The path of ``drive.toml``."""
        return self.path / names.MANIFEST

    @property
    def imu(self) -> ImuSection:
        """The section ``[imu]``, defaults filled in."""
        return self.manifest.imu

    @property
    def gnss(self) -> GnssSection:
        """The section ``[gnss]``, defaults filled in."""
        return self.manifest.gnss

    @property
    def site(self) -> SiteSection:
        """The section ``[site]``."""
        return self.manifest.site

    @property
    def vehicle(self) -> VehicleSection:
        """The section ``[vehicle]``."""
        return self.manifest.vehicle

    @property
    def imu_axes(self) -> ImuAxes:
        """The axes of the IMU's triads."""
        return imu_axes(self.imu.axes, self.imu.accel_axes, self.imu.gyro_axes)

    @property
    def lever_arm(self) -> FloatArray:
        """IMU to antenna [3] in body axes, m; zeros where the manifest gives none."""
        arm = self.gnss.lever_arm_m
        return np.zeros(3) if arm is None else np.array(arm, dtype=np.float64)

    @property
    def out(self) -> Path:
        """The default output folder."""
        return self.path / names.DEFAULT_OUT

    def cameras(self) -> dict[str, Camera]:
        """The cameras by name, in the order of the manifest.

        An image size that the manifest lacks is read from the video, else from the principal
        point; a missing matrix is replaced by ``usual_matrix`` (see
        ``camera_warnings``). A camera whose size cannot be known at all is left out.
        """
        cameras = {}
        for name, video in self.videos.items():
            camera = _camera(video)
            if camera is not None:
                cameras[name] = camera
        return cameras

    def camera_warnings(self) -> list[str]:
        """One sentence for every assumption that ``cameras`` had to make."""
        sentences = []
        for name, video in self.videos.items():
            section = f"{self.manifest_file}: [video.{name}]"
            if _image_size(video) is None:
                sentences.append(
                    f"{section} has no width and height and no readable video, so this camera "
                    "is left out; add width, height and camera_matrix"
                )
            elif video.section.camera_matrix is None:
                sentences.append(
                    f"{section} has no camera_matrix; a view of 60 degrees along the longer side "
                    "is taken, which the boxes of signs correct as far as they tell; film a "
                    "chessboard, calibrate with OpenCV and add camera_matrix "
                    "(docs/howto/own-drive.md)"
                )
        return sentences

    def input_files(self) -> list[Path]:
        """Every file that any stage may read, manifest first; truth is not among them."""
        files = [self.manifest_file]
        single = (
            self.imu_file,
            self.imu_calibration,
            self.gnss_file,
            self.arrival_file,
            self.odometer_file,
            self.trajectory_file,
            self.bearings_file,
        )
        files += [path for path in single if path is not None]
        for video in self.videos.values():
            files += video.chapters
            files += [path for path in (video.frames, video.detections) if path is not None]
        return files


def load_drive(path: Path | str) -> Drive:
    """Read the manifest of a drive folder (or of a path to its drive.toml) and find its files.

    A file named in the manifest that is not there becomes a warning, but for the recordings
    of IMU and receiver: a wrong name there would quietly give a far worse map. Raises
    InputError for those, when the folder or its manifest is missing, or when no input file at
    all is found; ConfigError when the manifest is wrong.
    """
    try:
        return _load(Path(path))
    except PermissionError as error:
        raise InputError(
            f"{error.filename or path} cannot be read ({error.strerror}); change its rights or "
            "copy the drive."
        ) from error


def _load(folder: Path) -> Drive:
    if folder.name == names.MANIFEST and folder.is_file():
        folder = folder.parent
    if not folder.exists():
        raise InputError(f"{folder}: there is no such drive folder; check the path.")
    if not folder.is_dir():
        raise InputError(f"{folder} is a file; give the drive folder that holds {names.MANIFEST}.")
    check_inside(folder / names.MANIFEST, folder, str(folder))
    manifest = read_manifest(folder / names.MANIFEST)
    _check_presets(folder, manifest)
    finder = _Finder(folder)
    drive = Drive(
        path=folder,
        name=manifest.name or folder.resolve().name,
        manifest=manifest,
        imu_file=finder.require(manifest.imu.file, "imu.file", (names.IMU_TABLE,)),
        imu_calibration=finder.find(manifest.imu.calibration, "imu.calibration"),
        gnss_file=finder.require(manifest.gnss.file, "gnss.file", _GNSS_FILES),
        arrival_file=finder.find(manifest.gnss.arrival, "gnss.arrival", (_ARRIVAL_FILE,)),
        odometer_file=finder.find(manifest.odometer.file, "odometer.file", (_ODOMETER_FILE,)),
        trajectory_file=finder.find(None, "", names.FINISHED_TRAJECTORIES),
        bearings_file=finder.find(None, "", (names.BEARINGS,)),
        truth_dir=_truth(folder),
        videos=_videos(finder, manifest),
        warnings=tuple(finder.warnings),
    )
    if len(drive.input_files()) == 1:
        missing = "".join(f" {text}." for text in finder.warnings)
        raise InputError(
            f"{folder} holds no recording.{missing} Put imu.csv and gnss.ubx (or "
            f"trajectory.csv or .pos, or bearings.csv) beside {names.MANIFEST}, or name the files "
            "in it."
        )
    return drive


def _truth(folder: Path) -> Path | None:
    """The folder of the truth; ConfigError where a link in it leads out of the drive."""
    truth = folder / names.TRUTH_DIR
    if not truth.is_dir():
        return None
    for path in (truth, *truth.iterdir()):
        check_inside(path, folder, str(folder))
    return truth


def _is_file(path: Path) -> bool:
    """Whether a path is a file; a name that no file system takes is none."""
    try:
        return path.is_file()
    except OSError as error:
        if error.errno == errno.ENAMETOOLONG:
            return False
        raise


def _exists(path: Path) -> bool:
    try:
        return path.exists()
    except OSError as error:
        if error.errno == errno.ENAMETOOLONG:
            return False
        raise


class _Finder:
    """Resolves file names of one manifest, gathering a sentence for each that is missing."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.warnings: list[str] = []

    def find(self, named: str | None, key: str, defaults: tuple[str, ...] = ()) -> Path | None:
        if named is None:
            found = (self.folder / name for name in defaults)
            path = next((path for path in found if path.is_file()), None)
            return None if path is None else self.checked(path)
        path = self._inside(named, key)
        if _is_file(path):
            return path
        self.warnings.append(f"{self._absent(path, named, key)}; the drive goes on without it")
        return None

    def require(self, named: str | None, key: str, defaults: tuple[str, ...]) -> Path | None:
        """As ``find``, but a file that is named must be there."""
        path = None if named is None else self._inside(named, key)
        if named is None or path is None or _is_file(path):
            return self.find(named, key, defaults)
        raise InputError(
            f"{self._absent(path, named, key)}; correct the name, or take the line out to go on "
            "without that recording."
        )

    def _absent(self, path: Path, named: str, key: str) -> str:
        shown = named if len(named) <= limits.SHOWN else f"{named[: limits.SHOWN]}..."
        where = f"{self.folder / names.MANIFEST}: {key} names {shown}"
        if _is_file(path.parent):
            return f"{where}, which lies in a file"
        if _exists(path):
            return f"{where}, which is no file"
        present = [item.name for item in path.parent.glob("*")] if _exists(path.parent) else []
        near = difflib.get_close_matches(path.name[: limits.SHOWN], present, n=1, cutoff=0.6)
        return f"{where}, which is not there" + (f" (is {near[0]} meant?)" if near else "")

    def checked(self, path: Path) -> Path:
        """A file that bears a usual name; ConfigError where it is a link out of the folder."""
        check_inside(path, self.folder, str(self.folder))
        return path

    def _inside(self, named: str, key: str) -> Path:
        path = self.folder / named
        check_inside(path, self.folder, f"{self.folder / names.MANIFEST}: {key}")
        return path


def _check_presets(folder: Path, manifest: Manifest) -> None:
    """Whether counts can be converted, and whether sensor and receiver are known by name."""
    imu, manifest_file = manifest.imu, folder / names.MANIFEST
    if "counts" in (imu.gyro_unit, imu.accel_unit) and not (imu.sensor or imu.calibration):
        raise ConfigError(
            f"{manifest_file}: [imu] is in counts but names no sensor; add sensor = "
            '"thinimu-micro" (a file in configs/sensors/) or calibration = "imu_calibration.toml".'
        )
    for key, name, find in (
        ("imu.sensor", imu.sensor, find_sensor),
        ("gnss.receiver", manifest.gnss.receiver, find_receiver),
    ):
        if name is not None:
            try:
                find(name, folder)
            except ConfigError as error:
                raise ConfigError(f"{manifest_file}: {key}: {error}") from None


def _videos(finder: _Finder, manifest: Manifest) -> dict[str, VideoInput]:
    sections = dict(manifest.video)
    if not sections:
        sections = {name: VideoSection() for name in _unnamed_videos(finder.folder)}
    videos = {name: _video(finder, name, section) for name, section in sections.items()}
    of: dict[Path, str] = {}
    for name, video in videos.items():
        stated = video.chapters if video.section.files is not None else ()
        for path in (*stated, *([video.detections] if video.section.detections else [])):
            if path is not None and of.setdefault(path.resolve(), name) != name:
                raise ConfigError(
                    f"{finder.folder / names.MANIFEST}: video.{of[path.resolve()]} and "
                    f"video.{name} are both of {path.name}; one picture counts once, so leave "
                    "one of them out."
                )
    return videos


def _unnamed_videos(folder: Path) -> list[str]:
    """Cameras of a folder whose manifest has no ``[video]``: by their files' names."""
    stems = set()
    for path in sorted((folder / _VIDEO_DIR).glob("*")):
        if path.suffix.lower() in _VIDEO_SUFFIXES:
            stems.add(re.sub(r"[-_]?\d+$", "", path.stem) or path.stem)
        elif path.name.endswith("_detections.csv"):
            stems.add(path.name.removesuffix("_detections.csv"))
    return sorted(stems)


def _video(finder: _Finder, name: str, section: VideoSection) -> VideoInput:
    key = f"video.{name}"
    if section.files is not None:
        found = (finder.find(text, f"{key}.files") for text in section.files)
        chapters = tuple(path for path in found if path is not None)
    else:
        found_there = _default_chapters(finder.folder / _VIDEO_DIR, name)
        chapters = tuple(finder.checked(path) for path in found_there)
    frames = finder.find(section.frames, f"{key}.frames", (f"{_VIDEO_DIR}/{name}_frames.csv",))
    detections = finder.find(
        section.detections, f"{key}.detections", (f"{_VIDEO_DIR}/{name}_detections.csv",)
    )
    return VideoInput(name, section, chapters, frames, detections)


def _default_chapters(folder: Path, name: str) -> tuple[Path, ...]:
    """``NAME.mp4``, then ``NAME_2.mp4`` and the like in the order of their numbers."""
    pattern = re.compile(rf"^{re.escape(name)}(?:[-_]?(\d+))?$")
    found = []
    for path in folder.glob("*"):
        match = pattern.match(path.stem)
        if match and path.suffix.lower() in _VIDEO_SUFFIXES:
            found.append((int(match.group(1) or -1), path.name, path))
    return tuple(path for _, _, path in sorted(found))


def _image_size(video: VideoInput) -> tuple[int, int] | None:
    section = video.section
    if section.width is not None and section.height is not None:
        return section.width, section.height
    if video.chapters:
        size = image_size(video.chapters)
        if size is not None:
            return size
    if section.camera_matrix is not None:
        # the principal point lies near the middle of the image
        (_, _, cx), (_, _, cy), _ = section.camera_matrix
        if cx > 0 and cy > 0:
            return round(2 * cx), round(2 * cy)
    return None


def _camera(video: VideoInput) -> Camera | None:
    size = _image_size(video)
    if size is None:
        return None
    width, height = size
    section = video.section
    if section.camera_matrix is not None:
        matrix = np.array(section.camera_matrix, dtype=np.float64)
    else:
        matrix = usual_matrix(width, height)
    return Camera(
        width=width,
        height=height,
        matrix=matrix,
        distortion=np.array(section.distortion, dtype=np.float64),
        lever_arm_m=np.array(section.lever_arm_m, dtype=np.float64),
        mount_rpy=np.radians(np.array(section.mount_rpy_deg, dtype=np.float64)),
        mount_sd=float(np.radians(section.mount_rpy_sigma_deg)),
        time_offset_s=section.time_offset_s,
        time_offset_sd=section.time_offset_sigma_s,
        lever_arm_sd=section.lever_arm_sigma_m,
        distortion_sd=_distortion_sd(section),
        focal_sd=0.0 if section.camera_matrix is not None else UNKNOWN_FOCAL_SD,
    )


def _distortion_sd(section: VideoSection) -> float:
    """One sigma of k1: as stated, else of a calibration, else of a lens of which nobody said what
    it does."""
    if section.distortion_sigma is not None:
        return section.distortion_sigma
    return DISTORTION_SD if "distortion" in section.model_fields_set else UNKNOWN_DISTORTION_SD
