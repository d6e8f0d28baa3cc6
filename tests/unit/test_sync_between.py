"""Positions on the lines between a receiver's own are found, and only they."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from automap.earth import metres_per_radian
from automap.fusion.doubts.receiver import receiver_doubts, usable_fixes
from automap.records import Fixes, FixType, FloatArray
from automap.sync.between_fixes import carried_on, coasted, nothing_new, told_between
from automap.sync.velocity_consistency import velocity_consistency
from tests.unit.fusion_motion import city_drive
from tests.unit.fusion_receiver import Receiver, receive

DIGIT = np.radians(1e-7)
MOTION = city_drive(200.0, seed=11)


def _logged(fixes: Fixes) -> Fixes:
    """As it is printed: 1e-7 deg, 1 mm."""
    places = (np.round(v / DIGIT) * DIGIT for v in (fixes.lat_rad, fixes.lon_rad))
    lat, lon = places
    return replace(fixes, lat_rad=lat, lon_rad=lon, height_m=np.round(fixes.height_m, 3))


def _interpolated(fixes: Fixes, times: int) -> Fixes:
    """A log with ``times`` rows for each fix, on the lines between them."""
    at = np.arange((len(fixes) - 1) * times + 1) / times
    row = np.floor(at + 1e-9).astype(int)

    def between(values: FloatArray) -> FloatArray:
        return np.interp(at, np.arange(len(fixes)), values)

    rows = {name: values[row] for name, values in vars(fixes).items()}
    lines = {n: between(getattr(fixes, n)) for n in ("gps_s", "lat_rad", "lon_rad", "height_m")}
    velocity = np.column_stack([between(column) for column in fixes.vel_ned.T])
    return _logged(Fixes(**{**rows, **lines, "vel_ned": velocity}))


@pytest.mark.parametrize("times", [2, 5, 10])
def test_rows_between_fixes_are_left_out_and_told(times: int) -> None:
    fixes = _logged(receive(MOTION, Receiver(rate=1.0), 4))
    log = _interpolated(fixes, times)
    between = np.arange(len(log)) % times > 0
    assert (told_between(log) == between).all()
    found = velocity_consistency(log)
    assert found.between == np.count_nonzero(between)
    (reason,) = receiver_doubts(found, float(log.gps_s[0]))
    assert (reason.code, reason.state, reason.handled) == ("fixes_interpolated", "good", True)
    used = usable_fixes(log, found)
    assert (np.isfinite(used.lat_rad) == ~between).all()
    assert (np.isfinite(used.vel_ned[:, 0]) == ~between).all()


@pytest.mark.parametrize("times", [5, 10])
def test_a_log_that_lost_rows_keeps_its_fixes(times: int) -> None:
    log = _interpolated(_logged(receive(MOTION, Receiver(rate=1.0), 4)), times)
    kept = np.delete(np.arange(len(log)), [37, 38, 39, 612])
    part = Fixes(**{name: values[kept] for name, values in vars(log).items()})
    assert (told_between(part) == (kept % times > 0)).all()


@pytest.mark.parametrize("rate", [1.0, 5.0, 10.0])
@pytest.mark.parametrize("white", [0.0, 0.004, 0.3])
def test_sound_receivers_have_none(rate: float, white: float) -> None:
    """However smooth they are: with no white noise at all every row is nearly on a line."""
    sound = Receiver(rate=rate, white=(white,) * 3)
    log = _logged(receive(MOTION, sound, 7))
    assert not nothing_new(log).any()
    coarse = replace(log, lat_rad=np.round(log.lat_rad, 6), lon_rad=np.round(log.lon_rad, 6))
    assert not told_between(coarse).any()


def test_a_few_rows_tell_nothing() -> None:
    log = _interpolated(_logged(receive(MOTION, Receiver(rate=1.0), 4, end=12.0)), 3)
    assert not told_between(log).any()
    none = Fixes(**{name: values[:0] for name, values in vars(log).items()})
    assert told_between(none).shape == (0,)


def _carried_on(fixes: Fixes, times: int) -> Fixes:
    """A log with ``times`` rows for each fix, which go on from it by its velocity."""
    number = np.arange(len(fixes) * times)
    row, late = number // times, (number % times) / times
    rows = {name: values[row] for name, values in vars(fixes).items()}
    north, east = metres_per_radian(fixes.lat_rad[row], fixes.height_m[row])
    way = fixes.vel_ned[row] * late[:, None]
    return _logged(
        replace(
            Fixes(**rows),
            gps_s=fixes.gps_s[row] + late,
            lat_rad=fixes.lat_rad[row] + way[:, 0] / north,
            lon_rad=fixes.lon_rad[row] + way[:, 1] / east,
            height_m=fixes.height_m[row] - way[:, 2],
        )
    )


@pytest.mark.parametrize("times", [2, 5, 20])
def test_rows_that_go_on_from_a_fix_by_its_velocity_are_left_out_and_told(times: int) -> None:
    """At 20 a second of one that was measured a path was 11 m off, and its fixes by 1.6 m."""
    fixes = _logged(receive(MOTION, Receiver(rate=1.0), 4))
    fixes = replace(fixes, vel_ned=np.round(fixes.vel_ned, 3))
    log = _carried_on(fixes, times)
    own = np.arange(len(log)) % times == 0
    assert (carried_on(log) == ~own).all()
    lost = np.delete(np.arange(len(log)), [37, 38, 39, 211])
    part = Fixes(**{name: values[lost] for name, values in vars(log).items()})
    assert np.count_nonzero(carried_on(part) == ~own[lost]) > 0.98 * len(part)
    found = velocity_consistency(log)
    (reason,) = receiver_doubts(found, float(log.gps_s[0]))
    assert (reason.code, reason.state) == ("fixes_interpolated", "good")
    assert (np.isfinite(usable_fixes(log, found).lat_rad) == own).all()


def test_a_velocity_that_is_held_beside_measured_positions_is_no_way_on() -> None:
    log = receive(MOTION, Receiver(rate=5.0), 4)
    held = replace(log, vel_ned=log.vel_ned[np.arange(len(log)) // 5 * 5])
    assert not carried_on(_logged(held)).any()


@pytest.mark.parametrize("rate", [1.0, 5.0])
def test_a_receiver_that_goes_straight_on_measures_nothing(rate: float) -> None:
    """As one does that has lost its view: that had taken the path beside an IMU 15 m off."""
    log = _logged(receive(MOTION, Receiver(rate=rate), 4))
    log = replace(log, vel_ned=np.round(log.vel_ned, 3))
    speed = np.hypot(*log.vel_ned[:, :2].T)
    rows = round(25.0 * rate)
    fast = np.lib.stride_tricks.sliding_window_view(speed, rows).mean(axis=1)
    first = int(np.argmax(fast))
    late = (log.gps_s - log.gps_s[first])[first : first + rows]
    north, east = metres_per_radian(log.lat_rad[first], log.height_m[first])
    place = ("lat_rad", "lon_rad", "height_m")
    straight = replace(log, **{n: getattr(log, n).copy() for n in (*place, "vel_ned")})
    inside = slice(first, first + rows)
    straight.vel_ned[inside] = log.vel_ned[first]
    way = log.vel_ned[first, :2, None] * late / np.array([[north], [east]])
    straight.lat_rad[inside] = log.lat_rad[first] + way[0]
    straight.lon_rad[inside] = log.lon_rad[first] + way[1]
    straight.height_m[inside] = log.height_m[first]
    led = np.zeros(len(log), np.bool_)
    led[first + 1 : first + rows] = True
    assert (coasted(_logged(straight)) == led).all()
    # a velocity that stays beside positions or heights that were measured, or all of them do
    held = replace(log, vel_ned=straight.vel_ned)
    assert not coasted(held).any()
    assert not coasted(_logged(replace(straight, height_m=log.height_m))).any()
    for name in place:
        getattr(held, name)[inside] = getattr(held, name)[first]
    assert not coasted(held).any()


def test_a_faster_log_repeats_a_receiver_at_rest_too() -> None:
    """Ten rows of each fix: what is left of them is one a second, while driving and at rest."""
    fixes = _logged(receive(MOTION, Receiver(rate=1.0), 4))
    still = np.arange(len(fixes)) >= len(fixes) - 30
    held = np.where(still, len(fixes) - 30, np.arange(len(fixes)))
    rest = {n: v[held] for n, v in vars(fixes).items()} | {"gps_s": fixes.gps_s}
    rest["vel_ned"] = np.where(still[:, None], 0.0, fixes.vel_ned)
    log = Fixes(**{n: np.repeat(v, 10, axis=0) for n, v in rest.items()})
    log = replace(log, gps_s=log.gps_s + np.tile(np.arange(10) / 10.0, len(fixes)))
    left = log.gps_s[~nothing_new(log)]
    assert len(left) == len(fixes)
    np.testing.assert_allclose(left, fixes.gps_s, atol=1e-3)


def test_what_a_receiver_reckons_without_satellites_is_left_out_and_told() -> None:
    fixes = _logged(receive(MOTION, Receiver(rate=5.0), 4))
    kind = fixes.fix_type.copy()
    kind[300:600] = FixType.DEAD_RECKONING
    log = replace(fixes, fix_type=kind)
    found = velocity_consistency(log)
    assert found.between == 300
    left = usable_fixes(log, found)
    assert (np.isnan(left.lat_rad) == (kind == FixType.DEAD_RECKONING)).all()
    assert np.isnan(left.vel_ned[300:600]).all()
    (reason,) = (r for r in receiver_doubts(found, 0.0) if r.code == "fixes_interpolated")
    assert "reckoned" in reason.text
    # a receiver that says so of all measures nothing less
    all_of_them = replace(fixes, fix_type=np.full_like(kind, FixType.DEAD_RECKONING))
    assert not nothing_new(all_of_them).any()
