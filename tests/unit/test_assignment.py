"""Assignment against all ways in which rows can be given columns."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from automap.assignment import assign


def least(cost: np.ndarray, alone: np.ndarray) -> float:
    n, m = cost.shape
    every = []
    for columns in product(range(-1, m), repeat=n):
        used = [c for c in columns if c >= 0]
        if len(used) == len(set(used)):
            every.append(sum(alone[i] if c < 0 else cost[i, c] for i, c in enumerate(columns)))
    return float(min(every))


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("shape", [(3, 4), (4, 2), (1, 1)])
def test_no_other_assignment_costs_less(seed: int, shape: tuple[int, int]) -> None:
    rng = np.random.default_rng(seed)
    cost = rng.normal(2.0, 2.0, shape)
    cost[rng.random(shape) < 0.3] = np.inf
    alone = rng.uniform(0.5, 3.0, shape[0])
    partner = assign(cost, alone)
    paired = partner[partner >= 0]
    assert len(paired) == len(set(paired.tolist()))
    total = sum(alone[i] if c < 0 else cost[i, c] for i, c in enumerate(partner))
    assert total == pytest.approx(least(cost, alone))


def test_what_cannot_be_stays_alone() -> None:
    assert assign(np.array([[np.nan, np.inf], [0.5, np.inf]]), 1.0).tolist() == [-1, 0]
    assert assign(np.zeros((2, 0)), 1.0).tolist() == [-1, -1]
    assert assign(np.zeros((0, 3)), 1.0).tolist() == []
