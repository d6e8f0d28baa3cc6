"""Other drawings of a face: heavier or lighter ink, a larger or shifted picture, other inks.

Countries, makers and decades draw one sign with other strokes and proportions. A network that
knows a face by one or two drawings takes the next one for an unknown face.
"""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

Image = npt.NDArray[np.uint8]
Floats = npt.NDArray[np.float32]
Random = np.random.Generator

_RIM = (0.04, 0.13)
"""Depths below the outline, of the face's size, from which and up to which the rim ends."""
_SIZE = 112


def varied(face: Image, rng: Random) -> Image:
    """Another drawing of a face: BGRA [height, width, 4], at most 112 px and its outline kept.

    Most differ a little, some as much as two countries' drawings of one sign.
    """
    high, wide = face.shape[:2]
    scale = _SIZE / max(high, wide)
    if scale < 1.0:
        size = (max(8, round(wide * scale)), max(8, round(high * scale)))
        face = np.asarray(cv2.resize(face, size, interpolation=cv2.INTER_AREA), np.uint8)
    much = rng.uniform(0.8, 1.8)
    if rng.random() < 0.8:
        face = _moved(face, rng, much)
    if rng.random() < 0.6:
        face = _inked(face, rng, 0.02 * much)
    if rng.random() < 0.5:
        face = _coloured(face, rng)
    return face


def depth_of(face: Image) -> Floats:
    """Distance [height, width] of every pixel from the outline, of the face's larger side."""
    solid = cv2.copyMakeBorder((face[:, :, 3] > 127).astype(np.uint8), 1, 1, 1, 1, 0)
    depth = cv2.distanceTransform(np.asarray(solid, np.uint8), cv2.DIST_L2, 3)[1:-1, 1:-1]
    return np.asarray(depth / max(face.shape[:2]), np.float32)


def _moved(face: Image, rng: Random, much: float) -> Image:
    """The picture within the rim turned, stretched, shifted and bent; the rim wider or not."""
    high, wide = face.shape[:2]
    y, x = np.mgrid[0:high, 0:wide].astype(np.float32)
    depth = depth_of(face)
    inner = np.clip((depth - _RIM[0]) / (_RIM[1] - _RIM[0]), 0.0, 1.0)
    size = float(np.exp(rng.normal(0.0, 0.08 * much)))
    stretch = np.exp(rng.normal(0.0, 0.07 * much, 2)) * size
    angle = rng.normal(0.0, 0.05)
    matrix = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    matrix = matrix / stretch[:, None]
    centre = np.array([wide - 1, high - 1]) / 2
    shift = rng.normal(0.0, 0.015 * much, 2) * max(high, wide)
    u, v = x - centre[0], y - centre[1]
    dx = matrix[0, 0] * u + matrix[0, 1] * v - u + shift[0]
    dy = matrix[1, 0] * u + matrix[1, 1] * v - v + shift[1]
    if rng.random() < 0.5:
        bend = rng.normal(0.0, 0.016 * much * max(high, wide), (4, 4, 2)).astype(np.float32)
        field = cv2.resize(bend, (wide, high), interpolation=cv2.INTER_CUBIC)
        dx, dy = dx + field[:, :, 0], dy + field[:, :, 1]
    moved = cv2.remap(
        face, np.asarray(x + inner * dx, np.float32),
        np.asarray(y + inner * dy, np.float32), cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE,
    )  # fmt: skip
    # nothing comes in from beyond the outline
    colour = np.where(moved[:, :, 3:] > 127, moved[:, :, :3], face[:, :, :3])
    return np.dstack([colour, face[:, :, 3]])


def _inked(face: Image, rng: Random, most: float) -> Image:
    """Dark strokes heavier or lighter by up to ``most`` of the face."""
    radius = rng.uniform(0.0, most) * max(face.shape[:2])
    n = 2 * int(radius) + 3
    y, x = np.mgrid[0:n, 0:n] - n // 2
    kernel = (np.hypot(x, y) <= radius + 0.5).astype(np.uint8)
    solid = face[:, :, :3].copy()
    # what is outside must not run in
    outside = face[:, :, 3] < 128
    heavier = rng.random() < 0.5
    solid[outside] = 255 if heavier else 0
    work = cv2.erode if heavier else cv2.dilate
    changed = np.where(outside[:, :, None], face[:, :, :3], work(solid, kernel))
    part = rng.uniform(0.3, 1.0)
    mixed = cv2.addWeighted(face[:, :, :3], 1.0 - part, np.asarray(changed, np.uint8), part, 0.0)
    return np.dstack([np.asarray(mixed, np.uint8), face[:, :, 3]])


def _coloured(face: Image, rng: Random) -> Image:
    """Coloured inks of another maker: some degrees of hue, paler or darker."""
    hsv = cv2.cvtColor(face[:, :, :3], cv2.COLOR_BGR2HSV).astype(np.float32)
    hsv[:, :, 0] = (hsv[:, :, 0] + rng.normal(0.0, 3.0)) % 180.0
    hsv[:, :, 1] *= rng.uniform(0.7, 1.1)
    # white and black stay what they are
    colour = hsv[:, :, 1:2] / 255.0
    hsv[:, :, 2:] *= 1.0 + colour * (rng.uniform(0.65, 1.15) - 1.0)
    pixels = np.clip(hsv, 0, [179, 255, 255]).astype(np.uint8)
    return np.dstack([np.asarray(cv2.cvtColor(pixels, cv2.COLOR_HSV2BGR), np.uint8), face[:, :, 3]])
