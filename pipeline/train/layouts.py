"""Pictures of no class that are put together as those of classes are: roads, words and bars.

A side road at a bend, two at different places or one that meets at an acute angle, a line of words
and a stack of bars are on the warnings of many countries, and each is near to some class.
"""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from automap.records import FloatArray
from pipeline.train.numbers import text_cover
from pipeline.train.symbols import cropped

Image = npt.NDArray[np.uint8]
Random = np.random.Generator

_SIDE, _FRAME, _PARTS = 96, 48, 16
_LETTERS = tuple("ABCDEFGHIKLMNOPRSTUVWY")


def road_layout(rng: Random) -> Image:
    """A road with side roads as no class has them, as white on black, cropped."""
    bent, arrow = rng.random() < 0.6, rng.random() < 0.4
    path = _bend(rng) if bent else np.array([[0.5, 1.0], [0.5, 0.0]])
    wide = _SIDE * rng.uniform(0.09, 0.2)
    picture = np.zeros((_SIDE + 2 * _FRAME, _SIDE + 2 * _FRAME), np.uint8)
    _stroke(picture, path, wide)
    if bent or arrow:
        _head(picture, path[-1], path[-1] - path[-2], wide, rng)
    # on a straight road without a head, one at a right angle or two at one place are classes
    apart = not bent and not arrow and rng.random() < 0.6
    acute = not bent and not arrow and not apart
    first = rng.uniform(0.2, 0.4) if apart else rng.uniform(0.25, 0.75)
    places = [first, first + rng.uniform(0.3, 0.45)] if apart else [first]
    for place in places:
        start, ahead = _at(path, place)
        turn = rng.uniform(30.0, 60.0) if acute else rng.normal(90.0, 6.0)
        angle = np.radians(turn) * (1.0 if rng.random() < 0.5 else -1.0)
        c, s = np.cos(angle), np.sin(angle)
        aside = np.array([[c, -s], [s, c]]) @ ahead
        _stroke(picture, np.array([start, start + aside * rng.uniform(0.3, 0.5)]),
                wide * rng.uniform(0.7, 1.0))  # fmt: skip
    return cropped(picture)


def words(rng: Random) -> Image:
    """Lines of letters that are no word of any sign's, as white on black."""
    lines = [
        "".join(rng.choice(_LETTERS, int(rng.integers(3, 8)))) for _ in range(rng.integers(1, 4))
    ]
    room = rng.uniform(0.7, 1.0) * _SIDE / max(len(lines), 2)
    rows = []
    for line in lines:
        cover = text_cover(line, rng, float(_SIDE), 0.8 * room)
        row = np.zeros((round(room) + 1, _SIDE + 2), np.uint8)
        x = (row.shape[1] - cover.shape[1]) // 2
        row[: cover.shape[0], x : x + cover.shape[1]] = 255 * cover
        rows.append(row)
    return cropped(np.vstack(rows))


def bars(rng: Random) -> Image:
    """Three to six bars side by side or one above the other, as white on black."""
    count, thick = int(rng.integers(3, 7)), rng.uniform(0.35, 0.65)
    ends = (np.arange(count)[:, None] + [0.0, thick]) * _SIDE / count
    picture = np.zeros((_SIDE, _SIDE), np.uint8)
    for k, (low, high) in enumerate(ends):
        # one length, or shorter towards one end
        inset = round(0.4 * _SIDE * k / count) if count % 2 else 0
        picture[round(low) : round(high), inset // 2 : _SIDE - inset // 2] = 255
    if rng.random() < 0.3:
        picture = np.asarray(picture.T, np.uint8)
    return cropped(picture)


def _bend(rng: Random) -> FloatArray:
    """Points [n, 2] of a road up and then to one side, sharp or round, in the unit square."""
    angle, size = np.radians(rng.uniform(30.0, 90.0)), rng.uniform(0.1, 0.45)
    turned = np.linspace(0.0, angle, 10)
    bend = np.stack([size * (1.0 - np.cos(turned)), -size * np.sin(turned)], axis=1)
    end = bend[-1] + rng.uniform(0.25, 0.4) * np.array([np.sin(angle), -np.cos(angle)])
    path = np.concatenate([[[0.0, rng.uniform(0.3, 0.5)]], bend, [end]])
    path = path - (path.min(axis=0) + path.max(axis=0)) / 2 + 0.5
    mirrored = path * [-1.0, 1.0] + [1.0, 0.0]
    return np.asarray(path if rng.random() < 0.5 else mirrored)


def _at(path: FloatArray, place: float) -> tuple[FloatArray, FloatArray]:
    """The point of a path [n, 2] at a part of its length, and the way ahead there."""
    steps = np.diff(path, axis=0)
    long = np.hypot(*steps.T)
    passed = np.cumsum(long)
    k = int(np.searchsorted(passed, place * passed[-1]))
    back = passed[k] - place * passed[-1]
    return path[k + 1] - steps[k] * back / long[k], steps[k] / long[k]


def _pixels(points: FloatArray) -> npt.NDArray[np.int32]:
    return np.asarray(((points * _SIDE + _FRAME) * _PARTS).round(), np.int32)


def _stroke(picture: Image, path: FloatArray, wide: float) -> None:
    line = [_pixels(path)]
    cv2.polylines(picture, line, False, 255, max(2, round(wide)), cv2.LINE_AA, 4)


def _head(picture: Image, tip: FloatArray, ahead: FloatArray, wide: float, rng: Random) -> None:
    """An arrow's head beyond the end of a road."""
    ahead = ahead / np.hypot(*ahead) * wide / _SIDE
    aside = np.array([-ahead[1], ahead[0]]) * rng.uniform(0.9, 1.5)
    corners = np.array([tip + ahead * rng.uniform(1.0, 2.0), tip + aside, tip - aside])
    cv2.fillPoly(picture, [_pixels(corners)], 255, cv2.LINE_AA, 4)
