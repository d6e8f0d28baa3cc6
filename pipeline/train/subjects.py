"""Which pictures of faces show what no class of a group shows."""

from __future__ import annotations

import re
from collections.abc import Sequence

import cv2
import numpy as np
import numpy.typing as npt

from automap.signs.classes import load_classes
from pipeline.train.art import Face
from pipeline.train.pictograms import silhouette_of

Image = npt.NDArray[np.uint8]
Random = np.random.Generator

_SIDE = 96
_ALIKE, _TRIES = 0.5, 4
"""Overlap (intersection over union) from which on a picture of two parts is taken for one of those
that they are of, and how many pairs are tried. Chosen: drawings of one class overlap more."""
_OF_MANNER = frozenset({"ahead", "left", "right", "end", "zone", "road", "crossing", "only"})
"""Words of names that tell no subject."""
_OF_WAYS = frozenset({"turn", "curve", "winding", "direction", "lane", "keep", "pas", "straight",
                      "merge", "junction", "intersection", "roundabout", "narrow", "way", "go",
                      "reverse", "hairpin", "side", "traffic", "arrow", "through"})  # fmt: skip
"""Words of pictures of ways, which are alike whatever they are called."""


def _words(name: str) -> set[str]:
    """What a name speaks of: its words without those of manner, in the singular; none if it is a
    national code, which tells no subject."""
    if "--" not in name:
        return set()
    words = re.split(r"[-\s]+", name.split("/")[-1].split("--", 1)[-1])
    return {word.rstrip("s") for word in words if len(word) > 2} - _OF_MANNER


def foreign_pictures(
    by_base: dict[str, list[Face]], groups: Sequence[str]
) -> dict[str, list[Image]]:
    """For each of some ``groups`` the pictures of faces whose subject no class of the
    group has, white on black; ``by_base`` faces by meaning."""
    spoken: dict[str, set[str]] = {group: set() for group in groups}
    for name, entry in load_classes().items():
        if entry.group in spoken:
            spoken[entry.group] |= _words(name)
    pictures = [(_words(base), silhouettes(of, None)) for base, of in sorted(by_base.items())]
    return {
        group: [p for words, of in pictures if words and not words & (taken | _OF_WAYS) for p in of]
        for group, taken in spoken.items()
    }


def silhouettes(faces: list[Face], shape: str | None = "circle") -> list[Image]:
    """The pictures, white on black, of faces of one shape, or of any but plates."""
    chosen = [f.image for f in faces if (f.shape == shape if shape else not f.plate)]
    return [picture for picture in map(silhouette_of, chosen) if picture is not None]


def mixed_picture(pictures: Sequence[Image], rng: Random) -> Image | None:
    """Part of one picture and part of another, cut along a line through the middle, white on black.

    None if those that were tried are too much alike, or too like what came out.
    """
    for _ in range(_TRIES):
        one, two = (_squared(pictures[int(k)]) for k in rng.integers(0, len(pictures), 2))
        # most cuts part the upper from the lower half or the left one from the right
        angle = rng.integers(4) * np.pi / 2 if rng.random() < 0.7 else rng.uniform(0.0, 2 * np.pi)
        y, x = np.mgrid[0:_SIDE, 0:_SIDE] - (_SIDE - 1) / 2
        first = np.cos(angle) * x + np.sin(angle) * y > rng.uniform(-0.1, 0.1) * _SIDE
        both = np.where(first, one, two)
        if max(_overlap(both, one), _overlap(both, two)) < _ALIKE:
            return np.asarray(both, np.uint8)
    return None


def _squared(picture: Image) -> Image:
    """A picture in the middle of a square that it just fits."""
    scale = _SIDE / max(picture.shape)
    size = (max(1, round(picture.shape[1] * scale)), max(1, round(picture.shape[0] * scale)))
    drawn = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    square = np.zeros((_SIDE, _SIDE), np.uint8)
    y, x = (_SIDE - size[1]) // 2, (_SIDE - size[0]) // 2
    square[y : y + size[1], x : x + size[0]] = drawn
    return square


def _overlap(one: Image, two: Image) -> float:
    a, b = one > 127, two > 127
    return float((a & b).sum() / max((a | b).sum(), 1))
