"""Host times from a device's clock that is seen through late and jittery deliveries."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.record.clock import DeviceClock, HostClock


def deliver(
    seconds: float, skew: float, rng: np.random.Generator, rate_hz: float = 100.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """True host times, device times and arrivals [n], ns: 1 ms delay, exponential jitter of
    1 ms, now and then 80 ms."""
    true = 5_000_000_000 + np.arange(int(seconds * rate_hz)) * round(1e9 / rate_hz)
    device = np.rint((true - true[0]) / (1.0 + skew)).astype(np.int64) + 777
    delay = 1e6 + rng.exponential(1e6, len(true)) + 8e7 * (rng.random(len(true)) < 0.005)
    arrival = np.maximum.accumulate(true + np.rint(delay).astype(np.int64))
    return true, device, arrival


def run(clock: DeviceClock, device: np.ndarray, arrival: np.ndarray, batch: int = 10) -> np.ndarray:
    stamps: list[int] = []
    for at in range(0, len(device), batch):
        part = slice(at, at + batch)
        stamps += clock.stamps(device[part].tolist(), arrival[part].tolist())
    return np.array(stamps)


@pytest.mark.parametrize("skew", [0.0, 5e-5, -2e-4, 0.01, -0.01])
def test_jitter_and_skew_are_taken_out(skew: float) -> None:
    true, device, arrival = deliver(120.0, skew, np.random.default_rng(7))
    clock = DeviceClock()
    stamps = run(clock, device, arrival)
    # what remains is the shortest delivery, which nobody can see
    error = stamps - true - 1_000_000
    settled = error[1000:]
    assert np.std(settled) < 100_000 < np.std(arrival - true) / 5
    assert np.max(np.abs(settled)) < 1_000_000
    assert clock.skew == pytest.approx(skew, abs=2e-5)
    assert np.all(np.diff(stamps) > 0)
    assert np.all(stamps <= arrival)


def test_a_device_that_starts_anew_is_followed() -> None:
    true, device, arrival = deliver(60.0, 1e-4, np.random.default_rng(8))
    device[3000:] -= device[3000]
    clock = DeviceClock()
    stamps = run(clock, device, arrival)
    assert clock.resets == 1
    assert np.max(np.abs(stamps - true)[3100:]) < 4_000_000
    assert np.all(np.diff(stamps) > 0)


def test_one_wrong_stamp_spoils_nothing() -> None:
    true, device, arrival = deliver(60.0, 0.0, np.random.default_rng(9))
    device[2000] += 3_600_000_000_000
    device[2500] -= 9_000_000_000
    clock = DeviceClock()
    stamps = run(clock, device, arrival)
    assert clock.resets == 0
    others = np.delete(np.arange(len(true)), [2000, 2500])[1000:]
    assert np.max(np.abs(stamps - true - 1_000_000)[others]) < 1_500_000


def test_lines_that_came_twice_or_late_keep_their_place() -> None:
    _, device, arrival = deliver(30.0, 0.0, np.random.default_rng(12))
    device[2000], device[2001] = device[2001], device[2000]
    device[2500] = device[2499]
    stamps = run(DeviceClock(), device, arrival)
    assert stamps[2001] < stamps[2000] < stamps[2002]
    assert stamps[2000] - stamps[2001] == pytest.approx(10_000_000, abs=1_000_000)
    assert stamps[2500] == stamps[2499]
    others = np.delete(stamps, [2000, 2001, 2500])
    assert np.all(np.diff(others) > 0)


def test_an_interruption_does_not_reset_the_clock() -> None:
    true, device, arrival = deliver(90.0, 1e-4, np.random.default_rng(10))
    kept = np.r_[0:3000, 5000:9000]
    clock = DeviceClock()
    stamps = run(clock, device[kept], arrival[kept])
    assert clock.resets == 0
    assert np.max(np.abs(stamps - true[kept])[1000:]) < 3_000_000


def test_a_host_that_was_held_up_keeps_the_devices_regularity() -> None:
    """Everything of 1.5 s arrives at once: the stamps go on evenly."""
    true, device, arrival = deliver(40.0, 0.0, np.random.default_rng(11))
    arrival[2000:2150] = true[2150]
    stamps = run(DeviceClock(), device, np.maximum.accumulate(arrival))
    assert np.max(np.abs(stamps - true - 1_000_000)[1000:]) < 1_500_000


def test_a_scaled_clock_runs_faster_from_its_start() -> None:
    clock = HostClock(5.0)
    now = clock.at(0)
    assert clock.at(1000) - now == 5000
    assert HostClock().at(123) == 123
