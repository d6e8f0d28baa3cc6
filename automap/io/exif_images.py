"""Images with their place and time in EXIF, as Mapillary takes and gives them.

References: EXIF 2.32 (GPS IFD, DateTimeOriginal, SubSecTimeOriginal); mapillary_tools' image
description (MAPLatitude, MAPLongitude, MAPAltitude, MAPCaptureTime, MAPCompassHeading).
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from automap.errors import InputError
from automap.io.json_text import parse_json
from automap.timebase import QUARTER_S

_DESCRIPTION, _DATE_TIME, _SUB_SECOND, _OFFSET = 0x010E, 0x9003, 0x9291, 0x9011
_EXIF_IFD, _GPS_IFD = 0x8769, 0x8825
IMAGE_SUFFIXES = (".jpg", ".jpeg")


@dataclass(frozen=True)
class PlacedImage:
    """An image with UNIX time (s), degrees, height (m, NaN unknown), heading (deg, NaN unknown),
    accuracy (m, NaN unknown) and whether its time is only the camera's local calendar."""

    path: Path
    unix_s: float
    lat_deg: float
    lon_deg: float
    height_m: float
    heading_deg: float
    accuracy_m: float
    local_time: bool


def read_images(folder: Path) -> tuple[list[PlacedImage], list[str]]:
    """The JPEG images of a folder that have place and time, in their order in time, and a
    sentence on those that have not. Raises InputError when fewer than two have."""
    paths = sorted(path for path in folder.iterdir() if path.suffix.lower() in IMAGE_SUFFIXES)
    if not paths:
        raise InputError(f"{folder} holds no .jpg images; give the folder of one sequence.")
    images, without = [], []
    for path in paths:
        image = _read(path)
        if image is None:
            without.append(path.name)
        else:
            images.append(image)
    if len(images) < 2:
        raise InputError(
            f"{folder}: {len(images)} of {len(paths)} images have a place and a time in their "
            "EXIF; a sequence needs them, geotag it first."
        )
    sentences = []
    if without:
        sentences.append(
            f"{folder}: {len(without)} images without place or time, or damaged, were left out, "
            f"the first {without[0]}"
        )
    if any(image.local_time for image in images):
        sentences.append(
            f"{folder}: times without a zone are taken as UTC; relative times are not affected"
        )
    return sorted(images, key=lambda image: image.unix_s), sentences


def _read(path: Path) -> PlacedImage | None:
    from PIL import Image

    try:
        with warnings.catch_warnings():
            # headers alone are read, so a huge image costs nothing; what a damaged one lacks is
            # said by what is found in it
            warnings.simplefilter("ignore")
            with Image.open(path) as image:
                exif = image.getexif()
                tags: dict[int, Any] = dict(exif) | dict(exif.get_ifd(_EXIF_IFD))
                gps: dict[int, Any] = dict(exif.get_ifd(_GPS_IFD))
    except (OSError, ValueError, SyntaxError, KeyError, TypeError, Image.DecompressionBombError):
        return None
    try:
        return _described(path, tags) or _tagged(path, tags, gps)
    except (ValueError, TypeError, KeyError, ZeroDivisionError, IndexError, OverflowError):
        return None


def _described(path: Path, tags: dict[int, Any]) -> PlacedImage | None:
    """From mapillary_tools' description, which is exact to the millisecond."""
    text = tags.get(_DESCRIPTION)
    if not isinstance(text, str) or "MAPLatitude" not in text:
        return None
    values = parse_json(text)
    taken = datetime.strptime(values["MAPCaptureTime"], "%Y_%m_%d_%H_%M_%S_%f")
    heading = values.get("MAPCompassHeading") or {}
    return PlacedImage(
        path=path,
        unix_s=taken.replace(tzinfo=UTC).timestamp(),
        lat_deg=float(values["MAPLatitude"]),
        lon_deg=float(values["MAPLongitude"]),
        height_m=_or_nan(values.get("MAPAltitude")),
        heading_deg=_or_nan(heading.get("TrueHeading")),
        accuracy_m=_or_nan(values.get("MAPGPSAccuracyMeters")),
        local_time=False,
    )


def _tagged(path: Path, tags: dict[int, Any], gps: dict[int, Any]) -> PlacedImage | None:
    if 2 not in gps or 4 not in gps:
        return None
    unix, local = _time(tags, gps)
    if unix is None:
        return None
    height = _or_nan(gps.get(6))
    below = gps.get(5) in (1, b"\x01")
    return PlacedImage(
        path=path,
        unix_s=unix,
        lat_deg=_angle(gps[2]) * (-1.0 if str(gps.get(1, "N")).upper().startswith("S") else 1.0),
        lon_deg=_angle(gps[4]) * (-1.0 if str(gps.get(3, "E")).upper().startswith("W") else 1.0),
        height_m=-height if below else height,
        # magnetic directions are off by the declination
        heading_deg=_or_nan(gps.get(17)) if str(gps.get(16, "T")).upper() != "M" else np.nan,
        accuracy_m=_or_nan(gps.get(31)),
        local_time=local,
    )


def _time(tags: dict[int, Any], gps: dict[int, Any]) -> tuple[float | None, bool]:
    """UNIX time, and whether it is a calendar without a zone. The receiver's own time has whole
    seconds in most cameras, so the camera's with its fractions is preferred."""
    taken = tags.get(_DATE_TIME)
    if isinstance(taken, str) and taken.strip("\0 :"):
        whole = datetime.strptime(taken.strip("\0 ")[:19], "%Y:%m:%d %H:%M:%S")
        digits = "".join(c for c in str(tags.get(_SUB_SECOND, "")) if c.isdigit())
        seconds = whole.replace(tzinfo=UTC).timestamp() + float(f"0.{digits or 0}")
        zone = str(tags.get(_OFFSET, "")).strip("\0 ")
        if len(zone) == 6 and zone[0] in "+-":
            shift = int(zone[1:3]) * 3600 + int(zone[4:6]) * 60
            return seconds - (shift if zone[0] == "+" else -shift), False
        told = _receiver_time(gps)
        if told is None:
            return seconds, True
        # the receiver's time is UTC and tells the zone, of quarters of an hour
        return seconds - QUARTER_S * round((seconds - told) / QUARTER_S), False
    return _receiver_time(gps), False


def _receiver_time(gps: dict[int, Any]) -> float | None:
    """UNIX time that the receiver told, None where it is not there or damaged."""
    try:
        day = datetime.strptime(str(gps[29]).strip("\0 "), "%Y:%m:%d").replace(tzinfo=UTC)
        hour, minute, second = (float(v) for v in gps[7])
    except (KeyError, ValueError, TypeError, ZeroDivisionError):
        return None
    seconds = day.timestamp() + hour * 3600.0 + minute * 60.0 + second
    return seconds if np.isfinite(seconds) else None


def _angle(parts: Any) -> float:
    degrees, minutes, seconds = (float(v) for v in parts)
    angle = degrees + minutes / 60.0 + seconds / 3600.0
    if not 0.0 <= angle <= 180.0:
        raise ValueError("no angle")
    return angle


def _or_nan(value: Any) -> float:
    return float("nan") if value is None else float(value)
