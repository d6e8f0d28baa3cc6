"""Clocks against the standard library's calendar and known instants."""

from __future__ import annotations

import datetime as dt

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from automap import timebase as tb

EPOCH = dt.date(1980, 1, 6)


@given(st.dates(min_value=dt.date(1900, 1, 1), max_value=dt.date(2400, 1, 1)))
def test_days_agree_with_the_standard_library(date: dt.date) -> None:
    assert tb.days_since_epoch(date.year, date.month, date.day) == (date - EPOCH).days


@pytest.mark.parametrize(
    ("utc", "leap"),
    [
        (dt.datetime(1980, 1, 6), 0),
        (dt.datetime(1999, 8, 22), 13),
        (dt.datetime(2011, 9, 26), 15),
        (dt.datetime(2016, 12, 31, 23, 59, 59), 17),
        (dt.datetime(2017, 1, 1), 18),
        (dt.datetime(2024, 6, 1), 18),
    ],
)
def test_leap_seconds_of_known_dates(utc: dt.datetime, leap: int) -> None:
    seconds = (utc - dt.datetime(1980, 1, 6)).total_seconds()
    assert tb.utc_to_gps(seconds) - seconds == leap


def test_unix_time_of_the_epoch_and_of_a_known_instant() -> None:
    assert tb.unix_to_gps(315964800) == 0
    assert tb.unix_to_gps(1_700_000_000) == 1_384_035_218


@given(st.floats(min_value=0, max_value=3e9))
def test_gps_utc_and_unix_round_trip(gps: float) -> None:
    utc = tb.gps_to_utc(gps)
    at_leap = np.any(np.abs(tb.LEAP_GPS_S - gps) < 1.1)
    if not at_leap:
        assert tb.utc_to_gps(utc) == pytest.approx(gps, abs=1e-6)
        assert tb.unix_to_gps(tb.gps_to_unix(gps)) == pytest.approx(gps, abs=1e-6)


def test_the_leap_second_itself_is_continuous() -> None:
    seconds = np.array([86399.0, 86399.5, 86400.0, 86400.9])
    before = tb.calendar_to_gps(2016, 12, 31, seconds)
    after = tb.calendar_to_gps(2017, 1, 1, np.array([0.0, 1.0]))
    assert np.allclose(np.diff(before), [0.5, 0.5, 0.9], atol=1e-6)
    assert after[0] - before[2] == pytest.approx(1.0)
    assert after[1] - after[0] == pytest.approx(1.0)


@given(st.integers(0, 4000), st.floats(0, 604799))
def test_week_round_trip(week: int, tow: float) -> None:
    weeks, tows = tb.gps_to_week(tb.week_to_gps(week, tow))
    assert weeks == week
    assert tows == pytest.approx(tow, abs=1e-5)


def test_rollover_moves_only_what_is_too_early() -> None:
    limit = float(tb.week_to_gps(1400, 0))
    times = tb.week_to_gps([2200 - 1024, 2200 - 2048, 2200], 10.0)
    assert np.array_equal(tb.undo_rollover(times, limit), tb.week_to_gps([2200] * 3, 10.0))


def test_text_for_people() -> None:
    assert tb.gps_to_iso(float(tb.unix_to_gps(1_700_000_000.25))) == "2023-11-14T22:13:20.250Z"
