"""Clocks that jump or run off against the receiver's are found, others are not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from automap.evaluation.plausibility import Finding
from automap.records import ClockModel, Fixes, FloatArray, ImuData
from automap.sync.steadiness import ClockChange, Piece, clock_change
from pipeline.check.steadiness import check
from tests.slow_cases import others_slow
from tests.unit.fusion_drive import BASE_NS, CLOCK, Sensor, record
from tests.unit.fusion_motion import city_drive
from tests.unit.fusion_receiver import GPS0, Receiver, receive

CAR, PHONE = (100.0, 5.0), (10.0, 1.0)
"""Readings and fixes a second."""
SECONDS, MIDDLE = 330.0, 165.0


@cache
def recorded(rates: tuple[float, float], seed: int) -> tuple[ImuData, Fixes]:
    motion = city_drive(SECONDS, seed)
    imu = record(motion, Sensor(), seed, rate=rates[0])
    return imu, receive(motion, Receiver(rate=rates[1]), seed)


def judged(
    rates: tuple[float, float],
    stamps: Callable[[FloatArray], FloatArray],
    clock: ClockModel | None = CLOCK,
    seed: int = 1,
) -> list[Finding]:
    imu, fixes = recorded(rates, seed)
    t = stamps((imu.t_ns - BASE_NS) * 1e-9)
    # readers leave out what goes back in time
    keep = np.concatenate([[True], t[1:] > np.maximum.accumulate(t)[:-1]])
    t_ns = BASE_NS + np.rint(t * 1e9).astype(np.int64)
    imu = replace(imu, t_ns=t_ns[keep], gyro=imu.gyro[keep], accel=imu.accel[keep])
    return check(imu, fixes, clock)


@pytest.mark.parametrize("rates", [PHONE, pytest.param(CAR, marks=pytest.mark.slow)])
@pytest.mark.parametrize("seed", others_slow([1, 2]))
def test_a_steady_clock_is_none(rates: tuple[float, float], seed: int) -> None:
    assert judged(rates, lambda t: t, seed=seed) == []
    assert judged(rates, lambda t: t + 0.2, seed=seed) == []
    # what a crystal may be off by
    assert judged(rates, lambda t: t * (1.0 + 300e-6), seed=seed) == []


@pytest.mark.parametrize(
    ("rates", "clock"),
    [(CAR, CLOCK), (PHONE, None)]
    + [pytest.param(*case, marks=pytest.mark.slow) for case in ((CAR, None), (PHONE, CLOCK))],
)
def test_a_clock_of_another_rate(rates: tuple[float, float], clock: ClockModel | None) -> None:
    (finding,) = judged(rates, lambda t: 1.01 * t, clock)
    assert (finding.severity, finding.code) == ("error", "imu_clock_rate")
    assert "% fast" in finding.text
    assert abs(float(finding.text.split("clock is ")[1].split(" %")[0]) - 1.0) < 0.15


def test_a_clock_that_runs_off_from_some_time_on() -> None:
    (finding,) = judged(CAR, lambda t: t - 0.02 * np.maximum(t - MIDDLE, 0.0))
    assert (finding.severity, finding.code) == ("error", "imu_clock_rate")
    assert "% slow" in finding.text
    first, last = finding.text.split("beginning ")[1].split(" s after")[0].split(" to ")
    assert float(first) < MIDDLE < float(last)


@pytest.mark.parametrize(
    ("rates", "size"),
    [(CAR, 1.0), (PHONE, -1.0)]
    + [pytest.param(*case, marks=pytest.mark.slow) for case in ((CAR, -1.0), (PHONE, 1.0))],
)
def test_a_clock_that_jumps(rates: tuple[float, float], size: float) -> None:
    (finding,) = judged(rates, lambda t: t + size * (t > MIDDLE))
    assert (finding.severity, finding.code) == ("error", "imu_clock_jump")
    told = float(finding.text.split("jump by ")[1].split(" s")[0])
    assert abs(told - size) < 0.2
    if size > 0.0:
        stamp = int(finding.text.split("after t_ns ")[1].split()[0])
        assert stamp == BASE_NS + round(MIDDLE * 1e9)
    else:
        first, last = finding.text.split("(")[-1].split(" s after")[0].split(" to ")
        assert float(first) < MIDDLE < float(last)


@pytest.mark.parametrize("clock", [CLOCK, None])
def test_what_no_reading_covers_is_no_other_motion(clock: ClockModel | None) -> None:
    """Readings that end while the way of the minutes before is driven once more."""
    imu, fixes = recorded(CAR, 1)
    lap, end = 40.0, 200.0
    told = fixes.gps_s - GPS0
    again = told > end
    source = np.searchsorted(told, np.where(again, told - lap * np.ceil((told - end) / lap), told))
    vel = fixes.vel_ned[np.minimum(source, len(told) - 1)]
    kept = (imu.t_ns - BASE_NS) * 1e-9 < end
    imu = replace(imu, t_ns=imu.t_ns[kept], gyro=imu.gyro[kept], accel=imu.accel[kept])
    assert check(imu, replace(fixes, vel_ned=vel), clock) == []


def _pieces(lags: list[float]) -> list[Piece]:
    return [Piece(30.0 * k, 30.0 * k + 30.0, lag, 0.04) for k, lag in enumerate(lags)]


def test_no_single_piece_decides() -> None:
    noise = np.random.default_rng(1).normal(0.0, 0.05, 20)
    for place in range(20):
        lags = noise.copy()
        lags[place] += 40.0
        assert clock_change(_pieces(lags.tolist())) is None
    lags = noise + (np.arange(20) > 10)
    change = clock_change(_pieces(lags.tolist()))
    assert change is not None
    assert change.kind == "jump"
    assert change.size == pytest.approx(1.0, abs=0.1)


def test_eight_pieces_tell_a_jump_and_one_mistaken_lag_of_them_does_not() -> None:
    # of a recorded car whose receiver learnt its leap second
    lags = np.array([-0.779, -0.983, -0.905, -0.036, 0.131, 0.095, 0.082, -0.009])
    sds = [0.129, 0.050, 0.062, 0.051, 0.031, 0.052, 0.057, 0.058]

    def told(values: FloatArray) -> ClockChange | None:
        pieces = zip(values.tolist(), sds, strict=True)
        return clock_change([Piece(30.0 * k, 30.0 * k + 30.0, *p) for k, p in enumerate(pieces)])

    change = told(lags)
    assert change is not None
    assert (change.kind, change.first_s, change.last_s) == ("jump", 60.0, 120.0)
    steady = lags + (np.arange(8) < 3)
    assert told(steady) is None
    for place in range(8):
        assert told(steady + 2.0 * (np.arange(8) == place)) is None


def test_two_mistaken_lags_that_say_something_else_are_no_jump() -> None:
    # of a made receiver that smooths over a second and a half
    lags = np.array([27.438, 50.930, -1.230, -1.179, -1.048, -1.004])
    assert clock_change(_pieces(lags.tolist())) is None
    agreeing = np.where(np.arange(6) < 2, 27.44, lags)
    change = clock_change(_pieces(agreeing.tolist()))
    assert change is not None
    assert change.size == pytest.approx(-28.5, abs=0.2)


def test_chance_is_no_change() -> None:
    rng = np.random.default_rng(2)
    for count in rng.integers(0, 25, 200).tolist():
        lags = rng.normal(0.0, 0.1, count) - 0.4
        assert clock_change(_pieces(lags.tolist())) is None


def test_too_few_pieces_say_nothing() -> None:
    assert clock_change(_pieces([0.0, 0.0, 5.0])) is None
