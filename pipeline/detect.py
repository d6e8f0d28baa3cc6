"""``automap detect``: boxes of signs in a video, a folder of images or a drive, as CSV."""

from __future__ import annotations

import csv
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from automap.errors import InputError

if TYPE_CHECKING:
    from automap.io.drive import VideoInput
    from automap.records import Detections
    from automap.vision.detector import FoundSigns

Progress = Callable[[float, str], None]
Row = tuple[str | int, str, float, float, float, float, float]

_IMAGES = {".bmp", ".jpeg", ".jpg", ".png", ".ppm", ".tif", ".tiff", ".webp"}
_BOX = ("x_min", "y_min", "x_max", "y_max")


def _say(text: str) -> None:
    print(f"warning: {text}", file=sys.stderr)


def detect_to_csv(
    source: Path,
    out: Path,
    progress: Progress = lambda fraction, text: None,
    warn: Callable[[str], None] = _say,
) -> int:
    """Write the boxes found in ``source`` and return their number.

    A drive or a video gives ``frame, class, x_min, y_min, x_max, y_max, score``, as
    ``front_detections.csv`` has it (a drive with several cameras: one file each, named
    ``OUT_CAMERA.csv``); a folder of images gives ``image`` with the file name instead of
    ``frame``. Every frame is searched. The file appears whole or not at all.

    Raises InputError when there is nothing to search, StageError when ``out`` cannot be
    written.
    """
    from automap.io import names

    source = Path(source)
    if not source.exists():
        raise InputError(f"{source} is missing; give a video, a folder of images or a drive.")
    if source.is_file():
        video = _lone_video(source)
        return _write(out, "frame", _video_rows(video, progress, warn))
    if (source / names.MANIFEST).is_file():
        return _drive(source, out, progress, warn)
    images = sorted(p for p in source.iterdir() if p.suffix.lower() in _IMAGES)
    if not images:
        raise InputError(
            f"{source} holds neither {names.MANIFEST} nor images; give a video, a folder of "
            "images or a drive."
        )
    return _write(out, "image", _image_rows(images, progress, warn))


def _lone_video(path: Path) -> VideoInput:
    from automap.io.drive import VideoInput
    from automap.io.manifest import VideoSection

    return VideoInput(name="front", section=VideoSection(start_ns=0), chapters=(path,))


def _search(video: VideoInput, progress: Progress, warn: Callable[[str], None]) -> Detections:
    from automap.vision.search import search_video
    from pipeline.settings.detect import DetectSettings

    every_frame = 1e3
    return search_video(video, every_frame, DetectSettings().min_score, warn, progress)


def _video_rows(
    video: VideoInput, progress: Progress, warn: Callable[[str], None]
) -> Iterator[Row]:
    from automap.io.video import read_chapter

    for chapter in video.chapters[:1]:
        # an unreadable video is an error here: there is nothing else to do
        read_chapter(chapter)
    found = _search(video, progress, warn)
    for i in range(len(found)):
        x0, y0, x1, y1 = found.box[i].tolist()
        yield int(found.frame[i]), str(found.class_name[i]), x0, y0, x1, y1, float(found.score[i])


def _drive(source: Path, out: Path, progress: Progress, warn: Callable[[str], None]) -> int:
    from automap.io.drive import load_drive

    drive = load_drive(source)
    for text in drive.warnings:
        warn(text)
    videos = [video for video in drive.videos.values() if video.chapters]
    if not videos:
        raise InputError(f"{source} has no video; name its files in [video.front] of drive.toml.")
    if len(videos) == 1:
        return _write(out, "frame", _video_rows(videos[0], progress, warn))
    count = 0
    for video in videos:
        beside = out.with_name(f"{out.stem}_{video.name}{out.suffix}")
        count += _write(beside, "frame", _video_rows(video, progress, warn))
    return count


def _image_rows(
    images: list[Path], progress: Progress, warn: Callable[[str], None]
) -> Iterator[Row]:
    import cv2
    import numpy as np

    from automap.vision.classical import ClassicalDetector
    from pipeline.settings.detect import DetectSettings

    detector, least = ClassicalDetector(), DetectSettings().min_score
    for i, path in enumerate(images):
        picture = cv2.imread(str(path), cv2.IMREAD_COLOR)
        if picture is None:
            warn(f"{path} is no readable image; it is left out")
        else:
            yield from _rows(path.name, detector.detect(np.asarray(picture, np.uint8)), least)
        progress((i + 1) / len(images), f"image {i + 1} of {len(images)}")


def _rows(image: str, found: FoundSigns, least: float) -> Iterator[Row]:
    for name, box, score in zip(found.class_name, found.box.tolist(), found.score, strict=True):
        if score >= least:
            yield image, name, box[0], box[1], box[2], box[3], float(score)


def _write(out: Path, key: str, rows: Iterator[Row]) -> int:
    from automap.io.atomic import atomic_path

    count = 0
    with (
        atomic_path(Path(out)) as temporary,
        temporary.open("w", encoding="utf-8", newline="") as stream,
    ):
        table = csv.writer(stream, lineterminator="\n")
        table.writerow((key, "class", *_BOX, "score"))
        for row in rows:
            table.writerow((*row[:2], *(f"{v:.2f}" for v in row[2:6]), f"{row[6]:.3f}"))
            count += 1
    return count
