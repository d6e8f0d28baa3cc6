"""Whether one drive's missed signs are gone, by the gaps in the views of those it found."""

from __future__ import annotations

import numpy as np
import pytest

from automap.inventory.hidden import gaps, gone_by_gaps, hidden_for_good
from automap.inventory.missing import standing

LISTED, LOOKED = 400, 15


def town(
    part_hidden: float, seed: int = 0, drives: int = 1, passing: float = 0.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Frames that show each found sign, and those that should, of all drives that found it; of so
    many signs a part is hidden from all drives, and in each drive of ``passing`` ones."""
    rng = np.random.default_rng(seed)
    visible = np.where(rng.random(LISTED) < part_hidden, rng.random(LISTED), 1.0)
    moves = rng.random((drives, LISTED))
    visible = visible * np.where(moves < passing, rng.random((drives, LISTED)), 1.0)
    seen = rng.binomial(LOOKED, 0.9 * visible)
    by = (seen >= 2).sum(axis=0)
    seen = np.where(seen >= 2, seen, 0).sum(axis=0)
    return seen[by > 0], LOOKED * by[by > 0], by[by > 0]


def test_where_no_sign_has_gaps_one_that_was_not_seen_is_rather_gone() -> None:
    assert gone_by_gaps(gaps(*town(0.0)), LISTED, 20) > 0.6


def test_the_more_gaps_there_are_the_less_is_said() -> None:
    told = [gone_by_gaps(gaps(*town(part)), LISTED, 20) for part in (0.0, 0.1, 0.3, 0.6)]
    assert told == sorted(told, reverse=True)
    assert told[2] < 0.3


def test_the_share_of_signs_with_gaps_is_found() -> None:
    for part in (0.05, 0.4):
        share = gaps(*town(part)).share
        mean = float(share @ ((np.arange(40) + 0.5) / 40.0) ** 2)
        assert mean == pytest.approx(part, abs=0.25 * part + 0.02)


def test_without_found_signs_nothing_is_known() -> None:
    none = np.zeros(0, np.int64)
    assert 0.05 < gone_by_gaps(gaps(none, none, none), 20, 2) < 0.5


def test_what_moves_is_told_from_what_stays_by_several_drives() -> None:
    for stays, moves in ((0.3, 0.0), (0.0, 0.3), (0.3, 0.3)):
        share = gaps(*town(stays, drives=3, passing=moves)).share
        mean = float(share @ ((np.arange(40) + 0.5) / 40.0) ** 2)
        assert mean == pytest.approx(stays, abs=0.05)


def test_a_sign_that_no_drive_saw_is_surely_gone_only_where_nothing_stays_before_signs() -> None:
    tries, hits = np.full(200, 3), np.full(200, 3)
    hits[:40], hits[:8] = 2, 0
    gone = []
    for part in (0.0, 0.3):
        hidden = hidden_for_good(gaps(*town(part, drives=3)), 8).tolist()
        told = standing(tries, hits, np.zeros(200, np.int64), (), hidden)
        gone.append(told.gone[0])
        # of what no drive can see, no number of drives tells
        assert told.more_drives[0] == 0
    assert gone[0] > 0.9
    assert gone[1] < 0.6
