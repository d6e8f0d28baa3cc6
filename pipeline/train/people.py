"""People as signs show them, put together of strokes: no country's drawing, but the manner of many.

A head, a trunk, two arms and two legs that bend once: from before or in stride, as adult or child,
in trousers or a skirt, with a bag or none.
"""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from automap.records import FloatArray

Image = npt.NDArray[np.uint8]
Random = np.random.Generator

_SIDE = 128
_FRAME = 64
_PARTS = 16
_SKIRTED, _BAGGED, _WALKING = 0.25, 0.2, 0.5


def person(rng: Random) -> Image:
    """A figure as white on black, cropped."""
    picture = np.zeros((_SIDE + 2 * _FRAME, _SIDE + 2 * _FRAME), np.uint8)
    head = rng.uniform(0.055, 0.115)
    neck = 2.0 * head + rng.uniform(-0.01, 0.05)
    hip = rng.uniform(0.5, 0.62)
    lean = rng.normal(0.0, 0.06)
    # the height is one; x is measured from the hip, to the right
    top, bottom = np.array([lean, neck]), np.array([0.0, hip])
    wide = rng.uniform(0.09, 0.19)
    _disc(picture, np.array([lean * 1.2, head]), head)
    _trunk(picture, top, bottom, wide, rng)
    walking = rng.random() < _WALKING
    if rng.random() < _SKIRTED:
        hem = hip + rng.uniform(0.05, 0.2)
        half = wide * rng.uniform(0.7, 1.4)
        _area(picture, np.array([top, [half, hem], [-half, hem]]))
    thick, spread = rng.uniform(0.05, 0.1), wide * rng.uniform(0.0, 0.3)
    for side in (-1.0, 1.0):
        out = rng.uniform(0.03, 0.55) if walking or rng.random() < 0.6 else rng.uniform(0.0, 0.12)
        # in stride the leg behind is bent, the other as good as straight
        bend = rng.uniform(0.0, 0.6) if walking and side < 0 else rng.uniform(-0.08, 0.08)
        start = bottom + np.array([side * spread, -0.5 * thick])
        _limb(picture, start, side * out, -bend, 1.0 - hip, thick, rng)
    thin = thick * rng.uniform(0.5, 0.95)
    for side in (-1.0, 1.0):
        out, bend = rng.uniform(0.1, 1.1), rng.uniform(-0.3, 1.2)
        start = top + np.array([side * (0.5 * wide - 0.4 * thin), 0.5 * thin + 0.02])
        hand = _limb(picture, start, side * out, side * bend, rng.uniform(0.26, 0.36), thin, rng)
        if rng.random() < 0.5 * _BAGGED:
            size = rng.uniform(0.06, 0.12)
            _area(picture, hand + size * np.array([[-1, 0], [1, 0], [1, 1.4], [-1, 1.4]]))
    if rng.random() < 0.5:
        picture = np.asarray(picture[:, ::-1], np.uint8)
    rows, columns = np.nonzero(picture > 127)
    return np.asarray(
        picture[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1], np.uint8
    )


def _pixels(points: FloatArray) -> npt.NDArray[np.int32]:
    """Points [n, 2] in heights, from the hip's middle and the crown, in parts of pixels."""
    at = np.asarray(points) * _SIDE + [_FRAME + _SIDE / 2, _FRAME]
    return np.asarray((at * _PARTS).round(), np.int32)


def _disc(picture: Image, at: FloatArray, radius: float) -> None:
    x, y = _pixels(at).tolist()
    cv2.circle(picture, (x, y), round(radius * _SIDE * _PARTS), 255, -1, cv2.LINE_AA, 4)


def _area(picture: Image, points: FloatArray) -> None:
    cv2.fillPoly(picture, [_pixels(points)], 255, cv2.LINE_AA, 4)


def _trunk(picture: Image, top: FloatArray, bottom: FloatArray, wide: float, rng: Random) -> None:
    """A stroke with round ends, or shoulders that taper to the hip."""
    if rng.random() < 0.5:
        inner = np.array([[0.0, wide / 2], [0.0, -wide / 2]])
        ends = _pixels(np.array([top, bottom]) + inner)
        cv2.polylines(picture, [ends], False, 255, round(wide * _SIDE), cv2.LINE_AA, 4)
        return
    half, waist = wide / 2 * rng.uniform(1.0, 1.3), wide / 2 * rng.uniform(0.6, 1.0)
    sides = np.array([[-half, 0.0], [half, 0.0], [waist, 0.0], [-waist, 0.0]])
    _area(picture, np.array([top, top, bottom, bottom]) + sides)


def _limb(
    picture: Image, start: FloatArray, out: float, bend: float, long: float, thick: float,
    rng: Random,
) -> FloatArray:  # fmt: skip
    """Two strokes of one width from ``start``, at ``out`` rad from straight down and bent by
    ``bend`` more in the middle; where it ends."""
    upper = long * rng.uniform(0.45, 0.55)
    knee = start + upper * np.array([np.sin(out), np.cos(out)])
    end = knee + (long - upper) * np.array([np.sin(out + bend), np.cos(out + bend)])
    line = _pixels(np.array([start, knee, end]))
    cv2.polylines(picture, [line], False, 255, max(2, round(thick * _SIDE)), cv2.LINE_AA, 4)
    return np.asarray(end)
