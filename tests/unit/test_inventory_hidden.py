"""Whether missed signs are gone: by the gaps in the views of those that were found, by the faces
beside them, and by what a detector knows."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from inventory_case import faulty, town_and_drive

from automap.inventory.comparison import InventoryComparison, compare_inventory
from automap.inventory.findings import Inventory
from automap.inventory.hidden import gaps, gone_by_gaps, hidden_for_good
from automap.inventory.missing import standing
from automap.mapping.sightings import DriveSigns
from automap.records import Sign
from pipeline.compare.doubts import doubts
from tests.slow_cases import others_slow

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


def test_faces_taken_off_posts_that_stay_say_nothing_of_posts_that_are_gone() -> None:
    gone = []
    for faces in (0, 12):
        tries = np.full(200 + faces, 8)
        hits = np.where(np.arange(200 + faces) < 4, 0, 8)
        hits[200:] = 0
        screened = np.where(np.arange(200 + faces) < 200, 1.0, 0.05)
        told = standing(tries, hits, np.zeros(200 + faces, np.int64), (), [0.01], screened)
        gone.append(told.gone)
    assert gone[1][0] == pytest.approx(gone[0][0], abs=0.01)
    assert gone[1][0] < 0.9 < gone[1][200]


@cache
def passed(times: int) -> tuple[list[Sign], Inventory, list[DriveSigns]]:
    """A street that so many drives passed, of whose signs each drive saw every fifth in half of
    its frames, and a list of it."""
    rng, town, (drive,), _, signs = town_and_drive(21, 2500.0)
    names = [f"pass-{k}" for k in range(times)]
    signs = [
        replace(s, drives=tuple(names), n_looked=20 * times, seen_share=0.5 if k % 5 == 0 else 0.95)
        for k, s in enumerate(signs)
    ]
    return signs, faulty(rng, town).inventory, [replace(drive, name=name) for name in names]


def with_more(
    times: int, class_name: str | None, on_metres: float
) -> tuple[Inventory, InventoryComparison]:
    """Compared with a list that has eight more entries: of a class (None: of another one of the
    list), so far behind others, which look the same way."""
    signs, one, drives = passed(times)
    found = [
        f.listed for f in compare_inventory(signs, one, drives).findings if f.kind == "matched"
    ]
    at = np.array(found[:80:10])
    facing = one.facing_rad[at]
    names = [one.class_name[(k + 1) % len(one)] if class_name is None else class_name for k in at]
    more = Inventory(
        [*one.ids, *(f"more-{k}" for k in at)],
        [*one.class_name, *names],
        np.append(one.lat_rad, one.lat_rad[at] + on_metres * np.cos(facing) / 6.37e6),
        np.append(one.lon_rad, one.lon_rad[at]),
        np.append(one.facing_rad, facing),
        np.append(one.sd_m, np.full(8, np.nan)),
    )
    return more, compare_inventory(signs, more, drives)


@pytest.mark.slow
@pytest.mark.parametrize("times", others_slow([3, 1], fast=1))
def test_what_hides_no_face_of_a_post_hides_none_of_it(times: int) -> None:
    """One that stands by itself may be hidden for good; a face that is not there beside one that
    was in sight all along is gone, and surely so if three drives passed."""
    for metres, gone in ((0.0, 5), (12.0, 0)):
        listed, result = with_more(times, None, metres)
        more = [f for f in result.findings if f.listed >= len(listed) - 8]
        assert len(more) == 8
        told = [f for f in more if f.kind == "missing"]
        assert len(told) >= gone > 0 or len(told) == gone
        sure = [f for f in told if f.sure]
        assert all(f.probability > 0.9 for f in sure)
        assert len(sure) >= gone if times == 3 else not sure


@pytest.mark.parametrize("name", others_slow(["information--hospital--g1", ""], fast=1))
def test_of_kinds_that_a_detector_does_not_know_nothing_is_missing(name: str) -> None:
    listed, result = with_more(3, name, 12.0)
    more = [f for f in result.findings if f.listed >= len(listed) - 8]
    assert {f.kind for f in more} == {"unconfirmed"}
    told, _ = doubts(result, passed(3)[0], listed, Path("list.csv"))
    assert "8 entries are of kinds of which the drives found less than half" in " ".join(told)
