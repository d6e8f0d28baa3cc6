"""GeoTIFF pictures: Pillow reads the pixels, the tags say where they lie (OGC GeoTIFF 1.1).

A coordinate system is taken by its EPSG number, or from a ``.prj`` beside the file as the place is
from a world file. Of a picture that is too large the finest reduced copy in the file is taken.
"""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np

from automap.errors import InputError
from automap.io.silence import silent_libraries
from automap.io.warped import Warped, pyramid
from automap.io.web_tiles import MOST_PIXELS, Image
from automap.records import FloatArray

_SCALE, _TIES, _MATRIX, _KEYS, _NODATA = 33550, 33922, 34264, 34735, 42113
_MODEL, _RASTER, _GEOGRAPHIC, _PROJECTED = 1024, 1025, 2048, 3072
_USER_DEFINED = 32767


def open_geotiff(path: Path) -> Warped:
    """A background of a GeoTIFF.

    Raises InputError for a damaged file, one without a place or coordinate system, and one too
    large for memory without reduced copies.
    """
    from PIL import Image as Pictures

    try:
        with silent_libraries(), Pictures.open(path, formats=["TIFF"]) as picture:
            tags: Any = dict(picture.tag_v2)  # type: ignore[attr-defined]
            crs, to_crs = _system(tags, path), _place(tags, path)
            full = picture.size
            _seek_bearable(picture, path)
            scale = np.diag([full[0] / picture.width, full[1] / picture.height, 1.0])
            image = _pixels(picture, tags.get(_NODATA))
    except (OSError, ValueError, SyntaxError, KeyError, TypeError, struct.error,
            Pictures.DecompressionBombError, MemoryError) as error:  # fmt: skip
        told = str(error) or type(error).__name__
        raise InputError(
            f"{path}: cannot be read as a GeoTIFF ({told.splitlines()[0]})."
        ) from error
    return Warped(path, crs, pyramid(image, to_crs @ scale))


def _seek_bearable(picture: Any, path: Path) -> None:
    """Go to the finest copy in the file that memory holds."""
    wide = picture.width / picture.height
    best: tuple[int, int] | None = None
    for number in range(getattr(picture, "n_frames", 1)):
        picture.seek(number)
        pixels = picture.width * picture.height
        # a mask or another page is no reduced copy
        alike = abs(picture.width / picture.height / wide - 1.0) < 0.02
        if alike and pixels <= MOST_PIXELS and (best is None or pixels > best[0]):
            best = pixels, number
    if best is None:
        raise InputError(
            f"{path}: has more than {MOST_PIXELS // 1_000_000} million pixels and no reduced copy; "
            "make tiles of it (gdal_translate -of MBTiles, then gdaladdo)."
        )
    picture.seek(best[1])


def _pixels(picture: Any, nodata: Any) -> Image:
    """The frame [h, w, 4]; values of more than eight bits are stretched over the middle 98 %."""
    if picture.mode in ("1", "L", "LA", "P", "PA", "RGB", "RGBA", "CMYK", "YCbCr", "RGBX"):
        image = np.array(picture.convert("RGBA"), np.uint8)
        if picture.mode not in ("LA", "PA", "RGBA") and _number(nodata) is not None:
            image[(image[..., :3] == _number(nodata)).all(axis=2), 3] = 0
        return image
    grey = np.asarray(picture, np.float64)
    known = np.isfinite(grey)
    if _number(nodata) is not None:
        known &= grey != _number(nodata)
    low, high = np.percentile(grey[known], [1, 99]) if known.any() else (0.0, 1.0)
    level = np.clip((np.where(known, grey, low) - low) / max(high - low, 1e-9), 0.0, 1.0)
    image = np.empty((*grey.shape, 4), np.uint8)
    image[..., :3] = np.rint(255.0 * level)[..., None]
    image[..., 3] = np.where(known, 255, 0)
    return image


def _number(text: Any) -> float | None:
    try:
        return float(str(text).strip("\0 "))
    except ValueError:
        return None


def _keys(tags: Any) -> dict[int, int]:
    """The GeoKeys whose value is a number in the directory itself."""
    values = tags.get(_KEYS, ())
    return {
        int(values[k]): int(values[k + 3])
        for k in range(4, len(values) - 3, 4)
        if int(values[k + 1]) == 0
    }


def _system(tags: Any, path: Path) -> str:
    keys = _keys(tags)
    for key in (_PROJECTED, _GEOGRAPHIC) if keys.get(_MODEL) != 2 else (_GEOGRAPHIC,):
        number = keys.get(key, 0)
        if 1024 <= number < _USER_DEFINED:
            return f"EPSG:{number}"
    beside = path.with_suffix(".prj")
    if beside.is_file():
        return beside.read_text(encoding="utf-8", errors="replace")
    how = "states its coordinate system by no EPSG number" if keys else "has no coordinate system"
    raise InputError(
        f"{path}: {how}; write one with gdalwarp -t_srs EPSG:3857, or add a .prj file."
    )


def _place(tags: Any, path: Path) -> FloatArray:
    """Pixels to coordinates [2, 3], from the first pixel's corner."""
    matrix, scale, ties = tags.get(_MATRIX), tags.get(_SCALE), tags.get(_TIES)
    if matrix is not None:
        place = np.array(matrix, np.float64).reshape(4, 4)[:2][:, [0, 1, 3]]
    elif scale is not None and ties is not None:
        column, row, _, x, y, _ = (float(v) for v in ties[:6])
        sx, sy = float(scale[0]), float(scale[1])
        place = np.array([[sx, 0.0, x - column * sx], [0.0, -sy, y + row * sy]])
    else:
        return _world_file(path)
    if _keys(tags).get(_RASTER) == 2:
        # the place is that of the first pixel's middle
        place[:, 2] -= 0.5 * (place[:, 0] + place[:, 1])
    return place


def _world_file(path: Path) -> FloatArray:
    for suffix in (".tfw", ".TFW", ".tifw", ".wld"):
        beside = path.with_suffix(suffix)
        if beside.is_file():
            a, d, b, e, c, f = (float(text) for text in beside.read_text("utf-8").split()[:6])
            return np.array([[a, b, c - 0.5 * (a + b)], [d, e, f - 0.5 * (d + e)]])
    raise InputError(f"{path}: does not say where it lies; it has neither tags nor a world file.")
