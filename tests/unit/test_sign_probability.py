"""The fit of how surely whole signs are told, on passes with known truth."""

from __future__ import annotations

import numpy as np
import pytest

from tests.benchmarks.sign_probability import Claims, _power


def _claims(faces: int, of_each: int) -> Claims:
    """Passes told twice too surely in log-odds; those of one face are all the same."""
    rng = np.random.default_rng(5)
    odds = rng.normal(1.5, 1.0, faces)
    right = (rng.random(faces) < 1.0 / (1.0 + np.exp(-odds))).astype(float)
    told = 1.0 / (1.0 + np.exp(-2.0 * odds))
    face = np.arange(faces, dtype=float)
    told, right, face = (np.repeat(x, of_each) for x in (told, right, face))
    return Claims(told, right, told, right, np.ones_like(told), np.ones_like(told), face)


def test_the_power_of_the_odds_is_found_within_its_error() -> None:
    of = _claims(1500, 1)
    power, error, _ = _power(of.probability, of.right, of)
    assert abs(power - 0.5) < 3.0 * error
    assert error < 0.05


def test_passes_of_one_face_say_no_more_than_one_of_them() -> None:
    found = [_power(of.probability, of.right, of) for of in (_claims(300, 5), _claims(300, 1))]
    assert found[0] == pytest.approx(found[1], rel=1e-3)
