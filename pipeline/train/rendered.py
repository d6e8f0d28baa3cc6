"""Scenes with drawn faces that were not trained on, in streets that were not trained on."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from automap.records import FloatArray
from automap.signs.classes import load_classes
from automap.signs.faces import draw_face as draw_vocabulary_face
from automap.signs.vocabulary import load_vocabulary
from automap.vision.network import NetworkDetector
from pipeline.train import degrade, scenes
from pipeline.train.art import Face
from pipeline.train.classifier_data import CropMaker
from pipeline.train.metrics import Figure, overlaps, share_with_interval
from pipeline.train.street_data import Street

Image = npt.NDArray[np.uint8]
Random = np.random.Generator
Chooser = Callable[[Random], tuple[Image, str]]
"""Draws a face, BGRA, and its name."""
_LEAST = 0.3


@dataclass(frozen=True)
class Scene:
    """A picture, the boxes [n, 4] of the faces set into it, what each is called, and which drawing
    it is, as a number."""

    image: Image
    boxes: FloatArray
    names: tuple[str, ...]
    drawings: tuple[int, ...]


def _weathered(image: Image, rng: Random) -> Image:
    """Light and optics of another camera on an ordinary day."""
    image = degrade.tone(image, rng.uniform(0.8, 1.15), rng.uniform(0.8, 1.3), 1.0)
    if rng.random() < 0.4:
        image = degrade.white_balance(image, rng.uniform(0.85, 1.15), rng.uniform(0.85, 1.15))
    if rng.random() < 0.3:
        image = degrade.motion_blur(image, rng.uniform(2.0, 4.0), rng.normal(0.0, 30.0))
    return degrade.compress(image, int(rng.integers(35, 85)))


def make_scenes(streets: list[Street], draw: Chooser, seed: int, each: int = 3) -> list[Scene]:
    """``each`` faces of 16 to 90 px in every street image, away from its own signs."""
    result = []
    for number, street in enumerate(streets):
        rng = np.random.default_rng([seed, number])
        image = street.image.copy()
        height, width = image.shape[:2]
        boxes: list[FloatArray] = []
        names: list[str] = []
        drawings: list[int] = []
        for _ in range(20 * each):
            if len(names) == each:
                break
            size = float(np.exp(rng.uniform(np.log(16), np.log(90))))
            face, name = draw(rng)
            high, wide = face.shape[:2]
            half = np.array([wide, high]) / np.sqrt(wide * high) * size / 2
            x, y = rng.uniform(60, width - 60), rng.uniform(0.25, 0.65) * height
            box = np.array([x - half[0], y - half[1], x + half[0], y + half[1]])
            grown = (box + np.array([-1, -1, 1, 1]) * size)[None]
            taken = np.concatenate([street.boxes, np.array(boxes).reshape(-1, 4)])
            if len(taken) and overlaps(grown, taken).max() > 0:
                continue
            scenes.pole(image, box, rng)
            placed = scenes.draw_face(image, face, box, rng)
            if placed is not None:
                boxes.append(placed)
                names.append(name)
                drawings.append(zlib.crc32(face.tobytes()))
        image = _weathered(image, rng)
        places = np.array(boxes).reshape(-1, 4)
        result.append(Scene(image, places, tuple(names), tuple(drawings)))
    return result


def in_turn(choices: Sequence[tuple[Image, str]]) -> Chooser:
    """Draws each of the faces as often as every other: of 200 drawings, a few of which go wrong
    wherever they stand, those that chance brings up twice would make the figures."""
    left: list[int] = []

    def draw(rng: Random) -> tuple[Image, str]:
        if not left:
            left.extend(rng.permutation(len(choices)).tolist())
        return choices[left.pop()]

    return draw


def australian_faces(faces: list[Face]) -> Chooser:
    """Faces that were not trained on: the simulator's drawings, and drawings that were held."""
    by_name = {face.name: face for face in faces}
    simulated = {name: face for face, name in drawn_by_simulator()}
    choices: list[tuple[Image, str]] = []
    for name, entry in load_classes().items():
        if "AU" not in entry.codes and name not in simulated:
            continue
        art = [by_name[a] for a in entry.art if a in by_name]
        if any(not face.held for face in art):
            choices += [(face.image, name) for face in art if face.held]
        if name in simulated:
            choices.append((simulated[name], name))
    return in_turn(choices)


def drawn_by_simulator() -> list[tuple[Image, str]]:
    """The simulator's own drawings, BGRA, and their classes."""
    return [
        (_cropped(draw_vocabulary_face(name)), name)
        for name in load_classes()
        if name in load_vocabulary().classes
    ]


def _cropped(face: Image) -> Image:
    rows, columns = np.nonzero(face[:, :, 3] > 127)
    return face[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1]


def foreign_faces(maker: CropMaker, country: str = "") -> Chooser:
    """Held faces that are no class of ours, called by their group's name.

    ``maker`` one of held faces; ``country``: those alone whose drawings' names begin with it. The
    Nordic warnings are among them: red triangles on yellow, a look that no training face has.
    """
    groups = load_vocabulary().groups
    choices = [
        (face.image, groups[group])
        for group, members in maker.unknown.items()
        for face in members
        if face.name.startswith(country)
    ]
    return in_turn(choices)


@dataclass(frozen=True)
class Outcome:
    """Of ``faces``: shares ``found``, and of those ``right`` in name, ``group`` right by group's
    name only, and ``wrong``: named as a class that they are not, with intervals by resampling
    drawings; ``by_name``: of every name how many were found and how many of these were right."""

    faces: int
    found: Figure
    right: Figure
    group: Figure
    wrong: Figure
    by_name: dict[str, tuple[int, int]]


def judge_scenes(detector: NetworkDetector, made: list[Scene]) -> Outcome:
    """What the detector makes of the scenes, at a score of 0.3."""
    vocabulary = load_vocabulary()
    rows: list[tuple[bool, bool, bool]] = []
    found: list[float] = []
    drawings: list[int] = []
    by_name: dict[str, tuple[int, int]] = {}
    for scene in made:
        signs = detector.detect(scene.image)
        table = overlaps(signs.box, scene.boxes)
        table[signs.score < _LEAST] = 0.0
        for j, name in enumerate(scene.names):
            drawings.append(scene.drawings[j])
            found.append(float(table[:, j].max(initial=0.0) >= 0.5))
            if not found[-1]:
                continue
            said = signs.class_name[int(table[:, j].argmax())]
            before = by_name.get(name, (0, 0))
            by_name[name] = before[0] + 1, before[1] + int(said == name)
            in_group = vocabulary.group_of(said) == vocabulary.group_of(name)
            group = said != name and in_group and said in vocabulary.groups.values()
            rows.append((said == name, group, said != name and said in load_classes()))
    seen = [drawing for drawing, hit in zip(drawings, found, strict=True) if hit]
    told = np.array(rows, np.float64).reshape(-1, 3).T
    right, group_only, wrong = (share_with_interval(column.tolist(), seen) for column in told)
    of_all = share_with_interval(found, drawings)
    return Outcome(len(found), of_all, right, group_only, wrong, by_name)
