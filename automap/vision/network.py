"""The detector that comes with the package: a trained network finds, another one names."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from automap.records import FloatArray, Image, IntArray
from automap.vision import limits
from automap.vision.classifier import SignClassifier
from automap.vision.dark import brightened
from automap.vision.detector import FoundSigns, Region
from automap.vision.onnx_model import OnnxModel

Floats = npt.NDArray[np.float32]

_STRIDE, _MULTIPLE = 4, 32
"""Of the heat map's cells, px, and what the sides of a picture must be a multiple of."""
_PAIR = np.dtype("V6")
_KINDS = 2
"""Heat maps: of the kinds that are labelled everywhere, and of all others."""
_LARGEST_STEP = 5.6
"""Of the logarithm of a distance in strides, as in the training: 1080 px."""


@dataclass(frozen=True)
class NetworkRules:
    """``min_score`` below which nothing is reported; ``overlap`` (IoU) from which two boxes are
    one sign; ``inside`` the share of a smaller box within a larger one that does the same;
    ``most`` boxes a picture; ``width`` in px to which smaller pictures are enlarged."""

    min_score: float = 0.08
    width: int = 1920
    overlap: float = 0.4
    inside: float = 0.8
    most: int = 32


def default_detector(country: str | None = None, threads: int = 1) -> NetworkDetector:
    """The detector that comes with the package.

    ``country`` (ISO 3166 alpha-2) chooses the set of classes; ``threads`` for one picture.
    """
    return NetworkDetector(country=country, threads=threads)


class NetworkDetector:
    """Finds signs from about 10 px to the whole picture and names their faces.

    The files are read when the first picture comes. One object may serve several threads, and
    may be handed to another process.
    """

    name = "network"
    calibrated = True

    def __init__(
        self,
        country: str | None = None,
        threads: int = 1,
        rules: NetworkRules | None = None,
        model: Path | None = None,
        classifier: SignClassifier | None = None,
    ) -> None:
        self.rules = rules or NetworkRules()
        self._model = OnnxModel("sign-detector.onnx", model, threads)
        self.classifier = classifier or SignClassifier(country, threads=threads)

    def detect(
        self, image: Image, region: Region | None = None, zoom: float | None = None
    ) -> FoundSigns:
        """Signs in a BGR picture [height, width, 3] of 8 bits.

        ``region`` (x_min, y_min, x_max, y_max in px) looks only there; ``zoom`` enlarges it
        first, which finds smaller signs in proportion, up to 180 px as enlarged, and costs its
        square; None goes by the size of the picture and looks for signs of all sizes.

        Raises ValueError for a picture of another kind, InputError for a broken model file.
        """
        if image.ndim != 3 or image.shape[2] != 3 or image.dtype != np.uint8:
            raise ValueError("the detector takes pictures with three channels of 8 bits")
        image = brightened(image)
        boxes, scores = self._propose(image, region, zoom)
        return self._named(image, boxes, scores)

    def detect_in(self, image: Image, region: Region) -> FoundSigns:
        """Signs within a region, as ``detect`` finds them there in the whole picture."""
        return self.detect(image, region)

    def zoom_of(self, image: Image) -> float:
        """How much a picture is enlarged: the smaller it is, the fewer pixels a far sign has."""
        return float(min(max(self.rules.width / max(image.shape[:2]), 1.0), limits.MOST_ZOOM))

    def zooms_of(self, image: Image, window: tuple[int, int, int, int]) -> list[float]:
        """By how much a window of a picture is enlarged to be searched, the most first.

        The network finds what is some 10 to 180 px large. Reduced copies, which cost a twelfth of
        the first search together, show it what is larger, up to the whole window.
        """
        first = self.zoom_of(image)
        largest = max(window[2] - window[0], window[3] - window[1])
        reduced = (first / by for by in limits.REDUCED_BY)
        return [first, *(z for z in reduced if z * largest >= limits.LEAST_COPY_PX)]

    def propose(
        self, image: Image, region: Region | None = None, zoom: float | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Boxes [n, 4] px and scores [n] of what may be signs, the best of each copy of the picture
        first, not yet named."""
        return self._propose(brightened(image), region, zoom)

    def _propose(
        self, image: Image, region: Region | None, zoom: float | None
    ) -> tuple[FloatArray, FloatArray]:
        height, width = image.shape[:2]
        x0, y0, x1, y1 = window = _window(region, width, height)
        part = image[y0:y1, x0:x1]
        boxes, scores = [np.zeros((0, 4))], [np.zeros(0)]
        if min(part.shape[:2]) >= 8:
            copy = part
            for step, z in enumerate([zoom] if zoom is not None else self.zooms_of(image, window)):
                # each reduced copy is made of the one before
                copy = _resized(copy if len(copy) < len(part) else part, part, z)
                own, score = self._in_copy(copy)
                # what a reduced copy shows in few pixels, the one before shows in more
                size = np.max(own[:, 2:] - own[:, :2], axis=1, initial=0.0)
                kept = size >= (limits.LEAST_REDUCED_PX if step else 0.0)
                scale = np.array([copy.shape[1] / part.shape[1], copy.shape[0] / part.shape[0]])
                # outlines run between pixels, whose centres are integers
                own = (own[kept] + 0.5) / np.tile(scale, 2) - 0.5 + np.array([x0, y0, x0, y0])
                boxes.append(own)
                scores.append(score[kept])
        return np.concatenate(boxes), np.concatenate(scores)

    def _in_copy(self, copy: Image) -> tuple[FloatArray, FloatArray]:
        """Boxes [n, 4] and scores [n] in pixels of what is searched."""
        maps = self._model.run(blocks_of(copy))[0]
        boxes, scores = decode_maps(maps, self.rules.min_score, 4 * self.rules.most)
        kept = distinct(boxes, scores, self.rules.overlap, self.rules.inside)[: self.rules.most]
        return boxes[kept], scores[kept]

    def _named(self, image: Image, boxes: FloatArray, scores: FloatArray) -> FoundSigns:
        weights = self._model.notes.get("score", limits.JOINT_WEIGHTS)
        # what no face could bring to the least score need not be named
        able = [joint_score(float(s), 1.0, weights) >= self.rules.min_score for s in scores]
        boxes, scores = boxes[able], scores[able]
        named = self.classifier.name(image, boxes)
        # a large face can be read: a rectangle that is then none of the classes is mostly the front
        # of a house, a window or a shop's board
        large = np.max(boxes[:, 2:] - boxes[:, :2], axis=1, initial=0.0) * self.zoom_of(image)
        read = large >= limits.LEAST_REDUCED_PX * limits.REDUCED_BY[0]
        odds = self.classifier.unknown_odds
        final = np.array(
            [
                doubted(
                    joint_score(
                        float(score), face.sign * (1.0 - face.board if legible else 1.0), weights
                    ),
                    face.known,
                    odds,
                )
                for score, face, legible in zip(scores, named, read, strict=True)
            ],
            np.float64,
        )
        # copies of the picture show the same sign, and parts of a large one
        order = distinct(boxes, final, self.rules.overlap, self.rules.inside)[: self.rules.most]
        order = order[final[order] >= self.rules.min_score]
        return FoundSigns(
            class_name=tuple(named[i].name for i in order),
            box=boxes[order].reshape(-1, 4),
            score=final[order],
            alternatives=tuple(named[i].alternatives for i in order),
        )


def joint_score(found: float, sign: float, weights: Sequence[float]) -> float:
    """One probability of a sign from what the detector and the classifier say.

    Their log-odds are added with ``weights`` after a bias, which were fitted to street images
    that neither was trained on.
    """
    odds = [
        math.log(p / (1.0 - p))
        for p in (min(max(v, limits.SURE), 1 - limits.SURE) for v in (found, sign))
    ]
    total = weights[0] + weights[1] * odds[0] + weights[2] * odds[1]
    return 1.0 / (1.0 + math.exp(-total))


def doubted(score: float, known: float, odds: float) -> float:
    """The probability of a sign whose face is one of the classes with ``known`` only.

    Wheels, lamps and shop boards look like signs to both networks, but seldom like one sign.
    ``odds`` of the country are how many signs of the classes there are for one of none: the
    fewer, the more such faces are signs. Never more than ``score``, and not less than even odds.
    """
    score = min(max(score, limits.SURE), 1.0 - limits.SURE)
    over = math.log(score / (1.0 - score))
    if over <= 0.0:
        return score
    unknown = 1.0 - known
    less = limits.UNKNOWN_DOUBT * over - math.log(limits.ODDS_AT_HOME / odds)
    return 1.0 / (1.0 + math.exp(-over + unknown * max(less, 0.0)))


def _resized(copy: Image, part: Image, zoom: float) -> Image:
    """A part of a picture enlarged by ``zoom``, made of a ``copy`` of it."""
    if zoom == 1.0:
        return part
    high, wide = (max(8, round(side * zoom)) for side in part.shape[:2])
    how = cv2.INTER_LINEAR if zoom > 1.0 else cv2.INTER_AREA
    return np.asarray(cv2.resize(copy, (wide, high), interpolation=how), np.uint8)


def _window(region: Region | None, width: int, height: int) -> tuple[int, int, int, int]:
    """Whole pixels of the region within the picture."""
    if region is None:
        return 0, 0, width, height
    x0, y0 = (max(0, int(np.floor(v))) for v in region[:2])
    x1, y1 = min(width, int(np.ceil(region[2]))), min(height, int(np.ceil(region[3])))
    return x0, y0, max(x1, x0), max(y1, y0)


def blocks_of(image: Image) -> Image:
    """A picture as the network reads it: blocks of 2 by 2 pixels [1, h / 2, w / 2, 12].

    The picture's sides are brought to multiples of 32 by its edge.
    """
    height, width = image.shape[:2]
    down, right = -height % _MULTIPLE, -width % _MULTIPLE
    if down or right:
        image = np.asarray(
            cv2.copyMakeBorder(image, 0, down, 0, right, cv2.BORDER_REPLICATE), np.uint8
        )
    rows, columns = image.shape[0] // 2, image.shape[1] // 2
    # two pixels beside one another are one run of memory
    pairs = np.ascontiguousarray(image).reshape(rows, 2, columns * 6).view(_PAIR)
    blocks = np.empty((rows, columns, 2), _PAIR)
    blocks[:, :, 0], blocks[:, :, 1] = pairs[:, 0], pairs[:, 1]
    return blocks.view(np.uint8).reshape(1, rows, columns, 12)


def decode_maps(maps: Floats, min_score: float, most: int) -> tuple[FloatArray, FloatArray]:
    """Boxes [n, 4] px and scores [n], best first, from the network's maps [6, h, w].

    A box for every cell that is the highest of its neighbours on its heat map.
    """
    logits = maps[:_KINDS].max(axis=0)
    least = np.log(min_score / (1.0 - min_score))
    highest = cv2.dilate(logits, np.ones((3, 3), np.uint8))
    rows, columns = np.nonzero((logits >= least) & (logits >= highest))
    values = logits[rows, columns]
    order = np.argsort(-values, kind="stable")[:most]
    rows, columns, values = rows[order], columns[order], values[order].astype(np.float64)
    return _mean_boxes(maps, logits, rows, columns), 1.0 / (1.0 + np.exp(-values))


def _mean_boxes(maps: Floats, logits: Floats, rows: IntArray, columns: IntArray) -> FloatArray:
    """Boxes [n, 4] px of the peaks [n]: means over the peak's cell and those around it.

    A cell counts by its heat and only within the middle of the peak's own box, where the
    network has learnt to tell the edges.
    """
    height, width = logits.shape
    own = _cell_boxes(maps, rows, columns)
    middle = (_STRIDE - 1) / 2.0
    peak = 1.0 / (1.0 + np.exp(-logits[rows, columns].astype(np.float64)))
    reach = np.maximum(limits.MIDDLE_SHARE * (own[:, 2:] - own[:, :2]), 1.0)
    total, weights = np.zeros((len(rows), 4)), np.zeros(len(rows))
    for down, right in product((-1, 0, 1), repeat=2):
        row, column = rows + down, columns + right
        inside = (row >= 0) & (row < height) & (column >= 0) & (column < width)
        row, column = np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)
        place = np.stack([column, row], axis=1) * float(_STRIDE) + middle
        away = np.abs(place - (own[:, :2] + own[:, 2:]) / 2.0)
        heat = 1.0 / (1.0 + np.exp(-logits[row, column].astype(np.float64)))
        near = inside & (away <= reach).all(axis=1) & (heat > limits.LEAST_HEAT * peak)
        share = np.where(near | ((down, right) == (0, 0)), heat, 0.0)
        total += share[:, None] * _cell_boxes(maps, row, column)
        weights += share
    return np.asarray(total / weights[:, None])


def _cell_boxes(maps: Floats, rows: IntArray, columns: IntArray) -> FloatArray:
    """The boxes [n, 4] px that cells tell."""
    x = columns * float(_STRIDE) + (_STRIDE - 1) / 2.0
    y = rows * float(_STRIDE) + (_STRIDE - 1) / 2.0
    steps = np.minimum(maps[_KINDS:, rows, columns].astype(np.float64), _LARGEST_STEP)
    left, up, right, down = np.exp(steps) * _STRIDE
    return np.stack([x - left, y - up, x + right, y + down], axis=1)


def distinct(
    boxes: FloatArray, scores: FloatArray, overlap: float, inside: float = 1.0
) -> IntArray:
    """Indices of the best boxes of every place, best first.

    A box goes that overlaps a better one by more than ``overlap`` (IoU), or of which the share
    ``inside`` of the smaller one lies in the larger.
    """
    order = np.argsort(-scores, kind="stable")
    ranked = boxes[order]
    area = np.prod(np.maximum(ranked[:, 2:] - ranked[:, :2], 1e-9), axis=1)
    low = np.maximum(ranked[:, None, :2], ranked[None, :, :2])
    high = np.minimum(ranked[:, None, 2:], ranked[None, :, 2:])
    common = np.prod(np.maximum(high - low, 0.0), axis=2)
    union = area[:, None] + area - common
    smaller = np.minimum(area[:, None], area)
    same = (common > overlap * union) | (common > inside * smaller)
    open_ = np.ones(len(order), dtype=bool)
    kept: list[int] = []
    for i in range(len(order)):
        if open_[i]:
            kept.append(i)
            open_ &= ~same[i]
    return np.asarray(order[np.array(kept, np.int64)], np.int64)
