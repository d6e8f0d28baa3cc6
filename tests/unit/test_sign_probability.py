"""The rule by which the power of whole signs' odds is chosen, on passes with known truth."""

from __future__ import annotations

import numpy as np

from tests.benchmarks.sign_probability import Claims, class_power, wrong_and_sure


def _claims(power: float, faces: int, of_each: int) -> Claims:
    """Passes told twice too surely in log-odds, to a power; those of one face are the same."""
    rng = np.random.default_rng(5)
    odds = rng.normal(2.0, 1.5, faces)
    right = (rng.random(faces) < 1.0 / (1.0 + np.exp(-odds))).astype(float)
    told = 1.0 / (1.0 + np.exp(-2.0 * power * odds))
    rows = (told, right, told, right, np.ones(faces), np.ones(faces), np.arange(faces, dtype=float))
    return Claims(*(np.repeat(row, of_each) for row in rows))


def test_where_care_costs_much_the_most_likely_power_is_chosen() -> None:
    told = {k: _claims(k, 2000, 1) for k in (0.1, 0.5, 1.0)}
    assert wrong_and_sure(told[0.1]) < 0.001 < wrong_and_sure(told[0.5])
    assert class_power(told) == 0.5


def test_where_few_faces_tell_nothing_of_the_cost_the_careful_power_is_chosen() -> None:
    told = {k: _claims(k, 12, 200) for k in (0.35, 0.5, 1.0)}
    assert class_power(told) == max(k for k, c in told.items() if wrong_and_sure(c) <= 0.001)
