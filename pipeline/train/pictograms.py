"""The picture of one face set on the ground of another: a country's children on another's sign."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from pipeline.train.variants import depth_of

Image = npt.NDArray[np.uint8]
Floats = npt.NDArray[np.float32]
Random = np.random.Generator

_RIM = 0.12
_UNLIKE = 90
_LEAST = 0.25
_SIDE = 112
_ONE_INK, _RED = 48.0, 60.0
"""Levels by which pixels of one ink, edges included, differ on average; of red over blue."""


def _reduced(face: Image) -> Image:
    scale = _SIDE / max(face.shape[:2])
    size = (round(face.shape[1] * scale), round(face.shape[0] * scale))
    return np.asarray(cv2.resize(face, size, interpolation=cv2.INTER_AREA), np.uint8)


def _ground(face: Image) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.float64]]:
    """Which pixels lie within the rim, and the most frequent colour there."""
    inside = depth_of(face) > _RIM
    pixels = face[inside][:, :3]
    if len(pixels) == 0:
        return inside, np.zeros(3)
    codes = pixels.astype(np.int64) // 24 @ np.array([1, 16, 256])
    values, counts = np.unique(codes, return_counts=True)
    return inside, np.median(pixels[codes == values[counts.argmax()]], axis=0)


def _ink(face: Image) -> tuple[Floats, npt.NDArray[np.float64]]:
    """How much of every pixel [height, width] is drawn within the rim, and the ground's colour.

    Small pieces that touch the rim are pieces of the rim.
    """
    inside, ground = _ground(face)
    unlike = np.abs(face[:, :, :3] - ground).max(axis=2)
    ink = np.clip((unlike - 0.4 * _UNLIKE) / (0.6 * _UNLIKE), 0.0, 1.0) * inside
    solid = (ink > 0.5).astype(np.uint8)
    count, pieces, stats, _ = cv2.connectedComponentsWithStats(solid, connectivity=8)
    touches = np.zeros(count, bool)
    touches[pieces[inside & (depth_of(face) < _RIM + 0.025)]] = True
    area = stats[:, cv2.CC_STAT_AREA]
    rim = touches & (area < 0.15 * max(int(area[1:].sum()), 1))
    rim[0] = False
    near = cv2.dilate(rim[pieces].astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    ink[near & (solid == 0)] = 0.0
    ink[rim[pieces]] = 0.0
    return np.asarray(ink, np.float32), ground


def picture_of(face: Image) -> Image | None:
    """What is drawn within the rim, BGRA cropped to it; None where that is next to nothing."""
    face = _reduced(face)
    ink, _ = _ink(face)
    rows, columns = np.nonzero(ink > 0.5)
    if len(rows) < 60 or max(np.ptp(rows), np.ptp(columns)) < _LEAST * _SIDE:
        return None
    picture = np.dstack([face[:, :, :3], np.asarray(255 * ink, np.uint8)])
    return np.asarray(
        picture[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1], np.uint8
    )


def ground_of(face: Image) -> npt.NDArray[np.float64]:
    """The colour, BGR, that a face shows most within its rim."""
    return _ground(_reduced(face))[1]


def regrounded(face: Image, colour: npt.NDArray[np.float64]) -> Image:
    """A face whose ground, in the rim as well, is of another colour; all else as it was."""
    face = _reduced(face)
    _, ground = _ground(face)
    own = face[:, :, :3].astype(np.float64)
    unlike = np.abs(own - ground).max(axis=2, keepdims=True)
    # what mixes at edges of the picture changes in part
    cover = np.clip(1.0 - unlike / _UNLIKE, 0.0, 1.0)
    return np.dstack([np.clip(own + cover * (colour - ground), 0, 255).astype(np.uint8),
                      face[:, :, 3]])  # fmt: skip


def silhouette_of(face: Image) -> Image | None:
    """The picture of a face as white on black, if it has one ink alone and that is not red."""
    picture = picture_of(face)
    if picture is None:
        return None
    drawn = picture[picture[:, :, 3] > 200][:, :3].astype(np.float64)
    # of a second ink, or of a bar that crosses the picture
    if len(drawn) == 0 or np.abs(drawn - np.median(drawn, axis=0)).max(axis=1).mean() > _ONE_INK:
        return None
    blue, _, red = np.median(drawn, axis=0)
    return None if red - blue > _RED else np.asarray(picture[:, :, 3], np.uint8)


def redrawn(face: Image, silhouette: Image, rng: Random) -> Image | None:
    """``face`` with another silhouette, white on black, in the place and ink of its picture."""
    ink, _ = _ink(_reduced(face))
    drawn = _reduced(face)[ink > 0.9][:, :3]
    if len(drawn) == 0:
        return None
    colour = np.median(drawn, axis=0)
    picture = np.empty((*silhouette.shape, 4), np.uint8)
    picture[:, :, :3], picture[:, :, 3] = colour, silhouette
    return transplanted(face, picture, rng)


def transplanted(face: Image, picture: Image, rng: Random) -> Image | None:
    """``face`` with another ``picture`` in the place and about the size of its own."""
    face = _reduced(face)
    ink, ground = _ink(face)
    rows, columns = np.nonzero(ink > 0.5)
    if len(rows) < 60:
        return None
    result = face.copy()
    # a little beyond the ink, so that no trace of its edges remains
    traces = cv2.dilate((ink > 0).astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    result[traces, :3] = ground.astype(np.uint8)
    high, wide = np.ptp(rows) + 1, np.ptp(columns) + 1
    scale = min(high / picture.shape[0], wide / picture.shape[1]) * rng.uniform(0.9, 1.2)
    size = (max(4, round(picture.shape[1] * scale)), max(4, round(picture.shape[0] * scale)))
    drawn = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    x = round((columns.min() + columns.max() - size[0]) / 2)
    y = round((rows.min() + rows.max() - size[1]) / 2)
    if x < 0 or y < 0 or x + size[0] > face.shape[1] or y + size[1] > face.shape[0]:
        return None
    cover = drawn[:, :, 3:] / 255.0
    part = result[y : y + size[1], x : x + size[0], :3]
    ink = drawn[:, :, :3].astype(np.float64)
    part[:] = np.asarray(part * (1 - cover) + ink * cover, np.uint8)
    return result
