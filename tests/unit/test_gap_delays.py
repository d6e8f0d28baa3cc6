"""Fixes that are old: what age does beyond the first order."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import minimum_filter1d

from automap.columns_between import interpolate
from automap.earth import metres_per_radian
from automap.effects.courses import with_courses
from automap.effects.measured_kernels import course_changes
from automap.effects.user import set_user_effects
from automap.effects.user_tables import effects_of_formulas
from automap.fusion.layout import CH_VEL
from automap.gap import base_model
from automap.gap.columns import named_columns
from automap.gap.drive import open_drive
from automap.gap.fit import Fit, fit_drive
from automap.gap.linear import Given, conditional
from automap.gap.motion import (
    Delays,
    Motion,
    _steady,
    at_times,
    lagged,
    linear_in_delays,
    motion_of,
)
from automap.gap.nodes import motions_of
from automap.gap.noise import Fitted, fitted_about
from automap.gap.sensitivity import linearised
from automap.records import FloatArray
from tests.unit.gap_values import estimates, value_of
from tests.unit.test_gap import simulated

BASE = base_model()
# no error of the simulated velocities lasts
MODEL = replace(BASE, options=replace(BASE.options, velocity_wander_sd=0.0))


@pytest.fixture(scope="module")
def plain() -> Fit:
    return fit_drive(open_drive(simulated({}), MODEL.options), MODEL)


def moving_antenna(motion: Motion, arm: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Velocity [n, 3] NED of an antenna, and its acceleration to the middle of its turn."""
    rate = motion.calm
    swing = np.cross(rate, arm)
    velocity = motion.vel + np.einsum("nij,nj->ni", motion.dcm, swing)
    return velocity, np.einsum("nij,nj->ni", motion.dcm, np.cross(rate, swing))


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
    velocity = at_times(motion, moving_antenna(motion, arm)[0], t)
    values = fixes.values[inner].copy()
    values[:, :3] = motion.pos[0] + old / [north, east, -1.0]
    aged = replace(fixes, **{f: getattr(fixes, f)[inner] for f in ("flags", "t", "row")})
    aged = replace(aged, values=values)
    rest, _ = linear_in_delays(aged, plain.last, motion, Delays(all_s=age))
    seen = (rest.values[:, :3] - motion.pos[0]) * [north, east, -1.0]
    expected = at_times(motion, antenna, t) - age * velocity
    assert np.abs(old - expected).max() > 0.03
    assert np.abs(seen - expected).max() < 3e-3


def test_noise_of_single_turn_rates_does_not_age_velocities(plain: Fit) -> None:
    motion = motion_of(plain.last)
    fixes = plain.opened.session.fixes
    noise = 0.1 * np.random.default_rng(1).standard_normal(motion.rate.shape)
    rough = replace(motion, rate=motion.rate + noise)
    seen = [linear_in_delays(fixes, plain.last, m, Delays(all_s=0.02))[0] for m in (motion, rough)]
    arm = np.array([plain.last.totals()[f"gnss_lever_arm_{a}"] for a in "xyz"])
    apart = np.std(seen[1].values[:, 3:6] - seen[0].values[:, 3:6])
    # two readings of that noise would part them by 0.14 rad/s times the arm
    assert np.linalg.norm(arm) > 0.5
    assert apart < 0.3 * 0.1 * np.linalg.norm(arm)


def test_columns_between_are_what_numpy_says_of_each() -> None:
    rng = np.random.default_rng(3)
    t = np.cumsum(rng.uniform(0.005, 0.015, 500))
    values = rng.standard_normal((500, 3))
    late, anyhow = t - 0.37, rng.uniform(-1.0, 8.0, 300)
    for x in (
        late,
        anyhow,
        t,
        t[::40] + 0.2,
        np.array([t[-1], t[0], np.nextafter(t[5], 9.0)]),
        t[:0],
    ):
        out = np.empty((len(x), 3))
        interpolate(x, t, values, out)
        for column, expected in zip(out.T, values.T, strict=True):
            assert (column == np.interp(x, t, expected)).all()


def test_large_delays_are_found_without_bias(monkeypatch: pytest.MonkeyPatch) -> None:
    hidden = {"gnss_latency": {"s": 0.15}, "gnss_velocity_latency": {"s": 0.2}}
    opened = open_drive(simulated(hidden), MODEL.options)
    estimate = {"gnss_latency": 2.0, "gnss_velocity_latency": 2.0}
    fit = fit_drive(opened, MODEL, estimate)
    for effect, true in hidden.items():
        value, sd = estimates(fit, effect)["s"]
        assert sd < 0.012
        assert abs(value - true["s"]) < 3.0 * sd
    # velocities alone tell the sum, far better than either
    assert float(fit.values.sum()) == pytest.approx(0.35, abs=0.012)
    monkeypatch.setattr("automap.gap.fit.DELAY_ROUNDS", 0)
    first_order = fit_drive(opened, MODEL, estimate)
    assert fit.score > first_order.score + 100.0


@pytest.mark.parametrize("offset", [0.0, 0.2])
def test_a_clock_that_runs_fast_is_found_wherever_the_two_agree(offset: float) -> None:
    hidden = {"imu_clock_skew": {"skew": 5e-4}, "imu_time_offset": {"s": offset}}
    opened = open_drive(simulated(hidden), MODEL.options)
    fit = fit_drive(opened, MODEL, {"imu_clock_skew": 1.0})
    assert value_of(fit, "imu_clock_skew")["skew"] == pytest.approx(5e-4, abs=1e-4)


def test_a_clock_that_runs_fast_is_found_beside_velocities_of_long_ago() -> None:
    hidden = {"imu_clock_skew": {"skew": 1e-3}, "gnss_velocity_latency": {"s": 0.8}}
    opened = open_drive(simulated(hidden), MODEL.options)
    fit = fit_drive(opened, MODEL, {"imu_clock_skew": 1.0, "gnss_velocity_latency": 5.0})
    # a delay that grows changes velocities by what happened then, as one that does not
    value, sd = estimates(fit, "imu_clock_skew")["skew"]
    assert sd < 1e-4
    assert abs(value - 1e-3) < 2.0 * sd
    assert value_of(fit, "gnss_velocity_latency")["s"] == pytest.approx(0.8, abs=0.02)


def test_metres_a_second_are_longer_on_a_clock_that_runs_fast(plain: Fit) -> None:
    skew = 0.01
    motion = motion_of(plain.last)
    fixes = plain.opened.session.fixes
    arm = np.array([plain.last.totals()[f"gnss_lever_arm_{a}"] for a in "xyz"])
    antenna, inward = moving_antenna(motion, arm)
    tag = plain.last.shift.position_times(fixes.t)
    # the receiver's own time, and its velocities as steps of the path over steps of that
    own = motion.t / (1.0 + skew)
    steps = 0.5 * (antenna[1:] + antenna[:-1]) * np.diff(motion.t)[:, None]
    path = np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])
    told = np.gradient(path, own, axis=0)
    values = fixes.values.copy()
    values[:, 3:6] = np.stack([np.interp(tag, own, axis) for axis in told.T], axis=1)
    late = replace(fixes, values=values)
    rest, change = linear_in_delays(late, plain.last, motion, Delays(skew=-skew))
    assert change is not None
    vel = at_times(motion, antenna, tag)
    acc = at_times(motion, _steady(plain.last, motion) + inward + change.whole, tag)
    off = np.abs(rest.values[:, 3:6] - vel - (skew * tag)[:, None] * acc)
    inner = (tag > 1.0) & (tag < own[-1] - 1.0)
    fast = inner & (np.hypot(*vel[:, :2].T) > 8.0)
    assert skew * np.hypot(*vel[fast, :2].T).min() > 0.05
    assert np.median(off[fast]) < 2e-3


def turned_back(vel: FloatArray, before: FloatArray) -> FloatArray:
    """Velocities [k, 3] with the courses that others have."""
    course = np.arctan2(before[:, 1], before[:, 0])
    speed = np.hypot(vel[:, 0], vel[:, 1])
    return np.stack([speed * np.cos(course), speed * np.sin(course), vel[:, 2]], axis=1)


def test_late_courses_less_the_remainder_are_late_to_first_order(plain: Fit) -> None:
    late = 0.3
    motion = motion_of(plain.last)
    arm = np.array([plain.last.totals()[f"gnss_lever_arm_{a}"] for a in "xyz"])
    antenna, inward = moving_antenna(motion, arm)
    fixes = plain.opened.session.fixes
    t = plain.last.shift.position_times(fixes.t)
    vel, before = at_times(motion, antenna, t), at_times(motion, antenna, t - late)
    # where the vehicle moves, and did so all the while
    speeds = [np.hypot(v[:, 0], v[:, 1]) for v in (vel, before)]
    moving = (np.minimum(*speeds) > 4.0) & (t > motion.t[0] + 1.0) & (t < motion.t[-1] - 1.0)
    values = fixes.values.copy()
    values[:, 3:6] = turned_back(vel, before)
    rest, change = linear_in_delays(
        replace(fixes, values=values), plain.last, motion, Delays(course_s=late)
    )
    assert change is not None
    # what the filter multiplies the delay with: of the acceleration that part which turns, and by
    # how much it was another when the course was that
    acc = at_times(motion, _steady(plain.last, motion) + inward, t)
    ahead = (at_times(motion, antenna, t + 0.2) - at_times(motion, antenna, t - 0.2)) / 0.4
    assert np.corrcoef(acc[moving, 0], ahead[moving, 0])[0, 1] > 0.97
    along = vel[:, :2] / np.linalg.norm(vel[:, :2], axis=1)[:, None].clip(1e-9)
    across = acc[:, :2] - along * np.sum(acc[:, :2] * along, axis=1)[:, None]
    expected = vel.copy()
    expected[:, :2] -= late * (across + at_times(motion, change.course, t)[:, :2])
    off = [np.abs(v[:, 3:6] - expected)[moving].max() for v in (values, rest.values)]
    assert moving.sum() > 100
    assert off[0] > 0.1
    assert off[1] < 1e-6
    # positions are not late
    np.testing.assert_allclose(rest.values[:, :3], values[:, :3], rtol=1e-12)


def test_courses_of_a_place_behind_less_the_remainder_are_those_of_an_arm(plain: Fit) -> None:
    behind = 4.0
    motion = motion_of(plain.last)
    arm = np.array([plain.last.totals()[f"gnss_lever_arm_{a}"] for a in "xyz"])
    antenna, _ = moving_antenna(motion, arm)
    fixes = plain.opened.session.fixes
    t = plain.last.shift.position_times(fixes.t)
    vel = at_times(motion, antenna, t)
    speed = np.hypot(vel[:, 0], vel[:, 1])
    before = at_times(motion, antenna, t - behind / np.maximum(speed, 1.0))
    moving = (np.minimum(speed, np.hypot(before[:, 0], before[:, 1])) > 4.0) & (t > 2.0)
    moving &= t < motion.t[-1] - 1.0
    values = fixes.values.copy()
    values[:, 3:6] = turned_back(vel, before)
    rest, change = linear_in_delays(
        replace(fixes, values=values), plain.last, motion, Delays(course_m=behind)
    )
    assert change is not None
    # a point so far behind the antenna swings by the turn rate times the distance, as that was
    rate = motion.calm
    swing = np.cross(rate, np.array([-behind, 0.0, 0.0]))
    expected = vel + at_times(motion, np.einsum("nij,nj->ni", motion.dcm, swing), t)
    expected -= behind * at_times(motion, change.behind, t)
    off = [np.abs(v[:, 3:6] - expected)[moving].max() for v in (values, rest.values)]
    assert moving.sum() > 100
    assert off[0] > 0.1
    assert off[1] < 1e-6


def test_a_course_at_a_crawl_is_not_turned() -> None:
    fast, slow = np.array([[10.0, 0.0, 0.3]]), np.array([[0.05, 0.0, 0.3]])
    before = np.array([[0.0, 3.0, 0.0]])
    np.testing.assert_allclose(with_courses(fast, before), turned_back(fast, before), atol=1e-12)
    assert np.abs(with_courses(slow, before) - slow).max() < 1e-3
    # one who stood has no course
    np.testing.assert_array_equal(with_courses(fast, np.zeros((1, 3))), fast)
    # as it was at rest its course is another with each path
    resting = np.array([[0.02, 0.03, 0.0]])
    assert np.abs(with_courses(fast, resting) - with_courses(fast, -resting)).max() < 0.05


@pytest.mark.parametrize("field", ["all_s", "skew", "velocity_s", "course_s", "course_m"])
def test_delays_are_close_where_no_age_moved(field: str) -> None:
    here = Delays(0.1, 1e-4, 0.05, 0.02, 0.2, 1.0)
    size = {"skew": 1.0, "course_m": 1000.0}.get(field, 100.0)
    for change, close in ((1e-6, True), (1e-4, False)):
        there = replace(here, **{field: getattr(here, field) + size * change})
        assert here.close_to(there, 100.0) is close


@pytest.mark.parametrize(
    "late",
    [
        *(Delays(velocity_s=0.8), Delays(lag_s=0.8), Delays(all_s=0.5)),
        *(Delays(skew=1e-2), Delays(velocity_s=0.5, skew=2e-3)),
        *(
            Delays(course_s=0.6),
            Delays(velocity_s=0.3, course_s=0.4),
            Delays(0.0, 0.0, 0.7, 0.0, -0.4),
        ),
    ],
)
def test_late_velocities_change_by_what_happened_then(plain: Fit, late: Delays) -> None:
    """What the filter multiplies a further delay with, against two delays in place of one."""
    step = 0.02
    motion = motion_of(plain.last)
    arm = np.array([plain.last.totals()[f"gnss_lever_arm_{a}"] for a in "xyz"])
    antenna, inward = moving_antenna(motion, arm)
    changing = _steady(plain.last, motion) + inward
    _, change = linear_in_delays(plain.opened.session.fixes, plain.last, motion, late)
    assert change is not None

    def told(more: float = 0.0, course: float = 0.0, behind: float = 0.0) -> FloatArray:
        tau = late.lag_s + more if late.lag_s > 0.0 else 0.0
        passed = lagged(motion, antenna, tau) if tau > 0.0 else antenna
        age = late.all_s + late.velocity_s + (0.0 if late.lag_s > 0.0 else more)
        then = motion.t - age - late.skew * motion.t
        seen = at_times(motion, passed, then)
        older = late.course_s + course + behind / np.maximum(np.hypot(*seen[:, :2].T), 1.0)
        before = at_times(motion, passed, then - older)
        return with_courses(seen, before) if older.any() else seen

    inner = (motion.t > 3.0) & (motion.t < motion.t[-1] - 3.0)
    speed = np.hypot(antenna[:, 0], antenna[:, 1])
    # a course at a crawl is anything
    inner &= minimum_filter1d(speed, round(4.0 / np.median(np.diff(motion.t)))) > 2.0
    assert inner.sum() > 1000
    at_tag = np.zeros_like(changing)
    course_changes(antenna, changing, at_tag)
    swings = np.cross(motion.calm, [1.0, 0.0, 0.0])
    aside = np.einsum("nij,nj->ni", motion.dcm, swings)
    numerics = [
        -(told(*(step * np.eye(3)[k])) - told(*(-step * np.eye(3)[k]))) / (2.0 * step)
        for k in range(3)
    ]
    for numeric, now, more in zip(numerics, (changing, at_tag, aside), change[:3], strict=True):
        # a smoothed path and the forces behind it are not one and the same to the last bit
        off = [float(np.std((a - numeric)[inner])) for a in (now + more, now)]
        assert off[0] < 0.2 * np.std(numeric[inner])
        assert off[0] < 0.5 * off[1]


def test_velocities_that_are_late_are_no_evidence_about_when_positions_were() -> None:
    """Early fixes with velocities that are late all the more: where late velocities alone have been
    fitted, the linear model still says by how much all is early, by the positions."""
    hidden = {"imu_time_offset": {"s": 0.12}, "gnss_velocity_latency": {"s": 0.8}}
    opened = open_drive(simulated(hidden), MODEL.options)
    late = Fitted(MODEL, {}, (fit_drive(opened, MODEL),))
    late = fitted_about(MODEL, {"gnss_velocity_latency": 5.0}, late.fits)
    values = late.values()
    held = fit_drive(opened, replace(MODEL, values=values), linearised_at=late.fits[0])
    names = ["imu_time_offset", "gnss_velocity_latency"]
    linear = linearised(motions_of([held]), lambda at: named_columns(names, at), values)
    both = conditional(linear, Given((0, 1), (0.2, 2.0)))
    sd = 1.0 / np.sqrt(conditional(linear, Given((1,), (2.0,))).diagonal[0])
    assert both.value[0] == pytest.approx(0.12, abs=0.02)
    # velocities say the sum of both, and of one alone nothing
    known = Given((1,), (1e3,))
    (rows,) = linear.rows
    alone = rows.phi[:, 0] - rows.phi[:, 1] * conditional(linear, known).weights[0, 0]
    told = np.isin(rows.channel, range(CH_VEL, CH_VEL + 3))
    assert np.sum(alone[told] ** 2) < 0.1 * np.sum(alone**2)
    assert 0.001 < sd < 0.02


@pytest.mark.parametrize("axis", [0, 1])
def test_an_antenna_swings_as_late_velocities_saw_it(axis: int) -> None:
    """What an arm adds to late velocities, as they are told with it and without it."""
    late = {"gnss_velocity_latency": {"s": 0.8}, "gnss_course_latency": {"s": -0.3}}
    opened = open_drive(simulated(late), MODEL.options)
    model = replace(MODEL, values=late)
    (at,) = motions_of([fit_drive(opened, model)])
    column = named_columns(["gnss_lever_arm"], at)[axis]
    assert column.direct is not None
    told = column.direct.by_channel[:, CH_VEL : CH_VEL + 2]
    motion = at.motion
    arm = 0.1 * np.eye(3)[axis]
    numeric = []
    for one in (arm, -arm):
        vel, _ = moving_antenna(motion, one)
        seen = at_times(motion, vel, motion.t - 0.8)
        numeric.append(with_courses(seen, at_times(motion, vel, motion.t - 0.5)))
    expected = at_times(motion, (numeric[0] - numeric[1]) / 0.2, at.t)[:, :2]
    moving = np.hypot(*at_times(motion, motion.vel, at.t)[:, :2].T) > 4.0
    moving &= np.hypot(*at_times(motion, motion.vel, at.t - 0.8)[:, :2].T) > 4.0
    off = np.std((told - expected)[moving]) / np.std(expected[moving])
    assert np.std(expected[moving]) > 0.02
    assert off < 0.1


def test_an_arm_beside_late_velocities_is_where_the_drive_is_likeliest() -> None:
    """Late velocities swing as the car turned then. Multiplied with how it turns at their tag, an
    arm that is right was told 0.37 +- 0.07 m further forward, where drives are less likely."""
    late = {"gnss_velocity_latency": {"s": 0.3}}
    opened = open_drive(simulated(late), MODEL.options)
    model = replace(MODEL, values=late)
    free = fit_drive(opened, model, {"gnss_lever_arm": 1.0}, fit_drive(opened, model))
    x, sd = estimates(free, "gnss_lever_arm")["x"]
    arm = value_of(free, "gnss_lever_arm")

    def held(more: float) -> float:
        values = {**late, "gnss_lever_arm": {**arm, "x": x + more}}
        return fit_drive(opened, replace(model, values=values), linearised_at=free).score

    assert abs(x) < 2.0 * sd < 0.3
    step = 4.0 * sd
    here, further, nearer = (held(more) for more in (0.0, step, -step))
    slope, drop = 0.5 * (further - nearer), here - 0.5 * (further + nearer)
    assert drop > 0.0
    # off the top by less than half a sigma
    assert abs(0.5 * slope / drop) * step < 0.5 * sd


def test_an_antenna_that_slid_swings_late_velocities_as_the_car_turned_then() -> None:
    late = {"gnss_velocity_latency": {"s": 0.8}}
    slid = {"k": {"on": "antenna_x", "formula": "step(time - 60)", "prior_sd": 0.5}}
    set_user_effects(effects_of_formulas({"slid": slid}, "x"))
    try:
        opened = open_drive(simulated({**late, "slid": {"k": 1.0}}), MODEL.options)
        model = replace(MODEL, values=late)
        fit = fit_drive(opened, model, {"slid": 1.0}, fit_drive(opened, model))
        k, sd = estimates(fit, "slid")["k"]
    finally:
        set_user_effects([])
    assert sd < 0.1
    # as the car turned at the tag it was 0.68
    assert abs(k - 1.0) < 3.0 * sd


def test_what_follows_the_speed_follows_it_at_once_beside_late_velocities() -> None:
    """An accelerometer that reads more with the speed squared, of which late velocities tell 0.8 s
    later: k v(t - 0.8)^2 lacks 1.6 k v a, a coupling of the axes that grows with the speed."""
    wrong = {"speed_vibration": {"z": 1e-3}, "gnss_velocity_latency": {"s": 0.8}}
    estimate = {**dict.fromkeys(wrong, 5.0), "accel_misalignment": 1.0}
    fit = fit_drive(open_drive(simulated(wrong), MODEL.options), MODEL, estimate)
    value, sd = estimates(fit, "speed_vibration")["z"]
    assert value == pytest.approx(1e-3, abs=3.0 * sd)
    value, sd = estimates(fit, "accel_misalignment")["zx"]
    assert abs(value) < 3.0 * sd
