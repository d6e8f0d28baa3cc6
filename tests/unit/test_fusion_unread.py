"""Where a vehicle drove without inertial readings: holes, late, early, none at all."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from automap.earth import metres_per_radian
from automap.frames import wrap_pi
from automap.fusion.gnss_only import smooth_fixes
from automap.fusion.options import FusionOptions
from automap.fusion.unread import longest_trip, lost_holes, over_holes
from automap.fusion.verdict_alone import weigh_alone
from automap.fusion.weighed import Weighed
from automap.records import Fixes, FloatArray, ImuData, Trajectory
from automap.sync.velocity_consistency import velocity_consistency
from tests.unit.fusion_drive import CLOCK, Sensor, record
from tests.unit.fusion_motion import city_drive
from tests.unit.fusion_receiver import GPS0, Receiver, receive
from tests.unit.test_fusion_wrong_inputs import LEVER, fused


def without(*holes: tuple[float, float]) -> Callable[[ImuData], ImuData]:
    """What is left of the readings but for ``holes`` [s from the first]."""

    def left(imu: ImuData) -> ImuData:
        t = (imu.t_ns - imu.t_ns[0]) * 1e-9
        keep = np.ones(len(t), dtype=bool)
        for a, b in holes:
            keep &= (t < a) | (t > b)
        return replace(imu, t_ns=imu.t_ns[keep], gyro=imu.gyro[keep], accel=imu.accel[keep])

    return left


def off(path: Trajectory) -> FloatArray:
    """Errors [n, 6] of position, m, and velocity, m/s, NED."""
    truth = city_drive(180.0, 4).at(path.gps_s - GPS0)
    north, east = metres_per_radian(truth.lat, truth.height)
    place = (
        (path.lat_rad - truth.lat) * north,
        (path.lon_rad - truth.lon) * east,
        truth.height - path.height_m,
    )
    return np.column_stack([*place, path.vel_ned - truth.vel])


def yaw(gps_s: FloatArray) -> FloatArray:
    """True headings [n], rad."""
    turn = city_drive(180.0, 4).at(gps_s - GPS0).c_n_b
    return np.arctan2(turn[:, 1, 0], turn[:, 0, 0])


@pytest.mark.slow
def test_where_no_reading_is_the_path_is_that_of_the_fixes() -> None:
    """Readings of the middle third of a drive alone; beside its own rows the fixes' path has ones
    at the sensor, off by no more than it says."""
    motion = city_drive(180.0, 4)

    def middle(imu: ImuData) -> ImuData:
        rows = slice(len(imu.t_ns) // 3, 2 * len(imu.t_ns) // 3)
        return replace(imu, t_ns=imu.t_ns[rows], gyro=imu.gyro[rows], accel=imu.accel[rows])

    _, weighed = fused(Receiver(lever=LEVER), CLOCK, read=middle)
    path, read = weighed.trajectory, middle(record(motion, Sensor(), 4)).t_ns
    assert (np.diff(path.t_ns) > 0).all()
    beside = (path.t_ns < read[0]) | (path.t_ns > read[-1])
    assert np.isin(read, path.t_ns).all()
    assert path.gps_s[0] - GPS0 < 1.5
    assert path.gps_s[-1] - GPS0 > 178.0
    assert np.sqrt(np.mean((off(path)[:, :3] / path.sd_pos_ned)[beside] ** 2)) < 1.5
    speed = np.hypot(*motion.at(path.gps_s - GPS0).vel[:, :2].T)
    driven = np.sum(np.diff(path.gps_s, prepend=path.gps_s[0]) * speed * beside)
    assert weighed.unread_m == pytest.approx(driven, rel=0.05)


def test_a_hole_is_turned_through_as_the_fixes_are() -> None:
    """A line between its ends, both in a bend, would turn the vehicle by radians."""
    motion = city_drive(180.0, 4)
    imu = record(motion, Sensor(), 4)
    t = (imu.t_ns - imu.t_ns[0]) * 1e-9
    bends = t[np.abs(imu.gyro[:, 2]) > 0.8 * np.abs(imu.gyro[:, 2]).max()]
    first = float(bends[0])
    last = float(bends[bends > first + 20.0][0])
    left = without((first, last))(imu)
    fixes = receive(motion, Receiver(lever=LEVER), 5)
    alone = smooth_fixes(fixes, CLOCK, FusionOptions())
    whole, psd = over_holes(left, alone)
    made = ~np.isin(whole.t_ns, left.t_ns)
    assert made.sum() > 0.9 * (last - first)
    assert (psd[made] > 0.0).all()
    assert not psd[:-1][~made[:-1] & ~made[1:]].any()

    def turned(read: ImuData) -> float:
        at = (read.t_ns - imu.t_ns[0]) * 1e-9
        inside = (at > first - 1.0) & (at < last + 1.0)
        return float(np.trapezoid(read.gyro[inside, 2], at[inside]))

    assert turned(whole) == pytest.approx(turned(imu), abs=0.15)
    assert abs(turned(left) - turned(imu)) > 1.0


@pytest.mark.parametrize(("apart_s", "parked"), [(900.0, False), (900.0, True), (200.0, False)])
def test_of_two_trips_in_one_log_the_longer_is_read(apart_s: float, parked: bool) -> None:
    """Between which the vehicle drove on with its loggers off: behind 573 s nothing was finite."""
    imu = record(city_drive(180.0, 4), Sensor(), 4)
    fixes = receive(city_drive(180.0, 4), Receiver(lever=LEVER), 5)
    cut = int(imu.t_ns[0] + 110e9)
    first = CLOCK.t_ns(fixes.gps_s) < cut
    kept = first | (CLOCK.t_ns(fixes.gps_s) > cut + 20e9)
    log = Fixes(**{name: values[kept] for name, values in vars(fixes).items()})
    late = np.where(first[kept], 0.0, apart_s - 20.0)
    if parked:
        # it goes on where it stood
        last = np.flatnonzero(first[kept])[-1]
        places = (v - (late > 0.0) * (v[last + 1] - v[last]) for v in (log.lat_rad, log.lon_rad))
        log = replace(log, **dict(zip(("lat_rad", "lon_rad"), places, strict=True)))
    log = replace(log, gps_s=log.gps_s + late)
    rows = (imu.t_ns < cut) | (imu.t_ns > cut + 20e9)
    stamps = imu.t_ns + np.where(imu.t_ns < cut, 0, round((apart_s - 20.0) * 1e9))
    read = replace(imu, t_ns=stamps[rows], gyro=imu.gyro[rows], accel=imu.accel[rows])
    left, told = longest_trip(read, smooth_fixes(log, CLOCK, FusionOptions()))
    if parked or apart_s < 300.0:
        assert left is read
        assert told == []
        return
    assert left.t_ns[-1] < cut
    assert len(left) == np.count_nonzero(imu.t_ns < cut)
    (text,) = told
    assert text.startswith("for 15 min from ")
    # a trip without readings is not taken, be none driven faster than at walking pace
    second = read.at(slice(int(np.argmax(read.t_ns > cut)), None))
    alone = smooth_fixes(log, CLOCK, FusionOptions())
    slow = replace(alone, vel_ned=np.zeros_like(alone.vel_ned))
    assert len(longest_trip(second, slow)[0]) == len(second)
    # where nothing was driven behind the hole there is one trip
    places = log.gps_s[first[kept]], log.lat_rad[first[kept]], log.lon_rad[first[kept]]
    assert lost_holes(read.t_ns * 1e-9, *places, 1.3) == []


@pytest.mark.slow
@pytest.mark.parametrize("hole", [(2.0, 60.0), pytest.param((50.0, 178.0), marks=pytest.mark.slow)])
def test_a_few_readings_beside_a_long_hole_spoil_nothing(hole: tuple[float, float]) -> None:
    """Two seconds of readings, at rest or not, tell no heading."""
    _, weighed = fused(Receiver(lever=LEVER), CLOCK, read=without(hole))
    path = weighed.trajectory
    assert weighed.verdict.state == "good"
    assert not weighed.verdict.reasons
    assert np.degrees(np.sqrt(np.mean(wrap_pi(path.rpy[:, 2] - yaw(path.gps_s)) ** 2))) < 1.0


@pytest.mark.slow
def test_without_an_imu_the_path_is_that_of_the_point_that_arms_count_from() -> None:
    far = (2.4, 0.6, -1.5)
    fixes = receive(city_drive(180.0, 4), Receiver(lever=far), 5)
    receiver = velocity_consistency(fixes)

    def size(weighed: Weighed) -> FloatArray:
        path = weighed.trajectory
        moving = np.hypot(*path.vel_ned[:, :2].T) > 3.0
        return np.sqrt(np.mean(off(path)[moving] ** 2, axis=0))

    at_antenna = weigh_alone(fixes, CLOCK, FusionOptions(), receiver)
    at_sensor = weigh_alone(fixes, CLOCK, FusionOptions(), receiver, np.array(far))
    before, after = size(at_antenna), size(at_sensor)
    assert np.hypot(*before[:2]) > 2.0
    assert np.hypot(*after[:2]) < 0.6 * np.hypot(*before[:2])
    assert after[2] < before[2]
    assert np.hypot(*after[3:5]) < np.hypot(*before[3:5])
