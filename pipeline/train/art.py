"""Sign faces as pictures, with their shape and colour."""

from __future__ import annotations

import pickle
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from pipeline.train.splits import is_held_face

Image = npt.NDArray[np.uint8]

_PIXELS = 160
# neither a sign on its own nor one face: plates below signs, boards of text, examples
_NO_FACE = ("street-name", "--text", "directions", "highway-exit", "exit-ahead")


@dataclass(frozen=True)
class Face:
    """A face: BGRA [height, width, 4] cropped to what is drawn; ``name`` as its file is named.

    ``shape``: circle, octagon, triangle-up, triangle-down, diamond, rectangle or other;
    ``colour``: that of its rim if it is coloured, else of its ground. ``ground``: the most
    frequent colour. ``held``: kept out of training.
    """

    name: str
    image: Image
    shape: str
    colour: str
    ground: str
    held: bool

    @property
    def plate(self) -> bool:
        """A plate that stands below a sign."""
        return self.name.startswith("complementary")


def load_faces(art: Path, cache: Path) -> list[Face]:
    """All faces below ``art``, rendered once and kept in ``cache``."""
    if cache.is_file():
        with cache.open("rb") as stream:
            faces: list[Face] = pickle.load(stream)
        return faces
    faces = []
    for folder in ("mapillary", "au"):
        for path in sorted((art / folder).glob("*.svg")):
            if any(part in path.stem for part in _NO_FACE):
                continue
            image = _cropped(render(path, _PIXELS))
            if image is not None:
                colour, ground = _colours(image)
                name = path.stem
                # in Sweden, Finland and Iceland warnings stand on yellow: that look is kept
                # whole, as faces of a country never seen
                shape = _shape(image)
                nordic = shape == "triangle-up" and ground in ("yellow", "orange")
                held = nordic or is_held_face(name)
                faces.append(Face(name, image, shape, colour, ground, held))
    cache.parent.mkdir(parents=True, exist_ok=True)
    with cache.open("wb") as stream:
        pickle.dump(faces, stream)
    return faces


def render(path: Path, width: int) -> Image:
    """An SVG as BGRA."""
    import resvg_py

    options: dict[str, Any] = {"svg_path": str(path), "width": width}
    data = np.frombuffer(bytes(resvg_py.svg_to_bytes(**options)), np.uint8)
    return np.asarray(cv2.imdecode(data, cv2.IMREAD_UNCHANGED), np.uint8)


def _cropped(image: Image) -> Image | None:
    if image.ndim != 3 or image.shape[2] != 4:
        return None
    rows, columns = np.nonzero(image[:, :, 3] > 127)
    if len(rows) == 0:
        return None
    part = image[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1]
    return np.ascontiguousarray(part) if min(part.shape[:2]) >= 24 else None


def _shape(image: Image) -> str:
    cover = (image[:, :, 3] > 127).astype(np.uint8)
    height, width = cover.shape
    share = float(cover.mean())
    if width / height > 1.35 or height / width > 1.35 or share > 0.92:
        return "rectangle" if share > 0.8 else "other"
    square = cv2.resize(cover, (48, 48), interpolation=cv2.INTER_AREA)
    rows = square.mean(axis=1)
    if 0.42 < share < 0.72:
        third = 16
        top, bottom = rows[:third].mean(), rows[-third:].mean()
        if bottom > 1.6 * top:
            return "triangle-up"
        if top > 1.6 * bottom:
            return "triangle-down"
        return "diamond" if share < 0.62 else "other"
    edge = (rows[0] + rows[-1] + square[:, 0].mean() + square[:, -1].mean()) / 4
    if 0.75 < share < 0.81:
        return "circle"
    if 0.80 < share < 0.88 and edge > 0.3:
        return "octagon"
    return "other"


def _names(pixels: npt.NDArray[np.uint8]) -> npt.NDArray[np.str_]:
    """The colour name of each of BGR pixels [n, 3]."""
    hsv = cv2.cvtColor(pixels[None], cv2.COLOR_BGR2HSV)[0].astype(int)
    hue, saturation, value = hsv.T
    grey = saturation < 70
    tests = {
        "black": value < 70,
        "white": grey & (value > 150),
        "grey": grey,
        "red": (hue < 8) | (hue > 170),
        "brown": (hue < 17) & (value < 160),
        "orange": hue < 17,
        "yellow": hue < 45,
        "green": hue < 85,
        "blue": hue < 135,
    }
    return np.select(list(tests.values()), list(tests), "red")


def _colours(image: Image) -> tuple[str, str]:
    """The colour of the rim and the most frequent colour."""
    solid = (image[:, :, 3] > 200).astype(np.uint8)
    padded = cv2.copyMakeBorder(solid, 1, 1, 1, 1, cv2.BORDER_CONSTANT)
    depth = cv2.distanceTransform(padded, cv2.DIST_L2, 3)[1:-1, 1:-1] / max(solid.shape)
    inside = image[depth > 0.01, :3]
    if len(inside) == 0:
        inside = image[solid > 0, :3]
    names = _names(inside)
    found, counts = np.unique(names, return_counts=True)
    ground = str(found[counts.argmax()])
    rim = _names(image[(depth > 0.015) & (depth < 0.09), :3]) if (depth > 0.015).any() else names
    for colour in ("red", "blue", "green", "orange", "yellow"):
        if len(rim) and float((rim == colour).mean()) > 0.35:
            return colour, ground
    return ground, ground
