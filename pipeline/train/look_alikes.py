"""What the networks took for signs on streets and is none: tail lamps, wheels, gables, pylons."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
import numpy.typing as npt

Image = npt.NDArray[np.uint8]
Random = np.random.Generator
Place = tuple[int, int, float]
"""Middle, px, and size, px."""
_PARTS = 16
_BULBS = ((235, 240, 245), (120, 130, 250), (30, 150, 240), (40, 30, 90))
"""White, bright red, amber and dark, BGR."""


def tail_lamp(image: Image, place: Place, light: float, rng: Random) -> None:
    """Rings of red about a bright or dark middle, on the corner of a car."""
    x, y, size = place
    body = rng.uniform(0.1, 1.0, 3) * rng.uniform(0.3, 1.0) * light
    corner = (int(x + size * rng.uniform(0.5, 1.5)), int(y + size * rng.uniform(0.4, 0.9)))
    first = (int(x - size * rng.uniform(0.5, 1.0)), int(y - size * rng.uniform(0.5, 0.9)))
    cv2.rectangle(image, first, corner, body.tolist(), -1)
    squeeze, angle = rng.uniform(0.5, 1.0), rng.uniform(0, 180)
    red = np.array([rng.uniform(10, 60), rng.uniform(10, 60), rng.uniform(90, 240)])
    for share, shade in ((0.5, 0.5), (0.45, 1.0), (rng.uniform(0.2, 0.38), rng.uniform(0.4, 1.5))):
        axes = (max(1, int(size * share)), max(1, int(size * share * squeeze)))
        tone = np.clip(red * shade, 0, 255)
        cv2.ellipse(image, (x, y), axes, angle, 0, 360, tone.tolist(), -1, cv2.LINE_AA)
    middle = [
        (235.0, 240.0, 245.0),
        (120.0, 130.0, 250.0),
        (30.0, 150.0, 240.0),
        (40.0, 30.0, 90.0),
    ]
    axes = (max(1, int(size * rng.uniform(0.08, 0.2))), max(1, int(size * rng.uniform(0.06, 0.18))))
    tone4 = middle[int(rng.integers(len(middle)))]
    cv2.ellipse(image, (x, y), axes, angle, 0, 360, tone4, -1, cv2.LINE_AA)


def wheel(image: Image, place: Place, light: float, rng: Random) -> None:
    """A tyre about a rim with spokes or holes, or a spare wheel's cover with a mark on it."""
    x, y, size = place
    squeeze = rng.uniform(0.45, 1.0)
    tyre = rng.uniform(10, 60)
    axes = (max(2, int(size / 2 * squeeze)), max(2, int(size / 2)))
    cv2.ellipse(image, (x, y), axes, 0, 0, 360, (tyre, tyre, tyre), -1, cv2.LINE_AA)
    part = rng.uniform(0.55, 0.85)
    inner = (max(1, int(axes[0] * part)), max(1, int(axes[1] * part)))
    ground = rng.uniform(0.3, 1.0) * light * rng.uniform(0.85, 1.1, 3)
    cv2.ellipse(image, (x, y), inner, 0, 0, 360, ground.tolist(), -1, cv2.LINE_AA)
    dark = (ground * rng.uniform(0.1, 0.6)).tolist()
    count, turn = int(rng.integers(3, 12)), rng.uniform(0, 2 * np.pi)
    round_holes = rng.random() < 0.4
    for a in turn + np.linspace(0, 2 * np.pi, count, endpoint=False):
        out = np.array([np.cos(a) * inner[0], np.sin(a) * inner[1]])
        if round_holes:
            at = (int(x + 0.65 * out[0]), int(y + 0.65 * out[1]))
            cv2.circle(image, at, max(1, int(0.12 * size * part)), dark, -1, cv2.LINE_AA)
        else:
            wide = 2.4 / count
            edges = [np.array([np.cos(a + d) * inner[0], np.sin(a + d) * inner[1]]) * r
                     for d, r in ((-wide / 2, 0.92), (wide / 2, 0.92), (0.0, 0.3))]  # fmt: skip
            points = (np.array(edges) + np.array([x, y])) * _PARTS
            cv2.fillPoly(image, [points.astype(np.int32)], dark, cv2.LINE_AA, 4)
    cv2.circle(image, (x, y), max(1, int(0.1 * size * part)), dark, -1, cv2.LINE_AA)


def gable(image: Image, place: Place, light: float, rng: Random) -> None:
    """The front of a roof: a wall's triangle under dark or red edges, with a window or none."""
    x, y, size = place
    wall = rng.uniform(0.4, 1.0) * light * np.array([*rng.uniform(0.75, 1.0, 2), 1.0])
    roof = np.array([rng.uniform(20, 80), rng.uniform(20, 80), rng.uniform(40, 170)])
    half, high = size / 2 * rng.uniform(0.9, 1.4), size / 2
    corners = np.array([[x - half, y + high], [x, y - high], [x + half, y + high]])
    points = (corners * _PARTS).astype(np.int32)
    cv2.fillPoly(image, [points], wall.tolist(), cv2.LINE_AA, 4)
    below = (int(x + half * 0.85), int(y + high + size * rng.uniform(0.2, 1.0)))
    cv2.rectangle(image, (int(x - half * 0.85), int(y + high)), below, wall.tolist(), -1)
    thick = max(1, int(size * rng.uniform(0.05, 0.13)))
    cv2.polylines(image, [points], False, roof.tolist(), thick, cv2.LINE_AA, 4)
    if rng.random() < 0.6:
        w, h = size * rng.uniform(0.06, 0.16), size * rng.uniform(0.08, 0.2)
        first = (int(x - w), int(y + high * 0.3 - h))
        pane = (wall * rng.uniform(0.1, 0.5)).tolist()
        cv2.rectangle(image, first, (int(x + w), int(y + high * 0.3 + h)), pane, -1)


def pylon(image: Image, place: Place, light: float, rng: Random) -> None:
    """Arms and braces of a mast against the sky: triangles of thin dark lines that hold nothing."""
    x, y, size = place
    haze = np.array([1.0, *rng.uniform(0.8, 1.0, 2)])
    sky = np.clip(light * rng.uniform(0.8, 1.1) * haze, 0, 255)
    reach = int(size)
    cv2.rectangle(image, (x - reach, y - reach), (x + reach, y + reach), sky.tolist(), -1)
    tone = (rng.uniform(0.2, 0.6) * sky).tolist()
    thick = max(1, int(size * rng.uniform(0.02, 0.09)))
    half, high = size / 2 * rng.uniform(0.8, 1.6), size / 2 * rng.uniform(0.6, 1.0)
    way = 1 if rng.random() < 0.6 else -1
    corners = np.array(
        [[x - half, y - way * high], [x + half, y - way * high], [x, y + way * high]]
    )
    lines = [corners[[0, 1]], corners[[1, 2]], corners[[2, 0]]]
    lines.append(np.array([[x, y - 2 * size], [x, y + 2 * size]]))
    for _ in range(int(rng.integers(0, 4))):
        part = rng.uniform(0.1, 0.9, 2)
        lines.append(np.stack([corners[0] + part[0] * (corners[2] - corners[0]),
                               corners[1] + part[1] * (corners[2] - corners[1])]))  # fmt: skip
    for line in lines:
        points = (line * _PARTS).astype(np.int32)
        cv2.polylines(image, [points], False, tone, thick, cv2.LINE_AA, 4)


LOOK_ALIKES: tuple[Callable[[Image, Place, float, Random], None], ...] = (
    tail_lamp, wheel, gable, pylon,
)  # fmt: skip
