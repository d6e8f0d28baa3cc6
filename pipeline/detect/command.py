"""``automap detect``: boxes of signs in a video, a folder of images or a drive, as CSV."""

from __future__ import annotations

import csv
import sys
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from automap.errors import InputError
from automap.io.atomic import make_folder
from pipeline.detect.camera_paths import path_finder
from pipeline.detect.images import SHEET, images_in, search_images
from pipeline.detect.search_setup import open_detector, search_rules
from pipeline.settings.detect import DetectSettings
from pipeline.shared.progress import Progress
from pipeline.shared.targets import spare_recordings

if TYPE_CHECKING:
    from automap.io.drive import Drive
    from automap.io.video import VideoInput
    from automap.records import Crop, Detections
Row = tuple[str | int, ...]

_BOX = ("x_min", "y_min", "x_max", "y_max")


def say(text: str) -> None:
    """Tell the user of a trouble that does not stop the work."""
    print(f"warning: {text}", file=sys.stderr)


@dataclass(frozen=True)
class Outcome:
    """``files`` written, ``boxes`` found in them, of ``tracks`` signs, in ``searched`` of
    ``frames`` pictures."""

    files: tuple[Path, ...]
    boxes: int
    tracks: int
    searched: int
    frames: int


def detect_to_csv(
    source: Path,
    out: Path,
    progress: Progress = lambda fraction, text: None,
    warn: Callable[[str], None] = say,
    settings: DetectSettings | None = None,
    annotate: bool = False,
    hide: bool = True,
) -> Outcome:
    """Search ``source`` and write what is found.

    A drive or a video gives ``frame, class, x_min, y_min, x_max, y_max, score, track, view_class,
    class_probability, group_probability`` (``class`` by all views of the track, ``view_class`` by
    this one alone, the probabilities those of ``class`` and of its shape and colour), which
    ``front_detections.csv`` may hold as it is; a drive with several cameras gives one file each,
    named ``OUT_CAMERA.csv``. A folder of images gives ``image`` with the file name instead of
    ``frame``, and no tracks. Beside it ``OUT_signs.jpg`` shows every sign, and with ``annotate``
    ``OUT_annotated.mp4`` (a folder for images) shows them in place, with ``hide`` so that
    nobody can be recognised around them. Files appear whole or not at all.

    Raises InputError when there is nothing to search, ConfigError or InputError for a detector
    that cannot be used, StageError when a file cannot be written.
    """
    from automap.io import names

    source, out = Path(source), Path(out)
    settings = settings or DetectSettings()
    if not source.exists():
        raise InputError(f"{source} is missing; give a video, a folder of images or a drive.")
    for path in (out, _sheet_of(out), _annotated_of(out)):
        spare_recordings(path, source)
    # before a search that may take an hour
    make_folder(out.parent)
    if source.is_file() and source.name != names.MANIFEST:
        job = _Job(out, settings, annotate, progress, warn, hide)
        return job.video(_lone_video(source), None)
    if source.is_file() or (source / names.MANIFEST).is_file():
        return _drive(source, _Job(out, settings, annotate, progress, warn, hide))
    images = images_in(source)
    if not images:
        raise InputError(
            f"{source} holds neither {names.MANIFEST} nor images; give a video, a folder of "
            "images or a drive."
        )
    return _Job(out, settings, annotate, progress, warn, hide).images(images)


def _lone_video(path: Path) -> VideoInput:
    from automap.io.manifest import VideoSection
    from automap.io.video import VideoInput

    return VideoInput(name="front", section=VideoSection(start_ns=0), chapters=(path,))


def _drive(source: Path, job: _Job) -> Outcome:
    from dataclasses import replace

    from automap.io.drive import load_drive

    drive = load_drive(source)
    for text in drive.warnings:
        job.warn(text)
    videos = [video for video in drive.videos.values() if video.chapters]
    if not videos:
        raise InputError(f"{source} has no video; name its files in [video.front] of drive.toml.")
    if len(videos) == 1:
        return job.video(videos[0], drive)
    parts = []
    for video in videos:
        beside = job.out.with_name(f"{job.out.stem}_{video.name}{job.out.suffix}")
        parts.append(replace(job, out=beside).video(video, drive))
    return Outcome(
        tuple(path for part in parts for path in part.files),
        sum(part.boxes for part in parts),
        sum(part.tracks for part in parts),
        sum(part.searched for part in parts),
        sum(part.frames for part in parts),
    )


@dataclass(frozen=True)
class _Job:
    """What is to be written, and how the search is to be done."""

    out: Path
    settings: DetectSettings
    annotate: bool
    progress: Progress
    warn: Callable[[str], None]
    hide: bool = True

    def video(self, video: VideoInput, drive: Drive | None) -> Outcome:
        """Search one camera's video."""
        from pipeline.detect.video_search import search_video

        said: list[str] = []

        def warn(text: str) -> None:
            said.append(text)

        camera = None if drive is None else drive.cameras().get(video.name)
        share = 0.7 if self.annotate else 1.0
        result = search_video(
            video,
            open_detector(self.settings, None if drive is None else drive.site.country),
            search_rules(self.settings),
            camera,
            # of a drive that was run before the trajectory is known
            (lambda t_ns: None) if drive is None else path_finder(drive.out, drive, video),
            warn,
            lambda fraction, text: self.progress(share * fraction, text),
        )
        if result.searched == 0:
            # there is nothing else to do here
            raise InputError("; ".join(said) + "." if said else f"{video.chapters[0]} is empty.")
        for text in said:
            self.warn(text)
        found = result.detections
        files = [self.out, *self._sheet(result.crops)]
        _write(self.out, "frame", _rows(found))
        if self.annotate:
            from pipeline.detect.annotated_video import annotate_video

            shown = _annotated_of(self.out)
            annotate_video(
                video,
                found,
                shown,
                progress=lambda f, text: self.progress(0.7 + 0.3 * f, text),
                hide=self.hide,
            )
            files.append(shown)
        tracks = len(set(found.track.tolist()))
        return Outcome(tuple(files), len(found), tracks, result.searched, result.frames)

    def images(self, images: list[Path]) -> Outcome:
        """Search pictures that have nothing to do with each other."""
        detector = open_detector(self.settings, None)
        folder = self.out.with_name(f"{self.out.stem}_annotated") if self.annotate else None
        result = search_images(
            images, detector, self.settings.min_score, folder, self.warn, self.progress, self.hide
        )
        files = [self.out, *self._sheet(result.crops), *([folder] if folder else [])]
        _write(self.out, "image", result.rows)
        return Outcome(tuple(files), len(result.rows), 0, result.read, len(images))

    def _sheet(self, crops: Iterable[Crop]) -> list[Path]:
        from automap.io.atomic import write_bytes
        from automap.vision.contact_sheet import contact_sheet

        path = _sheet_of(self.out)
        if not (seen := list(crops)):
            if path.is_file():
                path.unlink()  # that of an earlier search does not belong to this table
            return []
        write_bytes(path, contact_sheet(seen))
        return [path]


def _sheet_of(table: Path) -> Path:
    """Where all signs are shown that a table lists."""
    return table.with_name(f"{table.stem}{SHEET}")


def _annotated_of(table: Path) -> Path:
    return table.with_name(f"{table.stem}_annotated.mp4")


def _rows(found: Detections) -> Iterator[Row]:
    from automap.records import TRACK_PROBABILITIES

    views = found.class_name if found.view_class is None else found.view_class
    told = [found.told(name).tolist() for name in TRACK_PROBABILITIES]
    for i in range(len(found)):
        box = (f"{v:.2f}" for v in found.box[i].tolist())
        score, track = f"{found.score[i]:.3f}", int(found.track[i])
        likely = (f"{p[i]:.4f}" if p[i] == p[i] else "" for p in told)
        yield (
            int(found.frame[i]),
            str(found.class_name[i]),
            *box,
            score,
            track,
            str(views[i]),
            *likely,
        )


def _write(out: Path, key: str, rows: Iterable[Row]) -> None:
    from automap.io.atomic import atomic_path
    from automap.records import TRACK_PROBABILITIES

    with (
        atomic_path(Path(out)) as temporary,
        temporary.open("w", encoding="utf-8", newline="") as stream,
    ):
        table = csv.writer(stream, lineterminator="\n")
        table.writerow((key, "class", *_BOX, "score", "track", "view_class", *TRACK_PROBABILITIES))
        table.writerows(rows)
