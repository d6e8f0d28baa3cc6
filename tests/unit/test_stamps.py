"""Stamps out of order, repeated, in pieces or of clocks that were reset."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from automap.io.stamps import find_gaps, order_stamps


@settings(max_examples=200)
@given(st.lists(st.integers(0, 60), min_size=1, max_size=60))
def test_kept_stamps_increase_and_every_row_is_accounted_for(values: list[int]) -> None:
    t_ns = np.array(values, dtype=np.int64) * 100_000_000
    order = order_stamps(t_ns)
    assert order is not None
    assert np.all(np.diff(t_ns[order.keep]) > 0)
    lost = sum(piece.last - piece.first + 1 for piece in order.lost)
    assert len(order.keep) + order.repeats + order.stepped_back + lost == len(values)


def test_late_packets_are_sorted_in_and_copies_left_out() -> None:
    regular = np.arange(1000) * 10_000_000
    shuffled = regular.copy()
    shuffled[500:504] = shuffled[[503, 500, 501, 502]]
    doubled = np.insert(shuffled, 700, shuffled[690:700])
    order = order_stamps(doubled)
    assert order is not None
    np.testing.assert_array_equal(doubled[order.keep], regular)
    assert (order.reordered, order.repeats, order.stepped_back) == (3, 10, 0)


def test_a_clock_set_back_loses_the_second_passage_only() -> None:
    t_ns = np.arange(1000) * 10_000_000
    t_ns[600:] -= 303_000_000
    order = order_stamps(t_ns)
    assert order is not None
    assert order.stepped_back == 30
    assert len(order.keep) == 970


@pytest.mark.parametrize(("row", "stamp"), [(500, 10**16), (500, 0), (0, 0), (999, 10**16)])
def test_a_single_wrong_stamp_costs_one_row(row: int, stamp: int) -> None:
    t_ns = 5 * 10**12 + np.arange(1000) * 10_000_000
    t_ns[row] = stamp
    order = order_stamps(t_ns)
    assert order is not None
    assert len(order.keep) == 999
    assert [(piece.first, piece.last) for piece in order.lost] == [(row, row)]


def test_of_a_recording_whose_clock_was_reset_the_larger_part_stays() -> None:
    t_ns = np.concatenate([10**13 + np.arange(600) * 10**7, np.arange(400) * 10**7])
    order = order_stamps(t_ns)
    assert order is not None
    np.testing.assert_array_equal(order.keep, np.arange(600))
    assert [(piece.first, piece.last) for piece in order.lost] == [(600, 999)]


def test_pieces_of_one_clock_are_put_in_order() -> None:
    """As a ring buffer has them, that was written from its middle on."""
    t_ns = np.roll(10**13 + np.arange(1000) * 10**7, 400)
    order = order_stamps(t_ns)
    assert order is not None
    assert (np.diff(t_ns[order.keep]) == 10**7).all()
    assert (len(order.keep), order.lost) == (1000, ())


def test_gaps_are_listed() -> None:
    t_ns = np.array([0, 10, 20, 70, 80, 105, 115]) * 1_000_000
    assert find_gaps(t_ns) == [(20_000_000, 0.05)]
    assert len(find_gaps(t_ns, 2.0)) == 2


def test_stamps_at_the_ends_of_what_a_number_holds_are_lost_alone() -> None:
    t_ns = np.arange(30) * 10**7 + 10**12
    t_ns[0], t_ns[9] = np.iinfo(np.int64).min, np.iinfo(np.int64).max
    with np.errstate(all="raise"):
        order = order_stamps(t_ns)
    assert order is not None
    assert order.keep.tolist() == [k for k in range(30) if k not in (0, 9)]
