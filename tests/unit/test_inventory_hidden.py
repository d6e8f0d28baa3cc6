"""Whether one drive's missed signs are gone, by the gaps in the views of those it found."""

from __future__ import annotations

import numpy as np
import pytest

from automap.mapping.inventory_hidden import gaps, gone_by_gaps

LISTED, LOOKED = 400, 15


def town(part_hidden: float, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Frames that show each found sign, and those that should."""
    rng = np.random.default_rng(seed)
    visible = np.where(rng.random(LISTED) < part_hidden, rng.random(LISTED), 1.0)
    seen = rng.binomial(LOOKED, 0.9 * visible)
    found = seen >= 2
    return seen[found], np.full(int(found.sum()), LOOKED)


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
    assert 0.05 < gone_by_gaps(gaps(none, none), 20, 2) < 0.5
