"""Symbols on signs: arrows and figures put together, and pictures that no sign shows."""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np
import numpy.typing as npt

from automap.records import FloatArray
from pipeline.train.numbers import typed

Image = npt.NDArray[np.uint8]
Random = np.random.Generator

_SIDE = 96
_FRAME = 40
_PARTS = 16
_STRANGE_TYPE = "DejaVuSans"
_STRANGE = (
    (0x2600, 0x2604), (0x2614, 0x2619), (0x2620, 0x2620), (0x2622, 0x262F), (0x2638, 0x263B),
    (0x2640, 0x266F), (0x2680, 0x2685), (0x2690, 0x269C), (0x26A1, 0x26A9), (0x26C0, 0x26C3),
    (0x2702, 0x2718), (0x2721, 0x274D), (0x2761, 0x2767),
)  # fmt: skip
"""Ranges of characters that are pictures: tools, chessmen, flowers. Those that some sign could
show are left out: arrows, crosses, bars, numbers."""


def turn_arrow(way: str, rng: Random) -> Image:
    """An arrow as white on black, cropped: ``way`` left, right, u or straight."""
    if way == "straight":
        path = np.array([[0.5, 1.0], [0.5, 0.15]])
    else:
        path = _u_turn(rng) if way == "u" else _left_turn(rng)
    if way == "right" or (way != "left" and rng.random() < 0.5):
        path = path * [-1.0, 1.0] + [1.0, 0.0]
    return _drawn([path], rng)


def pointing_arrow(degrees: float, rng: Random) -> Image:
    """A straight arrow, long or short, turned clockwise from upright, as white on black."""
    path = np.array([[0.5, 1.0], [0.5, rng.uniform(0.1, 0.45)]])
    upright = _drawn([path], rng)
    side = round(float(np.hypot(*upright.shape))) + 4
    shift = (np.array([side, side]) - upright.shape[::-1]) / 2
    turn = np.array(cv2.getRotationMatrix2D((side / 2, side / 2), -degrees, 1.0), np.float64)
    turn[:, 2] += turn[:, :2] @ shift
    return cropped(np.asarray(cv2.warpAffine(upright, turn, (side, side)), np.uint8))


def forked_arrow(ways: tuple[str, ...], rng: Random) -> Image:
    """One shaft that forks into arrows, as white on black: of ``ways`` straight, left and right."""
    top, bend = rng.uniform(0.3, 0.5), rng.uniform(0.0, 1.0)
    reach = rng.uniform(0.25, 0.45)
    angle = np.linspace(0.0, np.pi / 2, 8)
    round_ = bend * min(reach, 0.9 - top)
    aside = np.stack([round_ * (1 - np.cos(angle)), top + round_ * (1 - np.sin(angle))], 1)
    left = np.concatenate([[[0.0, 1.0]], aside * [-1.0, 1.0], [[-reach, top]]])
    left = left + np.array([0.5, 0.0])
    paths = {
        "straight": np.array([[0.5, 1.0], [0.5, rng.uniform(0.0, 0.1)]]),
        "left": left,
        "right": left * [-1.0, 1.0] + [1.0, 0.0],
    }
    return _drawn([paths[way] for way in ways], rng)


def ring_of_arrows(rng: Random, count: int = 3) -> Image:
    """Arrows that follow each other around a circle, as white on black."""
    wide = _SIDE + 2 * _FRAME
    picture = np.zeros((wide, wide), np.uint8)
    radius = _SIDE * rng.uniform(0.32, 0.42)
    stroke = radius * rng.uniform(0.14, 0.5)
    half = stroke * rng.uniform(0.8, 1.6) + 0.06 * radius
    long = min(half * rng.uniform(1.0, 2.2), 0.8 * radius)
    step = 2.0 * np.pi / count
    first = rng.uniform(0.0, step)
    # what is left free between the point of one and the end of the next
    free = rng.uniform(0.02, 0.3) * step
    turned = max(step - free - long / radius, 0.25 * step)
    for k in range(count):
        angle = first + k * step + np.linspace(0.0, turned, 16)
        around = np.stack([np.cos(angle), np.sin(angle)], 1)
        end, ahead = around[-1], np.array([-around[-1, 1], around[-1, 0]])
        # the head bends with the circle or goes straight on
        inward = rng.uniform(0.0, 0.5) * long / radius * long
        tip = radius * end + long * ahead - inward * end
        head = np.array([tip, (radius + half) * end, (radius - half) * end]) + wide / 2
        # an outline of the band has flat ends, which a line of one width has not
        band = np.concatenate(
            [(radius + stroke / 2) * around, (radius - stroke / 2) * around[::-1]]
        )
        for part in (band + wide / 2, head):
            points = (part * _PARTS).round().astype(np.int32)
            cv2.fillPoly(picture, [points], 255, cv2.LINE_AA, 4)
    turned_other = picture if rng.random() < 0.5 else picture[:, ::-1]
    return cropped(np.asarray(turned_other, np.uint8))


def _left_turn(rng: Random) -> FloatArray:
    """Points [n, 2] of an arrow up and then left, its bend sharp or round, in the unit square."""
    right, top = rng.uniform(0.62, 0.95), rng.uniform(0.2, 0.45)
    end = rng.uniform(0.15, 0.3)
    radius = rng.uniform(0.0, 0.9) * min(right - end, 0.95 - top)
    angle = np.linspace(0.0, np.pi / 2, 12)
    bend = np.stack([right - radius * (1 - np.cos(angle)), top + radius * (1 - np.sin(angle))], 1)
    return np.concatenate([[[right, 1.0]], bend, [[end, top]]])


def _u_turn(rng: Random) -> FloatArray:
    """Points [n, 2] of an arrow up, round to the left and down again."""
    wide, low = rng.uniform(0.34, 0.6), rng.uniform(0.5, 0.75)
    left, right = 0.5 - wide / 2, 0.5 + wide / 2
    power = rng.uniform(2.0, 4.5)
    high = rng.uniform(0.7, 1.1) * wide / 2
    angle = np.linspace(0.0, np.pi, 24)
    x = 0.5 + wide / 2 * np.sign(np.cos(angle)) * np.abs(np.cos(angle)) ** (2 / power)
    y = 0.1 + high * (1.0 - np.abs(np.sin(angle)) ** (2 / power))
    return np.concatenate([[[right, 1.0]], np.stack([x, y], 1), [[left, low]]])


def _drawn(paths: list[FloatArray], rng: Random) -> Image:
    """Lines of one width with a head at the end of each."""
    stroke = _SIDE * rng.uniform(0.1, 0.24)
    long = stroke * rng.uniform(1.1, 2.2)
    half = stroke * rng.uniform(0.95, 1.5)
    # barbs swept back or a plain triangle
    back = rng.uniform(0.0, 0.35) * long if rng.random() < 0.4 else 0.0
    picture = np.zeros((_SIDE + 2 * _FRAME, _SIDE + 2 * _FRAME), np.uint8)
    for path in paths:
        points = path * _SIDE + _FRAME
        ahead = points[-1] - points[-2]
        ahead = ahead / np.hypot(*ahead)
        aside = np.array([-ahead[1], ahead[0]])
        base = points[-1]
        head = np.array([base + ahead * long, base + aside * half - ahead * back, base,
                         base - aside * half - ahead * back])  # fmt: skip
        line = [(points * _PARTS).round().astype(np.int32)]
        cv2.polylines(picture, line, False, 255, max(2, round(stroke)), cv2.LINE_AA, 4)
        cv2.fillPoly(picture, [(head * _PARTS).round().astype(np.int32)], 255, cv2.LINE_AA, 4)
    # the round end of the line becomes a straight one
    picture[_FRAME + _SIDE :] = 0
    return cropped(picture)


def cropped(picture: Image) -> Image:
    """The part of a picture, white on black, that is drawn on."""
    rows, columns = np.nonzero(picture > 127)
    return np.asarray(
        picture[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1], np.uint8
    )


def hand_in_hand(large: Image, small: Image, rng: Random) -> Image:
    """Two figures, white on black, one of them a child: beside each other on one ground."""
    heights = [_SIDE, round(_SIDE * rng.uniform(0.5, 0.85))]
    figures = [
        _of_height(picture, high) for picture, high in zip((large, small), heights, strict=True)
    ]
    order = (0, 1) if rng.random() < 0.5 else (1, 0)
    left, right = (figures[i] for i in order)
    # their arms may overlap, and some stand apart
    apart = round(rng.uniform(-0.25, 0.5) * min(left.shape[1], right.shape[1]))
    wide = max(left.shape[1], left.shape[1] + apart + right.shape[1])
    result = np.zeros((_SIDE, wide), np.uint8)
    _add(result, left, 0)
    _add(result, right, left.shape[1] + apart)
    return result


def opposite_arrows(rng: Random) -> Image:
    """Two upright arrows beside each other, one up and one down, as white on black."""
    one = turn_arrow("straight", rng)
    pair = [one, np.asarray(one[::-1], np.uint8)]
    left, right = pair if rng.random() < 0.5 else pair[::-1]
    high, wide = one.shape
    shift = round(high * rng.uniform(0.0, 0.25)) if rng.random() < 0.4 else 0
    result = np.zeros((high + shift, 2 * wide + round(wide * rng.uniform(-0.15, 0.7))), np.uint8)
    result[:high, :wide] = left
    # where they come close, one head lies beside the other's shaft
    part = result[shift:, -wide:]
    np.maximum(part, right, out=part)
    return result if rng.random() < 0.5 else np.asarray(result[:, ::-1], np.uint8)


def riding(figure: Image, bicycle: Image, rng: Random) -> Image:
    """A figure on a bicycle, both white on black: its legs end among the wheels."""
    rider = _of_height(figure, round(_SIDE * rng.uniform(0.65, 0.85)))
    scale = _SIDE * rng.uniform(0.45, 0.6) / bicycle.shape[0]
    size = (max(4, round(bicycle.shape[1] * scale)), max(4, round(bicycle.shape[0] * scale)))
    wheels = np.asarray(cv2.resize(bicycle, size, interpolation=cv2.INTER_AREA), np.uint8)
    result = np.zeros((_SIDE, max(rider.shape[1], wheels.shape[1])), np.uint8)
    _add(result, wheels, (result.shape[1] - wheels.shape[1]) // 2)
    # a little behind the middle
    free = result.shape[1] - rider.shape[1]
    x = int(np.clip(free * rng.uniform(0.25, 0.6), 0, free))
    part = result[: rider.shape[0], x : x + rider.shape[1]]
    np.maximum(part, rider, out=part)
    return result


def _of_height(picture: Image, high: int) -> Image:
    wide = max(4, round(picture.shape[1] * high / picture.shape[0]))
    return np.asarray(cv2.resize(picture, (wide, high), interpolation=cv2.INTER_AREA), np.uint8)


def _add(result: Image, picture: Image, x: int) -> None:
    """A picture set onto the ground of another, from column ``x`` on, in place."""
    part = result[-picture.shape[0] :, x : x + picture.shape[1]]
    np.maximum(part, picture, out=part)


def strange_symbol(rng: Random) -> Image:
    """A picture that no sign of any country shows, as white on black, cropped."""
    characters = _strange_characters()
    return _picture(characters[int(rng.integers(len(characters)))])


@cache
def _strange_characters() -> tuple[str, ...]:
    import matplotlib
    from matplotlib.ft2font import FT2Font

    path = f"{matplotlib.get_data_path()}/fonts/ttf/{_STRANGE_TYPE}.ttf"
    known = FT2Font(path).get_charmap()
    return tuple(chr(c) for first, last in _STRANGE for c in range(first, last + 1) if c in known)


@cache
def _picture(character: str) -> Image:
    return cropped(typed(character, _STRANGE_TYPE))
