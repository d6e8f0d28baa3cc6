"""Positions of two receivers, or of another point of the vehicle, beside the velocities of one."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from automap.earth import metres_per_radian
from automap.fusion.doubts.alternation import alternation
from automap.fusion.doubts.offsets import Offset, offset_doubts, offsets
from automap.fusion.doubts.receiver import accuracy_doubts
from automap.fusion.doubts.slow_drift import beside_motion
from automap.fusion.fix_axes import Epochs, usable_epochs, whitened_epochs
from automap.fusion.fix_levels import fix_levels
from automap.fusion.gnss_only import smooth_fixes
from automap.fusion.measurements.position import common_errors, position_errors
from automap.fusion.options import FusionOptions
from automap.fusion.verdict_alone import weigh_alone
from automap.fusion.weighed import Weighed
from automap.interpolation import Poses, poses_at_gps
from automap.records import BoolArray, Fixes, FixType, FloatArray, Trajectory
from automap.sync.velocity_consistency import velocity_consistency
from tests.unit.fusion_drive import CLOCK
from tests.unit.fusion_motion import city_drive
from tests.unit.fusion_receiver import GPS0, Receiver, receive

OPTIONS = FusionOptions()
PHONE = Receiver(rate=1.0, velocity=0.1, lasting=0.15, says_all=False)
U_BLOX = Receiver(rate=5.0)
EXACT = Receiver(rate=10.0, wander=(0.0,) * 3, white=(0.0,) * 3, velocity=0.0)


def drive(receiver: Receiver, seed: int) -> Fixes:
    return receive(city_drive(300.0, seed), receiver, seed + 1)


def moved(fixes: Fixes, rows: BoolArray, forward: float, right: float) -> Fixes:
    """Positions of ``rows`` [n] so many metres aside, as seen from the vehicle."""
    course = np.arctan2(fixes.vel_ned[:, 1], fixes.vel_ned[:, 0])
    slow = np.hypot(fixes.vel_ned[:, 0], fixes.vel_ned[:, 1]) < 1.0
    course[slow] = np.interp(fixes.gps_s[slow], fixes.gps_s[~slow], np.unwrap(course[~slow]))
    ahead = np.column_stack([np.cos(course), np.sin(course)])
    way = rows[:, None] * (forward * ahead + right * np.column_stack([-ahead[:, 1], ahead[:, 0]]))
    per_lat, per_lon = metres_per_radian(float(fixes.lat_rad[0]), 0.0)
    lat, lon = fixes.lat_rad + way[:, 0] / per_lat, fixes.lon_rad + way[:, 1] / per_lon
    return replace(fixes, lat_rad=lat, lon_rad=lon)


def every_second(fixes: Fixes) -> Fixes:
    return moved(fixes, np.arange(len(fixes)) % 2 == 1, 2.0, 2.0)


def every_second_a_little(fixes: Fixes) -> Fixes:
    """By less than the path is unsure by."""
    return moved(fixes, np.arange(len(fixes)) % 2 == 1, 0.5, 0.5)


def second_half(fixes: Fixes) -> Fixes:
    return moved(fixes, np.arange(len(fixes)) >= len(fixes) // 2, -3.0, 1.5)


def throughout(fixes: Fixes) -> Fixes:
    return moved(fixes, np.ones(len(fixes), np.bool_), 0.0, 4.0)


def seen(fixes: Fixes) -> tuple[float, Offset | None, Offset | None]:
    levels = fix_levels(fixes, OPTIONS)
    at = usable_epochs(fixes, OPTIONS)
    alone = smooth_fixes(fixes, CLOCK, OPTIONS, levels)
    return alternation(at, OPTIONS, levels), *offsets(at, alone, OPTIONS, levels)


@pytest.mark.parametrize("receiver", [PHONE, U_BLOX], ids=["phone", "u-blox"])
@pytest.mark.parametrize("seed", [21, 22, 23])
def test_a_sound_receiver_is_not_accused(receiver: Receiver, seed: int) -> None:
    assert seen(drive(receiver, seed)) == (0.0, None, None)


@pytest.mark.slow
def test_a_receiver_may_be_worse_at_every_second_fix_if_it_says_so() -> None:
    """Ambiguities that are fixed at one and float at the next, by an error that lasts seconds."""
    none = (0.0, 0.0, 0.0)
    fixes = drive(Receiver(wander=none, white=(0.012, 0.012, 0.02), velocity=0.05), 27)
    rows = np.arange(len(fixes)) % 2 == 1
    error = np.random.default_rng(28).normal(0.0, 0.15, (len(fixes), 2))
    error = lfilter([1.0], [1.0, -0.95], error, axis=0)
    per_lat, per_lon = metres_per_radian(float(fixes.lat_rad[0]), 0.0)
    fixes = replace(
        fixes,
        lat_rad=fixes.lat_rad + rows * error[:, 0] / per_lat,
        lon_rad=fixes.lon_rad + rows * error[:, 1] / per_lon,
        sd_pos_ned=np.where(rows, 1.5, 0.05)[:, None] + np.zeros(3),
    )
    assert seen(fixes)[0] == 0.0
    silent = replace(fixes, sd_pos_ned=np.full((len(fixes), 3), 0.3))
    assert seen(silent)[0] == pytest.approx(0.5 * np.sqrt((error**2).sum(axis=1).mean()), abs=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("receiver", [PHONE, U_BLOX], ids=["phone", "u-blox"])
def test_the_size_of_an_offset_is_found(receiver: Receiver) -> None:
    fixes = drive(receiver, 24)
    assert seen(every_second(fixes))[0] == pytest.approx(np.sqrt(2.0), abs=0.2)
    change = seen(second_half(fixes))[1]
    assert change is not None
    assert change.at_s == pytest.approx(150.0, abs=3.0)
    assert (change.forward, change.right) == pytest.approx((-3.0, 1.5), abs=1.2)
    # where it is known as a jump between places, these are told
    half, levels = second_half(fixes), fix_levels(second_half(fixes), OPTIONS)
    of = usable_epochs(half, OPTIONS), smooth_fixes(half, CLOCK, OPTIONS, levels), OPTIONS, levels
    assert [reason.code for reason in offset_doubts(*of, 0.1)] == ["positions_shift"]
    assert list(offset_doubts(*of, 0.1, [150.0])) == []
    none, other, aside = seen(throughout(fixes))
    assert aside is not None
    assert (none, other) == (0.0, None)
    assert aside.right == pytest.approx(4.0, abs=1.2)


def older(fixes: Fixes, from_s: float, seconds: float) -> Fixes:
    """Positions and velocities of so much before, from an instant on."""
    t, later = fixes.gps_s, fixes.gps_s - GPS0 > from_s

    def before(values: FloatArray) -> FloatArray:
        return np.where(later, np.interp(t - seconds, t, values), values)

    velocity = np.stack([before(column) for column in fixes.vel_ned.T], axis=1)
    return replace(
        fixes, lat_rad=before(fixes.lat_rad), lon_rad=before(fixes.lon_rad), vel_ned=velocity
    )


def test_fixes_that_become_older_are_told_without_an_imu_and_the_sigmas_hold_it() -> None:
    fixes = drive(U_BLOX, 26)
    late = older(fixes, 171.0, 0.4)
    change = seen(late)[1]
    assert change is not None
    assert change.at_s == pytest.approx(171.0, abs=1.0)
    # the jump itself is trusted less, so that it seems smaller
    assert 0.25 < change.older_s < 0.45
    weighed = weigh_alone(late, CLOCK, OPTIONS, velocity_consistency(late))
    (reason,) = weighed.verdict.reasons
    assert (reason.code, reason.state) == ("age_changes", "doubtful")
    assert "s older than before" in reason.text
    assert in_ellipses(weighed, 26) > 0.95


def in_ellipses(weighed: Weighed, seed: int) -> float:
    path = weighed.trajectory
    gps_s = path.gps_s[5:-5]
    at = poses_at_gps(path, gps_s)
    true = city_drive(300.0, seed).at(gps_s - GPS0)
    per_lat, per_lon = metres_per_radian(float(at.lat_rad[0]), 0.0)
    off: FloatArray = np.column_stack(
        [(at.lat_rad - true.lat) * per_lat, (at.lon_rad - true.lon) * per_lon]
    )
    return float(np.mean(((off / at.sd_pos_ned[:, :2]) ** 2).sum(axis=1) < 5.99))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("spoil", "code"),
    [
        (every_second, "fixes_alternate"),
        (every_second_a_little, "fixes_alternate"),
        (second_half, "positions_shift"),
        (throughout, "positions_beside"),
    ],
)
def test_what_lies_aside_is_told_and_the_sigmas_hold_it(
    spoil: Callable[[Fixes], Fixes], code: str
) -> None:
    fixes = spoil(drive(U_BLOX, 25))
    weighed = weigh_alone(fixes, CLOCK, OPTIONS, velocity_consistency(fixes))
    assert code in [reason.code for reason in weighed.verdict.reasons]
    assert weighed.verdict.state == "doubtful"
    assert in_ellipses(weighed, 25) > 0.9


def test_innovations_of_a_sum_are_the_sum_of_innovations() -> None:
    fixes = drive(U_BLOX, 26)
    at = usable_epochs(fixes, replace(OPTIONS, gate_probability=1e-300))
    rng = np.random.default_rng(3)
    errors = rng.standard_normal((len(at.t), 2, 2))

    def rows(at: Epochs, errors: FloatArray) -> FloatArray:
        return whitened_epochs(at, 0, replace(OPTIONS, gate_probability=1e-300), {}, errors)

    first = rows(at, errors)
    z = at.z.copy()
    z[0] += errors @ [0.7, -0.4]
    again = rows(replace(at, z=z), errors)
    np.testing.assert_allclose(again[:, 0], first[:, 0] + first[:, 1:] @ [0.7, -0.4], atol=1e-9)
    np.testing.assert_allclose(again[:, 1:], first[:, 1:], atol=1e-12)


def silent(fixes: Fixes) -> Fixes:
    return replace(fixes, vel_ned=np.full_like(fixes.vel_ned, np.nan))


def test_without_velocities_an_offset_throughout_is_not_told() -> None:
    assert seen(silent(throughout(drive(U_BLOX, 27)))) == (0.0, None, None)


@pytest.mark.parametrize(
    ("fix_type", "hdop", "stated", "sd"),
    [
        (FixType.THREE_D, 0.4, np.nan, 1.27),
        (FixType.THREE_D, 2.0, np.nan, 2.12),
        (FixType.THREE_D, 99.99, np.nan, 1.27),
        (FixType.THREE_D, 0.4, 0.2, 0.2),
        (FixType.THREE_D, 0.4, 0.8, 0.8),
        (FixType.DGNSS, 0.4, np.nan, 0.85),
        (FixType.DGNSS, 0.4, 0.3, 0.3),
        (FixType.FIXED, 0.8, np.nan, 0.05),
        (FixType.FIXED, 0.8, 0.02, 0.02),
    ],
)
def test_no_position_is_surer_than_its_kind(
    fix_type: FixType, hdop: float, stated: float, sd: float
) -> None:
    fixes = drive(PHONE, 28)
    n = len(fixes)
    fixes = replace(
        fixes,
        hdop=np.full(n, hdop),
        sd_pos_ned=np.full((n, 3), stated),
        fix_type=np.full(n, fix_type),
    )
    found = position_errors(fixes, np.ones(n), OPTIONS)[0]
    np.testing.assert_allclose(found[:, :2], sd, atol=0.01)
    told = accuracy_doubts(fixes, OPTIONS)
    assert [reason.code for reason in told] == ["accuracy_understated"] * (stated == 0.2)
    # and no path is where nothing corrects what satellites have in common
    least = {0.2: 1.27, 0.8: 0.7, 0.3: 0.0, 0.02: 0.0}.get(stated, min(sd, 1.27))
    np.testing.assert_allclose(common_errors(fixes, OPTIONS)[:, :2], least, atol=0.01)


def burst(fixes: Fixes, at_s: float) -> Fixes:
    """4 m ahead at one fix, and 3 and 1.3 m/s too slow at it and the next, as a phone was."""
    rows = np.searchsorted(fixes.gps_s, GPS0 + at_s) + np.arange(2)
    course = np.arctan2(fixes.vel_ned[rows, 1], fixes.vel_ned[rows, 0])
    slower = np.zeros_like(fixes.vel_ned)
    slower[rows, :2] = np.array([[3.0], [1.3]]) * np.column_stack([np.cos(course), np.sin(course)])
    one = np.arange(len(fixes)) == rows[0]
    return moved(replace(fixes, vel_ned=fixes.vel_ned - slower), one, 4.0, 0.0)


@pytest.mark.parametrize("seconds", [1.0, 300.0], ids=["two fixes", "from there on"])
def test_what_a_receiver_has_right_again_is_no_shift_beside_an_imu(seconds: float) -> None:
    fixes = drive(PHONE, 29)
    motion = receive(city_drive(300.0, 29), EXACT, 30)
    path = smooth_fixes(motion, CLOCK, OPTIONS, {})
    if seconds < 2.0:
        fixes = burst(fixes, 292.0)
    else:
        fixes = moved(fixes, fixes.gps_s >= GPS0 + 150.0, 4.0, 0.0)
    levels = fix_levels(fixes, OPTIONS)
    at, alone = usable_epochs(fixes, OPTIONS), smooth_fixes(fixes, CLOCK, OPTIONS, levels)
    change, _ = offsets(*of_path(at, alone, levels, path), True)
    assert (change is None) == (seconds < 2.0)
    # without an IMU nothing tells the two apart
    assert offsets(at, alone, OPTIONS, levels)[0] is not None


def of_path(
    at: Epochs, alone: Trajectory, levels: Mapping[str, float], path: Trajectory
) -> tuple[Epochs, Trajectory | Poses, FusionOptions, Mapping[str, float]]:
    off, there, by_imu = beside_motion(at, alone, levels, path, levels)
    return off, there, OPTIONS, by_imu
