"""Signs in a folder of pictures."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from automap.errors import InputError
from pipeline.shared.progress import Progress

if TYPE_CHECKING:
    from automap.records import Crop, Image
    from automap.vision.detector import Detector, FoundSigns
    from automap.vision.parallel import Candidate

_SUFFIXES = {".bmp", ".jpeg", ".jpg", ".png", ".ppm", ".tif", ".tiff", ".webp"}
SHEET = "_signs.jpg"
"""End of the name of the sheet of signs that is written beside a table."""


@dataclass
class ImageResult:
    """``rows`` of the table, the ``crops``, and how many pictures were ``read``."""

    rows: list[tuple[str | int, ...]] = field(default_factory=list)
    crops: list[Crop] = field(default_factory=list)
    read: int = 0


def images_in(folder: Path) -> list[Path]:
    """The pictures of a folder, by name, without the sheets of signs of earlier searches."""
    found = sorted(p for p in folder.iterdir() if p.suffix.lower() in _SUFFIXES)
    return [path for path in found if not _is_sheet(path)]


def _is_sheet(path: Path) -> bool:
    """Whether a picture stands beside the table whose signs it shows."""
    table = path.with_name(path.name.removesuffix(SHEET) + ".csv")
    return path.name.endswith(SHEET) and table.is_file()


def search_images(
    images: list[Path],
    detector: Detector,
    min_score: float,
    annotated: Path | None,
    warn: Callable[[str], None],
    progress: Progress,
    hide: bool = True,
) -> ImageResult:
    """Search pictures one by one; those with signs are drawn into the folder ``annotated``, with
    ``hide`` so that nobody can be recognised in them.

    A picture that cannot be read is left out with a warning; InputError when none can be.
    """
    from automap.vision.crops import BestCrops
    from automap.vision.detector import CalibratedDetector
    from automap.vision.parallel import detections, prefetched, worker_count
    from automap.vision.search import above
    from automap.vision.voting import rules_of, view_of, vote

    result, best = ImageResult(), BestCrops("")
    found_in = detections(
        prefetched(_pictures(images, warn)),
        lambda path, picture, beside: detector.detect(picture.image),
        workers=worker_count(),
    )
    for candidate, all_found in found_in:
        picture, path = candidate.frame, candidate.mark
        found = above(all_found, min_score)
        result.read += 1
        for i in range(len(found)):
            number = len(result.rows)
            name, score, likely = found.class_name[i], float(found.score[i]), ("", "")
            view = name
            if isinstance(detector, CalibratedDetector):
                verdict = vote([view_of(found, i)], rules_of(detector))
                name = verdict.name
                likely = f"{verdict.probability:.4f}", f"{verdict.group_probability:.4f}"
            box = (f"{v:.2f}" for v in found.box[i].tolist())
            result.rows.append((path.name, name, *box, f"{score:.3f}", -1, view, *likely))
            best.offer(picture.image, picture.frame, 0, number, name, found.box[i], score)
        if annotated is not None and len(found):
            _draw(annotated / f"{path.stem}.jpg", picture.image, found, hide)
        progress((picture.frame + 1) / len(images), f"image {picture.frame + 1} of {len(images)}")
    if not result.read:
        raise InputError(f"none of the {len(images)} images in {images[0].parent} can be read.")
    result.crops = best.crops({})
    return result


def _pictures(images: list[Path], warn: Callable[[str], None]) -> Iterator[Candidate[Path]]:

    from automap.records import VideoFrame
    from automap.vision.parallel import Candidate

    for number, path in enumerate(images):
        picture = _read(path)
        if picture is None:
            warn(f"{path} is no readable image; it is left out")
        else:
            if _cut_short(path):
                warn(f"{path} ends in the middle of the picture; what there is of it is searched")
            yield Candidate(VideoFrame(number, 0, picture), True, path)


def _read(path: Path) -> Image | None:
    import cv2
    import numpy as np

    if not path.is_file():
        return None
    try:
        picture = cv2.imread(str(path), cv2.IMREAD_COLOR)
    except cv2.error:
        return None  # a picture of absurd size
    return None if picture is None else np.asarray(picture, np.uint8)


def _cut_short(path: Path) -> bool:
    """Whether a JPEG lacks its end mark, after which cameras may still write notes."""
    if path.suffix.lower() not in (".jpg", ".jpeg"):
        return False
    data = path.read_bytes()
    return data.rfind(b"\xff\xd9") < len(data) // 2


def _draw(path: Path, image: Image, found: FoundSigns, hide: bool) -> None:
    import cv2

    from automap.io.atomic import write_bytes
    from automap.vision.annotate import draw, label_for
    from automap.vision.privacy import street_hidden

    shown = street_hidden(image, list(found.box)) if hide else image.copy()
    draw(
        shown,
        [
            label_for(found.box[i], found.class_name[i], float(found.score[i]), -1, True)
            for i in range(len(found))
        ],
    )
    coded, data = cv2.imencode(".jpg", shown)
    if coded:
        write_bytes(path, data.tobytes())
