"""Signs by colour, shape and correlation, without any training.

Blobs of a sign colour are taken at several levels, kept when their outline is one that
signs of that colour have, measured to sub-pixel, and named by comparison with the drawn
faces of the vocabulary. A blob that looks like a sign's plate but like no known face is
named after its colour and shape.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from cv2.typing import MatLike

from automap.records import FloatArray
from automap.vision.align import align_face
from automap.vision.colour import COLOURS, LEVELS, colour_maps
from automap.vision.detector import FoundSigns, Image
from automap.vision.evidence import looks_like_plate
from automap.vision.refine import BlobMoments, blob_moments, moments_box
from automap.vision.shapes import match_shapes
from automap.vision.templates import match_face
from automap.vision.vocabulary import load_vocabulary

_GROUPS = {
    ("red", "circle"): "red-circle",
    ("red", "octagon"): "red-octagon",
    ("red", "triangle-down"): "red-triangle-down",
    ("red", "triangle-up"): "red-triangle-up",
    ("yellow", "diamond"): "yellow-diamond",
    ("blue", "circle"): "blue-circle",
    ("blue", "square"): "blue-square",
}
# shapes whose overlap is so alike that a small blob may be either: the face decides
_ALIKE = 0.05
_RIM = 1.28
"""A red ring is this much wider than what it encloses."""
_WHITE_RIM = 1.05
"""A face with a white rim is this much wider than its coloured area."""


@dataclass(frozen=True)
class ClassicalRules:
    """Limits of the classical detector.

    Sizes in pixels; ``largest`` as a fraction of the picture's height. ``solidity`` of a
    filled blob against its hull, or ``rim_share`` of an open ring. ``overlap`` of the hull with
    its ideal outline, less for a known face, more for the inside of a ring; ``correlation``
    from which a face takes a class's name, and ``lead`` it must have over the second best;
    ``smallest_named`` the size from which faces are told apart at all.
    """

    smallest: float = 11.0
    smallest_hole: float = 16.0
    largest: float = 0.5
    overlap_of_known: float = 0.78
    overlap: float = 0.86
    overlap_of_hole: float = 0.93
    solidity: float = 0.86
    rim_share: float = 0.85
    narrowest: float = 0.45
    widest: float = 1.35
    correlation: float = 0.80
    lead: float = 0.04
    octagon_correlation: float = 0.45
    smallest_named: float = 16.0
    same_sign: float = 0.45


@dataclass(frozen=True)
class _Blob:
    """A compact blob: hull [k, 2] px, its overlap with every outline, its box [4]."""

    hull: FloatArray
    overlaps: dict[str, float]
    box: FloatArray

    @property
    def best(self) -> float:
        return max(self.overlaps.values())


@dataclass(frozen=True)
class _Candidate:
    box: FloatArray
    name: str
    score: float


class ClassicalDetector:
    """Colour-and-shape detector for the faces of the vocabulary."""

    name = "classical"

    def __init__(self, rules: ClassicalRules | None = None) -> None:
        self.rules = rules or ClassicalRules()

    def detect(self, image: Image) -> FoundSigns:
        """Signs in a BGR picture [height, width, 3] of 8 bits.

        Raises ValueError for anything else.
        """
        if image.ndim != 3 or image.shape[2] != 3 or image.dtype != np.uint8:
            raise ValueError("the detector takes pictures with three channels of 8 bits")
        candidates: list[_Candidate] = []
        maps = colour_maps(image)
        for colour in COLOURS:
            # a thin rim breaks where compression has taken its colour; closing the map
            # closes what is above any of its levels
            near = np.ones((3, 3), np.uint8)
            closed = np.asarray(cv2.morphologyEx(maps[colour], cv2.MORPH_CLOSE, near), np.uint8)
            blobs = [
                _Blob(
                    hull, match_shapes(hull), np.concatenate([hull.min(axis=0), hull.max(axis=0)])
                )
                for level in LEVELS[colour]
                for hull in self._blobs(closed, level, rings=colour == "red")
            ]
            for blob in _clearest(blobs):
                candidate = self._judge(image, maps[colour], colour, blob)
                if candidate is not None:
                    candidates.append(candidate)
        return _distinct(candidates, self.rules.same_sign)

    def _blobs(self, colour_map: Image, level: int, rings: bool) -> list[FloatArray]:
        """Hulls [k, 2] px of the compact blobs above a level, wholly within the picture.

        With ``rings`` a hole stands for the rim around it too: the rims of signs on one pole
        touch, but their insides do not.
        """
        _, binary = cv2.threshold(colour_map, level, 255, cv2.THRESH_BINARY)
        x, y, w, h = cv2.boundingRect(binary)
        if max(w, h) < self.rules.smallest:
            return []
        mode = cv2.RETR_CCOMP if rings else cv2.RETR_EXTERNAL
        contours, tree = cv2.findContours(
            binary[y : y + h, x : x + w], mode, cv2.CHAIN_APPROX_SIMPLE, offset=(x, y)
        )
        hulls = []
        for number, contour in enumerate(contours):
            hole = bool(tree[0][number][3] >= 0)
            if len(contour) < 4 or not self._fits(contour, colour_map, hole):
                continue
            hull = cv2.convexHull(contour)
            # areas of contours through pixel centres, each grown by half a pixel all around
            area = cv2.contourArea(contour) + 0.5 * cv2.arcLength(hull, True)
            hull_area = cv2.contourArea(hull) + 0.5 * cv2.arcLength(hull, True)
            filled = area >= self.rules.solidity * hull_area
            if hole and filled:
                inside = hull[:, 0, :].astype(np.float64)
                # gaps between red things are holes as well: a sign's inside is neat and not tiny
                if max(match_shapes(inside).values()) >= self.rules.overlap_of_hole:
                    hulls.append(_around(inside, _RIM))
            elif not hole and (filled or _rim_share(binary, hull) >= self.rules.rim_share):
                hulls.append(hull[:, 0, :].astype(np.float64))
        return hulls

    def _fits(self, contour: MatLike, colour_map: Image, hole: bool) -> bool:
        """Whether a contour has a sign's size and proportions and does not touch the edge."""
        rules = self.rules
        height, width = colour_map.shape
        x, y, w, h = cv2.boundingRect(contour)
        inside = x > 0 and y > 0 and x + w < width and y + h < height
        smallest = rules.smallest_hole if hole else rules.smallest
        sized = max(w, h) >= smallest and min(w, h) >= smallest * rules.narrowest
        slim = rules.narrowest <= w / h <= rules.widest
        return inside and sized and slim and h <= rules.largest * height

    def _judge(
        self, image: Image, colour_map: Image, colour: str, blob: _Blob
    ) -> _Candidate | None:
        clear = max(self.rules.overlap, blob.best - _ALIKE)
        shapes = [
            (shape, _GROUPS[colour, shape], overlap)
            for shape, overlap in blob.overlaps.items()
            if (colour, shape) in _GROUPS and overlap >= self.rules.overlap_of_known
        ]
        moments = blob_moments(colour_map, blob.hull) if shapes else None
        if moments is None:
            return None
        found: list[_Candidate] = []
        for shape, group, overlap in shapes:
            candidate = self._name(
                image, colour_map, moments, shape, group, overlap, known_only=overlap < clear
            )
            if candidate is not None:
                found.append(candidate)
        return max(found, key=lambda c: c.score, default=None)

    def _name(
        self,
        image: Image,
        colour_map: Image,
        moments: BlobMoments,
        shape: str,
        group: str,
        overlap: float,
        known_only: bool,
    ) -> _Candidate | None:
        rules = self.rules
        box = moments_box(moments, shape)
        if group in ("red-octagon", "blue-circle", "blue-square"):
            box = _scaled(box, _WHITE_RIM)
        size = float((box[2:] - box[:2]).max())
        match = match_face(image, box, shape, group)
        certain = (
            match.name is not None
            and size >= rules.smallest_named
            and match.correlation >= rules.correlation
            and match.correlation - match.runner_up >= rules.lead
        )
        # 0 at the least overlap that is accepted, 1 for a perfect outline
        form = (overlap - rules.overlap_of_known) / (1.0 - rules.overlap_of_known)
        if certain and match.name is not None:
            box = align_face(image, box, match.name)
            return _Candidate(box, match.name, 0.55 + 0.35 * match.correlation + 0.1 * form)
        if group == "red-octagon" and match.correlation < rules.octagon_correlation:
            # every octagon says STOP; a red blob of that form that says nothing is a lamp
            return None
        if known_only or not looks_like_plate(image, colour_map, box, shape, group):
            return None
        likeness = max(match.correlation, 0.0)
        name = load_vocabulary().groups[group]
        return _Candidate(box, name, 0.2 + 0.2 * likeness + 0.2 * form)


def _clearest(blobs: list[_Blob]) -> list[_Blob]:
    """Of blobs that are nearly the same at several levels, the one with the clearest form."""
    kept: list[_Blob] = []
    boxes = np.empty((len(blobs), 4))
    for blob in sorted(blobs, key=lambda b: -b.best):
        near = 0.12 * float((blob.box[2:] - blob.box[:2]).max())
        others = boxes[: len(kept)]
        if not (np.abs(others - blob.box).max(axis=1) <= near).any():
            boxes[len(kept)] = blob.box
            kept.append(blob)
    return kept


def _rim_share(binary: MatLike, hull: MatLike) -> float:
    """The share of a hull's edge along which its blob is present: 1 for a closed ring."""
    x, y, w, h = cv2.boundingRect(hull)
    edge = np.zeros((h, w), np.uint8)
    cv2.polylines(edge, [hull - [x, y]], True, 1)
    near = cv2.dilate(binary[y : y + h, x : x + w], np.ones((3, 3), np.uint8))
    return float((near[edge == 1] > 0).mean())


def _around(hull: FloatArray, factor: float) -> FloatArray:
    middle = (hull.min(axis=0) + hull.max(axis=0)) / 2.0
    return np.asarray(middle + (hull - middle) * factor)


def _scaled(box: FloatArray, factor: float) -> FloatArray:
    middle, half = (box[:2] + box[2:]) / 2.0, (box[2:] - box[:2]) / 2.0 * factor
    return np.concatenate([middle - half, middle + half])


def _distinct(candidates: list[_Candidate], same_sign: float) -> FoundSigns:
    """The best candidate of every place: others that overlap it or lie within it go."""
    kept: list[_Candidate] = []
    for candidate in sorted(candidates, key=lambda c: -c.score):
        if all(_share(candidate.box, other.box) < same_sign for other in kept):
            kept.append(candidate)
    return FoundSigns(
        class_name=tuple(c.name for c in kept),
        box=np.array([c.box for c in kept]).reshape(-1, 4),
        score=np.array([c.score for c in kept]),
    )


def _share(a: FloatArray, b: FloatArray) -> float:
    """Common area of two boxes over the smaller one's."""
    sides = np.minimum(a[2:], b[2:]) - np.maximum(a[:2], b[:2])
    if (sides <= 0).any():
        return 0.0
    least = min(np.prod(a[2:] - a[:2]), np.prod(b[2:] - b[:2]))
    return float(np.prod(sides) / least)
