"""Figures of a detector against labelled boxes, with intervals by bootstrap over images."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from automap.records import FloatArray

_IOU = 0.5
_RESAMPLES = 1000


@dataclass(frozen=True)
class ImageResult:
    """One image: scores [n] of its boxes and whether each is right; ``truths`` signs in it.

    ``small`` [n]: whether the sign that a right box found is under 32 px; ``small_truths``.
    """

    score: FloatArray
    right: npt.NDArray[np.bool_]
    truths: int
    small: npt.NDArray[np.bool_]
    small_truths: int


@dataclass(frozen=True)
class Figure:
    """A value and its 95 % interval."""

    value: float
    low: float
    high: float

    def __str__(self) -> str:
        return f"{self.value:.3f} [{self.low:.3f}, {self.high:.3f}]"


def overlaps(a: FloatArray, b: FloatArray) -> FloatArray:
    """Intersection over union [n, m] of boxes [n, 4] and [m, 4]."""
    low = np.maximum(a[:, None, :2], b[None, :, :2])
    high = np.minimum(a[:, None, 2:], b[None, :, 2:])
    common = np.prod(np.maximum(high - low, 0.0), axis=2)
    areas = [np.prod(x[:, 2:] - x[:, :2], axis=1) for x in (a, b)]
    return np.asarray(common / np.maximum(areas[0][:, None] + areas[1] - common, 1e-9))


def judge_image(boxes: FloatArray, scores: FloatArray, truth: FloatArray) -> ImageResult:
    """Match boxes, best first, with the labelled ones; a second box on a sign is wrong."""
    order = np.argsort(-scores, kind="stable")
    right = np.zeros(len(order), bool)
    small = np.zeros(len(order), bool)
    sizes = (truth[:, 2:] - truth[:, :2]).max(axis=1) if len(truth) else np.zeros(0)
    free = np.ones(len(truth), bool)
    table = overlaps(boxes, truth) if len(truth) and len(boxes) else np.zeros((len(boxes), 0))
    for place, i in enumerate(order):
        fits = np.where(free, table[i], 0.0) if len(truth) else np.zeros(0)
        if len(fits) and fits.max() >= _IOU:
            best = int(fits.argmax())
            free[best] = False
            right[place], small[place] = True, bool(sizes[best] < 32)
    return ImageResult(scores[order], right, len(truth), small, int((sizes < 32).sum()))


def _pooled(results: Sequence[ImageResult]) -> tuple[FloatArray, npt.NDArray[np.bool_]]:
    score = np.concatenate([r.score for r in results])
    order = np.argsort(-score, kind="stable")
    return score[order], np.concatenate([r.right for r in results])[order]


def average_precision(results: Sequence[ImageResult]) -> float:
    """Area below the precision-recall curve, all points, as PASCAL VOC has it from 2010 on."""
    truths = sum(r.truths for r in results)
    if truths == 0:
        return float("nan")
    _, right = _pooled(results)
    if len(right) == 0:
        return 0.0
    hits = np.cumsum(right)
    precision = hits / np.arange(1, len(right) + 1)
    envelope = np.maximum.accumulate(precision[::-1])[::-1]
    recall = hits / truths
    return float(np.sum(np.diff(np.concatenate([[0.0], recall])) * envelope))


def threshold_at(results: Sequence[ImageResult], false_per_image: float) -> float:
    """The lowest score with at most so many false boxes an image."""
    score, right = _pooled(results)
    allowed = false_per_image * len(results)
    wrong = np.cumsum(~right)
    good = np.flatnonzero(wrong <= allowed)
    return float(score[good[-1]]) if len(good) else 1.0


def recall_at(results: Sequence[ImageResult], false_per_image: float = 0.1) -> float:
    """Share of the signs found at so many false boxes an image."""
    least = threshold_at(results, false_per_image)
    hits = sum(int((r.right & (r.score >= least)).sum()) for r in results)
    return hits / max(sum(r.truths for r in results), 1)


def small_recall_at(results: Sequence[ImageResult], false_per_image: float = 0.1) -> float:
    """The same for signs under 32 px."""
    least = threshold_at(results, false_per_image)
    hits = sum(int((r.small & (r.score >= least)).sum()) for r in results)
    return hits / max(sum(r.small_truths for r in results), 1)


def with_interval(
    results: Sequence[ImageResult], figure: Callable[[Sequence[ImageResult]], float]
) -> Figure:
    """A figure and its 95 % interval by resampling the images."""
    rng = np.random.default_rng(3)
    n = len(results)
    values = []
    for _ in range(_RESAMPLES):
        values.append(figure([results[i] for i in rng.integers(0, n, n)]))
    low, high = np.nanpercentile(values, [2.5, 97.5])
    return Figure(figure(results), float(low), float(high))


def share_with_interval(hits: Sequence[float], groups: Sequence[int]) -> Figure:
    """Mean of ``hits`` and its 95 % interval by resampling whole groups (tracks)."""
    numbers, sums, counts = np.unique(groups), [], []
    values, of = np.asarray(hits, float), np.asarray(groups)
    for number in numbers:
        mine = values[of == number]
        sums.append(mine.sum())
        counts.append(len(mine))
    total, size = np.array(sums), np.array(counts)
    rng = np.random.default_rng(4)
    draws = rng.integers(0, len(numbers), (_RESAMPLES, len(numbers)))
    means = total[draws].sum(axis=1) / size[draws].sum(axis=1)
    low, high = np.percentile(means, [2.5, 97.5])
    return Figure(float(values.mean()), float(low), float(high))
