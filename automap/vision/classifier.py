"""What the face in a box shows: class probabilities by a small network.

The network tells the classes of the table, one "unknown face" for each group of shape and
colour, and "no sign" apart. Its temperature was set on signs it was not trained on, so that of
the faces named with 90 % about nine in ten are right.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from automap.records import FloatArray, Image, IntArray
from automap.signs.classes import country_set, load_classes
from automap.signs.vocabulary import load_vocabulary
from automap.vision import limits
from automap.vision.detector import Alternatives
from automap.vision.onnx_model import OnnxModel

Floats = npt.NDArray[np.float32]

CROP_PX = 48
"""Side of what the network sees."""
_LISTED, _FAINT = 6, 0.01
"""Alternatives that are told of a face at most, and how probable they are at least."""
_BATCH = 32
"""Faces that are named at once."""


BOARDS = ("white-square", "black-square", "red-square", "orange-square", "other")
"""Groups whose faces are mostly fronts of houses, windows, adverts and cars where they are large.
Of such on 440 street images, none of six with even odds was a road sign; all five of the blue and
yellow ones were, most of them direction signs."""


@dataclass(frozen=True)
class Named:
    """What a face is: ``name``, ``alternatives``, the probability that it is a ``sign``, and if it
    is that it is no more than a board (rectangular, and none of the classes), and that it is the
    most probable of the classes (``known``)."""

    name: str
    alternatives: Alternatives
    sign: float
    board: float
    known: float


@dataclass(frozen=True)
class _Outcomes:
    """The outputs but "no sign": their ``names``, the first ``n_classes`` of them classes;
    each output's group as a number, what an unknown face of each group is called, and which
    outputs are unknown rectangles and other shapes (``boards``)."""

    names: tuple[str, ...]
    n_classes: int
    group_of: IntArray
    unknown: tuple[str, ...]
    boards: IntArray


def crop_faces(image: Image, boxes: FloatArray) -> Image:
    """The boxes [n, 4] with a margin as crops [n, CROP_PX, CROP_PX, 3] of a BGR picture."""
    crops = np.empty((len(boxes), CROP_PX, CROP_PX, 3), np.uint8)
    for crop, box in zip(crops, boxes, strict=True):
        size = np.maximum(box[2:] - box[:2] + 1.0, 2.0) * (1.0 + 2.0 * limits.FACE_MARGIN)
        middle = (box[:2] + box[2:]) / 2.0
        step = size / CROP_PX
        first = middle - size / 2.0 + step / 2.0
        source, low = image, np.zeros(2)
        if step.max() > 1.5:
            # averaged before it is thinned out
            near = np.maximum(np.floor(middle - size / 2.0 - 2.0), 0).astype(int)
            far = np.ceil(middle + size / 2.0 + 3.0).astype(int)
            source, low = image[near[1] : far[1], near[0] : far[0]], near
            if source.size == 0:
                source, low = image, np.zeros(2)
            else:
                kernel = (max(1, round(step[0])), max(1, round(step[1])))
                source = np.asarray(cv2.blur(source, kernel), np.uint8)
                # an even kernel's middle lies half a pixel before the pixel it is written to
                low = low - np.array([(k % 2 == 0) * 0.5 for k in kernel])
        matrix = np.array([[step[0], 0.0, first[0] - low[0]], [0.0, step[1], first[1] - low[1]]])
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        cv2.warpAffine(
            source, matrix, (CROP_PX, CROP_PX), crop, flags, cv2.BORDER_REPLICATE
        )  # fmt: skip
    return crops


class SignClassifier:
    """Names faces; ``country`` (ISO 3166 alpha-2) makes the classes of its set more probable."""

    def __init__(
        self, country: str | None = None, path: Path | None = None, threads: int = 1
    ) -> None:
        self._model = OnnxModel("sign-classifier.onnx", path, threads)
        self.country = country
        self._prior: Floats | None = None
        self._called: _Outcomes | None = None

    @property
    def labels(self) -> list[str]:
        """Names of the outputs: classes, then groups, then ``no-sign``."""
        labels: list[str] = self._model.notes["labels"]
        return labels

    def probabilities(self, crops: Image) -> Floats:
        """Calibrated probabilities [n, labels] of crops [n, CROP_PX, CROP_PX, 3], BGR."""
        temperature = float(self._model.notes.get("temperature", 1.0))
        rows = [
            self._model.run(np.ascontiguousarray(crops[i : i + _BATCH]))
            for i in range(0, len(crops), _BATCH)
        ]
        if not rows:
            return np.zeros((0, len(self.labels)), np.float32)
        logits = np.concatenate(rows) / temperature
        logits -= logits.max(axis=1, keepdims=True)
        p = np.exp(logits)
        # which sign it is depends on the country, not whether it is one
        sign = p[:, :-1].sum(axis=1, keepdims=True)
        weighted = p[:, :-1] * self._weights()
        p[:, :-1] = weighted * sign / weighted.sum(axis=1, keepdims=True).clip(1e-30)
        return np.asarray(p / p.sum(axis=1, keepdims=True), np.float32)

    def name(self, image: Image, boxes: FloatArray) -> list[Named]:
        """What is in the boxes [n, 4] px of a BGR picture."""
        return [self.judge(row) for row in self.probabilities(crop_faces(image, boxes))]

    def judge(self, probabilities: Floats) -> Named:
        """Name and alternatives for one row of probabilities.

        A class is named from ``limits.NAMED`` on, as for all views together; otherwise the group
        whose classes and unknown faces are the most probable together.
        """
        outcomes = self._outcomes()
        sign = 1.0 - float(probabilities[-1])
        p = probabilities[:-1] / max(sign, 1e-6)
        order = np.argsort(-p, kind="stable")[:_LISTED]
        listed = tuple((outcomes.names[i], float(p[i])) for i in order if p[i] >= _FAINT)
        board = float(p[outcomes.boards].sum())
        best, known = int(order[0]), float(p[: outcomes.n_classes].max())
        if best < outcomes.n_classes and p[best] >= limits.NAMED:
            return Named(outcomes.names[best], listed, sign, board, known)
        together = np.bincount(outcomes.group_of, weights=p)
        name = outcomes.unknown[int(together.argmax())]
        return Named(name, listed, sign, board, known)

    @property
    def unknown_odds(self) -> float:
        """How many signs that are one of the classes are expected for one that is none."""
        return limits.ODDS_AT_HOME if self.at_home else limits.ODDS_ELSEWHERE

    @property
    def at_home(self) -> bool:
        """Whether the country's set of signs is known."""
        return len(country_set(self.country)) < len(load_classes())

    def _outcomes(self) -> _Outcomes:
        """What the outputs but the last are called."""
        if self._called is None:
            labels, known = self.labels[:-1], load_classes()
            groups = [known[label].group if label in known else label for label in labels]
            order = list(dict.fromkeys(groups))
            told = load_vocabulary().groups
            self._called = _Outcomes(
                tuple(label if label in known else told[label] for label in labels),
                len(known),
                np.array([order.index(group) for group in groups], np.int64),
                tuple(told[group] for group in order),
                np.array(
                    [i for i, label in enumerate(labels) if label not in known and label in BOARDS]
                ),
            )
        return self._called

    def _weights(self) -> Floats:
        """Prior weights of all outputs but the last."""
        if self._prior is None:
            known, allowed = load_classes(), country_set(self.country)
            weights = [
                limits.TRAINED_ODDS / self.unknown_odds
                if label not in known
                else 1.0
                if label in allowed
                else limits.FOREIGN
                for label in self.labels[:-1]
            ]
            self._prior = np.array(weights, np.float32)
        return self._prior
