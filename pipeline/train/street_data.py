"""The street images of GTSDB and the sign crops of GTSRB, in memory, split and free of leaks."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from automap.records import FloatArray
from pipeline.train.splits import Part, image_parts, track_part

Image = npt.NDArray[np.uint8]
LEAK = 0.88
"""Normalised correlation, surround included, from which two crops show the same sign."""
_PATCH = 32
_SHIFTS = (-2, -1, 0, 1, 2)
_SURROUND = 0.2


@dataclass(frozen=True)
class Street:
    """A street image: file name, BGR, boxes [n, 4] px, class numbers [n]."""

    name: str
    image: Image
    boxes: FloatArray
    classes: npt.NDArray[np.int64]


@dataclass(frozen=True)
class Crop:
    """A sign crop: BGR with a margin, ``box`` [4] of the sign in it."""

    image: Image
    box: FloatArray
    class_id: int
    track: int


def load_streets(folder: Path, part: Part) -> list[Street]:
    """The street images of one part."""
    boxes: dict[str, list[list[float]]] = {}
    with (folder / "boxes.csv").open(encoding="utf-8") as stream:
        for row in csv.DictReader(stream):
            corners = [float(row[k]) for k in ("x_min", "y_min", "x_max", "y_max")]
            boxes.setdefault(row["image"], []).append([*corners, float(row["class_id"])])
    names = sorted(path.name for path in (folder / "images").glob("*.jpg"))
    parts = image_parts(names)
    streets = []
    for name in names:
        if parts[name] == part:
            image = cv2.imread(str(folder / "images" / name), cv2.IMREAD_COLOR)
            table = np.array(boxes.get(name, []), np.float64).reshape(-1, 5)
            streets.append(
                Street(name, np.asarray(image, np.uint8), table[:, :4], table[:, 4].astype(int))
            )
    return streets


def load_crops(folder: Path, part: Part) -> list[Crop]:
    """The sign crops of the tracks of one part."""
    crops = []
    with (folder / "crops.csv").open(encoding="utf-8") as stream:
        for row in csv.DictReader(stream):
            class_id, track = int(row["class_id"]), int(row["track"])
            if track_part(class_id, track) != part:
                continue
            image = cv2.imread(str(folder / "crops" / row["image"]), cv2.IMREAD_COLOR)
            box = np.array([float(row[k]) for k in ("roi_x1", "roi_y1", "roi_x2", "roi_y2")])
            crops.append(Crop(np.asarray(image, np.uint8), box, class_id, track))
    return crops


def _patch(image: Image, box: FloatArray, dx: float = 0.0, dy: float = 0.0) -> FloatArray:
    """A sign with its surround as a vector of norm 1 without its mean."""
    size = (box[2:] - box[:2]) * (1.0 + 2.0 * _SURROUND)
    centre = (box[:2] + box[2:]) / 2.0 + size / _PATCH * [dx, dy]
    scale = size / _PATCH
    first = centre - size / 2.0 + scale / 2.0
    matrix = np.array([[scale[0], 0.0, first[0]], [0.0, scale[1], first[1]]])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    blurred = (
        image
        if scale.max() < 2
        else cv2.blur(image, (max(1, int(scale[0])), max(1, int(scale[1]))))
    )
    patch = cv2.warpAffine(
        blurred, matrix, (_PATCH, _PATCH), flags=flags, borderMode=cv2.BORDER_REPLICATE
    )
    vector = patch.astype(np.float32).ravel()
    vector -= vector.mean()
    return np.asarray(vector / max(float(np.linalg.norm(vector)), 1e-6))


def _around(image: Image, box: FloatArray) -> tuple[Image, FloatArray]:
    """The part of a large image near a box, and the box in it."""
    low = np.maximum((box[:2] - 80).astype(int), 0)
    high = (box[2:] + 80).astype(int)
    part = image[low[1] : high[1], low[0] : high[0]]
    return part, box - np.concatenate([low, low])


def same_signs(
    ours: list[tuple[Image, FloatArray]], theirs: list[tuple[Image, FloatArray]]
) -> npt.NDArray[np.float32]:
    """Best correlation [len(ours)] of each crop of ours with any of theirs, over small shifts."""
    best = np.full(len(ours), -1.0, np.float32)
    if not ours or not theirs:
        return best
    fixed = np.array([_patch(*_around(image, box)) for image, box in ours])
    for image, box in theirs:
        near, inside = _around(image, box)
        moved = np.array([_patch(near, inside, dx, dy) for dx in _SHIFTS for dy in _SHIFTS])
        best = np.maximum(best, (fixed @ moved.T).max(axis=1))
    return best


def signs_of(streets: list[Street]) -> list[tuple[Image, FloatArray]]:
    """Every labelled sign of street images with its image."""
    return [(street.image, box) for street in streets for box in street.boxes]


def leak_free_streets(train: list[Street], held: list[Street]) -> list[Street]:
    """Training images none of whose signs is one of the held-out images'."""
    best = same_signs(signs_of(train), signs_of(held))
    kept, at = [], 0
    for street in train:
        mine = best[at : at + len(street.boxes)]
        at += len(street.boxes)
        if not (mine > LEAK).any():
            kept.append(street)
    return kept


def leak_free_crops(train: list[Crop], held: list[tuple[Image, FloatArray]]) -> list[Crop]:
    """Training crops of tracks none of whose frames shows a held-out sign."""
    best = same_signs([(crop.image, crop.box) for crop in train], held)
    shared = {
        (crop.class_id, crop.track) for crop, value in zip(train, best, strict=True) if value > LEAK
    }
    return [crop for crop in train if (crop.class_id, crop.track) not in shared]
