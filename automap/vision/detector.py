"""What a sign detector is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from automap.records import FloatArray, Image

Region = tuple[float, float, float, float]
"""x_min, y_min, x_max, y_max in pixels."""
Alternatives = tuple[tuple[str, float], ...]
"""Class names with their probabilities, best first; they need not sum to one."""


@dataclass(frozen=True)
class FoundSigns:
    """Signs in one picture, best first.

    ``class_name`` [n]; ``box`` [n, 4] x_min, y_min, x_max, y_max of the face's outline in
    pixels, sub-pixel, pixel centres being integers; ``score`` [n] in 0..1, the probability that
    a sign is there. ``alternatives`` [n], if the detector gives them: what the face may be, so
    that many views of one sign can vote on its class; None where only a name is known.
    """

    class_name: tuple[str, ...]
    box: FloatArray
    score: FloatArray
    alternatives: tuple[Alternatives, ...] | None = None

    def __len__(self) -> int:
        return len(self.class_name)


class Detector(Protocol):
    """Finds signs in single pictures; the one that comes along and the user's own look alike."""

    name: str

    def detect(self, image: Image) -> FoundSigns:
        """Signs in a BGR picture [height, width, 3]."""
        ...


@runtime_checkable
class CalibratedDetector(Detector, Protocol):
    """A detector by whose alternatives the pooling of views was fitted; ``country`` whose
    signs it takes to be likely."""

    @property
    def country(self) -> str | None:
        """Of ISO 3166 (alpha-2); None where it takes all classes alike."""
        ...


@runtime_checkable
class RegionDetector(Detector, Protocol):
    """A detector that looks at a part of a picture as it would at the whole of it."""

    def detect_in(self, image: Image, region: Region) -> FoundSigns:
        """Signs within a region of a BGR picture [height, width, 3]; boxes in the picture."""
        ...
