"""Which face of the vocabulary a patch shows, by correlation."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, lru_cache

import cv2
import numpy as np
import numpy.typing as npt

from automap.records import FloatArray
from automap.vision.detector import Image
from automap.vision.faces import draw_face, outline_points
from automap.vision.vocabulary import load_vocabulary

Patch = npt.NDArray[np.float32]

_SIZE = 36
_SEARCH = 3
_COARSENESS = (6, 7, 8, 9, 10, 12, 14, 16, 18, 20, 24, 28, 32, _SIZE)
"""Sizes in px at which templates are kept."""
_FLAT = 0.01
"""A patch whose values vary less than this, squared and on average, shows nothing."""
_SCALES = (0.94, 1.06)
_HOPELESS = 0.4
"""A face that correlates less than this is not worth trying at other scales."""

# the part of a face, in its unit square x0, y0, x1, y1, that holds what tells it from others
# of its group and lies inside the outline
_CORE = {
    "circle": (0.15, 0.15, 0.85, 0.85),
    "octagon": (0.12, 0.20, 0.88, 0.80),
    "diamond": (0.24, 0.24, 0.76, 0.76),
    "square": (0.06, 0.06, 0.94, 0.94),
    "triangle-down": (0.22, 0.08, 0.78, 0.55),
    "triangle-up": (0.22, 0.45, 0.78, 0.92),
}


@dataclass(frozen=True)
class Match:
    """Best and second best class with their correlations (-1 where there is none)."""

    name: str | None
    correlation: float
    runner_up: float


def face_patch(image: Image, box: FloatArray, shape: str, scale: float = 1.0) -> Patch:
    """The face in a box, stretched to its unit square, with a margin of ``_SEARCH`` px."""
    outline = outline_points(shape)
    low, high = outline.min(axis=0), outline.max(axis=0)
    centre = (box[:2] + box[2:]) / 2.0
    # pixels per unit of the face's square
    unit = (box[2:] - box[:2]) / (high - low) * scale
    origin = centre - unit * (low + high) / 2.0
    step = unit / _SIZE
    first = origin + step * (0.5 - _SEARCH)
    matrix = np.array([[step[0], 0.0, first[0]], [0.0, step[1], first[1]]])
    n = _SIZE + 2 * _SEARCH
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    patch = cv2.warpAffine(image, matrix, (n, n), flags=flags, borderMode=cv2.BORDER_REPLICATE)
    return patch.astype(np.float32)


def match_face(image: Image, box: FloatArray, shape: str, group: str) -> Match:
    """The class of ``group`` that looks most like the face in ``box`` [4] px.

    Normalised correlation of the inner part in all three channels, over small shifts and
    scales; templates are drawn as coarsely as the picture shows the face.
    """
    width, height = (_nearest_size(v) for v in (box[2:] - box[:2]).tolist())
    names, templates = _templates(group, width, height)
    if not names:
        return Match(None, -1.0, -1.0)
    window = _window(shape)
    best = _correlations(face_patch(image, box, shape)[window], shape, templates)
    if best.max() >= _HOPELESS:
        for scale in _SCALES:
            patch = face_patch(image, box, shape, scale)[window]
            best = np.maximum(best, _correlations(patch, shape, templates))
    order = np.argsort(-best, kind="stable")
    second = float(best[order[1]]) if len(names) > 1 else -1.0
    return Match(names[order[0]], float(best[order[0]]), second)


def _nearest_size(length: float) -> int:
    """The size of ``_COARSENESS`` next to a length in px."""
    return min(_COARSENESS, key=lambda size: abs(size - length))


def _core_pixels(shape: str) -> tuple[int, int, int, int]:
    x0, y0, x1, y1 = _CORE[shape]
    return round(x0 * _SIZE), round(y0 * _SIZE), round(x1 * _SIZE), round(y1 * _SIZE)


def _window(shape: str) -> tuple[slice, slice]:
    """The part of a patch over which the core may be shifted by the search."""
    x0, y0, x1, y1 = _core_pixels(shape)
    return slice(y0, y1 + 2 * _SEARCH), slice(x0, x1 + 2 * _SEARCH)


def _correlations(patch: Patch, shape: str, templates: Patch) -> Patch:
    """Best normalised correlation [k] of each template [k, n] over all shifts of a patch.

    The mean of every channel is taken out, as cv2's TM_CCOEFF_NORMED does; one matrix product
    serves all shifts and templates, where cv2 would transform each pair.
    """
    x0, y0, x1, y1 = _core_pixels(shape)
    wide, high = x1 - x0, y1 - y0
    centred = patch - patch.mean(axis=(0, 1))
    valid = (slice(high // 2, high // 2 + 2 * _SEARCH + 1),
             slice(wide // 2, wide // 2 + 2 * _SEARCH + 1))  # fmt: skip
    mean = cv2.boxFilter(centred, -1, (wide, high))[valid]
    square = cv2.sqrBoxFilter(centred, -1, (wide, high))[valid]
    power = (square - mean**2).sum(axis=2).ravel() * (wide * high)
    windows = np.lib.stride_tricks.sliding_window_view(centred, (high, wide), axis=(0, 1))
    products = windows.reshape(len(power), -1) @ templates.T
    flat = power < _FLAT * templates.shape[1]
    ratio = products / np.sqrt(np.where(flat, np.inf, power))[:, None]
    return np.asarray(ratio.max(axis=0))


@lru_cache(maxsize=192)
def _templates(group: str, width: int, height: int) -> tuple[tuple[str, ...], Patch]:
    """Names of a group's classes and their cores [k, n], each channel without its mean, of
    norm 1, as coarse as a face of that size in px."""
    signs = [c for c in load_vocabulary().classes.values() if c.group == group]
    rows = []
    for sign in signs:
        small = cv2.resize(_on_grey(sign.name), (width, height), interpolation=cv2.INTER_AREA)
        patch = cv2.resize(small, (_SIZE, _SIZE), interpolation=cv2.INTER_LINEAR)
        x0, y0, x1, y1 = _core_pixels(sign.outline)
        core = patch[y0:y1, x0:x1]
        core = (core - core.mean(axis=(0, 1))).transpose(2, 0, 1).ravel()
        rows.append(core / max(float(np.linalg.norm(core)), 1e-6))
    return tuple(c.name for c in signs), np.array(rows, np.float32)


@cache
def _on_grey(name: str) -> Patch:
    face = draw_face(name, 2 * _SIZE)
    # outside the outline stands a middle grey: what is behind a sign is unknown
    cover = face[:, :, 3:].astype(np.float32) / 255.0
    return np.asarray(face[:, :, :3] * cover + 110.0 * (1.0 - cover), np.float32)
