"""Which drawings stand for which class, and which for none."""

from __future__ import annotations

import re
from collections import Counter

import numpy as np
import numpy.typing as npt

from automap.signs.classes import load_classes
from pipeline.train.art import Face
from pipeline.train.boards import other_board
from pipeline.train.composed import on_board, prohibition
from pipeline.train.layouts import bars, road_layout, words
from pipeline.train.numbers import (
    end_face,
    letter_face,
    limit_face,
    on_plate,
    other_end,
    other_number,
    worded_board,
)
from pipeline.train.pictograms import (
    ground_of,
    picture_of,
    redrawn,
    regrounded,
    transplanted,
)
from pipeline.train.recipes import (
    BOARDED,
    COMPOSED,
    LIMIT_OF,
    SHOWS,
    other_order,
    other_prohibition,
    recipes,
    stands_on_plate,
    words_of,
)
from pipeline.train.subjects import foreign_pictures, mixed_picture, silhouettes
from pipeline.train.symbols import strange_symbol
from pipeline.train.variants import varied

Image = npt.NDArray[np.uint8]
Random = np.random.Generator

_CIRCLES = {"red": "red-circle", "blue": "blue-circle", "green": "green-circle",
            "yellow": "yellow-circle", "orange": "yellow-circle"}  # fmt: skip
_OTHER_NUMBER, _OTHER_LETTER, _OTHER_END = (
    "red-circle/number", "blue-square/letter", "white-circle/number")  # fmt: skip
_OTHER_ORDER = "blue-circle/strange"
"""Kinds of unknown faces drawn by rule; letters in red rings are among the numbers."""
_STRANGE_GROUPS = ("yellow-diamond", "red-triangle-up", "red-circle", "blue-circle", "blue-square")
_BOARDS, _BOARD = ("white-square", "yellow-square"), 0.3
"""Groups of which plates are composed by rule, and the share of these."""
_WORDED = "red-triangle-down/words"
_WORDED_SHARE = 0.02
"""Red boards on their point with words, as Japan's for stop, and their share of unknown faces."""
_GENERATED_KINDS = (
    _OTHER_NUMBER, _OTHER_LETTER, _OTHER_END, _WORDED,
    *(f"{group}/strange" for group in (*_STRANGE_GROUPS, *_BOARDS)),
)  # fmt: skip
_STRANGE, _OTHERWISE = 0.35, (0.45, 0.25, 0.2, 0.1)
"""Share of the unknown faces of these groups whose picture is one that no class shows; of these a
picture that no sign shows, words, on warnings roads with side roads, and bars."""
_FOREIGN, _MIXED = 0.3, 0.35
"""Shares of these with the picture of a face of another subject than any class of the group, and on
warnings with one put together of two classes' pictures: what is near to classes and none teaches
most (after Hendrycks, Mazeika and Dietterich 2019, *Deep anomaly detection with outlier
exposure*). Parts of numbers and of arrows on discs are often those of another class."""
_GENERATED, _GENERATED_LIMIT = 0.6, 0.85
_TRANSPLANTED = 0.45
_VARIANT = 0.25
"""Shares of a class's drawings: generated; with a picture from elsewhere; of another variant."""
_VARIED = 0.75
_ON_PLATE, _ON_USUAL_PLATE, _ON_BOARD = 0.1, 0.4, 0.5
"""Shares on a plate of faces that stand on one nowhere, or somewhere; of those on boards."""
_MORE_LIMITS, _MORE_COMPOSED = 4, 1
"""How many times more often than another class limits of speed are drawn, and others by rule."""
_WARNINGS = ("yellow-diamond", "red-triangle-up")
_MANY_GROUNDS, _REGROUNDED = "yellow-diamond", 0.35
"""Warnings that stand on yellow, amber and fluorescent green alike, and the share of their drawings
on the ground of another: children on green alone and arrows on yellow alone teach colours."""
_BRIGHT = 150
"""Level that a ground has in one channel at least: a picture may be larger than its ground."""
_WARNING_SHAPES = ("diamond", "triangle-up")


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
        by_base: dict[str, list[Face]] = {}
        for face in faces:
            if not face.held and not held:
                by_base.setdefault(_base(of_art.get(face.name, face.name)), []).append(face)
        self._recipes = recipes([(base, f) for base, of in by_base.items() for f in of])
        groups = {name: classes[name].group for name in only.values()}
        groups |= {kind: group_of_kind(kind) for kind in self.kinds}
        self._pictures = _of_same_meaning(by_base, groups)
        self._of_group = {group: list(self.unknown.get(group, [])) for group in _STRANGE_GROUPS}
        for name, drawn in self.art.items():
            self._of_group.get(classes[name].group, []).extend(drawn)
        grounded = self._of_group.get(_MANY_GROUNDS, []) if not held else []
        grounds = [ground_of(face.image) for face in grounded]
        self._grounds = [colour for colour in grounds if colour.max() > _BRIGHT]
        self._foreign = {} if held else foreign_pictures(by_base, _STRANGE_GROUPS)
        of_classes: dict[str, list[Face]] = {}
        for name, drawn in self.art.items() if not held else ():
            of_classes.setdefault(classes[name].group, []).extend(drawn)
        self._shown = {g: silhouettes(of_classes.get(g, []), None) for g in _WARNINGS}
        self._prohibited = {
            kind: pictures
            for kind in self.kinds
            if group_of_kind(kind) == "red-circle"
            and (pictures := silhouettes(by_base.get(kind.split("/")[1], [])))
        }

    def named(self, rng: Random) -> tuple[Image, str]:
        """A drawing, BGRA, of a class at random, and the class."""
        names = list(self.art)
        if not self._held:
            # the most frequent signs of all, and those whose drawings differ the most
            names += _MORE_LIMITS * [name for name in self.art if name in LIMIT_OF]
            names += _MORE_COMPOSED * [name for name in self.art if name in COMPOSED]
        name = names[int(rng.integers(len(names)))]
        if self._held:
            return _one(self.art[name], rng), name
        return self._drawn(name, rng), name

    def _drawn(self, name: str, rng: Random) -> Image:
        """A drawing to train on of a class."""
        image: Image | None = None
        if rng.random() < (_GENERATED_LIMIT if name in LIMIT_OF else _GENERATED):
            image = self._recipes.composed(name, rng)
            if image is not None and name in LIMIT_OF:
                return image
        if image is None and name in self._variants and rng.random() < _VARIANT:
            image = _one(self._variants[name], rng)
        elif image is None:
            image = self._other_picture(name, _one(self.art[name], rng), rng)
        image = self._perhaps_varied(image, load_classes()[name].group, rng)
        if stands_on_plate(name):
            share = _ON_USUAL_PLATE
        else:
            share = _ON_PLATE if load_classes()[name].group == "red-circle" else 0.0
        if rng.random() < share and _round(image):
            image = on_plate(image, rng, words_of(name))
        if name in BOARDED and rng.random() < _ON_BOARD:
            image = on_board(image, rng)
        return image

    def _strange(self, group: str, rng: Random) -> Image | None:
        """A face of a class or of none with a picture that no sign shows; None if it has none."""
        symbol, foreign = _of_no_class(group, rng), self._foreign[group]
        chance, shown = rng.random(), self._shown.get(group, [])
        if foreign and chance < _FOREIGN:
            symbol = foreign[int(rng.integers(len(foreign)))]
        elif len(shown) > 1 and chance < _FOREIGN + _MIXED:
            mixed = mixed_picture(shown, rng)
            symbol = symbol if mixed is None else mixed
        if group == "red-circle":
            return prohibition(symbol, bool(rng.random() < 0.5), rng)
        return redrawn(_one(self._of_group[group], rng), symbol, rng)

    def _other_picture(self, name: str, image: Image, rng: Random) -> Image:
        """A face of a class or kind, at times with another picture of the same meaning."""
        other: Image | None = None
        if rng.random() < _TRANSPLANTED:
            if name in self._pictures and (name not in SHOWS or rng.random() < 0.5):
                pictures = self._pictures[name]
                other = transplanted(image, pictures[int(rng.integers(len(pictures)))], rng)
            else:
                other = self._recipes.redrawn(name, image, rng)
        return image if other is None else other

    def _perhaps_varied(self, image: Image, group: str, rng: Random) -> Image:
        """A face as another country or maker might have it."""
        if group == _MANY_GROUNDS and rng.random() < _REGROUNDED:
            image = regrounded(image, self._grounds[int(rng.integers(len(self._grounds)))])
        return varied(image, rng) if rng.random() < _VARIED else image

    def other(self, rng: Random) -> tuple[Image, str]:
        """A drawing, BGRA, of a face that is no class, and its kind."""
        if not self._held and rng.random() < _WORDED_SHARE:
            return self._perhaps_varied(worded_board(3, "", rng), "red-triangle-down", rng), _WORDED
        groups = list(self.unknown)
        share = np.array([len(self.unknown[g]) ** 0.5 for g in groups])
        group = groups[int(rng.choice(len(groups), p=share / share.sum()))]
        face = self.unknown[group][int(rng.integers(len(self.unknown[group])))]
        kind = f"{group}/{_base(face.name)}"
        if self._held:
            return face.image, kind
        if rng.random() < 0.15:
            if group == "red-circle":
                if rng.random() < 0.5:
                    return _perhaps_on_plate(other_prohibition(rng), rng), _OTHER_NUMBER
                return limit_face(other_number(rng), rng), _OTHER_NUMBER
            if group == "blue-square":
                letters = "ABCDEFGIJKLMNOQRSTUVWXYZ123456789"
                letter = letters[int(rng.integers(len(letters)))]
                return letter_face(letter, rng), _OTHER_LETTER
            if group == "blue-circle":
                return self._perhaps_varied(other_order(rng), group, rng), _OTHER_ORDER
            if group == "white-circle":
                return end_face(other_end(rng), rng), _OTHER_END
        if group in _BOARDS and rng.random() < _BOARD:
            image, group = other_board(rng)
            return self._perhaps_varied(image, group, rng), f"{group}/strange"
        if group in _STRANGE_GROUPS and rng.random() < _STRANGE:
            strange = self._strange(group, rng)
            if strange is not None:
                return self._perhaps_varied(strange, group, rng), f"{group}/strange"
        image = self._other_picture(kind, face.image, rng)
        if kind in self._prohibited and rng.random() < _TRANSPLANTED:
            pictures = self._prohibited[kind]
            picture = pictures[int(rng.integers(len(pictures)))]
            image = prohibition(picture, bool(rng.random() < 0.6), rng)
        image = self._perhaps_varied(image, group, rng)
        return (_perhaps_on_plate(image, rng) if group == "red-circle" else image), kind


def _of_no_class(group: str, rng: Random) -> Image:
    """A picture, white on black, that no class of a group shows."""
    kind = int(rng.choice(4, p=_OTHERWISE))
    if kind == 1:
        return words(rng)
    if kind == 2 and group in _WARNINGS:
        return road_layout(rng)
    return bars(rng) if kind == 3 else strange_symbol(rng)


def _of_same_meaning(
    by_base: dict[str, list[Face]], groups: dict[str, str]
) -> dict[str, list[Image]]:
    """Pictures of all warnings of the same meaning, for the classes and kinds that are warnings.

    ``by_base`` faces by meaning, ``groups`` of the classes and kinds.
    """
    result: dict[str, list[Image]] = {}
    for name, group in sorted(groups.items()):
        if group in _WARNINGS:
            of = by_base.get(_base(name.split("/")[-1]), [])
            sources = [face.image for face in of if face.shape in _WARNING_SHAPES]
            pictures = [p for p in map(picture_of, sources) if p is not None]
            if len(pictures) > 1:
                result[name] = pictures
    return result


def _one(faces: list[Face], rng: Random) -> Image:
    return faces[int(rng.integers(len(faces)))].image


def _perhaps_on_plate(image: Image, rng: Random) -> Image:
    if rng.random() < 0.5 * _ON_USUAL_PLATE and _round(image):
        return on_plate(image, rng)
    return image


def _round(image: Image) -> bool:
    """Whether a face leaves its corners free, as one that is no plate itself."""
    return bool(image[[0, 0, -1, -1], [0, -1, 0, -1], 3].max() < 128)
