"""Training pictures for the detector: cut out of streets, with faces set into them."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from automap.records import FloatArray
from automap.vision.dark import brightened
from pipeline.train import scenes
from pipeline.train.art import Face
from pipeline.train.degrade import at_random, compress, exposed, motion_blur, night
from pipeline.train.drawn_streets import PREFIX
from pipeline.train.face_chooser import FaceChooser
from pipeline.train.street_data import Street

Image = npt.NDArray[np.uint8]
Floats = npt.NDArray[np.float32]
Random = np.random.Generator

SIZE = 192
STRIDE = 4
_SMALLEST, _LARGEST = 7.0, 230.0
_ZOOMED = 0.65
_ZOOMS = (1.2, 2.0)
"""Share of the pictures that are enlarged as the detector enlarges small ones, and by how much."""
_LEAST_CONTRAST = 4.0
_NIGHT, _BLURRED, _COMPRESSED = 0.14, 0.18, 0.06
"""Shares of the pictures that are spoilt by darkness, motion or compression more than chance has
it: what is missed of the images to tune on are small signs in motion, and burnt out or in deep
shade, which ``exposed`` makes."""


@dataclass(frozen=True)
class Sample:
    """``image`` [SIZE, SIZE, 3] BGR and the targets of ``detection_loss`` on its grid."""

    image: Image
    heat: Floats
    weight: Floats
    box: Floats
    near: Floats


def mirrored(sample: Sample) -> Sample:
    """Left and right exchanged."""
    return Sample(
        np.ascontiguousarray(sample.image[:, ::-1]),
        np.ascontiguousarray(sample.heat[:, :, ::-1]),
        np.ascontiguousarray(sample.weight[:, :, ::-1]),
        np.ascontiguousarray(sample.box[[2, 1, 0, 3], :, ::-1]),
        np.ascontiguousarray(sample.near[:, ::-1]),
    )


class SampleMaker:
    """Makes training pictures out of streets and faces."""

    def __init__(self, streets: list[Street], faces: list[Face]) -> None:
        self._drawn = [s for s in streets if s.name.startswith(PREFIX)]
        self._streets = [s for s in streets if not s.name.startswith(PREFIX)]
        self._with = [s for s in streets if len(s.boxes)]
        self._faces = FaceChooser(faces)

    def make(self, rng: Random) -> Sample:
        """One picture."""
        street = self._with if rng.random() < 0.6 else self._streets
        if self._drawn and rng.random() < 0.15:
            street = self._drawn
        chosen = street[int(rng.integers(len(street)))]
        zoom = rng.uniform(*_ZOOMS) if rng.random() < _ZOOMED else 1.0
        side = round(SIZE / zoom)
        image, boxes = self._cut(chosen, side, rng)
        kinds = [0] * len(boxes)
        if rng.random() < 0.6:
            for _ in range(int(rng.integers(1, 4))):
                _clutter(image, boxes, rng)
        if rng.random() < 0.8:
            boxes, kinds = self._set_faces(image, boxes, kinds, rng)
        # light, optics and compression come before the enlargement
        image = _spoilt(image, rng)
        if side < SIZE:
            image, boxes = _enlarged(image, boxes)
        if rng.random() < 0.5:
            image = np.ascontiguousarray(image[:, ::-1])
            boxes = [np.array([SIZE - 1 - b[2], b[1], SIZE - 1 - b[0], b[3]]) for b in boxes]
        return _targets(image, boxes, kinds)

    def _cut(self, street: Street, pixels: int, rng: Random) -> tuple[Image, list[FloatArray]]:
        scale = float(np.exp(rng.uniform(np.log(0.35), np.log(1.7))))
        side = pixels / scale
        height, width = street.image.shape[:2]
        if len(street.boxes) and rng.random() < 0.7:
            box = street.boxes[int(rng.integers(len(street.boxes)))]
            reach = side / 2 - (box[2:] - box[:2]).max() / 2
            centre = (box[:2] + box[2:]) / 2 + rng.uniform(-1, 1, 2) * max(reach, 4.0)
        else:
            centre = np.array([rng.uniform(0, width), rng.uniform(0.1, 0.9) * height])
        first = centre - side / 2
        source = street.image
        step = 1.0 / scale
        low = np.floor(first - 4).astype(int)
        high = np.ceil(first + side + 4).astype(int)
        low, high = np.maximum(low, 0), np.minimum(high, [width, height])
        part = source[low[1] : high[1], low[0] : high[0]]
        if step > 1.3:
            # averaged as a smaller sensor would, then brought to the grid
            part = np.asarray(cv2.GaussianBlur(part, (0, 0), 0.4 * step), np.uint8)
        first = first - low
        matrix = np.array(
            [[step, 0.0, first[0] + (step - 1) / 2], [0.0, step, first[1] + (step - 1) / 2]]
        )
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        image = cv2.warpAffine(
            part, matrix, (pixels, pixels), flags=flags, borderMode=cv2.BORDER_REFLECT_101
        )
        moved = (street.boxes - np.tile(low, 2) - np.tile(first, 2) - (step - 1) / 2) * scale
        last = pixels - 1
        inside = [b for b in moved if b[2] > 0 and b[3] > 0 and b[0] < last and b[1] < last]
        return np.asarray(image, np.uint8), inside

    def _set_faces(
        self, image: Image, boxes: list[FloatArray], kinds: list[int], rng: Random
    ) -> tuple[list[FloatArray], list[int]]:
        boxes, kinds = list(boxes), list(kinds)
        for _ in range(int(rng.integers(1, 4))):
            size = float(np.exp(rng.uniform(np.log(8), np.log(140))))
            x, y = rng.uniform(0, image.shape[1]), rng.uniform(0, image.shape[0])
            first = True
            for _ in range(1 if rng.random() < 0.75 else 2):
                face, kind = self._faces.draw(rng)
                high, wide = face.shape[:2]
                half = np.array([wide, high]) / np.sqrt(wide * high) * size / 2
                if max(half) > 115:
                    break
                box = np.array([x - half[0], y - half[1], x + half[0], y + half[1]])
                grown = box + np.array([-1, -1, 1, 1]) * 0.15 * size
                if any(_touch(grown, other) for other in boxes):
                    break
                if first and rng.random() < 0.7:
                    scenes.pole(image, box, rng)
                first = False
                placed = scenes.draw_face(image, face, box, rng)
                if placed is None:
                    break
                boxes.append(placed)
                kinds.append(kind)
                y = box[3] + size * 0.62
                if self._faces.plates and rng.random() < 0.15:
                    plate = self._faces.plates[int(rng.integers(len(self._faces.plates)))]
                    wide2 = half[0] * rng.uniform(0.7, 1.0)
                    high2 = wide2 * plate.image.shape[0] / plate.image.shape[1]
                    top = placed[3] + 0.05 * size
                    below = np.array([x - wide2, top, x + wide2, top + 2 * high2])
                    if not any(_touch(below, other) for other in boxes[:-1]):
                        scenes.draw_face(image, plate.image, below, rng)
                        boxes.append(below)
                        kinds.append(-1)
                    break
        return boxes, kinds


def _spoilt(image: Image, rng: Random) -> Image:
    """A picture as another camera might have taken it, as it is searched when it is dark."""
    chance = rng.random()
    if chance < _NIGHT:
        image = night(image, rng, rng.uniform(0.12, 0.4), rng.uniform(3.0, 14.0))
    elif chance < _NIGHT + _BLURRED:
        image = motion_blur(image, rng.uniform(4.0, 11.0), rng.normal(0.0, 30.0))
    elif chance < _NIGHT + _BLURRED + _COMPRESSED:
        image = compress(image, int(rng.uniform(10.0, 35.0)))
    else:
        image = at_random(exposed(image, rng), rng)
    return brightened(image)


def _clutter(image: Image, boxes: list[FloatArray], rng: Random) -> None:
    """Something that is no sign, unless it would hide one."""
    high, wide = image.shape[:2]
    size = float(np.exp(rng.uniform(np.log(8), np.log(70))))
    at = (float(rng.uniform(0, wide)), float(rng.uniform(0, high)))
    reach = 1.3 * size
    taken = np.array([at[0] - reach, at[1] - reach, at[0] + reach, at[1] + reach])
    if not any(_touch(taken, box) for box in boxes):
        scenes.no_sign(image, rng, at, size)


def _hidden(image: Image, box: FloatArray) -> bool:
    """Whether light and weather have left next to nothing to be seen of it."""
    x0, y0 = np.maximum(np.floor(box[:2]), 0).astype(int).tolist()
    x1, y1 = np.ceil(box[2:]).astype(int).tolist()
    part = cv2.resize(image[y0 : y1 + 1, x0 : x1 + 1], (6, 6), interpolation=cv2.INTER_AREA)
    return float(part.reshape(36, 3).std(axis=0).max()) < _LEAST_CONTRAST


def _enlarged(image: Image, boxes: list[FloatArray]) -> tuple[Image, list[FloatArray]]:
    """A picture brought to SIZE, as ``NetworkDetector.detect`` does it."""
    scale = SIZE / image.shape[0]
    image = np.asarray(cv2.resize(image, (SIZE, SIZE), interpolation=cv2.INTER_LINEAR), np.uint8)
    return image, [(box + 0.5) * scale - 0.5 for box in boxes]


def _touch(a: FloatArray, b: FloatArray) -> bool:
    return bool((np.minimum(a[2:], b[2:]) > np.maximum(a[:2], b[:2])).all())


def _cells(ends: FloatArray, n: int) -> slice:
    """The cells of the grid between two ends in px."""
    first, last = ((ends + 2) / STRIDE).round().astype(int).tolist()
    return slice(min(max(first, 0), n), min(max(last + 1, 0), n))


def _targets(image: Image, boxes: list[FloatArray], kinds: list[int]) -> Sample:
    n = SIZE // STRIDE
    heat = np.zeros((2, n, n), np.float32)
    weight = np.ones((2, n, n), np.float32)
    distances = np.zeros((4, n, n), np.float32)
    near = np.zeros((n, n), np.float32)
    # the middle of a cell in px; pixel centres are integers
    grid = np.arange(n, dtype=np.float32) * STRIDE + (STRIDE - 1) / 2
    order = np.argsort([-(b[2] - b[0]) * (b[3] - b[1]) for b in boxes])
    for i in order:
        box, kind = boxes[int(i)], kinds[int(i)]
        size = box[2:] - box[:2] + 1.0
        shown = np.clip(box, 0, SIZE - 1)
        whole = max(float(np.prod(size - 1)), 1.0)
        seen = float(np.prod(np.maximum(shown[2:] - shown[:2], 0))) / whole
        x = _cells(box[[0, 2]], n)
        y = _cells(box[[1, 3]], n)
        if kind < 0:
            # a plate below a sign is none and none of our business
            weight[1, y, x] = 0.0
            continue
        small = float(np.sqrt(np.prod(size))) < _SMALLEST
        if seen < 0.7 or small or size.max() > _LARGEST or _hidden(image, shown):
            weight[:, y, x] = 0.0
            continue
        centre = (box[:2] + box[2:]) / 2
        sd = np.maximum(size * 0.13, 1.4)
        bell = np.exp(
            -0.5 * ((grid[None, :] - centre[0]) / sd[0]) ** 2
            - 0.5 * ((grid[:, None] - centre[1]) / sd[1]) ** 2
        )
        cx = int(np.clip(np.rint((centre[0] - 1.5) / STRIDE), 0, n - 1))
        cy = int(np.clip(np.rint((centre[1] - 1.5) / STRIDE), 0, n - 1))
        bell = bell / max(float(bell[cy, cx]), 1e-6)
        bell = np.minimum(bell, 0.99)
        bell[cy, cx] = 1.0
        heat[kind] = np.maximum(heat[kind], bell)
        # a sign of the other kind there is a mistake of kind, not of place: little weight
        weight[1 - kind, y, x] *= 0.3
        inside = bell > 0.35
        share = np.where(inside, bell, 0.0)
        take = share > near
        near = np.where(take, share, near)
        edges = np.array(
            [
                np.broadcast_to(grid[None, :] - box[0], (n, n)),
                np.broadcast_to(grid[:, None] - box[1], (n, n)),
                np.broadcast_to(box[2] - grid[None, :], (n, n)),
                np.broadcast_to(box[3] - grid[:, None], (n, n)),
            ],
            np.float32,
        )
        distances = np.where(take[None] & (edges.min(axis=0) > 0)[None], edges, distances)
        near = np.where(take & (edges.min(axis=0) <= 0), 0.0, near).astype(np.float32)
    return Sample(image, heat, weight, distances, near)
