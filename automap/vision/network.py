"""The detector that comes with the package: a trained network finds, another one names."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from automap.records import FloatArray, Image, IntArray
from automap.vision import limits
from automap.vision.boxes import Floats, decode_maps, distinct
from automap.vision.classifier import SignClassifier
from automap.vision.dark import brightened
from automap.vision.detector import FoundSigns, Region
from automap.vision.fine import Window, fine_windows, whole
from automap.vision.onnx_model import OnnxModel
from automap.vision.scoring import least_found, sign_score, supported

_MULTIPLE = 32
"""What the sides of a picture must be a multiple of."""
_PAIR = np.dtype("V6")
_MOST_PEAKS = 128
"""Peaks of a heat map at most that become boxes: four times what is reported of a picture."""


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


@dataclass(frozen=True)
class _Look:
    """What was found in a copy or a part of a picture: ``boxes`` [n, 4] px of the picture,
    ``scores`` [n], and longest sides ``sizes`` [n] in px of what was searched."""

    boxes: FloatArray
    scores: FloatArray
    sizes: FloatArray

    def some(self, rows: IntArray) -> _Look:
        """Those in these rows."""
        return _Look(self.boxes[rows], self.scores[rows], self.sizes[rows])


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

    @property
    def country(self) -> str | None:
        """Whose signs are taken to be likely."""
        return self.classifier.country

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
        weights = self._model.notes.get("score", limits.JOINT_WEIGHTS)
        # what no face could bring to the least score need neither be read nor named
        least = least_found(self.rules.min_score, weights)
        boxes, scores = self._propose(image, region, zoom, max(least, self.rules.min_score))
        return self._named(image, boxes, scores, weights)

    def detect_in(self, image: Image, region: Region) -> FoundSigns:
        """Signs within a region, as ``detect`` finds them there in the whole picture."""
        return self.detect(image, region)

    def zoom_of(self, image: Image) -> float:
        """How much a picture is enlarged: the smaller it is, the fewer pixels a far sign has.

        Less than one for such that are much larger than the rules' width: the whole of these is
        searched in a copy, and pixel by pixel only where that may find more.
        """
        zoom = self.rules.width / float(max(image.shape[:2]))
        if zoom * limits.FINE_FROM <= 1.0:
            return zoom
        return float(min(max(zoom, 1.0), limits.MOST_ZOOM))

    def zooms_of(self, image: Image, window: Window) -> list[float]:
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
        return self._propose(brightened(image), region, zoom, self.rules.min_score)

    def _propose(
        self, image: Image, region: Region | None, zoom: float | None, least: float
    ) -> tuple[FloatArray, FloatArray]:
        height, width = image.shape[:2]
        x0, y0, x1, y1 = window = _window(region, width, height)
        part = image[y0:y1, x0:x1]
        if min(part.shape[:2]) < 8:
            return np.zeros((0, 4)), np.zeros(0)
        found: list[_Look] = []
        copy = part
        for step, z in enumerate([zoom] if zoom is not None else self.zooms_of(image, window)):
            # each reduced copy is made of the one before
            copy = _resized(copy if len(copy) < len(part) else part, part, z)
            maps = self._model.run(blocks_of(copy))[0]
            scale = np.array([copy.shape[1] / part.shape[1], copy.shape[0] / part.shape[0]])
            look = self._best(_read(maps, least, scale, (x0, y0)))
            if step == 0 and zoom is None and z < 1.0:
                hints = _read(maps, limits.FINE_HINT, scale, (x0, y0)).boxes
                look = self._best(_joined([look, *self._fine(image, window, hints, least)]))
            found.append(look)
        steps = np.repeat(np.arange(len(found)), [len(look.scores) for look in found])
        all_ = _joined(found)
        score = supported(all_.boxes, all_.scores, np.column_stack([steps, all_.sizes]))
        # what a reduced copy shows in few pixels, the one before shows in more
        kept = (steps == 0) | (all_.sizes >= limits.LEAST_REDUCED_PX)
        return all_.boxes[kept], score[kept]

    def _best(self, look: _Look) -> _Look:
        """The best box of each place, as many as a picture may have."""
        kept = distinct(look.boxes, look.scores, self.rules.overlap, self.rules.inside)
        return look.some(kept[: self.rules.most])

    def _fine(
        self, image: Image, window: Window, hints: FloatArray, least: float
    ) -> Iterator[_Look]:
        """What is small, from a large picture's own pixels where ``hints`` are and where far signs
        stand."""
        for piece in fine_windows(len(image), window, hints):
            left, top, right, bottom = piece
            maps = self._model.run(blocks_of(image[top:bottom, left:right]))[0]
            look = _read(maps, least, np.ones(2), (left, top))
            yield look.some(np.flatnonzero(whole(look.boxes, piece, window)))

    def _named(
        self, image: Image, boxes: FloatArray, scores: FloatArray, weights: Sequence[float]
    ) -> FoundSigns:
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


def _read(maps: Floats, least: float, scale: FloatArray, start: tuple[int, int]) -> _Look:
    """What the maps tell of a copy, of which ``scale`` [2] makes the part of the picture that
    begins at ``start``."""
    boxes, scores = decode_maps(maps, least, _MOST_PEAKS)
    sizes = np.max(boxes[:, 2:] - boxes[:, :2], axis=1, initial=0.0)
    # outlines run between pixels, whose centres are integers
    boxes = (boxes + 0.5) / np.tile(scale, 2) - 0.5 + np.tile(np.array(start), 2)
    return _Look(boxes, scores, sizes)


def _joined(looks: Sequence[_Look]) -> _Look:
    return _Look(
        np.concatenate([np.zeros((0, 4)), *(look.boxes for look in looks)]),
        np.concatenate([np.zeros(0), *(look.scores for look in looks)]),
        np.concatenate([np.zeros(0), *(look.sizes for look in looks)]),
    )


def _window(region: Region | None, width: int, height: int) -> Window:
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
