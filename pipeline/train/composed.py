"""Faces composed by rule of what road administrations compose theirs of: rings, bars, boards."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

Image = npt.NDArray[np.uint8]
Floats = npt.NDArray[np.float64]
Random = np.random.Generator

_SIDE = 112
_BOARDS = ((245, 245, 245), (40, 30, 190), (20, 200, 245))
"""White, red and yellow, BGR."""


def red_ring(
    face: Image, middle: tuple[float, float], diameter: float, white: Floats, rng: Random
) -> tuple[float, Floats]:
    """A red ring about a white disc set into a BGRA face in place.

    The diameter in px of what it encloses, and its red.
    """
    high, wide = face.shape[:2]
    red = np.array([rng.uniform(15, 70), rng.uniform(15, 60), rng.uniform(165, 230)])
    y, x = np.mgrid[0:high, 0:wide].astype(np.float32)
    away = np.hypot(x - middle[0], y - middle[1])
    ring = diameter * rng.uniform(0.08, 0.16)
    rim = diameter * rng.uniform(0.01, 0.03) if rng.random() < 0.3 else 0.0
    radii = diameter / 2 - np.array([0.0, rim, rim + ring])
    disc, outer, inner = (np.clip(r + 0.5 - away, 0.0, 1.0).astype(np.float32) for r in radii)
    white32, red32 = white.astype(np.float32), red.astype(np.float32)
    painted = white32 + (outer - inner)[:, :, None] * (red32 - white32)
    face[:, :, :3] = face[:, :, :3] * (1 - disc[:, :, None]) + painted * disc[:, :, None]
    face[:, :, 3] = np.maximum(face[:, :, 3], 255 * disc)
    return diameter - 2 * (ring + rim), red


def prohibition(symbol: Image, bar: bool, rng: Random) -> Image:
    """A black ``symbol``, white on black of any size, in a red ring; BGRA.

    With ``bar`` a red one crosses it, before or behind it and falling to either side.
    """
    face = np.zeros((_SIDE, _SIDE, 4), np.uint8)
    middle = (_SIDE - 1) / 2
    inner, red = red_ring(face, (middle, middle), _SIDE, rng.uniform(225, 255, 3), rng)
    ink = rng.uniform(5, 45, 3)
    behind = bar and rng.random() < 0.4
    if behind:
        _bar(face, inner, red, rng)
    set_symbol(face, symbol, inner * rng.uniform(0.6, 0.86), ink, rng)
    if bar and not behind:
        _bar(face, inner, red, rng)
    return face


def mandatory(symbol: Image, rng: Random, barred: bool = False) -> Image:
    """A white ``symbol``, white on black of any size, on a blue disc with a rim or none; BGRA.

    A red bar ends what such a sign orders.
    """
    face = np.zeros((_SIDE, _SIDE, 4), np.uint8)
    blue = np.array([rng.uniform(110, 200), rng.uniform(50, 110), rng.uniform(0, 50)])
    white = rng.uniform(215, 255, 3)
    y, x = np.mgrid[0:_SIDE, 0:_SIDE] - (_SIDE - 1) / 2
    away, rim = np.hypot(x, y), 0.0
    face[:, :, :3] = blue
    if rng.random() < 0.6:
        # at the very edge, or with a blue line around it
        rim, edge = _SIDE * rng.uniform(0.01, 0.06), _SIDE * rng.choice([0.0, rng.uniform(0, 0.04)])
        outer = _SIDE / 2 - edge
        cover = np.clip(outer - away, 0.0, 1.0) * np.clip(away - outer + rim, 0.0, 1.0)
        face[:, :, :3] = face[:, :, :3] * (1 - cover[:, :, None]) + white * cover[:, :, None]
        rim += edge
    face[:, :, 3] = 255 * np.clip(_SIDE / 2 - away, 0.0, 1.0)
    inner = _SIDE - 2 * rim
    set_symbol(face, symbol, inner * rng.uniform(0.55, 0.9), white, rng)
    if barred:
        _bar(face, inner, np.array([rng.uniform(15, 70), rng.uniform(15, 60), 210.0]), rng)
    return face


def _bar(face: Image, inner: float, red: Floats, rng: Random) -> None:
    """A bar across the ring's disc, at about 45 degrees."""
    angle = np.radians(rng.normal(45.0, 4.0)) * (1 if rng.random() < 0.65 else -1)
    half = inner * rng.uniform(0.05, 0.11)
    middle = (_SIDE - 1) / 2
    y, x = np.mgrid[0:_SIDE, 0:_SIDE] - middle
    beside = np.abs(-np.sin(angle) * x + np.cos(angle) * y)
    cover = np.clip(half - beside + 0.5, 0.0, 1.0) * np.clip(inner / 2 - np.hypot(x, y) + 1, 0, 1)
    face[:, :, :3] = face[:, :, :3] * (1 - cover[:, :, None]) + red * cover[:, :, None]


def set_symbol(face: Image, symbol: Image, room: float, ink: Floats, rng: Random) -> None:
    """A symbol, white on black, set into the middle of a face's ``room`` px, in place."""
    reach = float(np.hypot(*symbol.shape[:2]))
    # what fills its rectangle, as letters do, ends at the corners, a slim one at its ends
    scale = room / (0.5 * reach + 0.5 * max(symbol.shape[:2]))
    stretch = np.exp(rng.normal(0.0, 0.06, 2)) * scale
    size = (
        int(np.clip(round(symbol.shape[1] * stretch[0]), 4, face.shape[1] - 2)),
        int(np.clip(round(symbol.shape[0] * stretch[1]), 4, face.shape[0] - 2)),
    )
    cover = cv2.resize(symbol, size, interpolation=cv2.INTER_AREA)[:, :, None] / 255.0
    left = (np.array([face.shape[1], face.shape[0]]) - size) / 2
    shift = np.round(left + rng.normal(0.0, 1.2, 2)).astype(int)
    x, y = np.clip(shift, 0, [face.shape[1] - size[0], face.shape[0] - size[1]]).tolist()
    part = face[y : y + size[1], x : x + size[0], :3]
    part[:] = np.asarray(part * (1 - cover) + ink * cover, np.uint8)


def crossing_face(figure: Image, rng: Random) -> Image:
    """A dark ``figure``, white on black of any size, in a white triangle on a blue square; BGRA."""
    blue = np.array([rng.uniform(110, 200), rng.uniform(50, 110), rng.uniform(0, 50)])
    white = rng.uniform(220, 255, 3)
    face = np.full((_SIDE, _SIDE, 4), (*blue, 255), np.uint8)
    if rng.random() < 0.5:
        edge = int(rng.integers(1, 6))
        last = (_SIDE - 1 - edge, _SIDE - 1 - edge)
        cv2.rectangle(face, (edge, edge), last, (*white, 255), int(rng.integers(1, 4)), cv2.LINE_AA)
    wide = _SIDE * rng.uniform(0.7, 0.95)
    high = wide * rng.uniform(0.8, 0.95)
    top, middle = (_SIDE - high) / 2, (_SIDE - 1) / 2
    corners = [(middle, top), (middle + wide / 2, top + high), (middle - wide / 2, top + high)]
    points = (np.array(corners) * 16).round().astype(np.int32)
    cv2.fillPoly(face, [points], (*white, 255), cv2.LINE_AA, 4)
    # the widest rectangle of the figure's shape that stands on the triangle's base
    slim = figure.shape[1] / figure.shape[0]
    tall = high * wide / (high * slim + wide) * rng.uniform(0.85, 1.0)
    size = (max(4, round(tall * slim)), max(4, round(tall)))
    cover = cv2.resize(figure, size, interpolation=cv2.INTER_AREA)[:, :, None] / 255.0
    x = round(middle - size[0] / 2)
    y = round(top + high - size[1] - rng.uniform(0.0, 0.04) * _SIDE)
    part = face[y : y + size[1], x : x + size[0], :3]
    ink = rng.uniform(5, 45, 3) if rng.random() < 0.7 else 0.8 * blue
    part[:] = np.asarray(part * (1 - cover) + ink * cover, np.uint8)
    return face


def on_board(face: Image, rng: Random) -> Image:
    """A face on a board of one colour that is larger than it; BGRA."""
    high, wide = face.shape[:2]
    scale = _SIDE / max(high, wide)
    size = (round(wide * scale), round(high * scale))
    drawn = np.asarray(cv2.resize(face, size, interpolation=cv2.INTER_AREA), np.uint8)
    edges = [int(v) for v in rng.integers(2, 14, 2)]
    colour = np.array(_BOARDS[int(rng.integers(len(_BOARDS)))]) * rng.uniform(0.8, 1.02)
    shape = (size[1] + 2 * edges[1], size[0] + 2 * edges[0], 4)
    board = np.full(shape, (*np.clip(colour, 0, 255), 255), np.uint8)
    part = board[edges[1] : edges[1] + size[1], edges[0] : edges[0] + size[0], :3]
    cover = drawn[:, :, 3:] / 255.0
    part[:] = np.asarray(part * (1 - cover) + drawn[:, :, :3] * cover, np.uint8)
    return board
