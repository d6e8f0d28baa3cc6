"""Faces of no class that are made as classes are: a picture of elsewhere, or two, on their ground.

What a face of a country never seen is taken for is the class it looks most like. Such faces share
the ground, the ink and the style of a class; the picture says something that no class of the group
says. Subjects are told by the words of a name, so that no picture of a class's own subject, in any
drawing, is called none.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from automap.signs.classes import load_classes
from pipeline.train.art import Face
from pipeline.train.composed import prohibition
from pipeline.train.pictograms import redrawn, silhouette_of

Image = npt.NDArray[np.uint8]
Random = np.random.Generator

_FAMILIES = {
    "people": "pedestrian child children bicycle bicycles people school walk cyclists cyclist "
    "riders rider equestrians hikers playground ice-cream blind elderly handicapped shared path "
    "mofas mopeds skiers snowmobiles wheelchair",
    "vehicles": "vehicles vehicle motor truck trucks heavy goods bus buses car cars motorcycle "
    "motorcycles trailer trailers tram trams train railroad tractor tractors carts overtaking "
    "caravan agricultural vans parking",
    "ways": "left right straight turn turns u keep pass curve curves road roads lane lanes merge "
    "merges merging traffic way double winding hairpin roundabout junction crossroads divided "
    "highway narrows ahead side intersection oncoming two one go bend bends bridge diverges added "
    "both either exit speed limit number priority end hump dip uneven bump",
    "animals": "animals animal cow cows cattle deer moose elephant horse horses kangaroo koala "
    "emu camel sheep duck ducks wild domestic bird birds frog tortoise wombat farm",
}
"""Words of names by what their pictures have in common. Two pictures of one family may well be a
class together: two cars, a mother and her child, arrows to both sides."""
_OF_WORD = {word: name for name, words in _FAMILIES.items() for word in words.split()}
_NO_SUBJECT = (
    "a and at by crossing end ends for maximum minimum no of only or other to with without"
)
_EMPTY = frozenset(_NO_SUBJECT.split())
"""Words that name no subject."""
_SIDE = 96
_TWO = 0.4
"""Share of the faces with two pictures."""
_BARRED = 0.5
"""Share of the red rings with a bar: as drawn by rule elsewhere."""
_TRIES = 6


def words_in(base: str) -> frozenset[str]:
    """The words of a name that tell a subject; drawings that are named by a code have none."""
    parts = base.split("--")
    return frozenset(re.findall("[a-z]+", parts[1])) - _EMPTY if len(parts) > 1 else frozenset()


def families(words: frozenset[str]) -> frozenset[str]:
    """What the pictures of these words may show; a subject that is in no family is its own."""
    return frozenset(_OF_WORD.get(word, word) for word in words)


@dataclass(frozen=True)
class NearFaces:
    """Makes faces of ``grounds`` by group: pictures, white on black, with the words of their
    names, and by group the words that its classes have (``said``)."""

    grounds: dict[str, list[Image]]
    pictures: list[tuple[frozenset[str], Image]]
    said: dict[str, frozenset[str]]

    def draw(self, group: str, rng: Random) -> Image | None:
        """A face of a group that is none of its classes, BGRA; None if none came out."""
        grounds = self.grounds.get(group, [])
        if not grounds or not self.pictures:
            return None
        for _ in range(_TRIES):
            symbol = self._two(rng) if rng.random() < _TWO else self._foreign(group, rng)
            if symbol is None:
                continue
            if group == "red-circle":
                return prohibition(symbol, bool(rng.random() < _BARRED), rng)
            face = redrawn(grounds[int(rng.integers(len(grounds)))], symbol, rng)
            if face is not None:
                return face
        return None

    def _one(self, rng: Random) -> tuple[frozenset[str], Image]:
        return self.pictures[int(rng.integers(len(self.pictures)))]

    def _foreign(self, group: str, rng: Random) -> Image | None:
        """A picture of which no class of the group shares a word, nor a family."""
        words, picture = self._one(rng)
        said = self.said.get(group, frozenset())
        return None if families(words) & families(said) else picture

    def _two(self, rng: Random) -> Image | None:
        """Two pictures of nothing in common, beside each other or one above the other."""
        (words, picture), (others, other) = self._one(rng), self._one(rng)
        if families(words) & families(others):
            return None
        return beside(picture, other, bool(rng.random() < 0.6), rng)


def beside(one: Image, other: Image, across: bool, rng: Random) -> Image:
    """Two pictures, white on black, in one: side by side or the one above the other."""
    sizes = [_SIDE, round(_SIDE * rng.uniform(0.6, 1.0))]
    parts = []
    for picture, size in zip((one, other), sizes, strict=True):
        scale = size / max(picture.shape)
        shape = (max(4, round(picture.shape[1] * scale)), max(4, round(picture.shape[0] * scale)))
        parts.append(np.asarray(cv2.resize(picture, shape, interpolation=cv2.INTER_AREA)))
    if not across:
        parts = [part.T for part in parts]
    gap = round(_SIDE * rng.uniform(0.05, 0.2))
    high = max(part.shape[0] for part in parts)
    result = np.zeros((high, parts[0].shape[1] + gap + parts[1].shape[1]), np.uint8)
    x = 0
    for part in parts:
        y = (high - part.shape[0]) // 2
        result[y : y + part.shape[0], x : x + part.shape[1]] = part
        x += part.shape[1] + gap
    return np.ascontiguousarray(result if across else result.T)


def near_faces(by_base: dict[str, list[Face]], grounds: dict[str, list[Face]]) -> NearFaces:
    """The maker, with the pictures of faces that are free to train on, by their names."""
    pictures = [
        (words, picture)
        for base, faces in by_base.items()
        if (words := words_in(base))
        for face in faces
        if (picture := silhouette_of(face.image)) is not None
    ]
    said: dict[str, frozenset[str]] = {}
    for name, entry in load_classes().items():
        said[entry.group] = said.get(entry.group, frozenset()) | words_in(name)
    return NearFaces({g: [f.image for f in of] for g, of in grounds.items()}, pictures, said)
