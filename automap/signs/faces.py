"""Sign faces drawn from the vocabulary."""

from __future__ import annotations

from functools import cache
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from automap.records import FloatArray, Image
from automap.signs.glyphs import text_strokes
from automap.signs.outlines import outline_points
from automap.signs.vocabulary import SignClass, Vocabulary, load_vocabulary

_OVERSAMPLING = 4
_SHIFT = 4
_RIM = 0.025


@cache
def draw_face(name: str, size: int = 256) -> Image:
    """The face of a class as BGRA [size, size, 4]; alpha is 0 outside the outline.

    The unit square spans the whole image: its left edge lies at x = -0.5.
    Raises KeyError for a class that is not in the vocabulary.
    """
    vocabulary = load_vocabulary()
    sign = vocabulary.classes[name]
    n = size * _OVERSAMPLING
    canvas = np.zeros((n, n, 3), np.uint8)
    outline = outline_points(sign.outline)
    _polygon(canvas, outline, _bgr(vocabulary, sign.rim or sign.border))
    inner = _shrunk(outline, _RIM) if sign.rim else outline
    _polygon(canvas, inner, _bgr(vocabulary, sign.border))
    if sign.border_width > 0.0:
        inner = _shrunk(inner, sign.border_width)
    _polygon(canvas, inner, _bgr(vocabulary, sign.fill))
    for mark in sign.marks:
        _draw_mark(canvas, mark, _bgr(vocabulary, mark["colour"]))
    alpha = np.zeros((n, n), np.uint8)
    _polygon(alpha, outline, (255,))
    small = cv2.resize(canvas, (size, size), interpolation=cv2.INTER_AREA)
    cover = cv2.resize(alpha, (size, size), interpolation=cv2.INTER_AREA)
    # inside the outline the colour is not mixed with the black around it
    share = np.maximum(cover, 1)[:, :, None] / 255.0
    colour = np.clip(small / share, 0, 255).astype(np.uint8)
    return np.dstack([colour, cover])


def usual_size(name: str) -> float | None:
    """Usual width in metres of a class, or of its group's members; None if unknown."""
    vocabulary = load_vocabulary()
    if name in vocabulary.classes:
        return vocabulary.classes[name].size_m
    members = _members(vocabulary, vocabulary.group_of(name))
    return float(np.median([m.size_m for m in members])) if members else None


def _members(vocabulary: Vocabulary, group: str | None) -> list[SignClass]:
    return [c for c in vocabulary.classes.values() if c.group == group]


def _bgr(vocabulary: Vocabulary, colour: str) -> tuple[int, int, int]:
    r, g, b = vocabulary.colours[colour]
    return b, g, r


def _shrunk(points: FloatArray, by: float) -> FloatArray:
    """A convex polygon with every side moved inwards by ``by``."""
    before, after = np.roll(points, 1, axis=0), np.roll(points, -1, axis=0)
    a, b = points - before, after - points
    a /= np.linalg.norm(a, axis=1, keepdims=True)
    b /= np.linalg.norm(b, axis=1, keepdims=True)
    inwards = b - a
    inwards /= np.linalg.norm(inwards, axis=1, keepdims=True)
    half_angle_sine = np.abs(a[:, 0] * inwards[:, 1] - a[:, 1] * inwards[:, 0])
    return points + inwards * (by / half_angle_sine)[:, None]


def _fixed(points: Any, n: int) -> npt.NDArray[np.int32]:
    # the unit square spans pixels -0.5 .. n - 0.5
    return np.rint((np.asarray(points, np.float64) * n - 0.5) * (1 << _SHIFT)).astype(np.int32)


def _polygon(canvas: Image, points: Any, colour: tuple[int, ...]) -> None:
    cv2.fillPoly(canvas, [_fixed(points, canvas.shape[0])], colour, cv2.LINE_AA, _SHIFT)


def _stroke(canvas: Image, points: Any, width: float, colour: tuple[int, ...]) -> None:
    n = canvas.shape[0]
    thickness = max(1, round(width * n))
    cv2.polylines(canvas, [_fixed(points, n)], False, colour, thickness, cv2.LINE_AA, _SHIFT)


def _draw_mark(canvas: Image, mark: dict[str, Any], colour: tuple[int, ...]) -> None:
    kind = mark["kind"]
    if kind == "polygon":
        _polygon(canvas, mark["points"], colour)
    elif kind == "stroke":
        _stroke(canvas, mark["points"], mark["width"], colour)
    elif kind == "disc":
        circle = outline_points("circle") - 0.5
        _polygon(canvas, np.array(mark["at"]) + 2.0 * mark["radius"] * circle, colour)
    elif kind == "arc":
        a = np.radians(np.linspace(mark["from_deg"], mark["to_deg"], 24))
        points = np.array(mark["at"]) + mark["radius"] * np.stack([np.cos(a), np.sin(a)], axis=1)
        _stroke(canvas, points, mark["width"], colour)
    elif kind == "text":
        at = (mark["at"][0], mark["at"][1])
        lines, width = text_strokes(mark["text"], at, mark["height"])
        for line in lines:
            _stroke(canvas, line, width, colour)
    else:
        raise ValueError(f"the vocabulary has a mark of unknown kind {kind!r}")
