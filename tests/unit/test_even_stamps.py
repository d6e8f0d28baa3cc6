"""Stamps of a computer that reads several samples at once, and what is made of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from automap.calibration.allan_triads import resting_fits
from automap.io.even_stamps import bursts_text, straight_stamps
from automap.io.imu_csv import read_imu_csv
from automap.io.imu_log import LogFormat, read_imu_log

BEGIN_NS = 1_700_000_000_000_000_000


def noise(n: int, seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).standard_normal((n, 6))


def read_at_once(
    true: np.ndarray, period: float, stalls: float = 0.01, tick: float = 0.0
) -> np.ndarray:
    """Stamps [n] ns of samples taken at ``true`` [n] s by a program that wakes every ``period`` s,
    now and then ten times later, and reads what is there; written in steps of ``tick`` s."""
    rng = np.random.default_rng(3)
    n = int(true[-1] / period) + 200
    wakes = np.cumsum(np.where(rng.random(n) < stalls, 10.0, 1.0) * period)
    wakes = np.sort(wakes + rng.exponential(2e-4, n))
    at = np.searchsorted(wakes, true)
    fresh = np.concatenate([[True], np.diff(at) > 0])
    rows = np.arange(len(true))
    stamps = wakes[at] + 2e-5 * (rows - np.maximum.accumulate(np.where(fresh, rows, 0)))
    stamps = np.maximum.accumulate(stamps)
    if tick:
        stamps = np.floor(stamps / tick) * tick
    return BEGIN_NS + np.rint(stamps * 1e9).astype(np.int64)


def off(even: np.ndarray, true: np.ndarray) -> np.ndarray:
    """Delays [n] of straightened stamps in s."""
    return np.asarray((even - BEGIN_NS) * 1e-9 - true)


@pytest.mark.parametrize("tick", [0.0, 1e-3])
@pytest.mark.parametrize(("rate", "period"), [(100.0, 0.016), (200.0, 0.016), (100.0, 0.1)])
def test_bursts_are_put_on_the_sensors_own_clock(rate: float, period: float, tick: float) -> None:
    true = np.arange(20_000) / rate * (1.0 + 3e-5)
    stamps = read_at_once(true, period, tick=tick)
    assert off(stamps, true).std() > 0.3 * period
    even = straight_stamps(stamps, noise(len(true)))
    assert even is not None
    late = off(even, true)
    # what the reader's rhythm and the sensor's have in common cannot be told
    assert np.ptp(late) < 1.0 / rate + tick
    assert late.min() > -tick - 1e-4
    assert np.diff(even * 1e-9).std() < 0.02 / rate


def test_lost_samples_do_not_move_those_that_follow() -> None:
    true = np.arange(40_000) / 100.0
    keep = np.ones(len(true), bool)
    for begin in np.random.default_rng(5).integers(0, 39_000, 12):
        keep[begin : begin + 70] = False
    true = true[keep]
    even = straight_stamps(read_at_once(true, 0.016), noise(len(true)))
    assert even is not None
    late = off(even, true) - np.median(off(even, true))
    assert np.percentile(np.abs(late), 99.0) < 0.003
    # a loss shows at the next reading, which may be late
    assert np.abs(late).max() < 0.2


@pytest.mark.parametrize("jitter", [0.0, 2e-5, 1e-3])
def test_even_stamps_are_left_alone(jitter: float) -> None:
    true = np.arange(5_000) / 100.0
    true[2_000:] += 30.0
    stamps = true + jitter * np.random.default_rng(2).standard_normal(len(true))
    t_ns = BEGIN_NS + np.rint(np.sort(stamps) * 1e9).astype(np.int64)
    assert straight_stamps(t_ns, noise(len(t_ns))) is None


def test_copies_of_rows_and_a_clock_that_was_set_back_are_no_bursts() -> None:
    t_ns = np.repeat(np.arange(3_000) * 10_000_000, 2)
    values = np.repeat(noise(3_000), 2, axis=0)
    assert straight_stamps(t_ns, values) is None
    assert straight_stamps(t_ns, noise(6_000)) is not None
    back = read_at_once(np.arange(4_000) / 100.0, 0.016)
    back[2_000:] -= 500_000_000
    assert straight_stamps(back, noise(4_000)) is None


@given(
    st.lists(st.integers(0, 10**9), min_size=0, max_size=400),
    st.integers(-(2**60), 2**60),
)
@settings(max_examples=60)
def test_any_stamps_come_out_increasing_or_not_at_all(steps: list[int], begin: int) -> None:
    t_ns = begin + np.cumsum(np.array([0, *steps], dtype=np.int64))
    even = straight_stamps(t_ns, noise(len(t_ns)))
    if even is not None:
        assert even.shape == t_ns.shape
        assert (np.diff(even) > 0).all()


def write_rest(path: Path, seconds: float) -> tuple[Path, float, float]:
    """A sensor at rest, read every 40 ms and stamped in ms; its noise densities."""
    rng = np.random.default_rng(7)
    true = np.arange(int(seconds * 100.0)) / 100.0
    t_ns = read_at_once(true, 0.04, tick=1e-3)
    gyro = 0.002 * rng.standard_normal((len(true), 3))
    accel = 0.02 * rng.standard_normal((len(true), 3)) + [0.0, 0.0, 9.81]
    rows = np.column_stack([gyro, accel])
    lines = [
        f"{t}," + ",".join(f"{v:.6f}" for v in row)
        for t, row in zip(t_ns.tolist(), rows.tolist(), strict=True)
    ]
    path.write_text("t_ns,gx,gy,gz,ax,ay,az\n" + "\n".join(lines) + "\n")
    return path, 0.002 / 10.0, 0.02 / 10.0


def test_a_drive_keeps_all_samples_of_a_burst(tmp_path: Path) -> None:
    path, _, _ = write_rest(tmp_path / "imu.csv", 60.0)
    recording = read_imu_csv(path)
    assert len(recording.data) == 6_000
    assert recording.quality.rate_hz == pytest.approx(100.0, rel=1e-3)
    assert recording.quality.repeats == 0
    assert recording.quality.gaps == ()
    (told,) = recording.warnings
    assert "stamps come in bursts" in told
    assert "100 Hz" in told


@pytest.mark.slow
def test_the_allan_deviation_of_a_log_with_bursts_is_that_of_the_sensor(tmp_path: Path) -> None:
    path, gyro, accel = write_rest(tmp_path / "rest.csv", 660.0)
    log = read_imu_log(path, LogFormat())
    assert any("stamps come in bursts" in text for text in log.warnings)
    found = resting_fits(log.data)
    assert found.seconds > 650.0
    assert found.fits["gyro_x"].white.value == pytest.approx(gyro, rel=0.05)
    assert found.fits["accel_z"].white.value == pytest.approx(accel, rel=0.05)


@pytest.mark.parametrize("cut_s", [1.0, 0.1])
def test_stamps_that_were_cut_off_lie_between_the_earliest_and_the_latest_line(
    cut_s: float,
) -> None:
    """Whole seconds of 50 Hz are up to a second early, which the samples of each second tell."""
    true = 1_700_000_000.37 + 0.02 * np.arange(3_000)
    stamps = np.rint(np.floor(true / cut_s + 1e-9) * cut_s * 1e9).astype(np.int64)
    even = straight_stamps(stamps, noise(len(true)))
    assert even is not None
    assert np.abs(even * 1e-9 - true).max() < 0.02
    assert f"written to {cut_s:g} s" in bursts_text(50.0, stamps)
