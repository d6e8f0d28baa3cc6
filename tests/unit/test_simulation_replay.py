"""Recorded errors of receivers: taken from a drive with truth, and replayed along another."""

from __future__ import annotations

import json
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from automap.errors import ConfigError, InputError
from automap.evaluation.fix_errors import delays, fix_errors
from automap.io.fix_errors_csv import fix_errors_csv, read_fix_errors_csv
from automap.records import NO_TIME, FixErrors, Fixes, FixType, Trajectory
from automap.simulation.gnss import receive
from automap.simulation.replay import other_errors, replay
from automap.simulation.scenario import Gnss, Leg, Replay, Route, Scenario, Start
from automap.simulation.trajectory import DriveMotion, drive_motion
from pipeline.cli.root import run_command

BEGIN = 1_457_515_218.0
QUIET = Gnss(
    rate_hz=1.0,
    sigma_correlated_m=(0, 0, 0),
    sigma_white_m=(0, 0, 0),
    sigma_velocity=(0, 0, 0),
)
NOTHING = np.zeros(3)


def drive(turn: float, seed: int = 1) -> DriveMotion:
    legs = [
        Leg(length_m=120.0, speed_m_s=14.0),
        Leg(turn_deg=turn, radius_m=30.0, speed_m_s=7.0),
        Leg(length_m=150.0, speed_m_s=16.0),
        Leg(turn_deg=turn, radius_m=40.0, speed_m_s=8.0),
        Leg(length_m=100.0, speed_m_s=12.0),
    ]
    start = Start(utc=datetime(2026, 3, 14, 9, 20, tzinfo=UTC), lat_deg=-35.28, lon_deg=149.13)
    scenario = Scenario(schema="automap.scenario/1", name="x", start=start, route=Route(legs=legs))
    return drive_motion(scenario, np.random.default_rng(seed))


def truth_of(motion: DriveMotion) -> Trajectory:
    t = np.arange(0.0, motion.duration_s, 0.05)
    m = motion.at(t)
    unknown = np.full((len(t), 3), np.nan)
    rest = {n: unknown for n in Trajectory.__dataclass_fields__ if n != "slip_sd"}
    known = {
        "t_ns": np.full(len(t), NO_TIME, np.int64),
        "gps_s": BEGIN + t,
        "lat_rad": m.lat_rad,
        "lon_rad": m.lon_rad,
        "height_m": m.height_m,
        "vel_ned": m.vel_ned,
        "rpy": m.rpy,
    }
    return Trajectory(**{**rest, **known})


def made_errors(n: int, **more: float) -> FixErrors:
    """A series that never repeats, slow against a second."""
    t = np.arange(n) * 1.0
    waves = [np.sin(t / (3.0 + i) + i) for i in range(6)]
    position = np.stack(waves[:3], axis=1) * [1.0, 2.0, 3.0]
    return FixErrors(5000.0 + t, position, 0.3 * np.stack(waves[3:], axis=1), **more)


def taken(motion: DriveMotion, fixes: Fixes) -> FixErrors:
    return fix_errors(fixes, truth_of(motion), NOTHING)


def test_errors_come_back_from_a_replay_along_another_drive() -> None:
    recorded = made_errors(400)
    motion = drive(80.0)
    setup = QUIET.model_copy(update={"replay": Replay(errors="made", start_s=37.0)})
    fixes, said = receive(motion, setup, BEGIN, np.random.default_rng(1), {}, recorded)
    assert said is not None
    again = taken(motion, fixes)
    assert (again.speed_delay_s, again.course_delay_s) == (0.0, 0.0)
    part = slice(37, 37 + len(again))
    assert again.position == pytest.approx(recorded.position[part], abs=1e-3)
    # where it moves: at a crawl, along and across are those of the nose
    moving = np.linalg.norm(motion.at(again.gps_s - BEGIN).vel_ned, axis=1) > 2.0
    assert np.count_nonzero(moving) > 20
    assert again.velocity[moving] == pytest.approx(recorded.velocity[part][moving], abs=0.02)


def test_a_drives_errors_are_free_of_its_delays_and_have_them_on_the_next() -> None:
    first, second = drive(80.0), drive(-70.0)
    late = {"gnss_velocity_latency": {"s": 0.4}, "gnss_course_latency": {"s": 0.3}}
    fixes, _ = receive(first, QUIET, BEGIN, np.random.default_rng(2), late)
    recorded = taken(first, fixes)
    assert recorded.speed_delay_s == pytest.approx(0.4, abs=0.021)
    assert recorded.course_delay_s == pytest.approx(0.7, abs=0.041)
    raw = fix_errors(fixes, truth_of(first), NOTHING, with_delays=True)
    moving = np.linalg.norm(first.at(recorded.gps_s - BEGIN).vel_ned, axis=1) > 2.0
    left, whole = (np.sqrt(np.mean(e.velocity[moving] ** 2)) for e in (recorded, raw))
    assert left < 0.15 * whole
    setup = QUIET.model_copy(update={"replay": Replay(errors="made", wrap=True)})
    again, _ = receive(second, setup, BEGIN, np.random.default_rng(3), {}, recorded)
    anew = taken(second, again)
    assert anew.speed_delay_s == pytest.approx(0.4, abs=0.041)
    assert anew.course_delay_s == pytest.approx(0.7, abs=0.081)


def test_speed_and_course_have_delays_of_their_own() -> None:
    motion = drive(80.0)
    t = np.arange(2.0, motion.duration_s - 1.0, 1.0)
    for speed_late, course_late in ((0.2, 0.6), (0.66, 0.32)):
        slow, turned = motion.at(t - speed_late).vel_ned, motion.at(t - course_late).vel_ned
        course = np.arctan2(turned[:, 1], turned[:, 0])
        size = np.hypot(slow[:, 0], slow[:, 1])
        velocity = np.stack([size * np.cos(course), size * np.sin(course), slow[:, 2]], axis=1)
        found = delays(BEGIN + t, velocity, truth_of(motion))
        assert found == pytest.approx((speed_late, course_late), abs=0.021)


def test_the_seed_chooses_the_part_and_repeats_it() -> None:
    recorded, setup = made_errors(400), Replay(errors="made")
    t = np.arange(0.0, 100.0, 0.5)
    starts = [replay(recorded, t, setup, np.random.default_rng(s)).start_s for s in (1, 1, 2)]
    assert starts[0] == starts[1] != starts[2]
    assert all(0.0 <= s <= 399.0 - 99.5 for s in starts)
    one = replay(recorded, t, setup, np.random.default_rng(1))
    expected = np.interp(starts[0] + t, np.arange(400.0), recorded.position[:, 1])
    assert one.position[:, 1] == pytest.approx(expected)
    assert one.seams_s == ()


def test_a_series_too_short_is_refused_or_begins_anew_and_says_where() -> None:
    recorded = made_errors(61)
    t = np.arange(0.0, 200.0, 1.0)
    with pytest.raises(ConfigError, match=r"60 s.*199 s.*wrap"):
        replay(recorded, t, Replay(errors="made"), np.random.default_rng(1))
    with pytest.raises(ConfigError, match="wrap"):
        replay(made_errors(250), t, Replay(errors="x", start_s=60.0), np.random.default_rng(1))
    wrapped = replay(
        recorded, t, Replay(errors="made", start_s=20.0, wrap=True), np.random.default_rng(1)
    )
    assert wrapped.seams_s == (40.0, 100.0, 160.0)
    assert wrapped.position[40] == pytest.approx(recorded.position[0])
    assert wrapped.position[41] == pytest.approx(recorded.position[1])
    assert wrapped.position[139] == pytest.approx(recorded.position[39])
    assert np.isfinite(wrapped.position).all()


def test_where_the_recording_has_no_fix_there_is_none() -> None:
    whole = made_errors(300)
    keep = np.ones(300, bool)
    keep[100:110] = False
    gappy = FixErrors(whole.gps_s[keep], whole.position[keep], whole.velocity[keep])
    motion = drive(80.0)
    setup = QUIET.model_copy(update={"replay": Replay(errors="made", start_s=90.0)})
    fixes, _ = receive(motion, setup, BEGIN, np.random.default_rng(1), {}, gappy)
    assert fixes.fix_type[9] == FixType.THREE_D
    assert (fixes.fix_type[10:20] == FixType.NONE).all()
    assert (fixes.lat_rad[10:20] == fixes.lat_rad[9]).all()
    assert fixes.fix_type[20] == FixType.THREE_D


def test_what_the_recording_does_not_say_is_drawn() -> None:
    recorded = made_errors(300)
    recorded.velocity[:, 2] = np.nan
    setup = QUIET.model_copy(
        update={"replay": Replay(errors="made"), "sigma_velocity": (0.0, 0.0, 0.2)}
    )
    motion = drive(80.0)
    fixes, _ = receive(motion, setup, BEGIN, np.random.default_rng(1), {}, recorded)
    true = motion.at(fixes.gps_s - BEGIN).vel_ned[:, 2]
    assert (fixes.vel_ned[:, 2] - true).std() == pytest.approx(0.2, rel=0.4)


def test_drawn_errors_stay_away_and_the_installations_stay() -> None:
    values = {
        "gnss_slow_wander": {"sigma": 9.0, "tau": 60.0},
        "gnss_velocity_wander": {"sigma": 9.0, "tau": 60.0},
        "gnss_outliers": {"fraction": 0.5},
        "gnss_velocity_latency": {"s": 0.9},
        "gnss_lever_arm": {"x": 0.4},
        "gyro_bias": {"x": 0.1},
    }
    left = other_errors(values, made_errors(9, speed_delay_s=0.3, course_delay_s=0.5))
    assert set(left) == {
        *("gnss_lever_arm", "gyro_bias"),
        *("gnss_velocity_latency", "gnss_course_latency"),
    }
    assert left["gnss_velocity_latency"]["s"] == 0.3
    assert left["gnss_course_latency"]["s"] == pytest.approx(0.2)


def test_a_table_is_read_as_it_is_written(tmp_path: Path) -> None:
    errors = made_errors(30)
    errors.velocity[:, 2] = np.nan
    (tmp_path / "e.csv").write_text(fix_errors_csv(errors))
    again = read_fix_errors_csv(tmp_path / "e.csv")
    assert again.gps_s == pytest.approx(errors.gps_s - errors.gps_s[0])
    assert again.position == pytest.approx(errors.position, abs=1e-4)
    np.testing.assert_allclose(again.velocity, errors.velocity, atol=1e-4)
    (tmp_path / "back.csv").write_text("t_s,north_m,east_m,down_m\n1,0,0,0\n0,0,0,0\n")
    with pytest.raises(InputError, match="increasing"):
        read_fix_errors_csv(tmp_path / "back.csv")


SHORT = """
schema = "automap.scenario/1"
name = "x"
[start]
utc = 2026-03-14T09:20:00Z
lat_deg = -35.28
lon_deg = 149.13
[route]
legs = [{ length_m = 200.0 }, { turn_deg = 90.0, radius_m = 20.0 }, { length_m = 60.0 }]
[gnss]
format = "nmea"
rate_hz = 1.0
"""


def test_a_drive_with_truth_lends_its_errors_to_another(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, first, second = (tmp_path / n for n in ("x.toml", "first", "second"))
    file.write_text(SHORT)
    assert run_command(["simulate", str(file), "-o", str(first)]) == 0
    file.write_text(SHORT + 'replay = { errors = "first", wrap = true, start_s = 10.0 }\n')
    capsys.readouterr()
    assert run_command(["simulate", str(file), "--seed", "5", "-o", str(second)]) == 0
    said = json.loads((second / "truth" / "errors.json").read_text())
    assert said["replay"]["start_s"] == 10.0
    assert len(said["replay"]["seams_s"]) == 1
    assert "begin anew" in capsys.readouterr().err
    file.write_text(SHORT + 'replay = { errors = "first", start_s = 10.0 }\n')
    assert run_command(["simulate", str(file), "-o", str(tmp_path / "third")]) != 0
    assert "wrap = true" in capsys.readouterr().err
    option = ["simulate", str(file), "--replay", str(tmp_path / "none"), "-o", str(tmp_path / "4")]
    assert run_command(option) != 0
    assert not (tmp_path / "4").exists()


def test_fixes_out_of_order_give_errors_in_order() -> None:
    motion = drive(80.0)
    fixes, _ = receive(motion, QUIET, BEGIN, np.random.default_rng(2))
    back = Fixes(**{n: v[::-1] for n, v in vars(fixes).items()})
    assert taken(motion, back).gps_s == pytest.approx(taken(motion, fixes).gps_s)
    none = replace(fixes, fix_type=np.zeros(len(fixes), np.int64))
    assert len(taken(motion, none)) == 0
