"""Digits constructed as road administrations construct theirs: strokes of one width.

The types of road signs differ in what they are built of: round or upright bowls, how far a six
hooks over, how high its bowl is, narrow or wide. A number drawn here takes all of these at
random, the same for each of its digits.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from automap.records import FloatArray

Image = npt.NDArray[np.uint8]
Random = np.random.Generator

_HIGH = 96


@dataclass(frozen=True)
class _Style:
    """``power`` of the bowls, 2 round, above more upright; ``bowl`` height of that of a six;
    ``hook`` angle in degrees at which its upper end stops, 360 being the right-hand side;
    ``straight``: a six, nine and three of straight strokes; ``open_four``; ``flag`` of a one."""

    power: float
    bowl: float
    hook: float
    straight: bool
    open_four: bool
    flag: float


def _arc(
    middle: tuple[float, float], half: tuple[float, float], ends: tuple[float, float], power: float
) -> FloatArray:
    """Points [n, 2] of a superellipse between two angles in degrees, clockwise from the right."""
    angle = np.radians(np.linspace(*ends, 40))
    across, down = np.cos(angle), np.sin(angle)
    x = middle[0] + half[0] * np.sign(across) * np.abs(across) ** (2.0 / power)
    y = middle[1] + half[1] * np.sign(down) * np.abs(down) ** (2.0 / power)
    return np.stack([x, y], axis=1)


def _six(style: _Style) -> list[FloatArray]:
    middle = 1.0 - style.bowl / 2
    bowl = _arc((0.5, middle), (0.5, style.bowl / 2), (0, 360), style.power)
    if style.straight:
        return [bowl, np.array([[0.72, 0.0], [0.04, middle - 0.08]])]
    # the hook ends above the bowl, or it would be an eight
    radius = 0.55 * (1.0 - style.bowl)
    top = _arc((0.5, radius), (0.5, radius), (style.hook, 180), style.power)
    return [bowl, np.concatenate([top, [[0.0, middle]]])]


def _three(style: _Style) -> list[FloatArray]:
    lower = _arc((0.5, 0.72), (0.5, 0.28), (-90, 165), style.power)
    if style.straight:
        return [np.concatenate([[[0.05, 0.0], [0.95, 0.0], [0.45, 0.44]], lower])]
    return [np.concatenate([_arc((0.5, 0.22), (0.45, 0.22), (-160, 90), style.power), lower])]


def _strokes(digit: str, style: _Style) -> list[FloatArray]:
    """Lines [n, 2] of a digit in a box of 1 by 1, y downwards."""
    power = style.power
    if digit == "0":
        return [_arc((0.5, 0.5), (0.5, 0.5), (0, 360), power)]
    if digit == "1":
        return [np.array([[0.75 - style.flag, 0.3 * style.flag + 0.1], [0.75, 0.0], [0.75, 1.0]])]
    if digit == "2":
        top = _arc((0.5, 0.28), (0.5, 0.28), (-170, 20), power)
        return [np.concatenate([top, [[0.0, 1.0], [1.0, 1.0]]])]
    if digit == "3":
        return _three(style)
    if digit == "4":
        if style.open_four:
            return [
                np.array([[0.45, 0.0], [0.0, 0.72], [1.0, 0.72]]),
                np.array([[0.72, 0.42], [0.72, 1.0]]),
            ]
        return [np.array([[0.72, 1.0], [0.72, 0.0], [0.0, 0.7], [1.0, 0.7]])]
    if digit == "5":
        lower = _arc((0.5, 1.0 - style.bowl / 2), (0.5, style.bowl / 2), (-150, 160), power)
        return [np.concatenate([[[0.92, 0.0], [0.1, 0.0], [0.06, 0.5]], lower])]
    if digit == "7":
        return [np.array([[0.0, 0.0], [1.0, 0.0], [0.35, 1.0]])]
    if digit == "8":
        return [
            _arc((0.5, 0.23), (0.45, 0.23), (0, 360), power),
            _arc((0.5, 0.73), (0.5, 0.27), (0, 360), power),
        ]
    six = _six(style)
    return six if digit == "6" else [1.0 - line for line in six]


def road_digits(text: str, rng: Random) -> Image:
    """A number as white on black [96, n], its digits of one style that is drawn at random."""
    wide = round(_HIGH * rng.uniform(0.36, 0.64))
    stroke = round(min(_HIGH * rng.uniform(0.08, 0.17), 0.3 * wide))
    style = _Style(
        power=rng.uniform(1.9, 4.5), bowl=rng.uniform(0.5, 0.62),
        hook=rng.uniform(290, 375 - 350 * stroke / _HIGH),
        straight=bool(rng.random() < 0.15), open_four=bool(rng.random() < 0.3),
        flag=rng.uniform(0.0, 0.45),
    )  # fmt: skip
    apart = round(_HIGH * rng.uniform(0.03, 0.2))
    inside = np.array([max(wide - stroke, 8), _HIGH - stroke])
    parts = []
    for digit in text:
        picture = np.zeros((_HIGH, inside[0] + stroke + 2), np.uint8)
        for line in _strokes(digit, style):
            # in sixteenths of a pixel
            points = ((line * inside + stroke / 2) * 16).round().astype(np.int32)
            cv2.polylines(picture, [points], False, 255, stroke, cv2.LINE_AA, 4)
        if digit == "1":
            picture = picture[:, np.flatnonzero(picture.max(axis=0) > 127)[0] :]
        parts += [picture, np.zeros((_HIGH, apart), np.uint8)]
    return np.asarray(np.hstack(parts[:-1]), np.uint8)
