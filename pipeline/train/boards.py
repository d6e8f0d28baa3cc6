"""Plates that are no class, composed by rule of what road administrations compose theirs of.

Most signs of Australia and North America that no class is are white or yellow plates with words, an
arrow, a ring or a letter in a colour of their own, and their drawings are too few to tell that such
a plate is not the class it shares one of these with.
"""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
import numpy.typing as npt

from pipeline.train.numbers import text_cover
from pipeline.train.symbols import pointing_arrow, strange_symbol

Image = npt.NDArray[np.uint8]
Floats = npt.NDArray[np.float64]
Random = np.random.Generator

_SIDE = 112
_LETTERS = tuple("ABCDEGHIJKLMNORTUVWXYZ")
"""Without P and S, which parking and stopping are forbidden by."""
_YELLOW = 0.3


def other_board(rng: Random) -> tuple[Image, str]:
    """A plate that is no class, BGRA, and its group.

    One to three parts one below the other, at least one of which is none of a class: a ring or a
    disc about a word, a letter or a picture, words, or such a letter alone. Numbers are left out,
    since in rings they are limits of speed or their ends.
    """
    yellow = rng.random() < _YELLOW
    ground = rng.uniform([0, 170, 225], [60, 220, 255]) if yellow else rng.uniform(225, 255, 3)
    high = round(_SIDE * float(np.exp(rng.uniform(np.log(0.55), np.log(1.9)))))
    face = np.full((high, _SIDE, 4), (*ground, 255), np.uint8)
    ink = rng.uniform(5, 45, 3)
    edge = 0
    if rng.random() < 0.7:
        edge = int(rng.integers(1, 6))
        last = (_SIDE - 1 - edge, high - 1 - edge)
        cv2.rectangle(face, (edge, edge), last, (*ink, 255), int(rng.integers(1, 4)), cv2.LINE_AA)
    parts = [_Strange[int(rng.integers(len(_Strange)))]]
    if high > 0.8 * _SIDE or rng.random() < 0.5:
        parts.append((_words, _arrow)[int(rng.integers(2))])
    if high > 1.3 * _SIDE and rng.random() < 0.5:
        parts.append(_words)
    order = rng.permutation(len(parts))
    shares = rng.uniform(0.6, 1.4, len(parts))
    # what is round or square takes more of the room than a line
    shares = shares * [1.0 if part in (_words, _arrow) else 2.0 for part in parts]
    heights = shares[order] / shares.sum() * (high - 2 * edge - 8)
    top = edge + 4.0
    for number, room in zip(order, heights, strict=True):
        wide = (_SIDE - 2 * edge - 8) * rng.uniform(0.6, 0.98)
        one = ink if rng.random() < 0.6 else _bright(rng)
        drawn = parts[number](wide, max(8.0, 0.9 * room), one, ground, rng)
        rows, columns = drawn.shape[:2]
        y = int(np.clip(top + (room - rows) / 2, 0, high - rows))
        x = (_SIDE - columns) // 2
        into = face[y : y + rows, x : x + columns, :3]
        cover = drawn[:, :, 3:] / 255.0
        into[:] = np.asarray(into * (1 - cover) + drawn[:, :, :3] * cover, np.uint8)
        top += room
    return face, "yellow-square" if yellow else "white-square"


def _bright(rng: Random) -> Floats:
    """Red, green, blue or orange."""
    inks = ([30, 25, 190], [70, 110, 10], [160, 70, 10], [20, 120, 240])
    return np.clip(np.array(inks[int(rng.integers(len(inks)))]) + rng.normal(0, 15, 3), 0, 255)


def _painted(cover: npt.NDArray[np.float32], ink: Floats) -> Image:
    face = np.empty((*cover.shape, 4), np.uint8)
    face[:, :, :3], face[:, :, 3] = ink, 255 * cover
    return face


def _fitted(symbol: Image, wide: float, high: float) -> npt.NDArray[np.float32]:
    """A symbol, white on black, of 0..1 within a room in px."""
    scale = min(wide / symbol.shape[1], high / symbol.shape[0])
    size = (max(3, int(symbol.shape[1] * scale)), max(3, int(symbol.shape[0] * scale)))
    return np.asarray(cv2.resize(symbol, size, interpolation=cv2.INTER_AREA) / 255.0, np.float32)


def _word(rng: Random, least: int = 3) -> str:
    return "".join(rng.choice(_LETTERS, int(rng.integers(least, 8))))


def _words(wide: float, high: float, ink: Floats, ground: Floats, rng: Random) -> Image:
    """One line of letters, or two."""
    count = 2 if high > 0.35 * _SIDE and rng.random() < 0.6 else 1
    room = high / count
    cover = np.zeros((int(high), int(wide)), np.float32)
    for number in range(count):
        line = text_cover(_word(rng), rng, wide, 0.8 * room)[: int(room), : int(wide)]
        y, x = int(number * room), (cover.shape[1] - line.shape[1]) // 2
        into = cover[y : y + line.shape[0], x : x + line.shape[1]]
        into[:] = line[: into.shape[0]]
    return _painted(cover, ink)


def _arrow(wide: float, high: float, ink: Floats, ground: Floats, rng: Random) -> Image:
    """An arrow to the left or right, to both, or aslant."""
    angle = rng.choice([90.0, -90.0]) if rng.random() < 0.7 else rng.uniform(-180.0, 180.0)
    symbol = pointing_arrow(float(angle), rng)
    if abs(angle) == 90.0 and rng.random() < 0.4:
        symbol = np.asarray(np.hstack([symbol[:, ::-1], symbol] if angle > 0 else
                                      [symbol, symbol[:, ::-1]]), np.uint8)  # fmt: skip
    return _painted(_fitted(symbol, wide, high), ink)


def _letter(wide: float, high: float, ink: Floats, ground: Floats, rng: Random) -> Image:
    """A letter alone, or light on a square or an ellipse of the ink."""
    side = min(wide, high)
    letter = _LETTERS[int(rng.integers(len(_LETTERS)))]
    if rng.random() < 0.3:
        return _painted(text_cover(letter, rng, side, side), ink)
    size = (max(8, int(side * rng.uniform(0.75, 1.0))), max(8, int(side)))
    cover = np.zeros((size[1], size[0]), np.uint8)
    middle = (size[0] // 2, size[1] // 2)
    if rng.random() < 0.5:
        cover[:] = 255
    else:
        cv2.ellipse(cover, middle, (size[0] // 2, size[1] // 2), 0, 0, 360, 255, -1, cv2.LINE_AA)
    face = _painted(np.asarray(cover / 255.0, np.float32), ink)
    _set(face, text_cover(letter, rng, 0.7 * size[0], 0.75 * size[1]), ground)
    return face


def _round(wide: float, high: float, ink: Floats, ground: Floats, rng: Random) -> Image:
    """A ring, or a disc, about a word, a letter or a picture that no sign shows."""
    side = max(12, int(min(wide, high)))
    y, x = np.mgrid[0:side, 0:side] - (side - 1) / 2
    away = np.hypot(x, y)
    disc = np.clip(side / 2 - away, 0.0, 1.0)
    filled = rng.random() < 0.25
    colour = ink if filled or rng.random() < 0.4 else _bright(rng)
    inner = side / 2 * (1.0 if filled else rng.uniform(0.7, 0.92))
    paint = np.full_like(disc, 1.0) if filled else np.clip(away - inner + 0.5, 0.0, 1.0)
    face = np.empty((side, side, 4), np.uint8)
    face[:, :, :3] = ground + paint[:, :, None] * (colour - ground)
    face[:, :, 3] = 255 * disc
    kind, room = int(rng.integers(3)), 2.0 * inner
    if kind == 0:
        cover = text_cover(_word(rng), rng, 0.85 * room, 0.4 * room)
    elif kind == 1:
        cover = text_cover(str(rng.choice(_LETTERS)), rng, 0.6 * room, 0.65 * room)
    else:
        cover = _fitted(strange_symbol(rng), 0.62 * room, 0.62 * room)
    _set(face, cover, ground if filled else rng.uniform(5, 45, 3))
    return face


def _set(face: Image, cover: npt.NDArray[np.float32], ink: Floats) -> None:
    """What covers the middle of a face, in place."""
    rows, columns = (min(a, b) for a, b in zip(cover.shape, face.shape[:2], strict=True))
    y, x = (face.shape[0] - rows) // 2, (face.shape[1] - columns) // 2
    into, share = face[y : y + rows, x : x + columns, :3], cover[:rows, :columns, None]
    into[:] = np.asarray(into * (1 - share) + ink * share, np.uint8)


_Part = Callable[[float, float, Floats, Floats, Random], Image]
_Strange: tuple[_Part, ...] = (_round, _round, _letter, _words)
