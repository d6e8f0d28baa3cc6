"""A sequence of images with EXIF places as a drive folder."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from automap.io.atomic import write_bytes
from automap.records import FixType
from automap.timebase import unix_to_gps
from pipeline.importers.parts import gnss_section, video_section, write_arrival, write_image_files
from pipeline.importers.target import Import, new_drive

if TYPE_CHECKING:
    from automap.io.exif_images import PlacedImage

_NOTES = (
    "gnss.pos           the images' places and times; EXIF has no velocity, and most cameras",
    "                   give neither accuracy nor heights above the ellipsoid.",
    "video/             the images as they are, one frame each.",
    "There is no IMU: the path is that of the places, the heading the course.",
)


def import_mapillary(source: Path, out: Path) -> list[str]:
    """Write the images in the folder ``source`` as the drive ``out``; returns warnings."""
    from automap.errors import InputError
    from automap.io.exif_images import read_images

    with new_drive("mapillary", source, out) as run:
        if not run.source.is_dir():
            raise InputError(f"{source} is no folder; give the folder of one sequence of images.")
        images, warnings = read_images(run.source)
        for text in warnings:
            run.warn(text)
        run.sources += [image.path for image in images]
        _write_positions(run, images)
        sections = gnss_section("gnss.pos", "unix_ns") + _write_video(run, images)
        run.write_manifest(sections, _NOTES)
    return run.warnings


def _stamps(images: list[PlacedImage]) -> np.ndarray:
    return np.array([round(image.unix_s * 1e9) for image in images], np.int64)


def _write_positions(run: Import, images: list[PlacedImage]) -> None:
    from automap.io.pos_writer import pos_log

    accuracy = np.array([image.accuracy_m for image in images])
    sd = np.column_stack([accuracy / np.sqrt(2.0)] * 2 + [np.full(len(images), np.nan)])
    # several images may bear the same whole second; a position belongs to the first of them
    t_ns = _stamps(images)
    rows = np.flatnonzero(np.diff(t_ns, prepend=t_ns[0] - 1) > 0)
    log, offsets = pos_log(
        unix_to_gps(t_ns[rows] * 1e-9),
        np.array([images[i].lat_deg for i in rows]),
        np.array([images[i].lon_deg for i in rows]),
        np.array([images[i].height_m for i in rows]),
        np.full(len(rows), FixType.THREE_D),
        sd[rows],
    )
    write_bytes(run.folder / "gnss.pos", log)
    write_arrival(run, offsets, t_ns[rows])
    if len(rows) < len(images):
        run.warn(
            f"{run.source}: {len(images) - len(rows)} images share their second with another; "
            "their places are left out and their times spread between"
        )


def _write_video(run: Import, images: list[PlacedImage]) -> str:
    name = write_image_files(run, [image.path for image in images], _spread(_stamps(images)))
    return video_section(name, "unix_ns", more="mount_rpy_sigma_deg = 5.0\n")


def _spread(t_ns: np.ndarray) -> np.ndarray:
    """Stamps that increase: equal ones share the time to the next."""
    distinct, first = np.unique(t_ns, return_index=True)
    if len(distinct) == len(t_ns):
        return t_ns
    ends = np.append(first, len(t_ns))
    step = np.append(
        np.diff(distinct), np.median(np.diff(distinct)) if len(distinct) > 1 else 10**9
    )
    out = t_ns.copy()
    for i, start in enumerate(first):
        count = ends[i + 1] - start
        out[start : start + count] += np.rint(np.arange(count) * step[i] / count).astype(np.int64)
    return out
