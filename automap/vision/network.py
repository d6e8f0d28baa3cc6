"""The detector that comes with the package: a trained network finds, another one names."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from automap.records import FloatArray, Image
from automap.vision import limits
from automap.vision.boxes import decode_maps, distinct
from automap.vision.classifier import SignClassifier
from automap.vision.dark import brightened
from automap.vision.detector import FoundSigns, Region
from automap.vision.onnx_model import OnnxModel
from automap.vision.scoring import joint_score, sign_score, supported

_MULTIPLE = 32
"""What the sides of a picture must be a multiple of."""
_PAIR = np.dtype("V6")


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
        boxes, scores, copies = [np.zeros((0, 4))], [np.zeros(0)], [np.zeros((0, 2))]
        if min(part.shape[:2]) >= 8:
            copy = part
            for step, z in enumerate([zoom] if zoom is not None else self.zooms_of(image, window)):
                # each reduced copy is made of the one before
                copy = _resized(copy if len(copy) < len(part) else part, part, z)
                own, score = self._in_copy(copy)
                size = np.max(own[:, 2:] - own[:, :2], axis=1, initial=0.0)
                scale = np.array([copy.shape[1] / part.shape[1], copy.shape[0] / part.shape[0]])
                # outlines run between pixels, whose centres are integers
                boxes.append((own + 0.5) / np.tile(scale, 2) - 0.5 + np.array([x0, y0, x0, y0]))
                scores.append(score)
                copies.append(np.column_stack([np.full(len(size), step), size]))
        shown = np.concatenate(copies)
        box = np.concatenate(boxes)
        score = supported(box, np.concatenate(scores), shown)
        # what a reduced copy shows in few pixels, the one before shows in more
        kept = (shown[:, 0] == 0) | (shown[:, 1] >= limits.LEAST_REDUCED_PX)
        return box[kept], score[kept]

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
        # a large face can be read
        large = np.max(boxes[:, 2:] - boxes[:, :2], axis=1, initial=0.0) * self.zoom_of(image)
        legible = large >= limits.LEAST_REDUCED_PX * limits.REDUCED_BY[0]
        odds = self.classifier.unknown_odds
        final = np.array(
            [
                sign_score(float(score), face, bool(clear), odds, weights)
                for score, face, clear in zip(scores, named, legible, strict=True)
            ],
            np.float64,
        )
        # copies of the picture show the same sign, and parts of a large one
        order = distinct(boxes, final, self.rules.overlap, self.rules.inside, limits.PART)[
            : self.rules.most
        ]
        order = order[final[order] >= self.rules.min_score]
        return FoundSigns(
            class_name=tuple(named[i].name for i in order),
            box=boxes[order].reshape(-1, 4),
            score=final[order],
            alternatives=tuple(named[i].alternatives for i in order),
        )


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
