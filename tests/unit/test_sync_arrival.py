"""The clock from arrival times: accuracy, honesty of its sd, and everything that can break it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from automap.errors import InputError
from automap.records import NO_TIME, Fixes, FixType, FloatArray, ImuData, IntArray
from automap.sync import limits
from automap.sync.arrival import ClockFit, fit_arrival_clock
from automap.sync.clock import synchronise
from automap.sync.steps import find_step

GPS0 = 1_400_000_000.0
HOST0 = 900_000_000_000
LEAST = 0.07


def log(
    n: int, dt: float, waiting: FloatArray, drift: float = 0.0
) -> tuple[IntArray, FloatArray, Callable[[IntArray], FloatArray]]:
    """Arrivals, epochs and the true clock; ``drift`` is GPS seconds per host second less 1."""
    epochs = GPS0 + np.arange(n) * dt
    host = (np.arange(n) * dt + LEAST + waiting) / (1.0 + drift)

    def true(t_ns: IntArray) -> FloatArray:
        return GPS0 + (1.0 + drift) * (t_ns - HOST0) * 1e-9

    return HOST0 + np.rint(host * 1e9).astype(np.int64), epochs, true


def errors(fit: ClockFit, true: Callable[[IntArray], FloatArray]) -> float:
    ref = np.array([fit.clock.ref_ns])
    return float(fit.clock.gps_s(ref)[0] - true(ref)[0])


SHAPES: dict[str, Callable[[np.random.Generator, int], FloatArray]] = {
    "exponential": lambda rng, n: rng.exponential(0.01, n),
    "uniform": lambda rng, n: rng.uniform(0.0, 0.016, n),
    "half normal": lambda rng, n: np.abs(rng.normal(0.0, 0.01, n)),
    "soft edge": lambda rng, n: rng.gamma(2.0, 0.005, n),
    "bursts": lambda rng, n: (
        rng.exponential(0.01, n) + np.where(rng.random(n) < 0.15, rng.uniform(0.05, 0.6, n), 0.0)
    ),
    "some too early": lambda rng, n: (
        rng.exponential(0.01, n) - np.where(rng.random(n) < 0.02, rng.uniform(0.02, 0.4, n), 0.0)
    ),
}


@pytest.mark.parametrize("shape", SHAPES)
def test_offset_and_drift_lie_within_their_sd(shape: str) -> None:
    rng = np.random.default_rng(11)
    ratios, slopes, worst = [], [], 0.0
    for n, dt in ((170, 0.2), (600, 1.0), (170, 0.2), (600, 1.0)):
        drift = float(rng.normal(0.0, 40e-6))
        arrival, epochs, true = log(n, dt, SHAPES[shape](rng, n), drift)
        fit = fit_arrival_clock(arrival, epochs, LEAST)
        error = errors(fit, true)
        ratios.append(error / fit.clock.sd_offset_s)
        slopes.append((fit.clock.drift - drift) / fit.clock.sd_drift)
        worst = max(worst, abs(error))
    assert worst < 2e-3
    assert np.sqrt(np.mean(np.square(ratios))) < 2.0
    assert np.sqrt(np.mean(np.square(slopes))) < 2.5


def test_sd_is_not_claimed_far_too_large() -> None:
    arrival, epochs, _ = log(600, 1.0, np.random.default_rng(1).exponential(0.01, 600))
    fit = fit_arrival_clock(arrival, epochs, LEAST)
    assert fit.clock.sd_offset_s < 1e-3
    assert fit.clock.sd_drift < 3e-6


@pytest.mark.slow
def test_the_sd_has_a_part_that_no_number_of_epochs_takes_away() -> None:
    """Lognormal waiting has next to no edge: what arrived first is late by more than its sd, and
    the more so the longer the waiting."""
    outside = 0
    for seed in range(40):
        rng = np.random.default_rng(seed)
        waiting = 0.1 * np.exp(0.6 * rng.normal(size=4000))
        arrival, epochs, true = log(4000, 0.2, waiting)
        fit = fit_arrival_clock(arrival, epochs, LEAST)
        # the median is 100 ms, less what the earliest of all waited
        assert fit.clock.sd_offset_s > limits.UNSEEN * fit.waiting_s > 0.02 * 0.1
        outside += abs(errors(fit, true)) > 4.0 * fit.clock.sd_offset_s
    few = fit_arrival_clock(arrival[:200], epochs[:200], LEAST).clock.sd_offset_s
    many = fit.clock.sd_offset_s
    assert few < 3.0 * many
    assert outside <= 20


@pytest.mark.parametrize("with_imu", [True, False])
def test_what_the_clock_warns_of_reaches_the_drive(with_imu: bool) -> None:
    rng = np.random.default_rng(8)
    waiting = rng.exponential(0.01, 600)
    waiting[:50] -= 0.4
    arrival, epochs, _ = log(600, 0.2, waiting)
    n = len(epochs)
    none = np.full((n, 3), np.nan)
    fixes = Fixes(
        gps_s=epochs,
        arrival_ns=arrival,
        lat_rad=np.full(n, 0.5),
        lon_rad=np.full(n, 0.1),
        height_m=np.zeros(n),
        vel_ned=none,
        sd_pos_ned=none,
        sd_vel_ned=none,
        fix_type=np.full(n, FixType.THREE_D, np.int64),
        n_sats=np.full(n, 9),
        hdop=np.ones(n),
        geoid_sep_m=np.zeros(n),
        offset=np.arange(n),
    )
    t_ns = HOST0 + np.arange(1200) * 100_000_000
    still = np.tile([0.0, 0.0, -9.81], (1200, 1))
    imu = ImuData(t_ns, np.zeros((1200, 3)), still, None) if with_imu else None
    result = synchronise(imu, fixes, output_delay_s=LEAST)
    assert result.clock.method == "arrival"
    assert any("jump" in text for text in result.warnings)


def test_a_lasting_burst_does_not_move_the_clock() -> None:
    rng = np.random.default_rng(5)
    waiting = rng.exponential(0.01, 600)
    waiting[200:280] += 0.3
    waiting[400:450] += 1.5
    arrival, epochs, true = log(600, 0.2, waiting, 20e-6)
    fit = fit_arrival_clock(arrival, epochs, LEAST)
    assert abs(errors(fit, true)) < 1e-3


def test_gross_errors_of_tags_do_not_move_the_clock() -> None:
    rng = np.random.default_rng(6)
    waiting = rng.exponential(0.01, 400)
    waiting[[3, 50, 51, 300]] -= 18.0
    waiting[[7, 90]] += 3600.0
    arrival, epochs, true = log(400, 0.2, waiting)
    fit = fit_arrival_clock(arrival, epochs, LEAST)
    assert abs(errors(fit, true)) < 1e-3
    assert fit.early == 4
    assert any("wrong tags" in text for text in fit.warnings)


def test_a_clock_set_during_the_drive_is_an_error_that_says_how_far() -> None:
    rng = np.random.default_rng(7)
    waiting = rng.exponential(0.01, 600)
    waiting[350:] -= 1.25
    arrival, epochs, _ = log(600, 0.2, waiting)
    with pytest.raises(InputError, match=r"-1\.2[45]\d s .*2024-05"):
        fit_arrival_clock(arrival, epochs, LEAST)


def test_a_short_step_is_left_out_with_a_warning() -> None:
    rng = np.random.default_rng(8)
    waiting = rng.exponential(0.01, 600)
    waiting[:50] -= 0.4
    arrival, epochs, true = log(600, 0.2, waiting)
    fit = fit_arrival_clock(arrival, epochs, LEAST)
    assert abs(errors(fit, true)) < 1e-3
    assert not fit.used[:50].any()
    assert any("jump" in text for text in fit.warnings)


@pytest.mark.parametrize("drift", [-80e-6, 0.0, 80e-6])
def test_drift_and_bursts_are_no_step(drift: float) -> None:
    rng = np.random.default_rng(9)
    waiting = rng.exponential(0.01, 1500) + np.where(rng.random(1500) < 0.1, 0.3, 0.0)
    arrival, epochs, _ = log(1500, 1.0, waiting, drift)
    x = (arrival - arrival[0]) * 1e-9
    assert find_step(x, x - (epochs - epochs[0])) is None


def test_an_impossible_rate_is_an_error() -> None:
    arrival, epochs, _ = log(600, 0.2, np.random.default_rng(2).exponential(0.01, 600), 5e-3)
    with pytest.raises(InputError, match="ppm"):
        fit_arrival_clock(arrival, epochs)


def test_a_clock_that_bends_is_reported_and_its_sd_grows() -> None:
    rng = np.random.default_rng(3)
    bend = 0.06 * np.linspace(-1.0, 1.0, 3000) ** 2
    arrival, epochs, _ = log(3000, 1.0, rng.exponential(0.005, 3000) + bend)
    fit = fit_arrival_clock(arrival, epochs)
    assert fit.wander_s > 0.01
    assert fit.clock.sd_offset_s > 0.005
    assert any("straight line" in text for text in fit.warnings)


def test_no_arrival_time_at_all() -> None:
    with pytest.raises(InputError, match="arrival"):
        fit_arrival_clock(np.full(5, NO_TIME), GPS0 + np.arange(5.0))


def test_unknown_arrivals_and_epochs_are_passed_over() -> None:
    arrival, epochs, true = log(300, 0.2, np.random.default_rng(4).exponential(0.01, 300))
    arrival[:20] = NO_TIME
    epochs[30:40] = np.nan
    fit = fit_arrival_clock(arrival, epochs, LEAST)
    assert abs(errors(fit, true)) < 1e-3
    assert np.isnan(fit.delay_s[:20]).all()
    assert not fit.used[30:40].any()


@pytest.mark.parametrize("n", [1, 2, 3])
def test_a_handful_of_epochs_gives_a_clock_and_a_warning(n: int) -> None:
    arrival, epochs, true = log(n, 1.0, np.full(n, 0.004))
    fit = fit_arrival_clock(arrival, epochs, LEAST)
    assert abs(errors(fit, true)) < 0.01
    assert fit.clock.sd_offset_s >= 0.01
    assert fit.warnings


def test_without_output_delay_the_least_is_zero_and_stays_unknown() -> None:
    arrival, epochs, true = log(300, 0.2, np.random.default_rng(4).exponential(0.01, 300))
    fit = fit_arrival_clock(arrival, epochs, None)
    assert fit.clock.output_delay_s is None
    assert errors(fit, true) == pytest.approx(-LEAST, abs=1e-3)
    assert np.nanmedian(fit.delay_s) == pytest.approx(0.007, abs=2e-3)


def test_stamps_in_whole_milliseconds_and_no_jitter() -> None:
    arrival, epochs, true = log(300, 0.2, np.zeros(300))
    fit = fit_arrival_clock(arrival // 1_000_000 * 1_000_000, epochs, LEAST)
    assert abs(errors(fit, true)) < 2e-3
    assert 1e-5 < fit.clock.sd_offset_s < 5e-3


def test_order_of_the_epochs_does_not_matter() -> None:
    rng = np.random.default_rng(4)
    arrival, epochs, _ = log(300, 0.2, rng.exponential(0.01, 300))
    order = rng.permutation(300)
    first = fit_arrival_clock(arrival, epochs).clock
    second = fit_arrival_clock(arrival[order], epochs[order]).clock
    probe = arrival[[0, -1]]
    np.testing.assert_allclose(first.gps_s(probe), second.gps_s(probe), atol=2e-5)


@settings(max_examples=25)
@given(
    n=st.integers(1, 60),
    dt=st.sampled_from([0.05, 0.2, 1.0, 10.0]),
    jitter=st.floats(0.0, 2.0),
    seed=st.integers(0, 10_000),
)
def test_whatever_the_jitter_the_clock_is_finite_or_the_error_is_ours(
    n: int, dt: float, jitter: float, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    arrival, epochs, _ = log(n, dt, rng.exponential(jitter + 1e-12, n))
    try:
        fit = fit_arrival_clock(arrival, epochs)
    except InputError:
        return
    clock = fit.clock
    assert np.isfinite([clock.ref_gps_s, clock.drift, clock.sd_offset_s, clock.sd_drift]).all()
    assert clock.sd_offset_s > 0.0
    assert clock.sd_drift > 0.0
