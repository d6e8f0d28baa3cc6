"""Faces with numbers and letters drawn in many types: limits of speed, parking, hospital.

Digits differ from country to country more than anything else on a sign, and the drawings show
one or two types of each number.
"""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np
import numpy.typing as npt

from pipeline.train.composed import red_ring
from pipeline.train.digits import road_digits

Image = npt.NDArray[np.uint8]
Random = np.random.Generator

LIMITS = (5, 10, 15, 20, 25, 30, 40, 50, 60, 70, 80, 90, 100, 110, 120, 130)
"""The limits that are classes."""
END_OF = 80
"""The limit whose end is a class."""
_STROKES = "strokes"
_TYPES = ("DejaVuSans-Bold", "DejaVuSans", "DejaVuSansMono-Bold", "STIXGeneralBol", "cmss10",
          _STROKES, _STROKES)  # fmt: skip
_SCRIPTS = ((0x410, 0x42F), (0x391, 0x3A1), (0x531, 0x556), (0x10D0, 0x10F0), (0x621, 0x64A))
"""Letters of Cyrillic, Greek, Armenian, Georgian and Arabic."""
_SIDE = 112
_CONSTRUCTED = 0.65
"""Share of numbers whose digits are constructed."""


def limit_name(number: int) -> str:
    """The class of a limit of speed."""
    return f"regulatory--maximum-speed-limit-{number}--g1"


@cache
def _letters(text: str, kind: str) -> Image:
    """Text as white on black, cropped to what is drawn, 96 px high."""
    grey = _stroked(text) if kind == _STROKES else typed(text, kind)
    rows, columns = np.nonzero(grey > 127)
    part = grey[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1]
    wide = max(8, round(part.shape[1] * 96 / part.shape[0]))
    return np.asarray(cv2.resize(part, (wide, 96), interpolation=cv2.INTER_AREA), np.uint8)


def typed(text: str, kind: str) -> Image:
    """Text as white on black in one of matplotlib's types, larger than it by a frame."""
    import matplotlib
    from PIL import Image as Picture
    from PIL import ImageDraw, ImageFont

    path = f"{matplotlib.get_data_path()}/fonts/ttf/{kind}.ttf"
    font = ImageFont.truetype(path, 110)
    x0, y0, x1, y1 = (int(v) for v in font.getbbox(text))
    picture = Picture.new("L", (x1 - x0 + 8, y1 - y0 + 8), 0)
    ImageDraw.Draw(picture).text((4 - x0, 4 - y0), text, 255, font)
    return np.asarray(picture, np.uint8)


def _stroked(text: str) -> Image:
    """In strokes of one width with round ends, as many road administrations have it."""
    picture = np.zeros((200, 140 * len(text) + 80), np.uint8)
    cv2.putText(picture, text, (40, 150), cv2.FONT_HERSHEY_SIMPLEX, 5.0, 255, 15, cv2.LINE_AA)
    return picture


def _spaced(text: str, kind: str, rng: Random) -> Image:
    """Letter by letter, with a space of their own; a one may be a mere bar."""
    space = int(rng.integers(4, 22))
    parts = []
    for letter in text:
        if letter == " ":
            part = np.zeros((96, 40), np.uint8)
        elif letter == "1" and rng.random() < 0.6:
            part = np.full((96, int(rng.integers(10, 18))), 255, np.uint8)
        else:
            part = _letters(letter, kind)
        parts += [part, np.zeros((96, space), np.uint8)]
    return np.asarray(np.hstack(parts[:-1]), np.uint8)


def _lettered(text: str, rng: Random) -> Image:
    """Text in one of the types, its strokes heavier or not."""
    kind = _TYPES[int(rng.integers(len(_TYPES)))]
    drawn = _spaced(text, kind, rng) if rng.random() < 0.6 else _letters(text, kind)
    weight = int(rng.integers(-1, 7))
    if weight <= 0:
        return drawn
    framed = cv2.copyMakeBorder(drawn, 4, 4, 4, 4, 0)
    return np.asarray(cv2.dilate(framed, np.ones((weight, weight))), np.uint8)


def text_cover(text: str, rng: Random, wide: float, high: float) -> npt.NDArray[np.float32]:
    """Text [rows, columns] of 0..1 within ``wide`` by ``high`` px, in a type at random."""
    if text.isdigit() and rng.random() < _CONSTRUCTED:
        drawn, narrow = road_digits(text, rng), rng.uniform(0.85, 1.15)
    else:
        drawn, narrow = _lettered(text, rng), rng.uniform(0.55, 1.1)
    scale = min(high / drawn.shape[0], wide / (drawn.shape[1] * narrow))
    size = (
        max(3, round(drawn.shape[1] * narrow * scale)),
        max(3, round(drawn.shape[0] * scale)),
    )
    return np.asarray(cv2.resize(drawn, size, interpolation=cv2.INTER_AREA) / 255.0, np.float32)


def _print(face: Image, cover: npt.NDArray[np.float32], middle: tuple[float, float],
           ink: npt.NDArray[np.float64]) -> None:  # fmt: skip
    rows, columns = cover.shape
    x, y = round(middle[0] - columns / 2), round(middle[1] - rows / 2)
    part = face[y : y + rows, x : x + columns, :3]
    share = cover[: part.shape[0], : part.shape[1], None]
    part[:] = np.asarray(part * (1 - share) + ink * share, np.uint8)


def limit_face(number: int, rng: Random) -> Image:
    """A red ring about a number, on its own or on a white plate as in Australia; BGRA."""
    plate = rng.random() < 0.5
    diameter = _SIDE * (rng.uniform(0.8, 0.94) if plate else 1.0)
    high = round(_SIDE * (rng.uniform(1.0, 1.35) if plate else 1.0))
    face = np.zeros((high, _SIDE, 4), np.uint8)
    white = rng.uniform(225, 255, 3)
    middle = ((_SIDE - 1) / 2, diameter / 2 + (_SIDE - diameter) / 2 - 0.5)
    if plate:
        cv2.rectangle(face, (0, 0), (_SIDE - 1, high - 1), (*white, 255), -1)
        if rng.random() < 0.5:
            edge = int(rng.integers(2, 5))
            cv2.rectangle(face, (edge, edge), (_SIDE - 1 - edge, high - 1 - edge),
                          (20, 20, 20, 255), int(rng.integers(1, 3)), cv2.LINE_AA)  # fmt: skip
        middle = (middle[0], min(middle[1], high - 1 - diameter / 2))
    inner, _ = red_ring(face, middle, diameter, white, rng)
    text = text_cover(
        str(number), rng, inner * rng.uniform(0.74, 0.9), inner * rng.uniform(0.45, 0.68)
    )
    _print(face, text, middle, rng.uniform(5, 45, 3))
    return face


def end_face(number: int, rng: Random) -> Image:
    """The end of a limit: a number crossed by one bar or by thin ones, on a white disc; BGRA."""
    face = np.zeros((_SIDE, _SIDE, 4), np.uint8)
    white, ink = rng.uniform(225, 255, 3), np.full(3, rng.uniform(5, 60))
    middle = (_SIDE - 1) / 2
    y, x = np.mgrid[0:_SIDE, 0:_SIDE] - middle
    away = np.hypot(x, y)
    disc = np.clip(middle + 0.5 - away, 0.0, 1.0)
    rim = rng.uniform(0.0, 0.04) * _SIDE
    paint = np.clip(away - (middle - rim) + 0.5, 0.0, 1.0)[:, :, None] if rim > 1.0 else 0.0
    face[:, :, :3] = white + paint * (ink - white)
    face[:, :, 3] = 255 * disc
    grey = ink + rng.uniform(0.0, 0.7) * (white - ink)
    text = text_cover(str(number), rng, _SIDE * 0.74, _SIDE * rng.uniform(0.42, 0.6))
    _print(face, text, (middle, middle), grey)
    angle = np.radians(rng.normal(45.0, 5.0))
    beside = np.sin(angle) * x + np.cos(angle) * y
    thin = rng.random() < 0.6
    count, half = (int(rng.integers(3, 6)), 0.018) if thin else (1, rng.uniform(0.03, 0.08))
    places = (np.arange(count) - (count - 1) / 2) * rng.uniform(0.05, 0.075) * _SIDE
    near = np.abs(beside[:, :, None] - places).min(axis=2)
    bar = np.clip(half * _SIDE - near + 0.5, 0.0, 1.0) * np.clip(middle - away, 0.0, 1.0)
    face[:, :, :3] = face[:, :, :3] * (1 - bar[:, :, None]) + ink * bar[:, :, None]
    return face


def worded_board(corners: int, text: str, rng: Random) -> Image:
    """White words on a red octagon, or on a red triangle that stands on its point; BGRA.

    ``corners`` 8 or 3; without ``text`` the words are letters of any script, or strokes.
    """
    face = np.zeros((_SIDE, _SIDE, 4), np.uint8)
    red = (rng.uniform(15, 70), rng.uniform(15, 60), rng.uniform(150, 230))
    white = rng.uniform(215, 255, 3)
    first = np.pi / 8 if corners == 8 else np.pi / 2
    angle = first + 2.0 * np.pi / corners * np.arange(corners)
    outline = np.stack([np.cos(angle), np.sin(angle)], 1)
    outline = (outline - outline.min(axis=0)) / np.ptp(outline, axis=0) * (_SIDE - 1)
    middle = outline.mean(axis=0)
    rim = rng.uniform(0.0, 0.12) if rng.random() < 0.85 else 0.0
    # a red line around the rim in some countries
    edge = rng.uniform(0.01, 0.04) if rng.random() < 0.3 else 0.0
    for inset, colour in ((0.0, red), (edge, white), (edge + rim, red)):
        points = middle + (outline - middle) * (1.0 - inset)
        cv2.fillPoly(face, [(points * 16).round().astype(np.int32)], (*colour, 255), cv2.LINE_AA, 4)
    room = (0.8, rng.uniform(0.3, 0.5)) if corners == 8 else (0.5, rng.uniform(0.18, 0.28))
    wide, high = _SIDE * (1.0 - rim) * np.array(room)
    if text or rng.random() < 0.4:
        any_letters = "".join(rng.choice(list("ABDEGHILNOPRSTU"), int(rng.integers(2, 6))))
        cover = text_cover(text or any_letters, rng, wide, high)
    else:
        drawn = _foreign_word(rng)
        scale = min(high / drawn.shape[0], wide / drawn.shape[1])
        size = tuple(max(3, round(v * scale)) for v in drawn.shape[::-1])
        cover = np.asarray(cv2.resize(drawn, size, interpolation=cv2.INTER_AREA) / 255, np.float32)
    _print(face, cover, (float(middle[0]), float(middle[1])), white)
    return face


def _foreign_word(rng: Random) -> Image:
    """A word of another script, or of characters of strokes as in East Asia, white on black."""
    if rng.random() < 0.5:
        low, high = _SCRIPTS[int(rng.integers(len(_SCRIPTS)))]
        letters = rng.integers(low, high + 1, int(rng.integers(2, 6))).tolist()
        return typed("".join(map(chr, letters)), "DejaVuSans-Bold")
    characters = []
    for _ in range(rng.integers(1, 4)):
        part = np.zeros((96, 96), np.uint8)
        for _ in range(rng.integers(4, 10)):
            start, long = rng.uniform(10, 86, 2), rng.uniform(20, 80)
            angle = rng.choice([0.0, 0.0, np.pi / 2, np.pi / 2, rng.uniform(0, np.pi)])
            end = np.clip(start + long * np.array([np.cos(angle), np.sin(angle)]), 6, 90)
            ends = [tuple(round(float(v)) for v in point) for point in (start, end)]
            cv2.line(part, ends[0], ends[1], 255, int(rng.integers(6, 12)), cv2.LINE_AA)
        characters.append(part)
    return np.asarray(np.hstack(characters), np.uint8)


def on_plate(face: Image, rng: Random, words: str = "") -> Image:
    """A face on a white plate, as prohibitions stand in Australia, at times above words; BGRA.

    ``words`` are those of its meaning; without any, or now and then, they are any letters.
    """
    high = round(_SIDE * rng.uniform(1.0, 1.8))
    side = _SIDE * rng.uniform(0.6, 0.94)
    size = (round(side * min(1.0, face.shape[1] / face.shape[0])), round(side))
    drawn = np.asarray(cv2.resize(face, size, interpolation=cv2.INTER_AREA), np.uint8)
    white = rng.uniform(225, 255, 3)
    plate = np.full((high, _SIDE, 4), (*white, 255), np.uint8)
    if rng.random() < 0.6:
        edge = int(rng.integers(1, 5))
        last = (_SIDE - 1 - edge, high - 1 - edge)
        cv2.rectangle(plate, (edge, edge), last, (20, 20, 20, 255), int(rng.integers(1, 3)))
    x = (_SIDE - size[0]) // 2
    y = min(x, (high - size[1]) // 2)
    part = plate[y : y + size[1], x : x + size[0], :3]
    cover = drawn[:, :, 3:] / 255.0
    part[:] = np.asarray(part * (1 - cover) + drawn[:, :, :3] * cover, np.uint8)
    first = y + size[1]
    if high - first > 14 and rng.random() < 0.8:
        ink = rng.uniform(5, 45, 3)
        for text, middle, room in _lines(words, first, high - 5, rng):
            printed = text_cover(text, rng, rng.uniform(0.6, 0.85) * _SIDE, 0.75 * room)
            _print(plate, printed, ((_SIDE - 1) / 2, middle), ink)
    return plate


def _lines(words: str, first: int, last: int, rng: Random) -> list[tuple[str, float, float]]:
    """What stands in the lines from row ``first`` to ``last``: text, middle and height."""
    if not words or rng.random() < 0.3:
        count = int(rng.integers(1, 4))
        letters = list("ABCDEGHILNOPRSTU")
        lengths = rng.integers(2, 8, count).tolist()
        words = " ".join("".join(rng.choice(letters, length)) for length in lengths)
    lines = words.split()
    # several lines only where there is room for them
    while len(lines) > max(1, (last - first) // 12):
        lines = [*lines[:-2], f"{lines[-2]} {lines[-1]}"]
    room = (last - first) / len(lines)
    return [(text, first + (i + 0.5) * room, room) for i, text in enumerate(lines)]


def letter_symbol(letter: str, rng: Random) -> Image:
    """A letter in a type at random as white on black."""
    return np.asarray(255 * text_cover(letter, rng, 90.0, 90.0), np.uint8)


def letter_face(letter: str, rng: Random) -> Image:
    """A white letter on a blue square, with a rim or none; BGRA."""
    high = round(_SIDE * (rng.uniform(1.0, 1.3) if rng.random() < 0.3 else 1.0))
    face = np.zeros((high, _SIDE, 4), np.uint8)
    blue = (rng.uniform(110, 200), rng.uniform(50, 110), rng.uniform(0, 50), 255)
    cv2.rectangle(face, (0, 0), (_SIDE - 1, high - 1), blue, -1)
    white = rng.uniform(220, 255, 3)
    if rng.random() < 0.6:
        edge = int(rng.integers(1, 7))
        cv2.rectangle(face, (edge, edge), (_SIDE - 1 - edge, high - 1 - edge), (*white, 255),
                      int(rng.integers(1, 5)), cv2.LINE_AA)  # fmt: skip
    cover = text_cover(letter, rng, 0.75 * _SIDE, rng.uniform(0.45, 0.72) * _SIDE)
    _print(face, cover, ((_SIDE - 1) / 2, (high - 1) / 2 + rng.normal(0, 3)), white)
    return face


def other_number(rng: Random) -> int:
    """A number that is no class."""
    while True:
        number = int(rng.integers(2, 36)) * 5 if rng.random() < 0.7 else int(rng.integers(1, 100))
        if number not in LIMITS:
            return number


def other_end(rng: Random) -> int:
    """A limit whose end is no class."""
    while (number := 5 * int(rng.integers(1, 27))) == END_OF:
        pass
    return number
