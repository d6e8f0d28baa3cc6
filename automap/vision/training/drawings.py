"""Which drawings stand for which class, and which for none."""

from __future__ import annotations

import re
from collections import Counter

import numpy as np
import numpy.typing as npt

from automap.vision.classes import load_classes
from automap.vision.training.art import Face
from automap.vision.training.numbers import (
    LIMITS,
    letter_face,
    limit_face,
    limit_name,
    on_plate,
    other_number,
)
from automap.vision.training.pictograms import picture_of, transplanted
from automap.vision.training.variants import varied

Image = npt.NDArray[np.uint8]
Random = np.random.Generator

_CIRCLES = {"red": "red-circle", "blue": "blue-circle", "green": "green-circle",
            "yellow": "yellow-circle", "orange": "yellow-circle"}  # fmt: skip


_LETTERS = {"information--parking--g1": "P", "information--hospital--g1": "H"}
_OTHER_NUMBER, _OTHER_LETTER = "red-circle/number", "blue-square/letter"
_GENERATED_KINDS = (_OTHER_NUMBER, _OTHER_LETTER)
_GENERATED = 0.7
_TRANSPLANTED = 0.3
_VARIANT = 0.25
"""Shares of a class's drawings: generated; with a picture from elsewhere; of another variant."""
_VARIED = 0.75
_ON_PLATE = 0.2
_MORE_LIMITS = 4
"""How many times more often a limit of speed is drawn than another class."""


def group_of_face(face: Face) -> str:
    """The group of shape and colour that a drawn face belongs to."""
    if face.shape == "circle":
        return _CIRCLES.get(face.colour, "white-circle")
    if face.shape == "octagon" and face.colour == "red":
        return "red-octagon"
    if face.shape in ("triangle-up", "triangle-down") and face.colour == "red":
        return f"red-{face.shape}"
    if face.shape == "diamond" and face.colour in ("yellow", "orange", "white"):
        return f"{face.colour}-diamond"
    if face.shape == "rectangle":
        colour = {"grey": "white", "brown": "red"}.get(face.colour, face.colour)
        return f"{colour}-square"
    return "other"


def group_of_kind(kind: str) -> str:
    """The group of a kind of unknown face; any other name as it is."""
    return kind.split("/")[0]


def _base(name: str) -> str:
    """A class name without its number of variant."""
    return re.sub(r"--(g\d+|au)$", "", name)


class Drawings:
    """Draws faces to train on; ``held`` draws those that are kept out of training instead.

    ``art`` by class, ``unknown`` by group, ``kinds`` of these: ``group/meaning``. The held ones
    come as they are. The others come in many hands: varied, generated, or with the picture that
    another country's sign of the same meaning shows, since a class is known to most countries by
    a drawing we do not have.
    """

    def __init__(self, faces: list[Face], held: bool = False) -> None:
        classes = load_classes()
        self._held = held
        by_name = {face.name: face for face in faces}
        self.art: dict[str, list[Face]] = {}
        for name, entry in classes.items():
            drawn = [by_name[a] for a in entry.art if a in by_name]
            free = [face for face in drawn if not face.held]
            kept = [face for face in drawn if face.held] if free else []
            chosen = kept if held else (free or drawn)
            if chosen:
                self.art[name] = chosen
        of_art = {a: name for name, entry in classes.items() for a in entry.art}
        looks = Counter((_base(name), entry.group) for name, entry in classes.items())
        only = {
            (_base(name), entry.group): name
            for name, entry in classes.items()
            if looks[_base(name), entry.group] == 1
        }
        self.unknown: dict[str, list[Face]] = {}
        self._variants: dict[str, list[Face]] = {}
        for face in faces:
            look = (_base(face.name), group_of_face(face))
            if face.plate or face.name in of_art:
                continue
            if look in looks:
                # a variant of a class that looks much like it is not unknown
                if look in only and not face.held and not held:
                    self._variants.setdefault(only[look], []).append(face)
            elif face.held == held:
                self.unknown.setdefault(look[1], []).append(face)
        kinds = {f"{group}/{_base(f.name)}" for group, of in self.unknown.items() for f in of}
        self.kinds = sorted(kinds | set(_GENERATED_KINDS))
        self._pictures = {} if held else self._of_same_meaning(faces, set(only.values()), of_art)

    def _of_same_meaning(
        self, faces: list[Face], names: set[str], of_art: dict[str, str]
    ) -> dict[str, list[Image]]:
        """Pictures of all free warnings of a class's meaning."""
        by_base: dict[str, list[Face]] = {}
        for face in faces:
            if not face.held:
                by_base.setdefault(_base(of_art.get(face.name, face.name)), []).append(face)
        result: dict[str, list[Image]] = {}
        for name in sorted(names):
            group = load_classes()[name].group
            if group in ("yellow-diamond", "red-triangle-up"):
                shapes = ("diamond", "triangle-up")
                sources = [f.image for f in by_base.get(_base(name), []) if f.shape in shapes]
                pictures = [p for p in map(picture_of, sources) if p is not None]
                if len(pictures) > 1:
                    result[name] = pictures
        return result

    def named(self, rng: Random) -> tuple[Image, str]:
        """A drawing, BGRA, of a class at random, and the class."""
        names = list(self.art)
        if not self._held:
            # the most frequent signs of all, and those whose drawings differ the most
            names += _MORE_LIMITS * [name for name in names if name in _LIMIT_OF]
        name = names[int(rng.integers(len(names)))]
        if self._held:
            return _one(self.art[name], rng), name
        image: Image | None = None
        if rng.random() < _GENERATED:
            image = _generated(name, rng)
        if image is not None:
            return image, name
        if name in self._variants and rng.random() < _VARIANT:
            image = _one(self._variants[name], rng)
        else:
            image = _one(self.art[name], rng)
            if name in self._pictures and rng.random() < _TRANSPLANTED:
                pictures = self._pictures[name]
                picture = pictures[int(rng.integers(len(pictures)))]
                other = transplanted(image, picture, rng)
                image = image if other is None else other
        image = _perhaps_varied(image, rng)
        if load_classes()[name].group == "red-circle" and rng.random() < _ON_PLATE:
            image = on_plate(image, rng)
        return image, name

    def other(self, rng: Random) -> tuple[Image, str]:
        """A drawing, BGRA, of a face that is no class, and its kind."""
        groups = list(self.unknown)
        share = np.array([len(self.unknown[g]) ** 0.5 for g in groups])
        group = groups[int(rng.choice(len(groups), p=share / share.sum()))]
        face = self.unknown[group][int(rng.integers(len(self.unknown[group])))]
        kind = f"{group}/{_base(face.name)}"
        if self._held:
            return face.image, kind
        if rng.random() < 0.15:
            if group == "red-circle":
                return limit_face(other_number(rng), rng), _OTHER_NUMBER
            if group == "blue-square":
                letters = "ABCDEFGIJKLMNOQRSTUVWXYZ123456789"
                letter = letters[int(rng.integers(len(letters)))]
                return letter_face(letter, rng), _OTHER_LETTER
        return _perhaps_varied(face.image, rng), kind


def _one(faces: list[Face], rng: Random) -> Image:
    return faces[int(rng.integers(len(faces)))].image


def _perhaps_varied(image: Image, rng: Random) -> Image:
    return varied(image, rng) if rng.random() < _VARIED else image


def _generated(name: str, rng: Random) -> Image | None:
    """A drawing by rule of a class that has one."""
    if name in _LETTERS:
        return letter_face(_LETTERS[name], rng)
    number = _LIMIT_OF.get(name)
    return None if number is None else limit_face(number, rng)


_LIMIT_OF = {limit_name(number): number for number in LIMITS}
