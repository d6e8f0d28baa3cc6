"""Sub-pixel placing of a named face: the drawn face is fitted to the picture."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
import numpy.typing as npt

from automap.records import FloatArray
from automap.vision.detector import Image
from automap.vision.faces import draw_face, outline_points
from automap.vision.vocabulary import load_vocabulary

_FACE = 128
_PAD = 24
_FINE = 3
_ROUNDS = 8
_FARTHEST = 0.2
_ENOUGH = 4000

Floats = npt.NDArray[np.float64]


def align_face(image: Image, box: FloatArray, name: str) -> FloatArray:
    """The box [4] px of a known face, moved and stretched to where its drawing fits best.

    Gauss-Newton on centre, width and height, after Lucas and Kanade; brightness and contrast
    of each channel are free, and only pixels within the outline count, because what is
    behind a sign is unknown. Returns ``box`` unchanged when the fit runs away.
    """
    outline = outline_points(load_vocabulary().classes[name].outline)
    low, high = outline.min(axis=0), outline.max(axis=0)
    margin = 2
    x0, y0 = np.maximum(np.floor(box[:2]).astype(int) - margin, 0)
    x1 = min(int(np.ceil(box[2])) + margin + 1, image.shape[1])
    y1 = min(int(np.ceil(box[3])) + margin + 1, image.shape[0])
    region = image[y0:y1, x0:x1].astype(np.float64)
    # centre of the face's unit square and its sides, in pixels of the region
    sides = (box[2:] - box[:2]) / (high - low)
    place = np.concatenate([(box[:2] + box[2:]) / 2 - [x0, y0] - sides * ((low + high) / 2 - 0.5),
                            sides])  # fmt: skip
    first = place.copy()
    shape = region.shape[:2]
    for _ in range(_ROUNDS):
        drawn, cover = _draw(name, place, shape)
        rows, columns = np.nonzero(cover[1:-1, 1:-1] > 0.999)
        # a large face has more pixels than its four numbers need
        some = slice(None, None, 1 + len(rows) // _ENOUGH)
        rows, columns = rows[some] + 1, columns[some] + 1
        if len(rows) < 20:
            return box
        # moving or stretching the face shifts its gradients
        across = (drawn[rows, columns + 1] - drawn[rows, columns - 1]) / 2
        down = (drawn[rows + 1, columns] - drawn[rows - 1, columns]) / 2
        x = ((columns - place[0]) / place[2])[:, None]
        y = ((rows - place[1]) / place[3])[:, None]
        slopes = np.stack([-across, -down, -x * across, -y * down])
        move = _step(region[rows, columns], drawn[rows, columns], slopes)
        place += move
        off = np.abs(place - first) / np.maximum(first[[2, 3, 2, 3]], 12.0)
        if not np.isfinite(place).all() or off.max() > _FARTHEST:
            return box
        if np.abs(move).max() < 0.01:
            break
    centre = place[:2] + place[2:] * ((low + high) / 2 - 0.5) + [x0, y0]
    half = place[2:] * (high - low) / 2
    return np.concatenate([centre - half, centre + half])


def _step(picture: Floats, drawn: Floats, slopes: Floats) -> Floats:
    """One least-squares step [4] of pixels [n, 3] against a drawing [n, 3] with slopes
    [4, n, 3]; gain and offset of each channel are solved along."""
    normal, right = np.zeros((4, 4)), np.zeros(4)
    for c in range(picture.shape[1]):
        columns = np.vstack([slopes[:, :, c], drawn[:, c], picture[:, c]])
        columns -= columns.mean(axis=1, keepdims=True)
        # all products at once; then what the gain can explain is taken out of the others
        gram = columns @ columns.T
        power = max(gram[4, 4], 1e-9)
        gain = gram[4, 5] / power
        normal += gain**2 * (gram[:4, :4] - np.outer(gram[:4, 4], gram[4, :4]) / power)
        right += gain * (gram[:4, 5] - gram[:4, 4] * gain)
    # a face that says nothing along one axis stays where it is there
    normal += np.eye(4) * (1e-3 * np.trace(normal) / 4 + 1e-9)
    return np.asarray(np.linalg.solve(normal, right))


def _draw(name: str, place: Floats, shape: tuple[int, int]) -> tuple[Floats, Floats]:
    """The face at ``place`` (centre x, y, width, height px): colours [h, w, 3], cover [h, w]."""
    scale = place[2:] * _FINE / _FACE
    middle = (place[:2] + 0.5) * _FINE - 0.5
    offset = middle - scale * (_FACE + 2 * _PAD - 1) / 2.0
    matrix = np.array([[scale[0], 0.0, offset[0]], [0.0, scale[1], offset[1]]])
    size = (shape[1] * _FINE, shape[0] * _FINE)
    fine = cv2.warpAffine(
        _soft_face(name), matrix, size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    small = cv2.resize(fine, (shape[1], shape[0]), interpolation=cv2.INTER_AREA).astype(np.float64)
    return small[:, :, :3], small[:, :, 3]


@lru_cache(maxsize=64)
def _soft_face(name: str) -> npt.NDArray[np.float32]:
    face = draw_face(name, _FACE).astype(np.float32)
    cover = face[:, :, 3:] / 255.0
    # the rim's colour goes on outside, so that gradients within the face end at nothing else
    vocabulary = load_vocabulary()
    sign = vocabulary.classes[name]
    rim = np.array(vocabulary.colours[sign.rim or sign.border][::-1], np.float32)
    filled = np.dstack([face[:, :, :3] * cover + rim * (1.0 - cover), cover])
    edge = [(_PAD, _PAD), (_PAD, _PAD), (0, 0)]
    padded = np.pad(filled, edge)
    padded[:, :, :3] += rim * (np.pad(cover, edge, constant_values=-1.0) < 0.0)
    return padded.astype(np.float32)
