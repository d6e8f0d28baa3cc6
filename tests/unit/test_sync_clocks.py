"""Clocks by stamps, lags and motions against lines fitted otherwise and against what they say."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter

from automap.errors import InputError
from automap.records import NO_TIME, ClockModel, ImuData
from automap.sync import limits, motion_clock
from automap.sync.arrival import _few_points
from automap.sync.clock import (
    _refuse,
    _without_imu,
    contradiction,
    gps_clock,
    rough_clock,
    unix_clock,
    unknown_clock,
)
from automap.sync.coarse import CoarseOffset
from automap.sync.correlation import Lag
from automap.sync.finished import trajectory_clock
from automap.sync.motion import GnssMotion
from automap.sync.steps import find_step
from automap.timebase import leap_seconds_at_gps
from tests.unit.fusion_drive import BASE_NS
from tests.unit.fusion_receiver import GPS0, receive
from tests.unit.fusion_receiver import Receiver as Filter
from tests.unit.receiver_scene import Receiver, simulated_fixes
from tests.unit.test_fusion_velocity_step import drive


@pytest.mark.parametrize("rate", [0.0, 30e-6, -80e-6])
def test_the_clock_of_a_trajectory_is_the_line_through_its_rows(rate: float) -> None:
    rng = np.random.default_rng(2)
    seconds = np.sort(rng.uniform(0.0, 400.0, 80))
    t_ns = np.int64(7 * 10**9) + np.rint(seconds * 1e9).astype(np.int64)
    # so far apart that none of the rows is lost to a double's last digit
    gps_s = 5000.0 + seconds * (1.0 + rate) + rng.normal(0.0, 2e-3, 80)
    clock = trajectory_clock(t_ns, gps_s)
    line, cov = np.polyfit(seconds, gps_s - seconds, 1, cov="unscaled")
    wanted = np.polyval(line, seconds) + seconds
    assert clock.gps_s(t_ns) == pytest.approx(wanted, abs=1e-6)
    residual = np.sqrt(np.mean((gps_s - wanted) ** 2))
    assert clock.sd_drift == pytest.approx(residual * np.sqrt(cov[0, 0]), rel=1e-6)
    level = np.sqrt(residual**2 / 80 + limits.LEAST_SD_S**2)
    assert clock.sd_offset_s == pytest.approx(level, rel=1e-6)
    for wrong in (1.0 + 2.0 * limits.MAX_RATE, 1.0 - 2.0 * limits.MAX_RATE):
        with pytest.raises(InputError, match="run apart"):
            trajectory_clock(t_ns, 5000.0 + seconds * wrong)
    with pytest.raises(InputError, match="scatter"):
        trajectory_clock(t_ns, gps_s + 3.0 * limits.MOST_SCATTER_S * rng.standard_normal(80))


@pytest.mark.parametrize("at", [70.5, 100.25, 151.5])
@pytest.mark.parametrize("size", [-0.4, 0.15])
def test_a_step_is_where_the_delays_change_and_as_large(at: float, size: float) -> None:
    rng = np.random.default_rng(3)
    x = rng.permutation(np.arange(200.0))
    y = 0.3 + 2e-4 * x + size * (x > at) + rng.uniform(0.0, 2e-3, 200)
    found = find_step(x, y)
    assert found is not None
    # between the two delays beside it
    assert abs(found.x - (np.floor(at) + 0.5)) < 0.51
    assert found.size == pytest.approx(size, abs=0.01)
    assert find_step(x, y - size * (x > at)) is None


def test_few_arrivals_are_as_good_as_the_earliest() -> None:
    x, y = np.array([3.0, 10.0, 17.0]), np.array([0.5, 0.2, 0.26])
    edge = _few_points(x, y, 3e-5)
    assert edge.at(np.array([3.0, 10.0, 30.0])) == pytest.approx([0.2] * 3)
    assert edge.points == 3
    # of n ordinary waits the least is a nth of one, or a nth of what is seen
    assert edge.covariance == pytest.approx(np.diag([0.1**2, 3e-5**2]))
    assert _few_points(x, 0.1 * y, 3e-5).width == pytest.approx(limits.FEW_SD_S / 3.0)
    assert edge.x_ref == 10.0


def test_a_clocks_rate_is_the_weighted_line_through_the_lags_of_its_parts(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Parts of unlike sigmas; one of few intervals, one without a lag, one that is not sure."""
    start = np.concatenate(
        [np.arange(0.0, 500.0), np.arange(560.0, 570.0), np.arange(620.0, 900.0)]
    )
    gnss = GnssMotion(start, start + 1.0, *np.zeros((3, len(start))))
    motion = SimpleNamespace(t_s=np.array([0.0, 905.0]))
    told: list[tuple[float, float, float]] = []

    def lag_of(_: object, part: GnssMotion, near: float, reach: float) -> Lag | None:
        assert (near, reach) == (5.0, 0.6)
        assert len(part.start) >= limits.LEAST_INTERVALS
        middle = float(part.start.mean())
        if len(told) == 3:
            told.append((middle, np.nan, np.nan))
            return None
        k = len(told)
        piece = Lag(5.0 + 1e-4 * middle + 0.01 * (-1) ** k, 0.01 * (1 + k % 3), 50.0, 60)
        told.append((middle, piece.lag_s, piece.sd_s))
        if k == 5:
            piece = replace(piece, lag_s=9.0, gain_nats=0.5 * limits.SEGMENT_NATS)
            told[-1] = (middle, np.nan, np.nan)
        return piece

    monkeypatch.setattr(motion_clock, "refine_lag", lag_of)
    lag = Lag(5.0, 0.02, 100.0, 800)
    drift_sd = 2e-4
    offset, rate, sd, sd_rate, middle = motion_clock._lag_line(motion, gnss, lag, drift_sd)  # type: ignore[arg-type]
    # IMU seconds are GPS seconds plus the lag: both have data from 0 to 899
    assert middle == pytest.approx(449.5)
    count = min(int(899.0 / limits.SEGMENT_S), limits.MOST_SEGMENTS)
    edges = np.linspace(0.0, 899.0, count + 1)
    centre = 0.5 * (edges[1:] + edges[:-1])
    rows = [
        (float(centre[np.searchsorted(edges, m) - 1]) - 449.5, y, s)
        for m, y, s in told if np.isfinite(y)
    ]  # fmt: skip
    assert len(rows) >= 6
    x, y, s = np.array(rows).T
    design = np.vstack([np.column_stack([np.ones(len(x)), x]) / s[:, None], [0.0, 1.0 / drift_sd]])
    wanted, *_ = np.linalg.lstsq(design, np.append(y / s, 0.0))
    cov = np.linalg.inv(design.T @ design)
    assert (offset, rate) == pytest.approx(tuple(wanted))
    assert (sd, sd_rate) == pytest.approx(tuple(np.sqrt(np.diag(cov))))
    # a drive of two parts has one lag
    short = GnssMotion(start[:150], start[:150] + 1.0, *np.zeros((3, 150)))
    alone = motion_clock._lag_line(motion, short, lag, drift_sd)  # type: ignore[arg-type]
    assert alone == pytest.approx((5.0, 0.0, 0.02, drift_sd, 74.5))


def test_clocks_that_contradict_the_motions_are_refused_or_doubted() -> None:
    clock = gps_clock(np.array([14 * 10**17]))
    sure, some = 1.1 * limits.WRONG_CLOCK_NATS, 1.1 * limits.DOUBTED_CLOCK_NATS
    leap = float(leap_seconds_at_gps(1.4e9))
    for offset, text in ((leap + 0.2, "leap seconds"), (-leap, "leap seconds"),
                         (5.1, "whole seconds"), (7.4, r"\+7.4 s against"),
                         (1.4, r"\+1.4 s against"), (-2.6, "-2.6 s against")):  # fmt: skip
        with pytest.raises(InputError, match=text):
            _refuse(clock, CoarseOffset(offset, sure, 0.0), None, [])
    # a computer's clock that was set wrongly is no reason to drive again
    with pytest.raises(
        InputError, match=r'time = "boot_ns" there takes the clock from the motions'
    ):
        _refuse(unix_clock(np.array([14 * 10**17])), CoarseOffset(1.4, sure, 0.0), None, [])
    told: list[str] = []
    # a receiver that smooths is late by so much
    _refuse(clock, CoarseOffset(-1.4, sure, 0.0), None, told)
    assert "the receiver smooths" in told.pop()
    # as much better as its score is above that of no offset
    _refuse(clock, CoarseOffset(7.4, sure + some, 0.0), CoarseOffset(0.1, sure, 0.0), told)
    assert len(told) == 1
    assert "leap" not in told[0]
    assert "whole" not in told[0]
    _refuse(clock, CoarseOffset(7.4, sure, 0.0), CoarseOffset(0.1, sure - 0.5 * some, 0.0), told)
    assert len(told) == 1
    with pytest.raises(InputError):
        _refuse(clock, CoarseOffset(7.4, sure, 0.0), CoarseOffset(0.1, -some, 0.0), told)


def test_velocities_that_come_late_beside_positions_are_no_wrong_clock() -> None:
    """Running means of five seconds, as for a display; both late by two are a clock's."""
    motion, imu = drive(3)
    fixes = receive(motion, Filter(rate=1.0), 3)
    clock = ClockModel(BASE_NS, GPS0, 0.0, limits.GPS_SD_S, limits.GPS_DRIFT_SD, "identity", 0.0)
    late = replace(fixes, vel_ned=lfilter(np.full(5, 0.2), [1.0], fixes.vel_ned, axis=0))
    assert contradiction(clock, imu, late) is None
    told = contradiction(clock, imu, replace(fixes, gps_s=fixes.gps_s + 2.2))
    assert told is not None
    assert "contradict" in told


def test_without_an_imu_the_receiver_has_the_time() -> None:
    nothing = _without_imu(None, "gps_ns", None, 1e-5).clock
    assert (nothing.ref_ns, nothing.ref_gps_s, nothing.drift) == (0, 0.0, 0.0)
    fixes = simulated_fixes(1, Receiver(rate_hz=1.0), 30.0)
    gps_s = fixes.gps_s.copy()
    gps_s[0] = np.nan
    clock = _without_imu(replace(fixes, gps_s=gps_s), "gps_ns", None, 1e-5).clock
    assert clock.gps_s(clock.t_ns(gps_s[5:6])) == pytest.approx(gps_s[5:6], abs=1e-6)
    assert clock.ref_gps_s == pytest.approx(gps_s[1])
    late = np.rint((gps_s - gps_s[1] + 30.0 + 0.1) * 1e9)
    arrival = np.where(np.isfinite(late), np.nan_to_num(late), NO_TIME).astype(np.int64)
    heard = replace(fixes, gps_s=gps_s, arrival_ns=arrival)
    fitted = _without_imu(heard, "host_ns", 0.1, 1e-5)
    assert fitted.fit is not None
    assert fitted.clock.gps_s(np.array([30 * 10**9])) == pytest.approx([gps_s[1]], abs=0.02)
    # stamps that are GPS time are taken at their word
    assert _without_imu(heard, "gps_ns", 0.1, 1e-5).fit is None


def test_a_clock_that_nothing_tells_is_said() -> None:
    found = unknown_clock(np.array([3 * 10**9, 4 * 10**9]))
    assert found.clock.gps_s(np.array([4 * 10**9])) == pytest.approx([4.0])
    assert found.clock.sd_offset_s == np.inf
    assert len(found.warnings) == 1


@pytest.mark.filterwarnings("error")
def test_fixes_without_a_date_tell_no_rough_clock() -> None:
    fixes = simulated_fixes(1, Receiver(), 30.0)
    undated = replace(fixes, gps_s=np.full(len(fixes), np.nan))
    stamps = np.arange(200) * np.int64(10**8)
    imu = ImuData(stamps, np.zeros((200, 3)), np.tile([0.0, 0.1, -9.8], (200, 1)))
    assert rough_clock(imu, undated) is None
    assert rough_clock(imu, undated, "gps_ns") is not None
