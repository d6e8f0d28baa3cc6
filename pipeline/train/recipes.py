"""What the faces of some classes are composed of, and what some pictures show."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from automap.signs.classes import load_classes
from pipeline.train.art import Face
from pipeline.train.composed import crossing_face, mandatory, prohibition
from pipeline.train.numbers import (
    END_OF,
    LIMITS,
    end_face,
    letter_face,
    letter_symbol,
    limit_face,
    limit_name,
    text_cover,
    worded_board,
)
from pipeline.train.people import person
from pipeline.train.pictograms import redrawn, silhouette_of
from pipeline.train.symbols import (
    forked_arrow,
    hand_in_hand,
    opposite_arrows,
    pointing_arrow,
    riding,
    ring_of_arrows,
    turn_arrow,
)

Image = npt.NDArray[np.uint8]
Random = np.random.Generator

LIMIT_OF = {limit_name(number): number for number in LIMITS}
_LETTERS = {"information--parking--g1": "P", "information--hospital--g1": "H"}
_END = f"regulatory--end-of-maximum-speed-limit-{END_OF}--g1"
_NO_WAY = {
    "regulatory--no-left-turn--g1": "left",
    "regulatory--no-right-turn--g1": "right",
    "regulatory--no-u-turn--g1": "u",
}
_CROSSING = "information--pedestrians-crossing--g1"
_NO_LETTER = {"regulatory--no-parking--g2": "P", "regulatory--no-stopping--g5": "S"}
_OTHER_LETTERS = "ABCDEFGHJKLMNRTVXZ"
_PICTURES = {
    "bicycle": ("warning--bicycles-crossing", "regulatory--bicycles-only",
                "regulatory--no-bicycles"),
    "pedestrian": ("regulatory--pedestrians-only", "regulatory--no-pedestrians",
                   "warning--pedestrians-crossing--g4"),
    "crossing": ("warning--pedestrians-crossing", "regulatory--pedestrians-only"),
    "truck": ("warning--trucks-crossing", "regulatory--no-heavy-goods-vehicles"),
}  # fmt: skip
"""The faces, by their names or these without variants, whose pictures show a subject alone."""
_PEOPLE = ("pedestrian", "crossing")
_NO_PICTURE = {
    "regulatory--no-bicycles--g1": ("bicycle", False),
    "regulatory--no-bicycles--g2": ("bicycle", True),
    "regulatory--no-pedestrians--g2": ("crossing", True),
    "regulatory--no-heavy-goods-vehicles--g1": ("truck", None),
}
"""Subject, and whether a bar crosses it; None: in some countries."""
_STOP = "regulatory--stop--g1"
_ORDERS = {
    "regulatory--go-straight--g1": lambda rng: pointing_arrow(0.0, rng),
    "regulatory--turn-right--g1": lambda rng: pointing_arrow(90.0, rng),
    "regulatory--turn-left--g1": lambda rng: pointing_arrow(-90.0, rng),
    "regulatory--keep-right--g1": lambda rng: pointing_arrow(rng.normal(135.0, 4.0), rng),
    "regulatory--keep-left--g1": lambda rng: pointing_arrow(rng.normal(-135.0, 4.0), rng),
    "regulatory--turn-right-ahead--g1": lambda rng: turn_arrow("right", rng),
    "regulatory--turn-left-ahead--g1": lambda rng: turn_arrow("left", rng),
    "regulatory--go-straight-or-turn-right--g1": lambda rng: forked_arrow(
        ("straight", "right"), rng
    ),
    "regulatory--go-straight-or-turn-left--g1": lambda rng: forked_arrow(("straight", "left"), rng),
    "regulatory--roundabout--g1": lambda rng: ring_of_arrows(rng),
}
"""What the blue discs of orders show: known by one drawing each, by rule in every country."""
SHOWS = {
    "warning--bicycles-crossing--g1": "bicycle",
    "warning--bicycles-crossing--g3": "bicycle",
    "regulatory--bicycles-only--g1": "bicycle",
    "regulatory--pedestrians-only--g1": "pedestrian",
    "warning--pedestrians-crossing--g4": "pedestrian",
    "warning--trucks-crossing--g1": "truck",
    "warning--children--g1": "children",
    "warning--children--g2": "children",
    "warning--two-way-traffic--g1": "opposite arrows",
    "warning--two-way-traffic--g2": "opposite arrows",
}
"""Classes that show a subject as they are, by the subject."""
COMPOSED = frozenset({*_LETTERS, _END, *_NO_WAY, *_NO_LETTER, *_NO_PICTURE, _CROSSING, _STOP,
                      *_ORDERS, *SHOWS})  # fmt: skip
"""Classes other than limits that are drawn by rule or with other pictures of their subject."""
_RIDDEN, _BY_RULE = 0.35, 0.5
"""Shares of the bicycles with a rider, and of people put together of strokes."""
_SHAPES = ("circle", "diamond", "triangle-up")


@dataclass(frozen=True)
class Recipes:
    """Draws classes by rule; ``silhouettes`` by subject, white on black."""

    silhouettes: dict[str, list[Image]]

    def composed(self, name: str, rng: Random) -> Image | None:
        """A drawing by rule of a class, BGRA; None if it has no rule."""
        if name in LIMIT_OF:
            return limit_face(LIMIT_OF[name], rng)
        if name in _LETTERS:
            return letter_face(_LETTERS[name], rng)
        if name == _END:
            return end_face(END_OF, rng)
        if name in _NO_WAY:
            return prohibition(turn_arrow(_NO_WAY[name], rng), bool(rng.random() < 0.9), rng)
        if name in _ORDERS:
            return mandatory(_ORDERS[name](rng), rng)
        if name == _STOP:
            return worded_board(8, "STOP" if rng.random() < 0.5 else "", rng)
        if name in _NO_LETTER:
            return prohibition(letter_symbol(_NO_LETTER[name], rng), True, rng)
        if name in _NO_PICTURE:
            subject, bar = _NO_PICTURE[name]
            picture = self._silhouette(subject, rng)
            crossed = bool(rng.random() < 0.5) if bar is None else bar
            return None if picture is None else prohibition(picture, crossed, rng)
        if name == _CROSSING:
            picture = self._silhouette("crossing", rng)
            return None if picture is None else crossing_face(picture, rng)
        return None

    def redrawn(self, name: str, face: Image, rng: Random) -> Image | None:
        """A face of a class with another picture of what it shows; None if none is known."""
        picture = self._silhouette(SHOWS.get(name, ""), rng)
        return None if picture is None else redrawn(face, picture, rng)

    def _silhouette(self, subject: str, rng: Random) -> Image | None:
        if subject == "children":
            pair = [self._silhouette("pedestrian", rng) for _ in range(2)]
            known = [figure for figure in pair if figure is not None]
            return hand_in_hand(known[0], known[1], rng) if len(known) == 2 else None
        if subject == "opposite arrows":
            return opposite_arrows(rng)
        if subject in _PEOPLE and rng.random() < _BY_RULE:
            return person(rng)
        pictures = self.silhouettes.get(subject, [])
        if not pictures:
            return None
        picture = pictures[int(rng.integers(len(pictures)))]
        figure = self._silhouette("pedestrian", rng) if subject == "bicycle" else None
        ridden = figure is not None and rng.random() < _RIDDEN
        return riding(figure, picture, rng) if figure is not None and ridden else picture


def recipes(free: list[tuple[str, Face]]) -> Recipes:
    """The rules, with the pictures of faces that are free to train on: base name and face."""
    silhouettes: dict[str, list[Image]] = {}
    for base, face in free:
        subjects = [s for s, of in _PICTURES.items() if base in of or face.name in of]
        picture = silhouette_of(face.image) if subjects and face.shape in _SHAPES else None
        for subject in subjects:
            if picture is not None:
                silhouettes.setdefault(subject, []).append(picture)
    return Recipes(silhouettes)


def other_prohibition(rng: Random) -> Image:
    """A ring about a letter, or an arrow ahead, that is no class."""
    if rng.random() < 0.3:
        return prohibition(turn_arrow("straight", rng), bool(rng.random() < 0.7), rng)
    letter = _OTHER_LETTERS[int(rng.integers(len(_OTHER_LETTERS)))]
    return prohibition(letter_symbol(letter, rng), bool(rng.random() < 0.7), rng)


def other_order(rng: Random) -> Image:
    """A blue disc that is no class: a number, ways to both sides, or an order that ends."""
    kind = int(rng.integers(4))
    if kind == 0:
        number = str(5 * int(rng.integers(1, 27)))
        high = rng.uniform(50.0, 90.0)
        symbol = np.asarray(255 * text_cover(number, rng, 90.0, high), np.uint8)
        return mandatory(symbol, rng, bool(rng.random() < 0.3))
    if kind == 1:
        ways = ("straight", "left", "right") if rng.random() < 0.3 else ("left", "right")
        return mandatory(forked_arrow(ways, rng), rng)
    if kind == 2:
        return mandatory(turn_arrow("u", rng), rng)
    names = list(_ORDERS)
    return mandatory(_ORDERS[names[int(rng.integers(len(names)))]](rng), rng, barred=True)


def words_of(name: str) -> str:
    """What a plate below or about the face of a class says: its meaning in capitals."""
    return re.sub(r"[-\s]+", " ", name.split("--")[1]).upper()


def stands_on_plate(name: str) -> bool:
    """Whether a class is a ring that stands on white plates in some country."""
    entry = load_classes()[name]
    return name in _NO_LETTER or (entry.group == "red-circle" and "AU" in entry.codes)


BOARDED = ("regulatory--railroad-crossing--au",)
"""Classes that stand on boards of one colour as well as on their own."""
