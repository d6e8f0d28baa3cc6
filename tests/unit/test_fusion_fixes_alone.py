"""The smoother of fixes alone against the solution of all its equations at once."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pymap3d
import pytest

from automap.fusion.gnss_only import (
    as_old_as,
    as_sure_as_fixes,
    course_errors,
    smooth_fixes,
)
from automap.fusion.limits import (
    FIX_AGE_SD_S,
    ROAD_ACCELERATION_PSD,
    UNKNOWN_HEADING_SD,
    UNKNOWN_LEAN_SD,
)
from automap.fusion.options import FusionOptions
from automap.fusion.result import Prior
from automap.fusion.verdict_alone import weigh_alone
from automap.records import Fixes, FixType, FloatArray
from automap.sync.velocity_consistency import velocity_consistency
from pipeline.run.fusion_inputs import delay_of_arrivals
from tests.unit.fusion_drive import CLOCK
from tests.unit.fusion_motion import city_drive
from tests.unit.fusion_receiver import Receiver, receive, select

ORIGIN = (56.0, 10.0, 40.0)
TAU_S, WANDER, QUICK, WHITE, BIAS = 7.0, 0.7, 0.35, 0.3, 0.6
VELOCITY_TAU_S, VELOCITY_LASTS = 3.0, 0.2
"""The lasting error is larger than the white one on one axis, and smaller on two."""
OPTIONS = FusionOptions(
    wander_tau_s=TAU_S,
    wander_share=WANDER,
    multipath_share=QUICK,
    white_share=WHITE,
    bias_share=BIAS,
    velocity_wander_sd=VELOCITY_LASTS,
    velocity_wander_tau_s=VELOCITY_TAU_S,
)
SHARE = float(np.hypot(WANDER, QUICK))
"""Of what lasts, which a path of fixes alone takes for one error."""
SD_POS, SD_VEL = np.array([1.2, 1.9, 2.6]), np.array([0.15, 0.22, 0.4])
PRIOR = np.array([100.0, 30.0, 1.0, 1.0])


def _fixes(seed: int) -> Fixes:
    """Fixes at uneven times, some without velocity or its height, a figure for every axis."""
    motion = city_drive(25.0, 4, start_speed=9.0, origin_deg=ORIGIN)
    receiver = Receiver(rate=4.0, wander=tuple(SHARE * SD_POS), tau=TAU_S, velocity=0.1)
    fixes = receive(motion, receiver, seed)
    n = len(fixes)
    vel = fixes.vel_ned.copy()
    vel[7:30:6] = np.nan
    vel[5::4, 2] = np.nan
    # another figure for a while: the slow error grows in its own units
    worse = np.where((np.arange(n) > 40) & (np.arange(n) < 60), 1.5, 1.0)[:, None]
    fixes = replace(
        fixes, vel_ned=vel, sd_pos_ned=SD_POS * worse, sd_vel_ned=np.tile(SD_VEL, (n, 1))
    )
    keep = np.random.default_rng(seed).random(n) > 0.3
    keep[0] = True
    return select(fixes, keep)


def _all_at_once(
    t: FloatArray, z: FloatArray, var: FloatArray, lasting: FloatArray, psd: float
) -> tuple[FloatArray, FloatArray]:
    """Position and velocity [k, 2] with their sd: prior, white acceleration between the epochs,
    lasting errors of unit size, and the measurements ``z`` [k, 2] (NaN none), all in one system of
    normal equations."""
    k = len(t)
    information, right = np.zeros((4 * k, 4 * k)), np.zeros(4 * k)
    information[:4, :4] = np.diag(1.0 / PRIOR**2)
    right[0] = z[0, 0] / PRIOR[0] ** 2
    for i in range(1, k):
        dt = t[i] - t[i - 1]
        keep = np.exp(-dt / np.array([TAU_S, VELOCITY_TAU_S]))
        f = np.diag([1.0, 1.0, *keep])
        f[0, 1] = dt
        q = np.diag([0.0, 0.0, *(1.0 - keep**2)])
        q[:2, :2] = psd * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
        both = np.hstack([-f, np.eye(4)])
        at = slice(4 * i - 4, 4 * i + 4)
        information[at, at] += both.T @ np.linalg.solve(q, both)
    for i in range(k):
        rows = [1.0, 0.0, lasting[i, 0], 0.0], [0.0, 1.0, 0.0, lasting[i, 1]]
        for m, h in enumerate(rows):
            if np.isfinite(z[i, m]):
                at = slice(4 * i, 4 * i + 4)
                information[at, at] += np.outer(h, h) / var[i, m]
                right[at] += np.array(h) * z[i, m] / var[i, m]
    cov = np.linalg.inv(information)
    x, sd = (cov @ right).reshape(k, 4), np.sqrt(np.diag(cov)).reshape(k, 4)
    return x[:, :2], sd[:, :2]


@pytest.mark.parametrize("seed", [0, 1])
def test_smoothed_fixes_are_the_solution_of_all_equations_at_once(seed: int) -> None:
    fixes = _fixes(seed)
    path = smooth_fixes(fixes, CLOCK, OPTIONS)
    assert len(path) == len(fixes)
    ref = (float(fixes.lat_rad[0]), float(fixes.lon_rad[0]), float(fixes.height_m[0]))
    ned = np.stack(
        pymap3d.geodetic2ned(fixes.lat_rad, fixes.lon_rad, fixes.height_m, *ref, deg=False), axis=1
    )
    got = np.stack(
        pymap3d.geodetic2ned(path.lat_rad, path.lon_rad, path.height_m, *ref, deg=False), axis=1
    )
    t = fixes.gps_s - fixes.gps_s[0]
    for axis in range(3):
        z = np.column_stack([ned[:, axis], fixes.vel_ned[:, axis]])
        var = np.column_stack([WHITE * fixes.sd_pos_ned[:, axis], fixes.sd_vel_ned[:, axis]]) ** 2
        velocity = np.maximum(fixes.sd_vel_ned[:, axis], VELOCITY_LASTS)
        lasting = np.column_stack([SHARE * fixes.sd_pos_ned[:, axis], velocity])
        x, sd = _all_at_once(t, z, var, lasting, ROAD_ACCELERATION_PSD[axis])
        # no fix tells of an error that all fixes have
        unseen = BIAS * fixes.sd_pos_ned[:, axis]
        assert path.sd_pos_ned[:, axis] == pytest.approx(np.hypot(sd[:, 0], unseen), rel=1e-5)
        assert path.sd_vel_ned[:, axis] == pytest.approx(sd[:, 1], rel=1e-5)
        assert np.abs((got[:, axis] - x[:, 0]) / sd[:, 0]).max() < 1e-4
        assert np.abs((path.vel_ned[:, axis] - x[:, 1]) / sd[:, 1]).max() < 1e-4
    course = np.arctan2(path.vel_ned[:, 1], path.vel_ned[:, 0])
    speed = np.hypot(*path.vel_ned[:, :2].T)
    fast = speed > 2.0
    assert path.rpy[fast, 2] == pytest.approx(course[fast])
    assert path.rpy[fast, 1] == pytest.approx(np.arctan2(-path.vel_ned[fast, 2], speed[fast]))


def test_a_fix_far_off_pulls_no_further_than_its_surprise() -> None:
    """One height of forty is 60 m too high: trusted less, it moves the path by less than a sigma
    of a plain fix, and the path is less sure there."""
    fixes = _fixes(0)
    plain = smooth_fixes(fixes, CLOCK, OPTIONS)
    height = fixes.height_m.copy()
    height[20] += 60.0
    pulled = smooth_fixes(replace(fixes, height_m=height), CLOCK, OPTIONS)
    moved = pulled.height_m - plain.height_m
    assert 0.0 < moved[20] < 2.0
    assert pulled.sd_pos_ned[20, 2] > plain.sd_pos_ned[20, 2]
    assert np.abs(moved[[0, -1]]).max() < 0.5 * moved[20]


def test_attitude_is_that_of_the_velocity_where_there_is_any() -> None:
    """Heading and pitch of a vehicle that drives where it looks, with the sigma of the heading by
    moving the velocity by its own; at rest they are held."""
    rng = np.random.default_rng(6)
    fixes = _fixes(3)
    n = len(fixes)
    # a climb of a tenth, north-eastwards, then a stop
    speed = np.where(np.arange(n) < n // 2, 12.0, 0.0)
    course = 1.1
    climb = 0.1 * speed
    vel = np.column_stack([speed * np.cos(course), speed * np.sin(course), -climb])
    t = fixes.gps_s - fixes.gps_s[0]
    way = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(t))])
    north, east, up = way * np.cos(course), way * np.sin(course), 0.1 * way
    lat, lon, height = pymap3d.ned2geodetic(north, east, -up, *ORIGIN)
    small = np.array([0.05, 0.4, 0.3])
    fixes = replace(
        fixes,
        lat_rad=np.radians(lat),
        lon_rad=np.radians(lon),
        height_m=np.asarray(height),
        vel_ned=vel,
        sd_vel_ned=np.tile(small, (n, 1)),
    )
    path = smooth_fixes(fixes, CLOCK, OPTIONS)
    driving = np.hypot(path.vel_ned[:, 0], path.vel_ned[:, 1]) > 11.0
    assert 10 < driving.sum() < n - 10
    v = path.vel_ned
    np.testing.assert_allclose(path.rpy[driving, 2], course, atol=0.05)
    np.testing.assert_allclose(path.rpy[driving, 1], np.arctan(0.1), atol=0.05)
    np.testing.assert_array_equal(path.rpy[:, 0], 0.0)
    still = np.hypot(v[:, 0], v[:, 1]) < 0.2
    assert still.any()
    assert np.ptp(path.rpy[still, 2]) == 0.0
    np.testing.assert_array_equal(path.rpy[still, 1], 0.0)
    for row in np.flatnonzero(driving)[::7]:
        level = np.hypot(*v[row, :2])
        # what the velocity errs by across its way, and what a vehicle slides
        moved = v[row, :2] + path.sd_vel_ned[row, :2] * rng.normal(size=(4000, 2))
        scatter = np.std(np.arctan2(moved[:, 1], moved[:, 0]))
        slides = OPTIONS.nhc_sd / level
        assert path.sd_rpy[row, 2] == pytest.approx(np.hypot(scatter, slides), rel=0.1)
    np.testing.assert_array_equal(path.sd_rpy[:, :2], UNKNOWN_LEAN_SD)
    # held, and as unsure as it was when the vehicle stopped
    slow = np.hypot(v[:, 0], v[:, 1]) <= 1.0
    last = np.flatnonzero(~slow)[-1]
    assert path.sd_rpy[slow, 2] == pytest.approx(path.sd_rpy[last, 2])
    assert path.sd_rpy[last, 2] < 0.5 < UNKNOWN_HEADING_SD


def test_a_course_in_a_bend_is_as_unsure_as_the_axle_is_far() -> None:
    """At 10 m/s in a bend of 20 m a nose 1.5 m ahead of the axle is turned by 1.5 / 20 rad, and
    tyres slide by what the lateral acceleration pushes; straight on neither is there."""
    t = np.arange(0.0, 10.0, 0.2)
    angle = np.where(t > 5.0, 0.5 * (t - 5.0), 0.0)
    velocity = 10.0 * np.column_stack([np.cos(angle), np.sin(angle)])
    sd = course_errors(t, velocity, np.zeros((len(t), 2)), FusionOptions())
    assert sd[10] == pytest.approx(0.04 / 10.0, rel=1e-6)
    bend = np.hypot(1.5 / 20.0, np.hypot(0.04, 0.03 * 5.0) / 10.0)
    assert sd[-5] == pytest.approx(bend, rel=0.01)


def test_a_heading_along_the_course_is_no_surer_than_a_nose_is_on_it() -> None:
    paths = [
        smooth_fixes(_fixes(0), CLOCK, replace(OPTIONS, nhc_lasting_deg=deg)) for deg in (0.0, 0.6)
    ]
    for path, slip in zip(paths, np.radians([0.0, 0.6]), strict=True):
        assert path.slip_sd == pytest.approx(slip)
        assert path.sd_rpy[:, 2] == pytest.approx(np.hypot(paths[0].sd_rpy[:, 2], slip))


def test_what_lasts_of_fixes_is_nowhere_averaged_away() -> None:
    fixes = replace(_fixes(3), sd_pos_ned=np.tile(SD_POS, (len(_fixes(3)), 1)))
    path = smooth_fixes(fixes, CLOCK, OPTIONS)
    path = replace(path, sd_pos_ned=path.sd_pos_ned.copy())
    path.sd_pos_ned[0] = 50.0
    held = as_sure_as_fixes(path, fixes, OPTIONS).sd_pos_ned
    left = max(1.0 - WANDER**2 - QUICK**2 - WHITE**2, BIAS**2)
    lasts = SD_POS * np.sqrt(SHARE**2 + left)
    assert held[0] == pytest.approx(50.0)
    assert np.all(held >= lasts * (1.0 - 1e-9))
    assert held[10] == pytest.approx(np.maximum(lasts, path.sd_pos_ned[10]))


@pytest.mark.slow
def test_a_path_of_fixes_alone_is_as_unsure_as_their_instants() -> None:
    """Nothing in it tells their age or the clock's delay: a motorway's was 2.6 sigmas off by it."""
    fixes = receive(city_drive(60.0, 4), Receiver(rate=5.0), 1)
    found = velocity_consistency(fixes)
    plain = weigh_alone(fixes, CLOCK, FusionOptions(), found).trajectory
    late = weigh_alone(fixes, CLOCK, FusionOptions(), found, delay=Prior(-0.1, 0.2)).trajectory
    assert (late.t_ns - plain.t_ns == -100_000_000).all()
    assert (late.gps_s == plain.gps_s).all()
    more = late.sd_pos_ned**2 - plain.sd_pos_ned**2
    assert more == pytest.approx((0.2 * late.vel_ned) ** 2, abs=1e-9)
    exact = replace(fixes, fix_type=np.full(len(fixes), FixType.FIXED))
    sure = weigh_alone(exact, CLOCK, FusionOptions(), found).trajectory
    still = as_old_as(sure, FIX_AGE_SD_S).sd_pos_ned
    assert still**2 - sure.sd_pos_ned**2 == pytest.approx((FIX_AGE_SD_S * sure.vel_ned) ** 2)


@pytest.mark.parametrize(("known", "mean"), [(None, -0.1), (0.07, 0.0)])
def test_arrivals_of_a_receiver_that_nobody_measured_are_late_by_the_usual(
    known: float | None, mean: float
) -> None:
    clock = replace(CLOCK, method="arrival", output_delay_s=known)
    delay = delay_of_arrivals(clock)
    assert (delay.mean, delay.sd > 0.0) == (mean, known is None)
