"""Passes of signs that were not trained on: many views of one, as a drive sees it.

What a pass's views have in common is what makes their evidence saturate: the face, its dirt and
light, the optics, the weather and what the classifier confuses. Real ones are tracks of GTSRB;
drawn ones keep the draws of all of that from view to view, and change the size, the place on the
pixels, the box, the noise and the compression.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from automap.records import FloatArray
from automap.signs.classes import load_classes
from automap.signs.vocabulary import load_vocabulary
from automap.vision.classifier import SignClassifier, crop_faces
from automap.vision.voting import View
from pipeline.train import degrade, scenes
from pipeline.train.art import Face
from pipeline.train.classifier_data import jittered
from pipeline.train.drawings import Drawings
from pipeline.train.rendered import drawn_by_simulator
from pipeline.train.splits import Part, rank
from pipeline.train.street_data import Street, load_crops

Image = npt.NDArray[np.uint8]

FARTHEST_PX, NEAREST_PX = (11.0, 22.0), (24.0, 90.0)
"""Sizes of a drawn sign when it is first seen and last."""
VIEWS = (3, 16)
"""Of a drawn pass: a sign on a street is seen from every two metres of its approach."""


@dataclass(frozen=True)
class Pass:
    """The ``views`` of one sign, its class or its group's name, whether it is to check
    (else to fit) what is made of them, and the ``drawing`` or track that it shows."""

    name: str
    views: tuple[View, ...]
    check: bool
    drawing: str = ""


@dataclass(frozen=True)
class Drawn:
    """A face, BGRA, as its ``drawing`` is called, and the class or the group's name it has."""

    drawing: str
    image: Image
    name: str


def is_check(text: str) -> bool:
    """Whether a track or drawing is to check: by nothing but its name."""
    return rank(f"check/{text}") % 2 == 0


def track_passes(folder: Path, part: Part, classifier: SignClassifier) -> list[Pass]:
    """The tracks of one part of GTSRB."""
    number = {e.gtsdb: name for name, e in load_classes().items() if e.gtsdb is not None}
    tracks: dict[tuple[int, int], list[View]] = {}
    for crop in load_crops(folder, part):
        named = classifier.name(crop.image, crop.box[None])[0]
        height = float(crop.box[3] - crop.box[1])
        tracks.setdefault((crop.class_id, crop.track), []).append(View(named.alternatives, height))
    return [
        Pass(number[class_id], tuple(views), is_check(name := f"{class_id}/{track}"), name)
        for (class_id, track), views in tracks.items()
    ]


def held_faces(faces: Sequence[Face], country: str = "") -> tuple[list[Drawn], list[Drawn]]:
    """Drawings that were not trained on: of classes, the simulator's among them, and of none.

    ``country`` "AU" takes those of its classes and drawings alone.
    """
    held = Drawings(list(faces), held=True)
    classes = load_classes()
    at_home = [name for name, entry in classes.items() if not country or country in entry.codes]
    known = [
        Drawn(face.name, face.image, name)
        for name, drawn in held.art.items()
        for face in drawn
        if face.held and name in at_home
    ]
    known += [Drawn(f"simulator/{n}", i, n) for i, n in drawn_by_simulator() if n in at_home]
    groups = load_vocabulary().groups
    unknown = [
        Drawn(face.name, face.image, groups[group])
        for group, members in held.unknown.items()
        for face in members
        if face.name.startswith(f"{country}_" if country else "")
    ]
    return known, unknown


def seen_faces(faces: Sequence[Face], country: str = "") -> list[Drawn]:
    """Drawings of classes that were trained on, as they are: what stands on most streets."""
    classes = load_classes()
    return [
        Drawn(face.name, face.image, name)
        for name, drawn in Drawings(list(faces)).art.items()
        for face in drawn
        if not country or country in classes[name].codes
    ]


def drawn_passes(
    drawn: Sequence[Drawn],
    streets: Sequence[Street],
    classifier: SignClassifier,
    count: int,
    seed: int,
) -> list[Pass]:
    """``count`` passes by drawings chosen at random, each drawing as often as every other."""
    made = []
    for number in range(count):
        rng = np.random.default_rng([seed, number])
        face = drawn[number % len(drawn)]
        street = streets[int(rng.integers(len(streets)))]
        crops, heights = [], []
        for crop, height in _approach(face.image, street, rng):
            crops.append(crop)
            heights.append(height)
        if not crops:
            continue
        rows = classifier.probabilities(np.stack(crops))
        views = tuple(
            View(classifier.judge(row).alternatives, height)
            for row, height in zip(rows, heights, strict=True)
        )
        made.append(Pass(face.name, views, is_check(face.drawing), face.drawing))
    return made


def _approach(
    face: Image, street: Street, rng: np.random.Generator
) -> Iterator[tuple[Image, float]]:
    """Crops of a face that comes nearer, and the heights of their boxes, px."""
    height, width = street.image.shape[:2]
    first, last = (float(np.exp(rng.uniform(*np.log(span)))) for span in (FARTHEST_PX, NEAREST_PX))
    place = rng.uniform([150.0, 0.25 * height], [width - 150.0, 0.65 * height])
    drift, same = rng.uniform(-20.0, 20.0, 2), int(rng.integers(2**32))
    bias = rng.normal(0.0, 0.02, 4)
    high, wide = face.shape[:2]
    count = int(rng.integers(VIEWS[0], VIEWS[1] + 1))
    # equal steps of the way: the size grows as one over the distance that is left
    for step in np.linspace(0.0, 1.0, count):
        size = 1.0 / ((1.0 - step) / first + step / last)
        half = np.array([wide, high]) / np.sqrt(wide * high) * size / 2
        reach = int(half.max() * 1.5) + 6
        x, y = np.clip(place + step * drift, reach, np.array([width, height]) - reach - 1)
        left, top = int(x) - reach, int(y) - reach
        part = street.image[top : int(y) + reach, left : int(x) + reach].copy()
        middle = np.array([x - left, y - top])
        # what stays the same through the pass is drawn anew in the same way
        own = np.random.default_rng(same)
        placed = scenes.draw_face(part, face, np.concatenate([middle - half, middle + half]), own)
        if placed is None:
            continue
        part = degrade.at_random(degrade.exposed(part, own), own, 0.8)
        part = _own_noise(part, rng)
        box: FloatArray = jittered(placed, rng) + bias * np.tile(placed[2:] - placed[:2], 2)
        yield crop_faces(part, box[None])[0], float(box[3] - box[1])


def _own_noise(part: Image, rng: np.random.Generator) -> Image:
    """What differs from frame to frame: the sensor's noise, a little blur, and compression."""
    noisy = part + degrade.grain(rng, part.shape, rng.uniform(0.5, 4.0))
    part = np.clip(noisy, 0, 255).astype(np.uint8)
    if rng.random() < 0.3:
        part = np.asarray(cv2.GaussianBlur(part, (0, 0), rng.uniform(0.3, 0.9)), np.uint8)
    return degrade.compress(part, int(rng.integers(50, 90)))
