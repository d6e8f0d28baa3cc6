"""Which face of the vocabulary a patch shows, by correlation."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

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
    width, height = (int(v) for v in np.clip(np.rint(box[2:] - box[:2]), 6, _SIZE))
    signs = [c for c in load_vocabulary().classes.values() if c.group == group]
    window = _window(shape)
    patch = np.ascontiguousarray(face_patch(image, box, shape)[window])
    found = [(_correlation(patch, _template(c.name, width, height)), c.name) for c in signs]
    if max(found, default=(0.0, ""))[0] >= _HOPELESS:
        for scale in _SCALES:
            patch = np.ascontiguousarray(face_patch(image, box, shape, scale)[window])
            found = [
                (max(best, _correlation(patch, _template(name, width, height))), name)
                for best, name in found
            ]
    found.sort(reverse=True)
    if not found:
        return Match(None, -1.0, -1.0)
    return Match(found[0][1], found[0][0], found[1][0] if len(found) > 1 else -1.0)


def _core_pixels(shape: str) -> tuple[int, int, int, int]:
    x0, y0, x1, y1 = _CORE[shape]
    return round(x0 * _SIZE), round(y0 * _SIZE), round(x1 * _SIZE), round(y1 * _SIZE)


def _window(shape: str) -> tuple[slice, slice]:
    """The part of a patch over which the core may be shifted by the search."""
    x0, y0, x1, y1 = _core_pixels(shape)
    return slice(y0, y1 + 2 * _SEARCH), slice(x0, x1 + 2 * _SEARCH)


def _correlation(patch: Patch, template: Patch) -> float:
    return float(cv2.matchTemplate(patch, template, cv2.TM_CCOEFF_NORMED).max())


@lru_cache(maxsize=2048)
def _template(name: str, width: int, height: int) -> Patch:
    shape = load_vocabulary().classes[name].outline
    face = draw_face(name, 2 * _SIZE)
    # outside the outline stands a middle grey: what is behind a sign is unknown
    cover = face[:, :, 3:].astype(np.float32) / 255.0
    picture = face[:, :, :3] * cover + 110.0 * (1.0 - cover)
    small = cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA)
    patch = cv2.resize(small, (_SIZE, _SIZE), interpolation=cv2.INTER_LINEAR)
    x0, y0, x1, y1 = _core_pixels(shape)
    return np.ascontiguousarray(patch[y0:y1, x0:x1])
