"""Fixes that are old: what age does beyond the first order, and clocks that agree nowhere."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from automap.earth import metres_per_radian
from automap.gap import base_model
from automap.gap.delays import Delays, without_higher_orders
from automap.gap.drive import open_drive
from automap.gap.evidence import Evidence
from automap.gap.fit import Fit, at_times, fit_drive, motion_of
from automap.gap.naming import offset_at_start, offset_besides, offset_first
from automap.gap.scoring import Joint
from automap.gap.screening import Candidate
from automap.gap.search_state import Trial
from tests.unit.test_gap import simulated

MODEL = base_model()


@pytest.fixture(scope="module")
def plain() -> Fit:
    return fit_drive(open_drive(simulated({}), MODEL.options), MODEL)


def test_old_fixes_less_the_remainder_are_old_to_first_order(plain: Fit) -> None:
    age = 0.2
    motion = motion_of(plain.last)
    arm = np.array([plain.last.totals()[f"gnss_lever_arm_{a}"] for a in "xyz"])
    fixes = plain.opened.session.fixes
    t = plain.last.shift.position_times(fixes.t)
    # positions of the antenna as they were an age ago
    inner = (t > motion.t[0] + age) & (t < motion.t[-1])
    t = t[inner]
    north, east = metres_per_radian(motion.pos[0, 0], motion.pos[0, 2])
    flat = (motion.pos - motion.pos[0]) * [north, east, -1.0]
    antenna = flat + np.einsum("nij,j->ni", motion.dcm, arm)
    old = at_times(motion, antenna, t - age)
    velocity = at_times(motion, motion.vel, t)
    values = fixes.values[inner].copy()
    values[:, :3] = motion.pos[0] + old / [north, east, -1.0]
    aged = replace(fixes, **{f: getattr(fixes, f)[inner] for f in ("flags", "t", "row")})
    aged = replace(aged, values=values)
    rest = without_higher_orders(aged, plain.last, motion, Delays(all_s=age))
    seen = (rest.values[:, :3] - motion.pos[0]) * [north, east, -1.0]
    expected = at_times(motion, antenna, t) - age * velocity
    assert np.abs(old - expected).max() > 0.03
    assert np.abs(seen - expected).max() < 3e-3


def test_noise_of_single_turn_rates_does_not_age_velocities(plain: Fit) -> None:
    motion = motion_of(plain.last)
    fixes = plain.opened.session.fixes
    noise = 0.1 * np.random.default_rng(1).standard_normal(motion.rate.shape)
    rough = replace(motion, rate=motion.rate + noise)
    seen = [
        without_higher_orders(fixes, plain.last, m, Delays(all_s=0.02)) for m in (motion, rough)
    ]
    arm = np.array([plain.last.totals()[f"gnss_lever_arm_{a}"] for a in "xyz"])
    apart = np.std(seen[1].values[:, 3:6] - seen[0].values[:, 3:6])
    # two readings of that noise would part them by 0.14 rad/s times the arm
    assert np.linalg.norm(arm) > 0.5
    assert apart < 0.3 * 0.1 * np.linalg.norm(arm)


def test_large_delays_are_found_without_bias(monkeypatch: pytest.MonkeyPatch) -> None:
    hidden = {"gnss_latency": {"s": 0.15}, "gnss_velocity_latency": {"s": 0.2}}
    opened = open_drive(simulated(hidden), MODEL.options)
    estimate = {"gnss_latency": 2.0, "gnss_velocity_latency": 2.0}
    fit = fit_drive(opened, MODEL, estimate)
    for effect, true in hidden.items():
        value, sd = fit.value_of(effect)["s"], fit.sd_of(effect)["s"]
        assert sd < 0.012
        assert abs(value - true["s"]) < 3.0 * sd
    # velocities alone tell the sum, far better than either
    assert float(fit.values.sum()) == pytest.approx(0.35, abs=0.012)
    monkeypatch.setattr("automap.gap.fit.DELAY_ROUNDS", 0)
    first_order = fit_drive(opened, MODEL, estimate)
    assert fit.score > first_order.score + 100.0


@pytest.mark.parametrize(("offset", "apart"), [(0.0, False), (0.2, True)])
def test_clocks_of_different_rates_may_agree_somewhere(offset: float, apart: bool) -> None:
    hidden = {"imu_clock_skew": {"skew": 5e-4}, "imu_time_offset": {"s": offset}}
    opened = open_drive(simulated(hidden), MODEL.options)
    fit = fit_drive(opened, MODEL, {"imu_clock_skew": 20.0})
    assert fit.value_of("imu_clock_skew")["skew"] == pytest.approx(5e-4, abs=1e-4)
    assert offset_besides([fit]) is apart


@pytest.mark.parametrize("offset", [0.0, 0.06, -0.06])
def test_a_skew_alone_agrees_with_the_first_sample(offset: float) -> None:
    # over the drive the clocks part by more than that: they agree somewhere
    hidden = {"imu_clock_skew": {"skew": 2e-3 if offset < 0.0 else -2e-3}}
    hidden["imu_time_offset"] = {"s": offset}
    opened = open_drive(simulated(hidden), MODEL.options)
    fit = fit_drive(opened, MODEL, {"imu_clock_skew": 40.0})
    assert not offset_besides([fit])
    assert offset_at_start([fit]) == pytest.approx(offset, abs=0.02)


def trial(effect: str, nats: float) -> Trial:
    one = np.ones(1)
    evidence = Evidence(nats, one, one, 1.0, 1.0, nats)
    candidate = Candidate(effect, ("s",), np.array([0]), one, evidence, 0.0)
    joint = Joint(((effect, "s"),), one, np.eye(1), nats)
    return Trial(candidate, joint, (), MODEL, nats, 0.0, one)


@pytest.mark.parametrize(
    ("nats", "first"), [(98.0, "gnss_latency"), (90.0, "gnss_velocity_latency")]
)
def test_whole_fixes_are_late_where_late_velocities_explain_no_more(
    nats: float, first: str
) -> None:
    trials = [trial("gnss_velocity_latency", 100.0), trial("gnss_latency", nats)]
    assert offset_first(trials)[0].effect == first
    assert len(offset_first(trials)) == 2
