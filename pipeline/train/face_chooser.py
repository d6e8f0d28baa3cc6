"""Which faces are set into the detector's training pictures, and what kind each is."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from automap.signs.classes import load_classes
from pipeline.train.art import Face
from pipeline.train.drawings import Drawings, group_of_kind
from pipeline.train.numbers import limit_face, other_number, worded_board
from pipeline.train.variants import varied

Image = npt.NDArray[np.uint8]
Random = np.random.Generator

_VARIED, _LIMITS, _WORDED = 0.5, 0.06, 0.05
_COMPOSED = 0.35
"""Share of the faces that are drawn as for the classifier: composed by rule, on other grounds."""
_LABELLED_GROUPS = ("red-circle", "blue-circle", "white-circle", "red-triangle-up",
                    "red-triangle-down", "red-octagon")  # fmt: skip


def kind_of(face: Face) -> int:
    """0 for a face of a kind that GTSDB labels wherever it stands, 1 for any other."""
    if face.shape in ("triangle-up", "triangle-down", "octagon"):
        return 0 if face.colour in ("red", "white") else 1
    if face.shape == "circle":
        return 0 if face.colour in ("red", "blue", "white", "grey", "black") else 1
    return 0 if "priority-road" in face.name else 1


def kind_of_name(name: str) -> int:
    """The same for a class, or a kind of faces that are none."""
    classes = load_classes()
    group = classes[name].group if name in classes else group_of_kind(name)
    return 0 if group in _LABELLED_GROUPS or "priority-road" in name else 1


class FaceChooser:
    """Draws faces so that every shape and colour comes up, Australian ones more often."""

    def __init__(self, faces: list[Face]) -> None:
        usable = [f for f in faces if not f.held]
        self.plates = [f for f in usable if f.plate]
        signs = [f for f in usable if not f.plate]
        groups: dict[tuple[str, str, bool], list[Face]] = {}
        for face in signs:
            groups.setdefault((face.shape, face.colour, face.name.startswith("AU_")), []).append(
                face
            )
        self._groups = list(groups.values())
        share = np.array([len(group) ** 0.6 for group in self._groups])
        self._share = share / share.sum()
        self._drawings = Drawings(faces)

    def draw(self, rng: Random) -> tuple[Image, int]:
        """One face, BGRA, and its kind."""
        if rng.random() < _LIMITS:
            return limit_face(other_number(rng), rng), 0
        if rng.random() < _WORDED:
            corners = 8 if rng.random() < 0.7 else 3
            return varied(worded_board(corners, "", rng), rng), 0
        if rng.random() < _COMPOSED:
            draw = self._drawings.named if rng.random() < 0.5 else self._drawings.other
            composed, name = draw(rng)
            return composed, kind_of_name(name)
        group = self._groups[int(rng.choice(len(self._groups), p=self._share))]
        face = group[int(rng.integers(len(group)))]
        image = varied(face.image, rng) if rng.random() < _VARIED else face.image
        return image, kind_of(face)
