"""Filters that a receiver's fixes came through are found and taken back, and delays are none."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from automap.fusion.doubts.receiver import receiver_doubts
from automap.io.clock_json import read_clocks, write_clocks
from automap.records import DriveClocks, Fixes, FloatArray, ImuData, ReceiverFilter
from automap.sync.receiver_filter import receiver_filter, taken_back
from automap.sync.velocity_consistency import velocity_consistency
from tests.unit.fusion_drive import CLOCK, Sensor, record
from tests.unit.fusion_motion import city_drive
from tests.unit.fusion_receiver import Receiver, receive


@cache
def recorded() -> tuple[ImuData, Fixes]:
    motion = city_drive(330.0, 4)
    return record(motion, Sensor(), 4, rate=20.0), receive(motion, Receiver(rate=2.0), 4)


def filtered(gps_s: FloatArray, values: FloatArray, time_s: float) -> FloatArray:
    """Values [n, k] behind a first-order low-pass, one after the other."""
    out = values.copy()
    for k in range(1, len(out)):
        keeps = np.exp(-(gps_s[k] - gps_s[k - 1]) / time_s)
        out[k] = keeps * out[k - 1] + (1.0 - keeps) * values[k]
    return out


def smoothed(fixes: Fixes, velocity_s: float = 0.0, position_s: float = 0.0) -> Fixes:
    if velocity_s:
        fixes = replace(fixes, vel_ned=filtered(fixes.gps_s, fixes.vel_ned, velocity_s))
    if position_s:
        place = np.column_stack([fixes.lat_rad, fixes.lon_rad, fixes.height_m])
        lat, lon, height = filtered(fixes.gps_s, place, position_s).T
        fixes = replace(fixes, lat_rad=lat, lon_rad=lon, height_m=height)
    return fixes


@settings(max_examples=25)
@given(st.floats(0.05, 4.0), st.integers(0, 10_000))
def test_what_is_taken_back_is_what_was_measured(time_s: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    _, fixes = recorded()
    used = np.sort(rng.choice(len(fixes), 40, replace=False))
    few = Fixes(**{name: value[used] for name, value in vars(fixes).items()})
    behind = smoothed(few, time_s, 2.0 * time_s)
    back = taken_back(behind, ReceiverFilter(time_s, 2.0 * time_s))
    assert np.isnan(back.vel_ned[0]).all()
    # a step of the log as short as this part of the filter's time
    worse = 1.0 / -np.expm1(-np.diff(few.gps_s).min() / (2.0 * time_s))
    assert np.allclose(back.vel_ned[1:], few.vel_ned[1:], atol=1e-12 * worse * 100.0)
    assert np.allclose(back.lat_rad[1:], few.lat_rad[1:], rtol=1e-14 * worse, atol=0.0)


def test_a_filter_over_the_date_line() -> None:
    _, fixes = recorded()
    over = replace(fixes, lon_rad=fixes.lon_rad - float(np.median(fixes.lon_rad)) + np.pi)
    behind = smoothed(over, 0.0, 1.0)
    wrapped = replace(behind, lon_rad=(behind.lon_rad + np.pi) % (2.0 * np.pi) - np.pi)
    assert np.ptp(wrapped.lon_rad) > 6.0
    back = taken_back(wrapped, ReceiverFilter(0.0, 1.0))
    off = np.exp(1j * (back.lon_rad - over.lon_rad))[1:]
    assert np.abs(np.angle(off)).max() < 1e-12


def test_heights_are_dated_and_no_noisier() -> None:
    _, fixes = recorded()
    climbing = replace(fixes, height_m=100.0 + 0.5 * fixes.gps_s - 0.5 * fixes.gps_s[0])
    back = taken_back(smoothed(climbing, 0.0, 1.0), ReceiverFilter(0.0, 1.0))
    # the filter begins at rest, and the log ends
    assert np.nanmax(np.abs(back.height_m - climbing.height_m)[20:-3]) < 0.02
    apart = np.diff(fixes.gps_s[np.isfinite(back.height_m)])
    assert apart.min() > 1.4
    assert np.median(apart) == pytest.approx(2.0)


@pytest.mark.parametrize("time_s", [0.5, 1.5])
def test_a_filter_is_found_with_its_time(time_s: float) -> None:
    imu, fixes = recorded()
    found = receiver_filter(imu, smoothed(fixes, time_s, time_s), CLOCK)
    assert found is not None
    assert found.velocity_s == pytest.approx(time_s, rel=0.15)
    assert found.position_s == pytest.approx(time_s, rel=0.15)


def test_velocities_that_are_later_than_positions_are_filtered_alone() -> None:
    imu, fixes = recorded()
    found = receiver_filter(imu, smoothed(fixes, 1.0), CLOCK, late_s=1.0)
    assert found is not None
    assert found.velocity_s == pytest.approx(1.0, rel=0.15)
    assert found.position_s == 0.0


@pytest.mark.parametrize("late_s", [0.0, 0.7, 1.5])
def test_a_delay_is_no_filter(late_s: float) -> None:
    imu, fixes = recorded()
    late = replace(fixes, gps_s=fixes.gps_s + late_s)
    assert receiver_filter(imu, late, CLOCK) is None


def test_it_is_told_and_kept(tmp_path: Path) -> None:
    behind = ReceiverFilter(1.5, 0.0)
    _, fixes = recorded()
    told = replace(velocity_consistency(fixes), behind=replace(behind, position_s=0.7))
    (reason,) = receiver_doubts(told, 0.0)
    assert (reason.code, reason.state) == ("fixes_smoothed", "good")
    assert "its velocities over 1.5 s and its positions over 0.7 s, as" in reason.text
    path = tmp_path / "sync.json"
    clocks = DriveClocks(CLOCK, "boot_ns", receiver_filter=behind, shown_offset_s=0.8)
    write_clocks(path, clocks, {})
    assert read_clocks(path) == clocks
