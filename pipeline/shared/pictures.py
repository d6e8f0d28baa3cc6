"""The folder of sign pictures beside a map: taken from the video, kept, read again."""

from __future__ import annotations

import csv
import io
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from automap.errors import InputError
from automap.export.csv_text import csv_cell
from automap.export.dictionary import PICTURE_FIELDS
from automap.export.pictures import SignView, choose_views, context_picture, sign_picture
from automap.io import names
from automap.io.atomic import write_bytes, write_text
from automap.review.reviewed import Renamed
from pipeline.shared.products import RunProducts

if TYPE_CHECKING:
    from automap.io.video import VideoInput


@dataclass(frozen=True)
class Picture:
    """One view of a sign with its JPEG, and with that of the street around it for the nearest,
    which is ``hidden`` where nobody can be recognised in it. ``stored`` is the view whose names its
    files beside the map have, where a review called it otherwise since."""

    view: SignView
    jpeg: bytes
    context: bytes | None = None
    hidden: bool = True
    stored: SignView | None = None

    @property
    def lies_at(self) -> SignView:
        """The view that its files beside the map are named after."""
        return self.stored or self.view


@dataclass(frozen=True)
class Wanted:
    """Whether pictures of the street are ``context``, and whether it is to be hidden in them."""

    context: bool = True
    hide: bool = True

    def satisfied_by(self, picture: Picture) -> bool:
        """Whether a picture that is there will do."""
        if picture.view.rank != 1 or not self.context:
            return picture.context is None
        return picture.context is not None and picture.hidden == self.hide


def take_pictures(
    products: RunProducts,
    videos: Mapping[str, VideoInput],
    wanted: Wanted | None = None,
    warn: Callable[[str], None] = lambda text: None,
    progress: Callable[[float], None] = lambda fraction: None,
) -> list[Picture]:
    """Pictures of the signs of a run, ordered by sign and rank.

    Those that an earlier run left in OUT and that are of the same boxes are taken again
    instead of decoding the video. Signs seen by a camera without a readable video have none.
    """
    if products.observations is None or not products.signs:
        return []
    told = {name: (video.section.width, video.section.height) for name, video in videos.items()}
    sizes = {name: (w, h) for name, (w, h) in told.items() if w is not None and h is not None}
    views = choose_views(products.observations, [sign.id for sign in products.signs], sizes)
    wanted = Wanted() if wanted is None else wanted
    kept = {_identity(p.view): p for p in read_pictures(products)}
    kept = {key: p for key, p in kept.items() if key in {_identity(view) for view in views}}
    pictures = [replace(p, stored=None) for p in kept.values() if wanted.satisfied_by(p)]
    done = {_identity(p.view) for p in pictures}
    missing = [view for view in views if _identity(view) not in done]
    for camera in dict.fromkeys(view.camera for view in missing):
        own = [view for view in missing if view.camera == camera]
        video = videos.get(camera)
        if video is None or not video.chapters:
            # the sign itself is the same in any case
            old = [kept[_identity(view)] for view in own if _identity(view) in kept]
            pictures += [replace(picture, context=None, stored=None) for picture in old]
            continue
        try:
            pictures += _from_video(video, own, wanted, progress)
        except InputError as error:
            warn(f"The signs that the camera {camera} saw have no pictures: {error}")
    order = {sign.id: number for number, sign in enumerate(products.signs)}
    return sorted(pictures, key=lambda p: (order[p.view.sign_id], p.view.rank))


def _identity(view: SignView) -> tuple[object, ...]:
    box = tuple(np.round(view.box, 2).tolist())
    return (view.sign_id, view.rank, view.camera, view.frame, view.t_ns, box)


def _from_video(
    video: VideoInput,
    views: Sequence[SignView],
    wanted: Wanted,
    progress: Callable[[float], None],
) -> list[Picture]:
    from automap.io.video_decode import iter_frames

    matrix = video.section.camera_matrix
    focal_px = None if matrix is None else float(matrix[0][0])
    by_frame: dict[int, list[SignView]] = {}
    for view in views:
        by_frame.setdefault(view.frame, []).append(view)
    pictures = []
    # the detect stage has told of the video's troubles
    for done, frame in enumerate(iter_frames(video, sorted(by_frame)), start=1):
        for view in by_frame[frame.frame]:
            jpeg = sign_picture(frame.image, view.box)
            if jpeg is None:
                continue
            context = None
            if wanted.context and view.rank == 1:
                context = context_picture(frame.image, view.box, focal_px, wanted.hide)
            pictures.append(Picture(view, jpeg, context, wanted.hide))
        progress(done / len(by_frame))
    return pictures


def write_pictures(folder: Path, pictures: Sequence[Picture]) -> None:
    """Write the pictures and their index below ``folder``, which stands for OUT."""
    for picture in pictures:
        write_bytes(folder / names.PICTURES / picture.view.file, picture.jpeg)
        if picture.context is not None:
            write_bytes(folder / names.PICTURES / picture.view.context_file, picture.context)
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\r\n")
    writer.writerow([field.name for field in PICTURE_FIELDS])
    for picture in pictures:
        view = picture.view
        writer.writerow(
            [
                view.file,
                csv_cell(view.sign_id),
                view.rank,
                csv_cell(view.camera),
                view.frame,
                view.t_ns,
                *(f"{value:.2f}" for value in view.box),
                *("" if np.isnan(v) else f"{v:.3f}" for v in (view.range_m, view.score)),
                *_context_cells(picture),
            ]
        )
    text = stream.getvalue().encode("utf-8", "replace").decode()
    write_text(folder / names.PICTURE_INDEX, text)


def _context_cells(picture: Picture) -> tuple[str, str]:
    if picture.context is None:
        return "", ""
    return picture.view.context_file, "hidden" if picture.hidden else "shown"


def read_pictures(products: RunProducts) -> list[Picture]:
    """The pictures beside a map, in the order of the index; none where there are none.

    An entry that is damaged, or whose file is missing, is passed over; an index that cannot be
    read is noted among the problems.
    """
    pictures = products.attempt(names.PICTURE_INDEX, _read_index) or []
    if not products.renamed:
        return pictures
    ranked, rank = [], Counter[str]()
    for picture in sorted((_renamed(p, products.renamed) for p in pictures), key=_rank):
        name = picture.view.sign_id
        rank[name] += 1
        view = replace(picture.view, rank=rank[name])
        ranked.append(replace(picture, view=view, stored=picture.lies_at))
    return ranked


def _rank(picture: Picture) -> int:
    return picture.view.rank


def _renamed(picture: Picture, renamed: Renamed) -> Picture:
    """A picture under the name that its sign has after a review."""
    view = picture.view
    name = renamed.name_of(view.sign_id, view.camera, view.frame)
    if name == view.sign_id:
        # in a merged map the drive stands before the camera
        drive, _, camera = view.camera.rpartition(" ")
        name = renamed.name_of(view.sign_id, camera, view.frame, drive)
    return replace(picture, view=replace(view, sign_id=name), stored=view)


def _read_index(index: Path) -> list[Picture]:
    try:
        rows = list(csv.DictReader(io.StringIO(index.read_text(encoding="utf-8"), newline="")))
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"it is no CSV file ({error})") from error
    if rows and "sign_id" not in rows[0]:
        raise InputError("its column sign_id is missing")
    pictures = []
    for row in rows:
        try:
            view = SignView(
                sign_id=csv_cell(row["sign_id"], back=True),
                rank=int(row["rank"]),
                camera=csv_cell(row["camera"], back=True),
                frame=int(row["frame"]),
                t_ns=int(row["t_ns"]),
                box=np.array([float(row[k]) for k in ("x_min", "y_min", "x_max", "y_max")]),
                score=float(row["score"] or "nan"),
                range_m=float(row["range_m"] or "nan"),
            )
            # never by the name in the index, which anyone may have edited
            jpeg = (index.parent / view.file).read_bytes()
            told = row.get("street") or ""
            context = (index.parent / view.context_file).read_bytes() if told else None
        except (OSError, KeyError, ValueError, TypeError):
            continue
        if jpeg.startswith(b"\xff\xd8"):
            pictures.append(Picture(view, jpeg, context, told != "shown"))
    return pictures


def pictures_by_sign(pictures: Sequence[Picture]) -> dict[str, list[Picture]]:
    """The pictures of each sign, nearest first."""
    by_sign: dict[str, list[Picture]] = {}
    for picture in sorted(pictures, key=lambda p: p.view.rank):
        by_sign.setdefault(picture.view.sign_id, []).append(picture)
    return by_sign
