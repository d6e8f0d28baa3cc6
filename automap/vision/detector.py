"""What a sign detector is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from automap.records import FloatArray

Image = npt.NDArray[np.uint8]


@dataclass(frozen=True)
class FoundSigns:
    """Signs in one picture, best first.

    ``class_name`` [n]; ``box`` [n, 4] x_min, y_min, x_max, y_max of the face's outline in
    pixels, sub-pixel, pixel centres being integers; ``score`` [n] in 0..1.
    """

    class_name: tuple[str, ...]
    box: FloatArray
    score: FloatArray

    def __len__(self) -> int:
        return len(self.class_name)


class Detector(Protocol):
    """Finds signs in single pictures; a trained one and the classical one look alike."""

    name: str

    def detect(self, image: Image) -> FoundSigns:
        """Signs in a BGR picture [height, width, 3]."""
        ...
