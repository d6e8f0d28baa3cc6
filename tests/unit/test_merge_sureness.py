"""How sure merged classes are, by simulation, and against odds written out."""

from __future__ import annotations

import numpy as np
import pytest

from automap.mapping.limits import ALTERNATIVES
from automap.mapping.sureness import COMMON, class_probabilities, group_probabilities
from tests.slow_cases import others_slow

CLASSES = tuple(f"class-{k}" for k in range(1 + ALTERNATIVES))
K = len(CLASSES)


def one(code: list[int], told: list[float], merged: int = 0) -> float:
    n = len(code)
    found = class_probabilities(
        np.array(code), np.array(told), np.zeros(n, np.int64), np.array([merged])
    )
    return float(found[0])


def test_one_drive_says_what_it_says_and_none_nothing() -> None:
    for p in (0.05, 0.3, 0.7, 0.99):
        assert one([0], [p]) == pytest.approx(p, abs=1e-9)
    assert np.isnan(one([0, 0], [np.nan, np.nan]))
    # a drive that does not tell counts for nothing
    assert one([0, 0], [0.8, np.nan]) == pytest.approx(0.8)


def test_drives_that_agree_are_surer_and_any_number_counts_as_two() -> None:
    two, many = one([0, 0], [0.8, 0.8]), one([0] * 500, [0.8] * 500)
    assert 0.8 < two < many
    odds = (0.8 / (0.2 / ALTERNATIVES)) ** (1.0 / COMMON)
    assert many == pytest.approx(odds / (odds + ALTERNATIVES), abs=1e-3)
    # by hand: odds of the class against each other one, of as many drives as two count for
    odds = (0.8 / (0.2 / ALTERNATIVES)) ** (2.0 / (1.0 + COMMON))
    assert two == pytest.approx(odds / (odds + ALTERNATIVES))


def test_drives_that_contradict_each_other_are_less_sure() -> None:
    assert one([0, 1], [0.9, 0.9]) == pytest.approx(one([1, 0], [0.9, 0.9]))
    assert one([0, 1], [0.9, 0.9]) < 0.5
    assert one([0, 1], [0.95, 0.6]) > one([0, 1], [0.95, 0.9])
    assert one([0, 0, 1], [0.9, 0.9, 0.9]) > one([0, 1], [0.9, 0.9])


def test_groups_agree_where_classes_do_not() -> None:
    names = ("regulatory--maximum-speed-limit-30--g1", "regulatory--maximum-speed-limit-80--g1")
    code, sign, merged = np.array([0, 1]), np.zeros(2, np.int64), np.array([0])
    told = np.array([0.9, 0.9])
    assert class_probabilities(code, told, sign, merged)[0] < 0.5
    assert group_probabilities(code, names, told, sign, merged)[0] > 0.95


def readings(
    rng: np.random.Generator, signs: int, drives: int, common: float, sharpness: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Codes read and probabilities told [signs, drives] of signs whose true classes come last.

    Evidence of a drive for each class is normal about the truth's; a part ``common`` of its
    variance is the face's, the same in every drive. Each drive by itself is calibrated: its
    probabilities are Bayes' of its own evidence.
    """
    true = rng.integers(K, size=signs)
    level = np.eye(K)[true] * sharpness
    face = rng.standard_normal((signs, 1, K)) * np.sqrt(common)
    own = rng.standard_normal((signs, drives, K)) * np.sqrt(1.0 - common)
    seen = level[:, None, :] + face + own
    log = sharpness * seen
    p = np.exp(log - log.max(axis=2, keepdims=True))
    p /= p.sum(axis=2, keepdims=True)
    return p.argmax(axis=2), p.max(axis=2), true


@pytest.mark.parametrize("common", others_slow([0.25, 0.0, 0.5]))
@pytest.mark.parametrize("drives", others_slow([4, 2, 8]))
@pytest.mark.parametrize("sharpness", [1.5, 2.5])
def test_merged_classes_are_not_overconfident(common: float, drives: int, sharpness: float) -> None:
    """Whatever drives have in common up to COMMON, no bin of probabilities promises more than it
    holds, and together they are surer and as right as one drive."""
    rng = np.random.default_rng(round(100 * common) + drives)
    signs = 6000
    code, told, true = readings(rng, signs, drives, common, sharpness)
    sign = np.repeat(np.arange(signs), drives)
    asked = np.array(
        [np.bincount(row, weight, K).argmax() for row, weight in zip(code, told, strict=True)]
    )
    p = class_probabilities(code.ravel(), told.ravel(), sign, asked)
    right = asked == true
    for low, high in ((0.0, 0.5), (0.5, 0.7), (0.7, 0.9), (0.9, 0.97), (0.97, 1.0)):
        here = (p > low) & (p <= high)
        if here.sum() < 100:
            continue
        # three sigmas of a share, at most
        slack = 1.5 / np.sqrt(here.sum())
        assert right[here].mean() >= p[here].mean() - slack, (low, high)
    if drives > 2:
        # two that contradict each other leave more doubt than one
        assert p.mean() > told[:, 0].mean()
    assert right.mean() >= (code[:, 0] == true).mean()
