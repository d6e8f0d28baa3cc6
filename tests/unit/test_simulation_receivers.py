"""Simulated receivers: the presets, the random effects on fixes, and what is written of them."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from pyubx2 import UBXReader

from automap.effects.gnss import frozen, short_error, slow_error, stands, steps
from automap.errors import ConfigError
from automap.io.nmea_writer import gga_rmc
from automap.io.receiver import read_receiver_bytes
from automap.io.ubx_writer import nav_pvt
from automap.records import NO_TIME, Fixes, FixType
from automap.simulation.errors import check_errors
from automap.simulation.gnss import receive
from automap.simulation.receiver_errors import draw_errors
from automap.simulation.scenario import Gnss, Scenario
from automap.simulation.sensors import random_streams, simulate_sensors
from automap.simulation.trajectory import drive_motion
from pipeline.cli.root import run_command
from pipeline.simulate.command import load_scenario
from pipeline.simulate.receivers import receiver_names, with_receiver

TOWN = Path(__file__).resolve().parents[2] / "configs" / "scenarios" / "town.toml"
DAY = np.arange(0.0, 86_400.0, 1.0)
BEGIN = 1_457_515_218.0
ROUTE = {"legs": [{"length_m": 80.0}]}
START = {"utc": datetime(2026, 3, 14, 9, 20, tzinfo=UTC), "lat_deg": -35.28, "lon_deg": 149.13}


def preset(name: str) -> Scenario:
    return load_scenario(TOWN, name)


def correlation(x: np.ndarray, lag: int) -> float:
    return float(np.mean(x[:-lag] * x[lag:]) / np.mean(x * x))


@pytest.mark.parametrize("name", receiver_names())
def test_receivers_that_come_along_are_sound(name: str) -> None:
    given = preset(name)
    check_errors(given.errors)
    assert given.gnss is not None
    assert given.gnss.receiver == name
    # the drive's own stays
    assert given.gnss.lever_arm_m == (0.4, 0.1, -1.2)
    assert "gyro_bias" in given.errors
    fixes = simulate_sensors(given, random_streams(3)).fixes
    assert fixes is not None
    assert len(fixes) > 200


@pytest.mark.slow
def test_slow_errors_have_their_size_and_time() -> None:
    values = {
        "gnss_slow_wander": {"sigma": 0.8, "tau": 200.0},
        "gnss_height_wander": {"sigma": 3.0, "tau": 500.0},
    }
    n = 400_000
    error = slow_error(n, 1.0, values, np.random.default_rng(1))
    assert error.std(axis=0) == pytest.approx([0.8, 0.8, 3.0], rel=0.1)
    assert abs(np.corrcoef(error[:, 0], error[:, 1])[0, 1]) < 0.1
    for axis, tau in enumerate((200, 200, 500)):
        assert correlation(error[:, axis], tau) == pytest.approx(np.exp(-1.0), abs=0.07)
    assert not slow_error(9, 1.0, {}, np.random.default_rng(1)).any()


def test_short_errors_are_of_all_three_axes() -> None:
    values = {"gnss_multipath": {"sigma": 0.4, "tau": 8.0}}
    error = short_error(100_000, 1.0, values, np.random.default_rng(1))
    assert error.std(axis=0) == pytest.approx([0.4] * 3, rel=0.05)
    assert abs(np.corrcoef(error.T)[0, 1]) < 0.05
    for axis in range(3):
        assert correlation(error[:, axis], 8) == pytest.approx(np.exp(-1.0), abs=0.04)
    drawn = draw_errors(DAY[:900], 1.0, Gnss(), values, np.random.default_rng(5))
    plain = draw_errors(DAY[:900], 1.0, Gnss(), {}, np.random.default_rng(5))
    assert (drawn.position - plain.position).std() == pytest.approx(0.4, rel=0.2)


def test_steps_hold_between_jumps_and_do_not_grow() -> None:
    values = {"gnss_position_steps": {"size": 0.5, "interval": 40.0}}
    error = steps(DAY, values, np.random.default_rng(2))
    moved = (np.diff(error, axis=0) != 0.0).any(axis=1)
    assert moved.sum() == pytest.approx(len(DAY) / 40.0, rel=0.1)
    assert error.std(axis=0) == pytest.approx([0.5] * 3, rel=0.1)
    assert error[-20_000:].std() == pytest.approx(error[:20_000].std(), rel=0.2)


def test_positions_freeze_as_often_and_as_long_as_said() -> None:
    values = {"gnss_freeze": {"length": 5.0, "interval": 100.0}}
    held = frozen(DAY, values, np.random.default_rng(3))
    begins = np.count_nonzero(held[1:] & ~held[:-1])
    # 1 s apart: of lengths under a second some are never seen
    assert held.mean() == pytest.approx(0.05, rel=0.15)
    assert begins == pytest.approx(len(DAY) / 100.0, rel=0.25)


def test_a_frozen_position_is_repeated_and_its_velocity_is_not() -> None:
    scenario = Scenario(schema="automap.scenario/1", name="x", start=START, route=ROUTE)
    drive = drive_motion(scenario, np.random.default_rng(1))
    values = {"gnss_freeze": {"length": 2.0, "interval": 5.0}}
    fixes, _ = receive(drive, Gnss(), BEGIN, np.random.default_rng(4), values)
    plain, _ = receive(drive, Gnss(), BEGIN, np.random.default_rng(4))
    held = np.flatnonzero(fixes.lat_rad != plain.lat_rad)
    assert len(held) > 3
    assert (fixes.lat_rad[held] == fixes.lat_rad[held - 1]).all()
    assert (fixes.fix_type == FixType.THREE_D).all()
    np.testing.assert_array_equal(fixes.vel_ned, plain.vel_ned)


def test_a_slow_receiver_says_that_it_stands() -> None:
    speed = np.array([0.0, 0.29, 0.31, 4.0])
    assert stands(speed, {"gnss_speed_threshold": {"speed": 0.3}}).tolist() == [
        *(True, True),
        *(False, False),
    ]
    assert not stands(speed, {}).any()


def test_an_effect_more_leaves_the_draws_of_the_others() -> None:
    one = {"gnss_velocity_wander": {"sigma": 0.2, "tau": 2.0}}
    more = {
        **one,
        "gnss_slow_wander": {"sigma": 1.0, "tau": 60.0},
        "gnss_position_steps": {"size": 1.0, "interval": 5.0},
    }
    few, many = (
        draw_errors(DAY[:500], 1.0, Gnss(), v, np.random.default_rng(5)) for v in (one, more)
    )
    np.testing.assert_array_equal(few.velocity, many.velocity)
    assert (few.position != many.position).any()
    apart = slow_error(500, 1.0, more, np.random.default_rng(5).spawn(6)[3])
    apart += steps(DAY[:500], more, np.random.default_rng(5).spawn(6)[4])
    assert many.position - few.position == pytest.approx(apart)


def test_solutions_follow_one_another_with_their_own_errors() -> None:
    setup = preset("rtk").gnss
    assert setup is not None
    drawn = draw_errors(DAY, 1.0, setup, {}, np.random.default_rng(6))
    fixed = drawn.fix_type == FixType.FIXED
    floating = drawn.fix_type == FixType.FLOAT
    assert {int(k) for k in np.unique(drawn.fix_type)} == {
        *(FixType.NONE, FixType.DGNSS, FixType.FLOAT, FixType.FIXED)
    }
    assert 0.55 < fixed.mean() < 0.9
    # a float comes about once a loss and once a fixed one: never straight from loss to fixed
    jumps = np.flatnonzero(np.diff(drawn.fix_type))
    assert not (
        (drawn.fix_type[jumps] == FixType.NONE) & (drawn.fix_type[jumps + 1] == FixType.FIXED)
    ).any()
    off = np.abs(drawn.position[:, 0])
    assert np.median(off[fixed]) == pytest.approx(0.6745 * np.hypot(0.008, 0.004), rel=0.15)
    assert np.median(off[floating]) == pytest.approx(0.6745 * 0.25, rel=0.25)
    assert (drawn.sd_position[fixed, 0] <= 0.0141).all()
    # wrong integers: stated to a centimetre, off by decimetres
    assert 0.001 < (off[fixed] > 0.15).mean() < 0.05


def test_without_a_fix_the_last_one_is_repeated() -> None:
    setup = preset("rtk").gnss
    assert setup is not None
    drawn = draw_errors(DAY[:5000], 1.0, setup, {}, np.random.default_rng(6))
    lost = np.flatnonzero(drawn.fix_type == FixType.NONE)
    assert len(lost) > 10
    assert (drawn.position_of[lost] == drawn.position_of[lost - 1]).all()
    good = np.flatnonzero(drawn.fix_type != FixType.NONE)
    assert (drawn.position_of[good] == good).all()


def test_what_is_stated_need_not_be_true() -> None:
    setup = Gnss(stated_sd_m=(0.1, 0.1, 0.2), stated_sd_velocity=(0.5, 0.5, 0.5))
    drawn = draw_errors(DAY, 1.0, setup, {}, np.random.default_rng(7))
    assert drawn.sd_position[9] == pytest.approx([0.1, 0.1, 0.2])
    assert drawn.sd_velocity[9] == pytest.approx([0.5] * 3)
    true = draw_errors(DAY, 1.0, Gnss(), {}, np.random.default_rng(7))
    np.testing.assert_array_equal(drawn.position, true.position)
    assert true.position.std(axis=0) == pytest.approx(true.sd_position[9], rel=0.1)


def fixes(kinds: list[FixType]) -> Fixes:
    n = len(kinds)
    return Fixes(
        gps_s=BEGIN + 0.5 * np.arange(n),
        lat_rad=np.radians(-35.28 + 1e-4 * np.arange(n)),
        lon_rad=np.radians(np.full(n, -149.13)),
        height_m=np.full(n, 583.21),
        vel_ned=np.tile([6.0, -8.0, 0.3], (n, 1)),
        sd_pos_ned=np.full((n, 3), 0.014),
        sd_vel_ned=np.full((n, 3), 0.03),
        fix_type=np.array(kinds, np.int64),
        n_sats=np.full(n, 9, np.int64),
        hdop=np.full(n, 0.8),
        geoid_sep_m=np.full(n, 19.4),
        offset=np.full(n, -1, np.int64),
        arrival_ns=np.full(n, NO_TIME, np.int64),
    )


KINDS = [FixType.THREE_D, FixType.DGNSS, FixType.FLOAT, FixType.FIXED, FixType.NONE]


def test_kinds_of_fixes_are_written_as_others_read_them() -> None:
    messages = [UBXReader.parse(m) for m in nav_pvt(fixes(KINDS))]
    assert [m.gnssFixOk for m in messages] == [1, 1, 1, 1, 0]
    assert [m.diffSoln for m in messages] == [0, 1, 1, 1, 0]
    assert [m.carrSoln for m in messages] == [0, 0, 1, 2, 0]


@pytest.mark.parametrize("write", [nav_pvt, gga_rmc])
def test_logs_are_read_back_with_their_kinds(write: object) -> None:
    given = fixes(KINDS)
    read = read_receiver_bytes(b"".join(write(given)), "made").fixes  # type: ignore[operator]
    assert read.fix_type.tolist() == [int(k) for k in KINDS]
    assert read.gps_s == pytest.approx(given.gps_s, abs=2e-3)
    good = slice(0, 4)
    assert read.lat_rad[good] == pytest.approx(given.lat_rad[good], abs=2e-9)
    assert read.lon_rad[good] == pytest.approx(given.lon_rad[good], abs=2e-9)
    assert read.height_m[good] == pytest.approx(given.height_m[good], abs=0.01)
    # a tenth of a knot, a tenth of a degree
    assert read.vel_ned[good, :2] == pytest.approx(given.vel_ned[good, :2], abs=0.04)


def test_a_phone_says_nothing_of_accuracy_and_climb() -> None:
    log = read_receiver_bytes(b"".join(gga_rmc(fixes(KINDS))), "made").fixes
    assert np.isnan(log.vel_ned[:, 2]).all()
    assert np.isnan(log.sd_pos_ned).all()
    sensors = simulate_sensors(preset("phone"), random_streams(3))
    assert sensors.fixes is not None
    assert np.isnan(sensors.fixes.vel_ned[:, 2]).all()
    assert np.isnan(sensors.fixes.sd_vel_ned).all()
    assert np.isfinite(sensors.fixes.vel_ned[:, :2]).all()


def test_a_course_never_shows_as_a_whole_turn() -> None:
    north = replace(fixes([FixType.THREE_D]), vel_ned=np.array([[10.0, -1e-4, 0.0]]))
    assert b",000.0,140326" in gga_rmc(north)[0]


def test_a_scenario_stands_before_its_receiver_and_an_option_before_both() -> None:
    scenario = {
        "gnss": {"receiver": "phone", "rate_hz": 2.0, "lever_arm_m": [1.0, 0.0, 0.0]},
        "errors": {
            "gnss_velocity_wander": {"sigma": 0.5, "tau": 1.0},
            "gnss_lever_arm": {"x": 0.3},
            "accel_bias": {"x": 0.1},
        },
    }
    own = with_receiver(scenario)
    assert own["gnss"]["rate_hz"] == 2.0
    assert own["gnss"]["format"] == "nmea"
    assert own["errors"]["gnss_velocity_wander"]["sigma"] == 0.5
    assert own["errors"]["gnss_velocity_latency"]["s"] > 0.1
    other = with_receiver(scenario, instead="u-blox")
    assert other["gnss"]["rate_hz"] == 5.0
    assert other["gnss"]["lever_arm_m"] == [1.0, 0.0, 0.0]
    assert "format" not in other["gnss"]
    assert other["errors"]["gnss_velocity_wander"]["sigma"] < 0.2
    assert other["errors"]["gnss_lever_arm"] == {"x": 0.3}
    assert other["errors"]["accel_bias"] == {"x": 0.1}


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("fone", "", "did you mean phone"),
        ("mine", 'schema = "automap.receiver/1"\n', "simulated-receiver/1"),
        ("mine", 'schema = "automap.simulated-receiver/1"\n[gps]\n', "gps"),
        ("mine", 'schema = "automap.simulated-receiver/1"\ngnss = 3\n', "are sections"),
    ],
)
def test_mistakes_in_a_receiver_are_named(name: str, text: str, said: str, tmp_path: Path) -> None:
    if text:
        (tmp_path / "mine.toml").write_text(text)
    with pytest.raises(ConfigError, match=said):
        with_receiver({"gnss": {"receiver": name}}, tmp_path)


@pytest.mark.parametrize(
    ("solutions", "said"),
    [
        ({"a": {"then": {"b": 1.0}}}, "no solution"),
        ({"a": {"then": {"a": 0.0}}}, "weight"),
        ({"a": {"fix": "rtk"}}, "fix"),
    ],
)
def test_solutions_that_lead_nowhere_are_refused(solutions: object, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        Gnss.model_validate({"solutions": solutions})


@pytest.mark.parametrize(
    "errors",
    [{"gnss_slow_wander": {"sigma": 1.0}}, {"gnss_freeze": {"length": 0.0, "interval": 9.0}}],
)
def test_an_error_that_lasts_says_for_how_long(errors: dict[str, dict[str, float]]) -> None:
    with pytest.raises(ConfigError, match=r"in s|above 0 s"):
        check_errors(errors)


def test_the_option_makes_the_drive(tmp_path: Path) -> None:
    file, out = tmp_path / "x.toml", tmp_path / "drive"
    file.write_text(
        'schema = "automap.scenario/1"\nname = "x"\n[start]\nutc = 2026-03-14T09:20:00Z\n'
        "lat_deg = -35.28\nlon_deg = 149.13\n[route]\nlegs = [{ length_m = 30.0 }]\n[gnss]\n"
    )
    assert run_command(["simulate", str(file), "--receiver", "phone", "-o", str(out)]) == 0
    assert 'file = "gnss.nmea"' in (out / "drive.toml").read_text()
    assert (out / "gnss.nmea").read_bytes().startswith(b"$GPGGA,092000.00,")
    assert run_command(["simulate", str(file), "--receiver", "fone", "-o", str(out / "no")]) != 0
