"""Stop and give way as countries draw them: one outline, other words, rims and letters."""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np
import numpy.typing as npt

from pipeline.train.composed import on_board
from pipeline.train.numbers import text_cover, typed

Image = npt.NDArray[np.uint8]
Floats = npt.NDArray[np.float64]
Random = np.random.Generator

STOP, YIELD = "regulatory--stop--g1", "regulatory--yield--g1"
_SIDE = 112
_PARTS = 16
_PLAIN_STOP = 0.5
_STOPS = ("PARE", "ALTO", "ARRET", "DUR", "STOJ", "HENTI", "BERHENTI", "STOP ALTO", "ARRET STOP")
_YIELDS = ("GIVE WAY", "YIELD", "CEDA EL PASO", "CEDEZ", "VIKEPLIKT", "PREFERENCIA", "GEILL SLI")
_OTHER_LETTERS = (
    "\u0421\u0422\u041e\u041f", "\ufed7\ufed2", "\u05e2\u05e6\u05d5\u05e8",
    "\u054d\u054f\u0548\u054a", "\u10e1\u10e2\u10dd\u10de", "\u03a3\u03a4\u039f\u03a0",
)  # fmt: skip
"""Stop in Russian, Arabic (in the forms that its letters have in this word), Hebrew, Armenian,
Georgian and Greek letters."""
_OTHER = 0.5
"""Of the stop signs with other words, in other letters. Some say it twice, in two lines."""


def stop_face(rng: Random) -> Image:
    """A red octagon with a word; BGRA."""
    face = np.zeros((_SIDE, _SIDE, 4), np.uint8)
    red = (rng.uniform(15, 70), rng.uniform(15, 60), rng.uniform(150, 225))
    white = rng.uniform(220, 255, 3)
    _fill(face, _octagon(_SIDE / 2), white)
    _fill(face, _octagon(_SIDE / 2 * rng.uniform(0.88, 0.97)), np.array(red))
    lines = [_stop_word(rng)]
    if rng.random() < 0.2:
        lines.append(_stop_word(rng))
    room = _SIDE * rng.uniform(0.3, 0.48)
    for i, word in enumerate(lines):
        wide = _SIDE * rng.uniform(0.7, 0.86) * (1.0 if len(lines) == 1 else 0.85)
        middle = _SIDE / 2 + (i - (len(lines) - 1) / 2) * room * 0.85
        _ink(face, _word_cover(word, rng, wide, room / len(lines) ** 0.4), middle, white)
    return face


def yield_face(rng: Random) -> Image:
    """A red rim about a white or yellow triangle that points down, with a word or none; BGRA."""
    high = round(_SIDE * rng.uniform(0.84, 0.92))
    face = np.zeros((high, _SIDE, 4), np.uint8)
    red = np.array([rng.uniform(15, 70), rng.uniform(15, 60), rng.uniform(150, 225)])
    ground = rng.uniform(220, 255, 3)
    if rng.random() < 0.15:
        ground = np.array([rng.uniform(10, 60), rng.uniform(180, 225), rng.uniform(225, 255)])
    corners = np.array([[0.0, 0.0], [_SIDE - 1.0, 0.0], [(_SIDE - 1) / 2, high - 1.0]])
    if rng.random() < 0.5:
        _fill(face, corners, rng.uniform(220, 255, 3))
        corners = _inwards(corners, rng.uniform(0.04, 0.1))
    _fill(face, corners, red)
    _fill(face, _inwards(corners, rng.uniform(0.22, 0.5)), ground)
    if rng.random() < 0.4:
        word = _YIELDS[int(rng.integers(len(_YIELDS)))]
        cover = text_cover(word, rng, 0.4 * _SIDE, rng.uniform(0.1, 0.2) * high)
        _ink(face, cover, high * rng.uniform(0.28, 0.38), rng.uniform(5, 45, 3))
    return face


def worded(name: str, rng: Random) -> Image | None:
    """A face of a class that is a word on an outline, BGRA; None for all other classes."""
    if name not in (STOP, YIELD):
        return None
    face = stop_face(rng) if name == STOP else yield_face(rng)
    return on_board(face, rng) if rng.random() < 0.1 else face


def _stop_word(rng: Random) -> str:
    if rng.random() < _PLAIN_STOP:
        return "STOP"
    words = _OTHER_LETTERS if rng.random() < _OTHER else _STOPS
    return words[int(rng.integers(len(words)))]


def _word_cover(word: str, rng: Random, wide: float, high: float) -> npt.NDArray[np.float32]:
    """A word [rows, columns] of 0..1; other than Latin letters in the one type that has them."""
    if word.isascii():
        return text_cover(word, rng, wide, high)
    drawn, narrow = _other_letters(word), rng.uniform(0.8, 1.1)
    scale = min(high / drawn.shape[0], wide / (drawn.shape[1] * narrow))
    size = (max(3, round(drawn.shape[1] * narrow * scale)), max(3, round(drawn.shape[0] * scale)))
    return np.asarray(cv2.resize(drawn, size, interpolation=cv2.INTER_AREA) / 255.0, np.float32)


@cache
def _other_letters(word: str) -> Image:
    grey = typed(word, "DejaVuSans-Bold")
    rows, columns = np.nonzero(grey > 127)
    return grey[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1]


def _octagon(reach: float) -> Floats:
    """Corners [8, 2] px about a face's middle; ``reach`` from the middle to its sides."""
    angle = np.radians(22.5 + 45.0 * np.arange(8))
    radius = (reach - 0.5) / np.cos(np.radians(22.5))
    return (_SIDE - 1) / 2 + radius * np.stack([np.cos(angle), np.sin(angle)], 1)


def _inwards(corners: Floats, part: float) -> Floats:
    middle = corners.mean(axis=0)
    return middle + (corners - middle) * (1.0 - part)


def _fill(face: Image, corners: Floats, colour: Floats) -> None:
    points = (corners * _PARTS).round().astype(np.int32)
    cv2.fillPoly(face, [points], (*colour.tolist(), 255), cv2.LINE_AA, 4)


def _ink(face: Image, cover: npt.NDArray[np.float32], middle: float, ink: Floats) -> None:
    """Print a cover about row ``middle``, across the face's middle, in place."""
    rows, columns = cover.shape
    x, y = (face.shape[1] - columns) // 2, max(0, round(middle - rows / 2))
    part = face[y : y + rows, x : x + columns, :3]
    share = cover[: part.shape[0], : part.shape[1], None]
    part[:] = np.asarray(part * (1 - share) + ink * share, np.uint8)
