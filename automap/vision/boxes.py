"""Boxes of what a network finds: read from its maps, and one for each place."""

from __future__ import annotations

from itertools import product

import cv2
import numpy as np
import numpy.typing as npt

from automap.records import FloatArray, IntArray
from automap.vision import limits

Floats = npt.NDArray[np.float32]

_STRIDE = 4
"""Of the heat map's cells, px."""
_KINDS = 2
"""Heat maps: of the kinds that are labelled everywhere, and of all others."""
_LARGEST_STEP = 5.6
"""Of the logarithm of a distance in strides, as in the training: 1080 px."""


def decode_maps(maps: Floats, min_score: float, most: int) -> tuple[FloatArray, FloatArray]:
    """Boxes [n, 4] px and scores [n], best first, from the network's maps [6, h, w].

    A box for every cell that is the highest of its neighbours on its heat map.
    """
    logits = maps[:_KINDS].max(axis=0)
    least = np.log(min_score / (1.0 - min_score))
    highest = cv2.dilate(logits, np.ones((3, 3), np.uint8))
    rows, columns = np.nonzero((logits >= least) & (logits >= highest))
    values = logits[rows, columns]
    order = np.argsort(-values, kind="stable")[:most]
    rows, columns, values = rows[order], columns[order], values[order].astype(np.float64)
    return _mean_boxes(maps, logits, rows, columns), 1.0 / (1.0 + np.exp(-values))


def _mean_boxes(maps: Floats, logits: Floats, rows: IntArray, columns: IntArray) -> FloatArray:
    """Boxes [n, 4] px of the peaks [n]: means over the peak's cell and those around it.

    A cell counts by its heat and only within the middle of the peak's own box, where the
    network has learnt to tell the edges.
    """
    height, width = logits.shape
    own = _cell_boxes(maps, rows, columns)
    middle = (_STRIDE - 1) / 2.0
    peak = 1.0 / (1.0 + np.exp(-logits[rows, columns].astype(np.float64)))
    reach = np.maximum(limits.MIDDLE_SHARE * (own[:, 2:] - own[:, :2]), 1.0)
    total, weights = np.zeros((len(rows), 4)), np.zeros(len(rows))
    for down, right in product((-1, 0, 1), repeat=2):
        row, column = rows + down, columns + right
        inside = (row >= 0) & (row < height) & (column >= 0) & (column < width)
        row, column = np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)
        place = np.stack([column, row], axis=1) * float(_STRIDE) + middle
        away = np.abs(place - (own[:, :2] + own[:, 2:]) / 2.0)
        heat = 1.0 / (1.0 + np.exp(-logits[row, column].astype(np.float64)))
        near = inside & (away <= reach).all(axis=1) & (heat > limits.LEAST_HEAT * peak)
        share = np.where(near | ((down, right) == (0, 0)), heat, 0.0)
        total += share[:, None] * _cell_boxes(maps, row, column)
        weights += share
    return np.asarray(total / weights[:, None])


def _cell_boxes(maps: Floats, rows: IntArray, columns: IntArray) -> FloatArray:
    """The boxes [n, 4] px that cells tell."""
    x = columns * float(_STRIDE) + (_STRIDE - 1) / 2.0
    y = rows * float(_STRIDE) + (_STRIDE - 1) / 2.0
    steps = np.minimum(maps[_KINDS:, rows, columns].astype(np.float64), _LARGEST_STEP)
    left, up, right, down = np.exp(steps) * _STRIDE
    return np.stack([x - left, y - up, x + right, y + down], axis=1)


def distinct(
    boxes: FloatArray, scores: FloatArray, overlap: float, inside: float = 1.0, part: float = 0.0
) -> IntArray:
    """Indices of the best boxes of every place, best first.

    A box goes that overlaps a better one by more than ``overlap`` (IoU), or of which the share
    ``inside`` of the smaller one lies in the larger; but a better one of less than the share
    ``part`` of its area takes no larger one's place: it may be a part of it or stand before it.
    """
    order = np.argsort(-scores, kind="stable")
    ranked = boxes[order]
    area = areas(ranked)
    common = shared_areas(ranked, ranked)
    union = area[:, None] + area - common
    within = common > inside * np.minimum(area[:, None], area)
    same = (common > overlap * union) | (within & (area[:, None] >= part * area))
    open_ = np.ones(len(order), dtype=bool)
    kept: list[int] = []
    for i in range(len(order)):
        if open_[i]:
            kept.append(i)
            open_ &= ~same[i]
    return np.asarray(order[np.array(kept, np.int64)], np.int64)


def areas(boxes: FloatArray) -> FloatArray:
    """Areas [n] of boxes [n, 4]."""
    return np.asarray(np.prod(np.maximum(boxes[:, 2:] - boxes[:, :2], 1e-9), axis=1))


def shared_areas(one: FloatArray, other: FloatArray) -> FloatArray:
    """What boxes [n, 4] and [m, 4] have in common, px^2 [n, m]."""
    low = np.maximum(one[:, None, :2], other[None, :, :2])
    high = np.minimum(one[:, None, 2:], other[None, :, 2:])
    return np.asarray(np.prod(np.maximum(high - low, 0.0), axis=2))
