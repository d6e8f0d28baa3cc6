"""Which pictures of faces show what no class of a group shows."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from automap.signs.classes import load_classes
from pipeline.train.art import Face
from pipeline.train.pictograms import silhouette_of

Image = npt.NDArray[np.uint8]

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
