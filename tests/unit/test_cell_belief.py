"""Existence that is left as it was where a merge moved it by nothing that counts."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pipeline.merge.cell_belief import BELIEF, kept_belief
from pipeline.merge.cell_steps import Homes


def test_a_cell_keeps_its_existence_until_it_moved_by_what_counts(tmp_path: Path) -> None:
    homes = Homes(["a", "b"], [0, 2, 5])
    first = np.array([0.5, 0.999, 0.2, 0.7, 0.0])
    assert np.array_equal(kept_belief(tmp_path, homes, first), first)
    # a hundredth of sqrt(0.25) is 0.005, of sqrt(0.999e-3) 0.0003
    slow = first.copy()
    for _ in range(2):
        slow += np.array([0.003, 0.0, 0.0, 0.003, 0.0])
        kept = kept_belief(tmp_path, homes, slow)
        # what is kept is never further off than that, however small the steps
        assert (np.abs(kept - slow) <= 0.01 * np.sqrt(slow * (1.0 - slow))).all()
    assert np.array_equal(kept, slow)
    sure = slow + np.array([0.0, -0.0005, 0.0, 0.0, 0.0])
    kept = kept_belief(tmp_path, homes, sure)
    assert np.array_equal(kept, sure)
    # cells that are placed anew, or come and go, are as computed
    small = sure + 1e-6
    homes = Homes(["c", "a"], [0, 3, 5])
    assert np.array_equal(kept_belief(tmp_path, homes, small)[:3], small[:3])
    again = kept_belief(tmp_path, Homes(["a"], [0, 2]), small[3:] + 1e-6)
    assert np.array_equal(again, small[3:])


def test_what_was_kept_and_is_damaged_is_as_nothing(tmp_path: Path) -> None:
    homes, belief = Homes(["a"], [0, 2]), np.array([0.4, 0.6])
    kept_belief(tmp_path, homes, belief)
    (tmp_path / BELIEF).write_bytes((tmp_path / BELIEF).read_bytes()[:100])
    assert np.array_equal(kept_belief(tmp_path, homes, belief + 1e-6), belief + 1e-6)
    assert kept_belief(tmp_path, Homes([], [0]), np.zeros(0)).size == 0
    assert kept_belief(tmp_path, Homes([], [0]), np.zeros(0)).size == 0
