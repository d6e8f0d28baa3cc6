"""Wheel speed in the fusion: at any rate, late, long, in steps, stuck, and backwards."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest

from automap.fusion.engine import fuse_imu_gnss
from automap.fusion.nodes import model_fixes
from automap.fusion.options import FusionOptions
from automap.fusion.result import FusionResult, Prior
from automap.fusion.wheel_match import Reference, between, match_wheels, step_of, stuck
from automap.fusion.wheels import contradiction, judge_wheels, path_speed, readings
from automap.records import Fixes, ImuData, WheelSpeed
from tests.slow_cases import others_slow
from tests.unit.fusion_drive import BASE_NS, CLOCK, Sensor, errors, horizontal_rms, record
from tests.unit.fusion_motion import Motion, city_drive, make_motion
from tests.unit.fusion_receiver import GPS0, Receiver, receive, select

KMH = 1.0 / 3.6
OUTAGE = (120.0, 180.0)
# the receiver is prompt, so that delays are those of the wheels
OPTIONS = FusionOptions(fixed={"gnss_latency": {"s": 0.0}})


def forward(motion: Motion, t: np.ndarray) -> np.ndarray:
    true = motion.at(t)
    return np.einsum("ni,ni->n", true.c_n_b[:, :, 0], true.vel)


def count(
    motion: Motion,
    rate: float,
    late: float = 0.0,
    scale: float = 1.0,
    step: float = 0.0,
    noise: float = 0.02,
) -> WheelSpeed:
    """Wheels that know no sign, stamped ``late`` s after the truth."""
    t = np.arange(0.3, motion.duration - 0.5, 1.0 / rate)
    speed = forward(motion, np.maximum(t - late, 0.0))
    told = np.abs(scale * speed + noise * np.random.default_rng(5).standard_normal(len(t)))
    told[np.abs(speed) < 0.05] = 0.0
    if step:
        told = step * np.rint(told / step)
    return WheelSpeed(BASE_NS + np.rint(t * 1e9).astype(np.int64), told)


@dataclass(frozen=True)
class Recorded:
    motion: Motion
    imu: ImuData
    fixes: Fixes

    def fuse(self, wheels: WheelSpeed | None) -> FusionResult:
        delay = Prior(0.0, 0.05)
        return fuse_imu_gnss(
            self.imu, self.fixes, CLOCK, OPTIONS, delay, np.zeros(3), odometer=wheels
        )


def recorded(motion: Motion, seed: int, outage: tuple[float, float]) -> Recorded:
    fixes = receive(motion, Receiver(rate=1.0, vel_latency=0.1), seed)
    t = fixes.gps_s - GPS0
    fixes = select(fixes, (t < outage[0]) | (t > outage[1]))
    return Recorded(motion, record(motion, Sensor(), seed), fixes)


@cache
def town() -> Recorded:
    return recorded(city_drive(240.0, 3, slip=True), 3, OUTAGE)


@cache
def fused(rate: float, late: float = 0.0, scale: float = 1.0, step: float = 0.0) -> FusionResult:
    return town().fuse(count(town().motion, rate, late, scale, step))


@cache
def without() -> FusionResult:
    return town().fuse(None)


@cache
def with_all_fixes() -> FusionResult:
    return recorded(town().motion, 3, (1e3, 1e3)).fuse(None)


def rms(result: FusionResult, drive: Recorded | None = None) -> float:
    return horizontal_rms(errors(result.trajectory, (drive or town()).motion))


def in_outage(result: FusionResult) -> np.ndarray:
    """Errors [n, 9] while there were no fixes."""
    t = (result.trajectory.t_ns - BASE_NS) * 1e-9
    return errors(result.trajectory, town().motion)[(t > OUTAGE[0]) & (t < OUTAGE[1])]


@pytest.mark.slow
@pytest.mark.parametrize("rate", others_slow([1.0, 0.5, 20.0, 100.0]))
def test_any_rate_is_used_and_helps_without_fixes(rate: float) -> None:
    result = fused(rate)
    used = result.innovations.channel == "odometer"
    # each reading of a slow log, and of a fast one as many as tell anything new
    assert used.sum() == pytest.approx(239.0 * min(rate, 4.0), rel=0.03)
    speeds = [np.sqrt(np.mean(in_outage(r)[:, 3:5] ** 2)) for r in (without(), result)]
    assert speeds[1] < 0.75 * speeds[0]
    # what the outage adds to the receiver's slow error, which is in every one of them
    added = [
        horizontal_rms(in_outage(r) - in_outage(with_all_fixes())) for r in (without(), result)
    ]
    assert added[1] < 0.95 * added[0]


@pytest.mark.slow
@pytest.mark.parametrize("rate", [1.0, pytest.param(10.0, marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    ("late", "scale"), others_slow([(0.5, 1.05), (0.5, 1.0), (0.0, 1.05), (-1.3, 0.95)])
)
def test_wheels_that_are_late_or_long_cost_nothing(rate: float, late: float, scale: float) -> None:
    result = fused(rate, late, scale)
    assert rms(result) < 1.02 * rms(fused(rate))
    assert result.wheels is not None
    found, exact = result.wheels, fused(rate).wheels
    assert found.late is not None
    assert found.scale is not None
    assert exact is not None
    assert exact.late is not None
    assert abs(found.late.mean - late) < 4.0 * found.late.sd < 0.1
    assert abs(found.scale.mean - scale) < 4.0 * found.scale.sd < 0.01


@pytest.mark.slow
@pytest.mark.parametrize("rate", others_slow([1.0, 10.0]))
def test_speeds_in_whole_kilometres_an_hour_are_as_sure_as_said(rate: float) -> None:
    result = fused(rate, step=KMH)
    assert result.wheels is not None
    assert result.wheels.found.step == pytest.approx(KMH, rel=1e-3)
    table = result.innovations
    ratio = (table.innovation / table.sd)[table.channel == "odometer"]
    assert np.sqrt(np.mean(ratio**2)) < 1.1
    off = errors(result.trajectory, town().motion)
    velocity = off[:, 3:5] / result.trajectory.sd_vel_ned[:, :2]
    assert np.mean(velocity**2) < 1.3
    # they still tell how far the drive went while there were no fixes
    speeds = [np.sqrt(np.mean(in_outage(r)[:, 3:5] ** 2)) for r in (without(), result)]
    assert speeds[1] < 0.95 * speeds[0]


@pytest.mark.slow
@pytest.mark.parametrize("rate", [1.0, pytest.param(10.0, marks=pytest.mark.slow)])
@pytest.mark.parametrize("value", others_slow(["held", "zero"]))
def test_a_counter_that_hangs_does_not_pull_the_path(rate: float, value: str) -> None:
    good = count(town().motion, rate)
    t = (good.t_ns - BASE_NS) * 1e-9
    hangs = (t > 60.0) & (t < 100.0)
    speed = good.speed.copy()
    speed[hangs] = 0.0 if value == "zero" else speed[np.flatnonzero(hangs)[0]]
    result = town().fuse(replace(good, speed=speed))
    assert any("stuck while the vehicle drives" in text for text in result.warnings)
    gone = town().fuse(WheelSpeed(good.t_ns[~hangs], good.speed[~hangs]))
    off = errors(result.trajectory, town().motion) - errors(gone.trajectory, town().motion)
    assert horizontal_rms(off) < 0.02
    # whole seconds of wheels less move the levels, and with them the path, by centimetres
    whole = errors(result.trajectory, town().motion)
    whole -= errors(fused(rate).trajectory, town().motion)
    assert horizontal_rms(whole) < 0.1
    assert np.sqrt(np.mean(whole[:, 3:5] ** 2)) < 0.01


@pytest.mark.slow
def test_backing_up_does_not_hurt() -> None:
    """Twenty seconds backwards, which wheels without a sign tell as forwards."""
    speed = [(0.0, 0.0), (8.0, 0.0), (12.0, 10.0), (40.0, 12.0), (46.0, 0.0), (50.0, 0.0)]
    speed += [(54.0, -2.5), (70.0, -2.5), (74.0, 0.0), (78.0, 0.0), (84.0, 12.0), (120.0, 10.0)]
    motion = make_motion(speed, [(20.0, 6.0, 80.0), (60.0, 8.0, -60.0), (95.0, 5.0, -70.0)], 125.0)
    drive = recorded(motion, 4, (200.0, 201.0))
    plain = drive.fuse(None)
    for rate in (1.0, 10.0):
        result = drive.fuse(count(motion, rate))
        assert rms(result, drive) < 1.05 * rms(plain, drive)
        assert result.wheels is not None
        assert result.wheels.scale is not None
        assert abs(result.wheels.scale.mean - 1.0) < 4.0 * result.wheels.scale.sd
        t = (result.trajectory.t_ns - BASE_NS) * 1e-9
        back = (t > 56.0) & (t < 70.0)
        off = errors(result.trajectory, motion)[back, 3:5]
        assert np.sqrt(np.mean(off**2)) < 0.1


@pytest.mark.parametrize("decimals", [2, 4])
@pytest.mark.parametrize("step", [KMH, 0.5 * KMH, 0.44704])
def test_the_step_of_a_counter_is_found(step: float, decimals: int) -> None:
    speed = step * np.rint(count(town().motion, 1.0).speed / step)
    assert step_of(np.round(speed, decimals)) == pytest.approx(step, rel=2e-3)


def test_a_fine_counter_has_no_step_that_matters() -> None:
    assert step_of(count(town().motion, 1.0).speed) < 0.02
    assert step_of(count(town().motion, 100.0).speed) < 0.02


def test_between_samples_a_speed_is_as_unsure_as_said() -> None:
    """A random walk of one (m/s^2)^2/Hz, of which every second, and less, is told."""
    rng = np.random.default_rng(2)
    step, n = 0.05, 400_000
    t = step * np.arange(n)
    speed = np.cumsum(rng.standard_normal(n)) * np.sqrt(step)
    told, var, near = between(t[::20], speed[::20], t)
    assert near[: n - 20].all()
    for place in (0, 5, 10):
        miss = (told - speed)[place::20][:-1]
        assert np.mean(miss**2) == pytest.approx(var[place], rel=0.03, abs=1e-12)
    assert var[10] == pytest.approx(0.25)


def _reference(motion: Motion) -> Reference:
    t = np.arange(0.0, motion.duration)
    noise = 0.07 * np.random.default_rng(1).standard_normal(len(t))
    return Reference(t, np.abs(forward(motion, t) + noise), np.full(len(t), 0.07))


def _stamps(wheels: WheelSpeed) -> np.ndarray:
    return np.asarray((wheels.t_ns - BASE_NS) * 1e-9)


@pytest.mark.parametrize(
    ("factor", "unit"), [(3.6, "km/h"), (2.2369, "miles per hour"), (1.94384, "knots")]
)
def test_another_unit_is_named_and_left_out(factor: float, unit: str) -> None:
    wheels = count(town().motion, 1.0, late=0.4, scale=1.02)
    found = judge_wheels(_stamps(wheels), factor * wheels.speed, _reference(town().motion), OPTIONS)
    assert found.odometer is None
    assert f"as in {unit}; it is left out: write speed_m_s" in found.warnings[0]


@pytest.mark.parametrize("told", [True, False])
def test_fixes_with_and_without_velocity_tell_a_speed(told: bool) -> None:
    fixes = receive(town().motion, Receiver(rate=5.0), 2)
    if not told:
        fixes = replace(fixes, vel_ned=np.full_like(fixes.vel_ned, np.nan))
    seen = path_speed(model_fixes(fixes, fixes.gps_s - GPS0, OPTIONS))
    off = seen.speed - np.abs(forward(town().motion, seen.t))
    # at rest noise has a speed too
    driving = seen.speed > 3.0
    assert 0.5 < np.sqrt(np.mean((off / seen.sd)[driving] ** 2)) < 1.2
    wheels = count(town().motion, 1.0, 0.6, 1.04)
    match = match_wheels(_stamps(wheels), wheels.speed, seen, 3.0)
    assert match is not None
    assert match.late_s == pytest.approx(0.6, abs=0.1)
    assert match.scale == pytest.approx(1.04, abs=0.01)


@pytest.mark.parametrize("late", [-2.2, -0.4, 0.7, 2.5])
def test_delay_and_scale_are_found_by_comparison(late: float) -> None:
    wheels = count(town().motion, 1.0, late, 0.97)
    match = match_wheels(_stamps(wheels), wheels.speed, _reference(town().motion), 3.0)
    assert match is not None
    assert match.late_s == pytest.approx(late, abs=0.05)
    assert match.scale == pytest.approx(0.97, abs=0.005)
    assert contradiction(match) is None


def test_stamps_of_another_clock_are_named() -> None:
    wheels = count(town().motion, 5.0)
    found = judge_wheels(_stamps(wheels) + 3.4, wheels.speed, _reference(town().motion), OPTIONS)
    assert found.odometer is None
    assert "3.4 s later than the receiver's; it is left out: stamp t_ns" in found.warnings[0]


@pytest.mark.parametrize(
    ("shift_s", "shrunk", "words"),
    [
        (1.6e9, 1.0, "the first is 1600000"),
        (-500.0, 1.0, "s before it begins"),
        (0.0, 1e6, "bus"),
    ],
)
def test_stamps_that_are_of_another_time_or_unit_are_told(
    shift_s: float, shrunk: float, words: str
) -> None:
    wheels = count(town().motion, 5.0)
    t = _stamps(wheels) / shrunk + shift_s
    found = judge_wheels(t, wheels.speed, _reference(town().motion), OPTIONS)
    assert found.odometer is None
    assert words in found.warnings[0]
    assert "it is left out: is t_ns in nanoseconds" in found.warnings[0]


def test_wheels_that_come_after_the_last_fix_are_of_the_drive() -> None:
    """As in a car park under ground, where nothing can be compared and nothing else is known."""
    wheels = count(town().motion, 5.0)
    t, reference = _stamps(wheels), _reference(town().motion)
    early = Reference(*(values[reference.t < 30.0] for values in vars(reference).values()))
    later = t > 60.0
    span = (0.0, float(t[-1]))
    found = judge_wheels(t[later], wheels.speed[later], early, OPTIONS, span)
    assert found.odometer is not None
    assert judge_wheels(t[later], wheels.speed[later], early, OPTIONS).odometer is None


@pytest.mark.parametrize("seed", [4, 5, 6])
def test_wheels_of_another_drive_are_left_out(seed: int) -> None:
    wheels = count(city_drive(240.0, seed), 2.0)
    found = judge_wheels(_stamps(wheels), wheels.speed, _reference(town().motion), OPTIONS)
    assert found.odometer is None
    assert "does not follow the receiver's; it is left out: is it of this" in found.warnings[-1]


def test_only_what_hangs_is_stuck() -> None:
    reference = _reference(town().motion)
    for rate, step in ((10.0, 0.0), (10.0, KMH), (1.0, KMH), (50.0, 0.01)):
        wheels = count(town().motion, rate, late=0.5, step=step)
        assert not stuck(_stamps(wheels), wheels.speed, reference).any(), (rate, step)


def test_a_value_that_ends_in_a_jump_was_stuck_where_no_receiver_sees_it() -> None:
    t = np.arange(0.0, 60.0, 0.1)
    true = 15.0 + 5.0 * np.sin(t / 8.0)
    speed = true.copy()
    speed[200:400] = speed[200]
    nothing = Reference(np.zeros(0), np.zeros(0), np.zeros(0))
    assert np.flatnonzero(stuck(t, speed, nothing)).tolist() == list(range(200, 400))
    assert not stuck(t, true, nothing).any()


def test_a_value_that_stays_is_stuck_where_the_reference_says_otherwise() -> None:
    """Held while the reference changes its speed, and while it does not; at nothing while it
    drives, and while it stands. All without a jump, or with one beyond what vehicles do."""
    t = np.arange(0.0, 200.0, 0.1)
    at = np.arange(0.0, 200.0, 0.5)
    knots = [0.0, 20.0, 40.0, 60.0, 80.0, 100.0, 120.0, 140.0, 160.0, 200.0]
    path = np.interp(at, knots, [10.0, 10.0, 18.0, 10.0, 10.0, 1.0, 1.0, 12.0, 12.0, 10.0])
    reference = Reference(at, path, np.full(len(at), 0.1))
    speed = np.interp(t, at, path) + 0.01 * np.sin(7.0 * t)
    changing, steady = slice(250, 350), slice(620, 700)
    # at rest for the wheels: slower and slower to nothing, and as slowly off again
    slow, driving = slice(1060, 1140), slice(1450, 1550)
    for rows in (changing, steady):
        speed[rows] = speed[rows.start]
        after = speed[rows.stop + 20]
        speed[rows.stop : rows.stop + 20] = np.linspace(speed[rows.start], after, 22)[1:-1]
    for rows in (slow, driving):
        speed[rows] = 0.0
        speed[rows.start - 20 : rows.start] = np.linspace(speed[rows.start - 21], 0.1, 20)
        speed[rows.stop : rows.stop + 20] = np.linspace(0.1, speed[rows.stop + 20], 20)
    wanted = np.zeros(len(t), bool)
    wanted[changing] = wanted[driving] = True
    np.testing.assert_array_equal(stuck(t, speed, reference), wanted)
    # a reference that knows less says less
    unsure = replace(reference, sd=np.full(len(at), 5.0))
    assert not stuck(t, speed, unsure).any()
    # nor does one that did not look on for long
    for rows in (changing, driving):
        aside = (at < t[rows.start] + 0.6) | (at > t[rows.stop - 1] - 1.2)
        few = Reference(at[aside], path[aside], np.full(int(aside.sum()), 0.1))
        assert not stuck(t, speed, few)[rows].any()


def test_readings_share_the_error_of_a_value_that_stays() -> None:
    """Ten seconds at one value are one measurement of it, however often it is told."""
    t = np.arange(0.0, 60.0, 1.0)
    speed = KMH * np.concatenate([np.arange(20), np.full(20, 60.0), np.arange(60, 40, -1)])
    held = readings(t, speed, KMH, 0.0, 0.0, OPTIONS)
    plain = readings(t, speed, 0.0, 0.0, 0.0, OPTIONS)
    assert held.t == pytest.approx(t)
    assert held.speed == pytest.approx(speed)
    extra = held.var - plain.var
    assert extra[5:19] == pytest.approx(KMH**2 / 12.0)
    # and the first of those that go down again has it still
    assert extra[20:40] == pytest.approx(21 * KMH**2 / 12.0)


def test_signs_count_only_where_they_tell_the_direction() -> None:
    t = np.arange(0.0, 40.0)
    speed = np.concatenate([np.full(20, 12.0), np.full(20, -1.5)])
    for told in (speed, -speed):
        given = readings(t, told, 0.0, 0.0, 0.0, OPTIONS)
        assert given.signed
        assert given.speed == pytest.approx(speed)
    given = readings(t, np.where(t < 20.0, 12.0, -12.0), 0.0, 0.0, 0.0, OPTIONS)
    assert not given.signed
    assert given.speed == pytest.approx(12.0)


def test_samples_that_come_in_bursts_are_taken_once() -> None:
    t = np.sort(np.concatenate([np.arange(0.0, 40.0), np.arange(0.0, 40.0) + 1e-4]))
    given = readings(t, 10.0 + 0.1 * t, 0.0, 0.0, 0.0, OPTIONS)
    assert len(given.t) == 40
    assert given.speed == pytest.approx(10.0 + 0.1 * given.t)
    assert np.isfinite(given.var).all()
