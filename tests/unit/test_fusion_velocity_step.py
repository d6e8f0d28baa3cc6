"""Jumps of the receiver's velocity that the IMU does not feel are told, and what receivers do by
themselves is not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from automap.frames import matrix_to_rpy
from automap.fusion.doubts import limits
from automap.fusion.doubts.velocity_step import (
    Step,
    compare,
    led_away,
    step_doubts,
    velocity_steps,
)
from automap.fusion.free_inertial import FreeInertial, free_inertial
from automap.fusion.options import FusionOptions
from automap.records import Fixes, FloatArray, ImuData, Trajectory
from tests.unit.fusion_drive import BASE_NS, PERFECT, Sensor, record
from tests.unit.fusion_motion import Motion, city_drive
from tests.unit.fusion_receiver import GPS0, WHITE, Receiver, receive, receiver_named, shifted

LASTING_SD = FusionOptions().velocity_wander_sd
DURATION = 240.0


@cache
def drive(seed: int = 3) -> tuple[Motion, ImuData]:
    motion = city_drive(DURATION, seed)
    return motion, record(motion, Sensor(), seed)


def path_of(motion: Motion, imu: ImuData, off_rad: tuple[float, float, float]) -> Trajectory:
    """The true path with an attitude that is off by roll, pitch and heading."""
    t = (imu.t_ns - BASE_NS) * 1e-9
    true = motion.at(t)
    three = np.zeros((len(t), 3))
    return Trajectory(
        *(imu.t_ns, GPS0 + t, true.lat, true.lon, true.height, true.vel),
        *(matrix_to_rpy(true.c_n_b) + np.array(off_rad), three, three, three),
    )


def free_of(imu: ImuData) -> FreeInertial:
    t = (imu.t_ns - BASE_NS) * 1e-9
    return free_inertial(t, imu.gyro, imu.accel, np.zeros(len(t)))


def steps_of(
    motion: Motion,
    imu: ImuData,
    fixes: Fixes,
    off_rad: tuple[float, float, float] = (0.02, -0.02, 0.03),
    found: dict[str, tuple[float, float]] | None = None,
) -> list[Step]:
    path = path_of(motion, imu, off_rad)
    seen = compare(free_of(imu), fixes, path, found or {}, np.zeros(3))
    return velocity_steps(seen, LASTING_SD)


def led(fixes: Fixes, metres: Callable[[FloatArray], FloatArray]) -> Fixes:
    """Fixes that go away north, positions and velocities together, by ``metres`` of the seconds."""
    t = fixes.gps_s - GPS0
    away = np.zeros((len(t), 3))
    away[:, 0] = metres(t)
    velocity = fixes.vel_ned.copy()
    velocity[:, 0] += (metres(t + 0.01) - metres(t - 0.01)) / 0.02
    return replace(shifted(fixes, away), vel_ned=velocity)


def stays(t: FloatArray) -> FloatArray:
    return np.asarray(50.0 * np.clip((t - 100.3) / 15.0, 0.0, 1.0))


def comes_back(t: FloatArray) -> FloatArray:
    return np.asarray(50.0 * np.clip(1.0 - np.abs(t - 115.3) / 15.0, 0.0, 1.0))


# readings by themselves


def test_readings_by_themselves_give_the_motion_but_for_its_start_and_gravity() -> None:
    motion = city_drive(60.0, 4)
    imu = record(motion, PERFECT, 4)
    free = free_of(imu)
    true = motion.at(free.t)
    arm = np.array([0.8, -0.3, -1.2])
    velocity, position = free.of_point(free.t, arm)
    antenna = true.vel + np.einsum("nij,nj->ni", true.c_n_b, np.cross(true.turn, arm))
    # a second difference over three seconds has neither; gravity stays in it
    span = 300
    turned = true.c_n_b[0].T

    def bend(x: FloatArray) -> FloatArray:
        return np.asarray(x[2 * span :] - 2.0 * x[span:-span] + x[: -2 * span])

    assert np.abs(bend(velocity) - bend(antenna) @ turned.T).max() < 0.02
    place = true.c_n_b @ arm + np.cumsum(true.vel, axis=0) * 0.01
    still = bend(position) - bend(place) @ turned.T
    # the Earth turns gravity by 0.004 rad in a minute
    assert np.abs(still - still.mean(axis=0)).max() < 0.5 * 0.0045 * 9.8 * 3.0**2
    assert np.abs(bend(place)).max() > 5.0


def test_gaps_and_bridges_are_lost_seconds() -> None:
    _, imu = drive()
    t = (imu.t_ns - BASE_NS) * 1e-9
    keep = (t < 50.0) | (t > 51.0)
    bridged = np.where((t >= 80.0) & (t < 82.0), 2.0, 0.0)
    free = free_inertial(t[keep], imu.gyro[keep], imu.accel[keep], bridged[keep])
    lost = free.lost_between(np.array([10.0, 49.0, 79.0, -1.0]), np.array([20.0, 52.0, 83.0, 5.0]))
    assert lost == pytest.approx([0.0, 1.01, 2.0, np.inf], abs=0.02)


# what receivers do by themselves


@pytest.mark.parametrize("name", [WHITE, "phone", "u-blox"])
@pytest.mark.parametrize("seed", range(4))
def test_a_sound_receiver_steps_nowhere(name: str, seed: int) -> None:
    motion, imu = drive(seed)
    receiver = receiver_named(name)
    age = {
        "gnss_latency_s": (receiver.latency, 0.0),
        "gnss_velocity_latency_s": (receiver.latency + receiver.vel_latency, 0.0),
    }
    assert steps_of(motion, imu, receive(motion, receiver, seed), found=age) == []


def test_late_velocities_and_a_wrong_attitude_are_no_steps() -> None:
    motion, imu = drive()
    fixes = receive(motion, Receiver(rate=1.0, vel_latency=0.3, course_latency=0.3), 1)
    assert steps_of(motion, imu, fixes, (0.05, 0.05, 0.1)) == []


@pytest.mark.parametrize("rate", [1.0, 5.0])
def test_a_wild_velocity_and_velocities_that_positions_deny_are_no_steps(rate: float) -> None:
    motion, imu = drive()
    fixes = receive(motion, Receiver(rate=rate), 1)
    t, velocity = fixes.gps_s - GPS0, fixes.vel_ned.copy()
    velocity[np.searchsorted(t, [60.0, 100.0, 150.0]), 0] += 8.0
    assert steps_of(motion, imu, replace(fixes, vel_ned=velocity)) == []
    velocity[(t > 180.0) & (t < 190.0), 1] += 4.0
    assert steps_of(motion, imu, replace(fixes, vel_ned=velocity)) == []


# what they do not


@pytest.mark.parametrize("rate", [1.0, 5.0, 10.0])
def test_a_receiver_that_is_led_away_jumps_where_it_begins_and_ends(rate: float) -> None:
    motion, imu = drive()
    fixes = led(receive(motion, Receiver(rate=rate), 1), stays)
    first, second = steps_of(motion, imu, fixes)
    assert first.t == pytest.approx(100.3, abs=0.6 / rate)
    assert second.t == pytest.approx(115.3, abs=0.6 / rate)
    assert first.jump == pytest.approx([50.0 / 15.0, 0.0], abs=0.6)
    assert second.jump == pytest.approx([-50.0 / 15.0, 0.0], abs=0.6)
    there, since = step_doubts([first, second], path_of(motion, imu, (0.0, 0.0, 0.0)))
    assert there.code == since.code == "velocity_step"
    assert there.spans == ((first.t, second.t),)
    assert since.spans == ()
    assert there.error_m == since.error_m == pytest.approx(50.0, abs=6.0)
    assert "jumps 2 times, by up to 3." in there.text


def test_where_it_comes_back_the_rest_is_doubted_by_little() -> None:
    motion, imu = drive()
    fixes = led(receive(motion, Receiver(), 1), comes_back)
    steps = steps_of(motion, imu, fixes)
    assert [round(step.t) for step in steps] == [100, 115, 130]
    there, since = step_doubts(steps, path_of(motion, imu, (0.0, 0.0, 0.0)))
    ((begin, end),) = there.spans
    assert begin == pytest.approx(100.3, abs=0.3)
    assert end == pytest.approx(130.3, abs=0.3)
    assert there.error_m == pytest.approx(50.0, abs=6.0)
    assert since.error_m < 6.0


def test_across_a_gap_of_either_nothing_is_said() -> None:
    motion, imu = drive()
    fixes = led(receive(motion, Receiver(), 1), stays)
    t = (imu.t_ns - BASE_NS) * 1e-9
    keep = (np.abs(t - 100.3) > 0.5) & (np.abs(t - 115.3) > 0.5)
    holed = replace(imu, t_ns=imu.t_ns[keep], gyro=imu.gyro[keep], accel=imu.accel[keep])
    assert steps_of(motion, holed, fixes) == []
    at = fixes.gps_s - GPS0
    near = (np.abs(at - 100.3) < 1.0) | (np.abs(at - 115.3) < 1.0)
    lat = np.where(near, np.nan, fixes.lat_rad)
    assert steps_of(motion, imu, replace(fixes, lat_rad=lat)) == []


def test_too_few_fixes_say_nothing() -> None:
    motion, imu = drive()
    slow = led(receive(motion, Receiver(rate=0.5), 1), stays)
    assert steps_of(motion, imu, slow) == []
    nothing = replace(slow, vel_ned=np.full_like(slow.vel_ned, np.nan))
    assert steps_of(motion, imu, nothing) == []


# what steps make of the positions


def step(t: float, north: float, lasts: float = limits.STEP_WINDOW_S) -> Step:
    return Step(t, np.array([north, 0.0]), lasts)


def test_a_jump_that_nothing_takes_back_counts_while_it_is_seen() -> None:
    alone = led_away([step(50.0, 4.0, 20.0)], 300.0)
    assert (alone.most_m, alone.spans, alone.left_m) == (80.0, ((30.0, 70.0),), 80.0)
    # one that is not seen to last moves nothing for long
    short = led_away([step(50.0, 4.0)], 300.0)
    assert (short.most_m, short.spans, short.left_m) == (12.0, ((47.0, 53.0),), 0.0)
    # a drive may end before
    assert led_away([step(290.0, 4.0, 20.0)], 300.0).most_m == 40.0


def test_two_excursions_are_two_spans() -> None:
    steps = [step(50.0, 3.0), step(60.0, -3.1), step(200.0, -2.0), step(215.0, 2.0)]
    two = led_away(steps, 300.0)
    assert two.spans == ((50.0, 60.0), (200.0, 215.0))
    assert (two.most_m, two.left_m) == pytest.approx((30.0, 0.0))
    assert led_away(steps[:2], 300.0).left_m == pytest.approx(30.0)


def test_without_a_step_there_is_no_reason() -> None:
    motion, imu = drive()
    assert step_doubts([], path_of(motion, imu, (0.0, 0.0, 0.0))) == []
