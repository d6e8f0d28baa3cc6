"""From fixes to nodes and the start: what is trusted how much, and where a drive begins."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pymap3d
import pytest

from automap.fusion import limits
from automap.fusion.alignment import start_state
from automap.fusion.layout import CHANNELS, NHC, ODOMETER, STANDSTILL, UNSIGNED, WHEEL_SPEED
from automap.fusion.measurements.velocity import told_later
from automap.fusion.measurements.wheel_speed import Odometer
from automap.fusion.model import build_state_model
from automap.fusion.nodes import (
    Nodes,
    Shift,
    _node_times,
    build_nodes,
    model_fixes,
)
from automap.fusion.options import FusionOptions
from automap.fusion.passes import rate_of_turn
from automap.fusion.problem import make_problem
from automap.records import Fixes, FixType, ImuData
from tests.unit.fusion_drive import BASE_NS, PERFECT, record
from tests.unit.fusion_motion import city_drive, make_motion
from tests.unit.fusion_receiver import GPS0, Receiver, receive, select

OPTIONS = FusionOptions(
    effects=(),
    zero_velocity_sd=0.021,
    zero_rate_sd=0.0017,
    nhc_sd=0.05,
    nhc_slip=0.04,
    odometer_sd=0.06,
    min_velocity_sd=0.001,
)
SD_POS, SD_VEL = np.array([1.1, 1.7, 2.9]), np.array([0.11, 0.17, 0.29])
WORSE = {
    FixType.DEAD_RECKONING: 5.0,
    FixType.TWO_D: 2.0,
    FixType.THREE_D: 1.0,
    FixType.DGNSS: 1.0,
    FixType.FLOAT: 1.0,
    FixType.FIXED: 1.0,
}


def _fixes(kind: FixType = FixType.THREE_D) -> Fixes:
    """Fixes of a drive with a figure of its own for every axis."""
    fixes = receive(city_drive(30.0, 3), Receiver(), 1)
    n = len(fixes)
    return replace(
        fixes,
        sd_pos_ned=np.tile(SD_POS, (n, 1)),
        sd_vel_ned=np.tile(SD_VEL, (n, 1)),
        fix_type=np.full(n, kind, np.int64),
    )


@pytest.mark.parametrize("kind", WORSE)
def test_a_poorer_kind_of_fix_is_trusted_less_in_position_and_velocity(kind: FixType) -> None:
    fixes = _fixes(kind)
    model = model_fixes(fixes, fixes.gps_s - GPS0, OPTIONS)
    sd = np.sqrt(model.white_var)
    stated = np.broadcast_to(WORSE[kind] * SD_VEL, (len(sd), 3))
    assert sd[:, 3:] == pytest.approx(stated)
    carrier = kind in (FixType.FLOAT, FixType.FIXED)
    share = 1.0 if carrier else OPTIONS.white_share
    stated = np.broadcast_to(WORSE[kind] * SD_POS, (len(sd), 3))
    assert sd[:, :3] == pytest.approx(share * stated)
    assert model.stated_sd == pytest.approx(stated)


def test_a_velocity_without_a_figure_is_worse_with_a_poorer_fix_too() -> None:
    sds = []
    for kind in (FixType.THREE_D, FixType.DEAD_RECKONING):
        fixes = replace(_fixes(kind), sd_vel_ned=np.full((len(_fixes()), 3), np.nan))
        sds.append(np.sqrt(model_fixes(fixes, fixes.gps_s - GPS0, OPTIONS).white_var[:, 3:]))
    assert sds[1] == pytest.approx(5.0 * sds[0])


def _by_channel(nodes: Nodes) -> dict[str, np.ndarray]:
    return dict(zip(CHANNELS, nodes.var.T, strict=True))


def test_every_channel_has_the_variance_that_was_stated_for_it() -> None:
    fixes = _fixes()
    model = model_fixes(fixes, fixes.gps_s - GPS0, OPTIONS)
    speed_t = np.arange(0.0, 31.0)
    lateral = np.linspace(0.0, 3.0, len(speed_t))
    told_t = np.arange(0.123, 30.5, 0.35)
    wheels = Odometer(told_t, 10.0 + 0.5 * told_t, np.linspace(0.01, 0.02, len(told_t)))
    speed = np.full(len(speed_t), 12.0)
    shift = Shift(wheels_s=0.07)
    nodes = build_nodes(
        model, shift, (0.0, 29.9), [(4.05, 9.05)], speed_t, speed, lateral, wheels, OPTIONS, True
    )
    var = _by_channel(nodes)
    fix = nodes.fix_row >= 0
    for axis, name in enumerate("ned"):
        stated = (OPTIONS.white_share * SD_POS[axis]) ** 2
        assert var[f"position_{name}"][fix] == pytest.approx(stated)
        assert var[f"velocity_{name}"][fix] == pytest.approx(SD_VEL[axis] ** 2)
    # what is assumed holds for a second: nodes five times a second carry a fifth of it each
    rows = fix & (nodes.t > 0.5)
    spacing = np.diff(nodes.t, prepend=np.nan)[rows]
    for name in ("zupt_n", "zupt_e", "zupt_d"):
        assert var[name][rows] == pytest.approx(OPTIONS.zero_velocity_sd**2 / spacing)
    for name in ("zaru_x", "zaru_y", "zaru_z"):
        assert var[name][rows] == pytest.approx(OPTIONS.zero_rate_sd**2 / spacing)
    slip = OPTIONS.nhc_slip * np.interp(nodes.t[rows], speed_t, lateral)
    own = OPTIONS.nhc_sd**2 + slip**2
    assert var["nhc_y"][rows] == pytest.approx(own / spacing)
    assert var["nhc_z"][rows] == pytest.approx(4.0 * own / spacing)
    # each wheel speed at the instant that it tells of
    told = (nodes.flags & ODOMETER) > 0
    used = told_t - 0.07 <= 29.9
    assert nodes.t[told] == pytest.approx(told_t[used] - 0.07)
    assert nodes.values[told, WHEEL_SPEED] == pytest.approx(wheels.speed[used])
    assert var["odometer"][told] == pytest.approx(wheels.var[used])
    assert (((nodes.flags & UNSIGNED) > 0) == told).all()
    assert np.diff(nodes.t).max() < 0.5 + 1e-9
    still = (nodes.t >= 4.05) & (nodes.t <= 9.05)
    assert (((nodes.flags & STANDSTILL) > 0) == still).all()
    assert (((nodes.flags & NHC) > 0) == ~still).all()


def _turning(bias: float) -> tuple[ImuData, np.ndarray, np.ndarray]:
    """Twenty metres a second straight ahead but for one bend of 0.1 rad/s, by a gyro that is
    off by ``bias`` about all axes."""
    motion = make_motion([(0.0, 20.0)], [(40.0, 10.0, float(np.degrees(1.0)))], 100.0, slope=0.0)
    imu = record(motion, replace(PERFECT, gyro_bias=(bias, -bias, bias)), 0, rate=50.0)
    return imu, (imu.t_ns - BASE_NS) * 1e-9, motion.at(np.arange(100.0)).vel


def test_lateral_acceleration_is_that_of_the_bend_whatever_the_gyros_bias() -> None:
    imu, t, vel = _turning(0.05)
    speed = np.linalg.norm(vel, axis=1)
    found = speed * rate_of_turn(t, imu.gyro)[::50][:100]
    assert found[42:48] == pytest.approx(2.0, rel=0.05)
    assert np.abs(found[5:38]).max() < 0.1
    assert np.abs(found[55:95]).max() < 0.1
    plain, t, _ = _turning(0.0)
    assert found == pytest.approx(speed * rate_of_turn(t, plain.gyro)[::50][:100], abs=1e-9)


@pytest.mark.parametrize("lat_deg", [-60.0, 10.0, 68.0])
def test_a_start_before_the_first_fix_lies_where_the_vehicle_came_from(lat_deg: float) -> None:
    """Four seconds at 15 m/s to the north-east: 60 m, of them 42 m to the east."""
    motion = make_motion(
        [(0.0, 15.0)], [], 20.0, origin_deg=(lat_deg, 24.0, 100.0), heading_deg=45.0, slope=0.0
    )
    imu = record(motion, PERFECT, 0, rate=50.0)
    quiet = Receiver(wander=(0.0,) * 3, white=(0.0,) * 3, velocity=0.0)
    fixes = receive(motion, quiet, 0)
    fixes = select(fixes, fixes.gps_s - GPS0 >= 4.0)
    problem = make_problem(imu, build_state_model(OPTIONS), OPTIONS)
    model = model_fixes(fixes, fixes.gps_s - GPS0, OPTIONS)
    true = motion.at(np.zeros(1))
    start = start_state(problem, model, 0.0, true.c_n_b[0], np.full(3, 0.1))
    ned = np.array(
        pymap3d.geodetic2ned(
            *start.nominal[:3], true.lat[0], true.lon[0], true.height[0], deg=False
        )
    )
    # the Earth is taken as a sphere: half a percent of 60 m
    assert np.abs(ned).max() < 0.5
    assert (np.abs(ned) < start.sd[:3]).all()
    assert start.nominal[3:6] == pytest.approx(true.vel[0], abs=0.01)


@pytest.mark.parametrize("velocity_late", [0.0, 0.3])
def test_velocities_are_metres_a_second_of_the_clock_that_the_nodes_are_on(
    velocity_late: float,
) -> None:
    skew = 0.02
    fixes = receive(city_drive(30.0, 3), Receiver(), 1)
    model = model_fixes(fixes, fixes.gps_s - GPS0, OPTIONS)
    shift = Shift(skew=skew, vel_latency_s=velocity_late)
    still = np.zeros(0)
    nodes = build_nodes(model, shift, (0.0, 30.0), [], still, still, still, None, OPTIONS, False)
    moving = np.hypot(nodes.values[:, 3], nodes.values[:, 4]) > 1.0
    own = np.array([np.flatnonzero(model.row == row)[0] for row in nodes.fix_row[moving]])
    assert moving.sum() > 5
    # a step of the path is the same in metres, and takes a fast clock longer
    assert nodes.values[moving, 3:6] * (1.0 + skew) == pytest.approx(model.values[own, 3:6])
    np.testing.assert_array_equal(nodes.values[moving, :3], model.values[own, :3])


@pytest.mark.parametrize("seed", range(4))
def test_nodes_are_the_instants_of_all_that_was_measured_and_no_further_apart(seed: int) -> None:
    """Against sets of instants; a fix and a wheel speed of one instant are two nodes."""
    rng = np.random.default_rng(seed)
    most = limits.MAX_NODE_SPACING_S
    fixes = np.round(np.sort(rng.uniform(0.0, 30.0, 15)), 1)
    fixes[5:] += 4.0
    wheels = np.round(np.sort(rng.uniform(0.0, 34.0, 20)), 1) + (0.03 if seed % 2 else 0.0)
    span = (3.0, 32.4)
    t, row, wheel_row = _node_times(fixes, wheels, span)
    inside = [np.flatnonzero((v >= 3.0) & (v <= 32.4)) for v in (fixes, wheels)]
    # each once, at its own instant
    for found, of, where in zip((row, wheel_row), inside, (fixes, wheels), strict=True):
        assert sorted(found[found >= 0]) == of.tolist()
        np.testing.assert_array_equal(t[found >= 0], where[found[found >= 0]])
    assert not ((row >= 0) & (wheel_row >= 0)).any()
    told = np.unique(np.concatenate([fixes[inside[0]], wheels[inside[1]], span]))
    assert (t[0], t[-1]) == span
    apart = np.diff(t)
    assert apart.min() >= 0.0
    assert apart.max() <= most + 1e-9
    # what stands for nothing lies between instants at equal steps, as few as there can be
    filler = (row < 0) & (wheel_row < 0) & ~np.isin(t, told)
    for a, b in pairwise(told):
        between = t[filler & (t > a) & (t < b)]
        count = int(np.ceil((b - a) / most - 1e-9))
        assert between == pytest.approx(np.linspace(a, b, count + 1)[1:-1])
    # an end of the span at which something was measured is no node of its own
    alone = np.sum((row < 0) & (wheel_row < 0) & ~filler)
    assert alone == 2 - np.isin(span, np.concatenate([fixes, wheels])).sum()


def test_late_courses_are_put_where_they_belong() -> None:
    """Of bends and stops those of 0.8 s later; at rest, where a course is anything, none is."""
    motion = city_drive(120.0, 3)
    fixes = receive(motion, Receiver(rate=5.0), 1)
    t = fixes.gps_s - GPS0
    right, before = motion.velocity(t), motion.velocity(np.maximum(t - 0.8, 0.0))
    speed, late = np.hypot(right[:, 0], right[:, 1]), right.copy()
    course = np.arctan2(before[:, 1], before[:, 0])
    course[speed < 0.3] = np.random.default_rng(2).uniform(-np.pi, np.pi, (speed < 0.3).sum())
    late[:, 0], late[:, 1] = speed * np.cos(course), speed * np.sin(course)
    model = model_fixes(replace(fixes, vel_ned=late), t, OPTIONS)
    dated = told_later(model.t, model.values[:, 3:5], 0.0, 0.8)
    drives = (speed > 2.0) & (t < t[-1] - 1.0)
    off = np.linalg.norm(dated - right[:, :2], axis=1)[drives]
    assert np.quantile(off, 0.95) < 0.1
    told = np.linalg.norm(late[:, :2] - right[:, :2], axis=1)[drives]
    assert np.quantile(told, 0.95) > 1.0
    assert np.linalg.norm(dated, axis=1) == pytest.approx(speed, abs=1e-9)
