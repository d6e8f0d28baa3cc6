"""Existence that is left as it was where a merge moved it by nothing that counts."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from automap.records import FloatArray
from pipeline.merge.cell_belief import BELIEF
from pipeline.merge.cell_belief import kept_belief as kept_of
from pipeline.merge.cell_steps import Homes


def kept_belief(folder: Path, homes: Homes, belief: FloatArray) -> FloatArray:
    return kept_of(folder, homes, belief, 0.5)


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


def test_what_is_on_the_map_is_what_is_on_one_from_nothing(tmp_path: Path) -> None:
    """However little a sign's existence moved, if that takes it over the least one of a map."""
    homes, belief = Homes(["a", "b"], [0, 2, 3]), np.array([0.4999, 0.7, 0.3])
    kept_of(tmp_path, homes, belief, 0.5)
    kept = kept_of(tmp_path, homes, belief + 2e-4, 0.5)
    assert np.array_equal(kept, [*(belief[:2] + 2e-4), belief[2]])
