"""Training crops for the classifier: real ones, drawn ones, unknown faces and no signs."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from automap.records import FloatArray
from automap.signs.classes import load_classes
from automap.signs.vocabulary import load_vocabulary
from automap.vision.classifier import crop_faces
from pipeline.train import scenes
from pipeline.train.art import Face
from pipeline.train.degrade import at_random, exposed
from pipeline.train.drawings import Drawings, group_of_kind
from pipeline.train.mirror import mirrored_name
from pipeline.train.street_data import Crop, Street

Image = npt.NDArray[np.uint8]
Random = np.random.Generator

NO_SIGN = "no-sign"
_EVENNESS = 0.35
"""Power of the number of a class's crops with which it is drawn: 0 all classes alike."""


def labels() -> list[str]:
    """Names of the classifier's outputs as it is used: classes, groups, no sign."""
    return [*load_classes(), *load_vocabulary().groups, NO_SIGN]


def label_of(name: str) -> str:
    """The one of ``labels`` that a crop's name belongs to: a kind of unknown face to its group."""
    return group_of_kind(name)


@dataclass(frozen=True)
class _Real:
    image: Image
    box: FloatArray


class CropMaker:
    """Makes crops and their names; ``held`` draws the faces kept out of training instead.

    ``names``: what a crop may be called in training. Faces that are no class are told apart too,
    as kinds named ``group/meaning``: what a face shows in several drawings teaches what differs
    between drawings, and many kinds leave less room for a new face to be taken for a class.
    """

    def __init__(
        self, streets: list[Street], crops: list[Crop], faces: list[Face], held: bool = False
    ) -> None:
        classes = load_classes()
        self._streets = streets
        by_number = {c.gtsdb: name for name, c in classes.items() if c.gtsdb is not None}
        self._real: dict[str, list[_Real]] = {}
        for crop in crops:
            self._real.setdefault(by_number[crop.class_id], []).append(_Real(crop.image, crop.box))
        for street in streets:
            for box, number in zip(street.boxes, street.classes, strict=True):
                self._real.setdefault(by_number[int(number)], []).append(_Real(street.image, box))
        self._drawings = Drawings(faces, held)
        self.art, self.unknown = self._drawings.art, self._drawings.unknown
        self.names = [*classes, *self._drawings.kinds, NO_SIGN]

    def require_every_class(self) -> None:
        """Raise ValueError for classes of which there is no picture to learn from.

        Without this a training on a part of the faces takes these classes for none, in silence.
        """
        without = [name for name in load_classes() if name not in self.art | self._real]
        if without:
            raise ValueError(
                f"no drawing and no crop of {', '.join(without)}; give the training all faces of "
                "sign-art, those that are kept out of it too"
            )

    def real(self, rng: Random) -> tuple[Image, str]:
        """A crop of a real sign."""
        names = list(self._real)
        share = np.array([len(self._real[n]) ** _EVENNESS for n in names])
        name = names[int(rng.choice(len(names), p=share / share.sum()))]
        one = self._real[name][int(rng.integers(len(self._real[name])))]
        image, box = _near(one.image, one.box)
        if rng.random() < 0.6:
            image, box = _tilted(image, box, rng)
        if rng.random() < 0.5:
            image = at_random(exposed(image, rng), rng, 0.7)
        size = float((box[2:] - box[:2]).max())
        if rng.random() < 0.25 and size > 24:
            image, box = _smaller(image, box, rng.uniform(12, 24) / size)
        return _perhaps_mirrored(crop_faces(image, jittered(box, rng)[None])[0], name, rng)

    def drawn(self, rng: Random) -> tuple[Image, str]:
        """A drawn face of a class."""
        face, name = self._drawings.named(rng)
        return _perhaps_mirrored(self._set(face, rng), name, rng)

    def drawing(self, rng: Random) -> tuple[Image, str]:
        """A drawn face, BGRA, of a class or of none, and its name."""
        if rng.random() < 0.7:
            return self._drawings.named(rng)
        face, kind = self._drawings.other(rng)
        return face, load_vocabulary().groups[group_of_kind(kind)]

    def other(self, rng: Random) -> tuple[Image, str]:
        """A drawn face that is no class, called by its kind."""
        face, kind = self._drawings.other(rng)
        return self._set(face, rng), kind

    def nothing(self, rng: Random) -> tuple[Image, str]:
        """A crop without a sign, or with so little of one that it is none."""
        street = self._streets[int(rng.integers(len(self._streets)))]
        height, width = street.image.shape[:2]
        for _ in range(20):
            size = float(np.exp(rng.uniform(np.log(10), np.log(100))))
            x, y = rng.uniform(0, width - size), rng.uniform(0.1, 0.85) * height
            wide = size * rng.uniform(0.7, 1.4)
            box = np.array([x, y, x + wide, y + size])
            if len(street.boxes) == 0:
                break
            low = np.maximum(box[:2], street.boxes[:, :2])
            high = np.minimum(box[2:], street.boxes[:, 2:])
            if np.prod(np.maximum(high - low, 0), axis=1).max() < 0.15 * wide * size:
                break
        image, box = _near(street.image, box)
        if rng.random() < 0.45:
            image = image.copy()
            at, size = (box[:2] + box[2:]) / 2, float((box[2:] - box[:2]).max())
            box = scenes.no_sign(image, rng, (float(at[0]), float(at[1])), size)
        image = at_random(image, rng, 0.8)
        return crop_faces(image, jittered(box, rng)[None])[0], NO_SIGN

    def _set(self, face: Image, rng: Random) -> Image:
        street = self._streets[int(rng.integers(len(self._streets)))]
        height, width = street.image.shape[:2]
        size = float(np.exp(rng.uniform(np.log(13), np.log(90))))
        high, wide = face.shape[:2]
        half = np.array([wide, high]) / np.sqrt(wide * high) * size / 2
        reach = int(half.max() * 1.5) + 6
        x = int(rng.uniform(reach, width - reach))
        y = int(rng.uniform(reach, height - reach))
        part = street.image[y - reach : y + reach, x - reach : x + reach].copy()
        middle = np.array([part.shape[1], part.shape[0]]) / 2
        if rng.random() < 0.3:
            # cameras see them small and sharpened as well as large
            part = np.asarray(cv2.GaussianBlur(part, (0, 0), 1.0), np.uint8)
        box = np.concatenate([middle - half, middle + half])
        if rng.random() < 0.6:
            scenes.pole(part, box, rng)
        placed = scenes.draw_face(part, face, box, rng)
        part = at_random(exposed(part, rng), rng, 0.8)
        return np.asarray(
            crop_faces(part, jittered(box if placed is None else placed, rng)[None])[0], np.uint8
        )


def jittered(box: FloatArray, rng: Random) -> FloatArray:
    """A box as a detector would give it."""
    size = box[2:] - box[:2] + 1.0
    blur = 0.045 + 0.35 / max(float(size.max()), 4.0)
    # all its edges out or in together too: how tight a box is differs between sources
    grown = size * rng.normal(0.0, 0.04)
    return np.asarray(
        box + rng.normal(0.0, blur, 4) * np.tile(size, 2) + np.concatenate([-grown, grown])
    )


def _perhaps_mirrored(image: Image, name: str, rng: Random) -> tuple[Image, str]:
    other = mirrored_name(name)
    if other is None or rng.random() < 0.5:
        return image, name
    return np.ascontiguousarray(image[:, ::-1]), other


def _tilted(image: Image, box: FloatArray, rng: Random) -> tuple[Image, FloatArray]:
    """Turned, sheared and narrowed about the box, as from another place."""
    angle, shear = rng.normal(0.0, np.radians(4.0)), rng.normal(0.0, 0.05)
    narrow = float(np.exp(rng.normal(0.0, 0.08)))
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    matrix = turn @ np.array([[narrow, shear], [0.0, 1.0]])
    middle = (box[:2] + box[2:]) / 2
    whole = np.column_stack([matrix, middle - matrix @ middle])
    moved = cv2.warpAffine(
        image, whole, (image.shape[1], image.shape[0]), flags=cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_REPLICATE,
    )  # fmt: skip
    half = (box[2:] - box[:2]) / 2 * [narrow, 1.0]
    return np.asarray(moved, np.uint8), np.concatenate([middle - half, middle + half])


def _near(image: Image, box: FloatArray) -> tuple[Image, FloatArray]:
    reach = 0.6 * float((box[2:] - box[:2]).max()) + 4
    low = np.maximum((box[:2] - reach).astype(int), 0)
    high = (box[2:] + reach).astype(int)
    return image[low[1] : high[1], low[0] : high[0]], box - np.tile(low, 2)


def _smaller(image: Image, box: FloatArray, factor: float) -> tuple[Image, FloatArray]:
    height, width = image.shape[:2]
    size = (max(4, round(width * factor)), max(4, round(height * factor)))
    small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    scale = np.tile(np.array([size[0] / width, size[1] / height]), 2)
    return np.asarray(small, np.uint8), (box + 0.5) * scale - 0.5
