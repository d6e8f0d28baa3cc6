"""Recorded receivers on other roads: their delays, their errors, their log, and what is judged."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.hidden_effects.answers import strangers
from tests.hidden_effects.cases import Drawn, case_ids, draw_case
from tests.hidden_effects.gnss import record_gnss
from tests.hidden_effects.hide import RECEIVERS_OWN
from tests.hidden_effects.judge import judge
from tests.hidden_effects.motion import Motion
from tests.hidden_effects.noise import GnssNoise
from tests.hidden_effects.real_receiver import Replay, draw_replay, read_series, shared_drives
from tests.hidden_effects.route import draw_plan, draw_style
from tests.hidden_effects.write import write_drive

recorded = pytest.mark.skipif(
    shared_drives() is None, reason="AUTOMAP_SHARED_DATA holds no drives with a reference"
)
ARM = np.array([0.4, 0.1, -1.2])
PLACE = (np.radians(47.0), np.radians(8.0), 400.0)
SECONDS = 120.0


def drive() -> Motion:
    rng = np.random.default_rng(3)
    return Motion(draw_plan(rng, draw_style(rng, False), SECONDS), PLACE, SECONDS, rng)


@recorded
@pytest.mark.parametrize(
    ("name", "speed_s", "rms"), [("gsdc-mtv1", 0.23, 1.03), ("gsdc-mtv1-xl", 0.69, 2.14)]
)
def test_a_recording_has_the_errors_that_are_known_of_it(
    name: str, speed_s: float, rms: float
) -> None:
    series = read_series(name)
    assert series.speed_s == pytest.approx(speed_s, abs=0.06)
    # without delay and place in the car a good part of the raw error is left
    assert 0.5 * rms < np.sqrt(np.mean(np.sum(series.position[:, :2] ** 2, axis=1))) < rms
    assert 0.05 < np.std(series.along) < 0.25
    noise = series.noise()
    assert noise.velocity > np.std(series.along)
    assert not noise.down_known


@recorded
def test_a_replay_is_turned_and_mirrored_but_as_large_and_holds_its_gaps() -> None:
    plain = Replay("gsdc-mtv1", 300.0, False, 0.0, 1.0, 1.0, 1.0)
    series = read_series("gsdc-mtv1")
    position, along, across, hdop = plain.errors(SECONDS)
    first = int(np.searchsorted(series.t, 301.0))
    np.testing.assert_array_equal(position, series.position[first : first + len(position)])
    np.testing.assert_array_equal(hdop, series.hdop[first : first + len(hdop)])
    other = Replay("gsdc-mtv1", 300.0, True, 1.0, -1.0, -1.0, -1.0)
    turned, reverse, mirrored, _ = other.errors(SECONDS)
    np.testing.assert_allclose(
        np.hypot(*turned[::-1, :2].T), np.hypot(*position[:, :2].T), atol=1e-9
    )
    np.testing.assert_allclose(reverse[::-1], -along)
    np.testing.assert_allclose(mirrored[::-1], -across)
    tags = plain.tags(SECONDS)
    assert np.all(np.diff(tags) > 0.5)
    assert tags[0] >= 0.5
    assert tags[-1] <= SECONDS
    gap = series.t[np.argmax(np.diff(series.t))]
    holed = Replay("gsdc-mtv1", float(gap) - 60.0, True, 0.0, 1.0, 1.0, 1.0)
    assert np.diff(holed.tags(SECONDS)).max() == pytest.approx(2.0)


@recorded
def test_delays_act_on_the_new_motion_and_a_halt_is_told_as_one() -> None:
    motion, rng = drive(), np.random.default_rng(0)
    replay = Replay("gsdc-mtv1-xl", 500.0, False, 0.0, 1.0, 1.0, 1.0)
    series = replay.series()
    record = record_gnss(motion, {}, GnssNoise(0.0, 0.0, 60.0, 0.0), rng, ARM, replay=replay)
    position, along, _, hdop = replay.errors(SECONDS)
    then = motion.at(record.tag)
    # the rest of the position's error is what the car went in its delay
    moved = record.error_pos - position + series.position_s * then.vel_ned
    # the lever arm swings along, a bend bends the way
    assert np.abs(moved).max() < 0.25
    early = motion.at(record.tag - series.speed_s)
    told = np.hypot(record.vel[:, 0], record.vel[:, 1])
    moving = early.speed > 3.0
    np.testing.assert_allclose(told[moving], (early.speed + along)[moving], atol=0.15)
    assert np.all(told[early.speed < 1e-3] == 0.0)
    assert record.hdop is not None
    np.testing.assert_array_equal(record.hdop, hdop)


@recorded
def test_its_log_is_read_as_it_was_recorded(tmp_path: Path) -> None:
    from automap.io.receiver import read_receiver_log
    from tests.hidden_effects.imu import record_imu
    from tests.hidden_effects.noise import ImuNoise

    motion, rng = drive(), np.random.default_rng(0)
    replay = draw_replay(rng, SECONDS)
    gnss = record_gnss(motion, {}, GnssNoise(0.0, 0.0, 60.0, 0.0), rng, ARM, replay=replay)
    imu = record_imu(motion, {}, ImuNoise(0.0, 0.0), rng, (20.0, 15.0, 100.0))
    write_drive(tmp_path, 1_400_000_000, imu, gnss, ARM)
    fixes = read_receiver_log(tmp_path / "gnss.nmea").fixes
    np.testing.assert_allclose(fixes.gps_s, 1_400_000_000 + gnss.tag, atol=1e-6)
    np.testing.assert_allclose(fixes.lat_rad, gnss.lat, atol=1e-11 + np.radians(1e-6 / 60.0))
    np.testing.assert_allclose(fixes.height_m, gnss.height, atol=0.006)
    told = np.hypot(gnss.vel[:, 0], gnss.vel[:, 1])
    read = np.hypot(fixes.vel_ned[:, 0], fixes.vel_ned[:, 1])
    known = np.isfinite(read)
    assert known.mean() > 0.5
    # a tenth of a knot is its digit
    np.testing.assert_allclose(read[known], told[known], atol=0.06)


def test_half_of_the_cases_are_real_and_hide_nothing_that_the_receiver_has() -> None:
    for kind in ("effect", "null", "triple"):
        ids = case_ids(kind, 60)
        real = [i for i in ids if i.endswith("-real")]
        assert len(real) == 30
        assert not any(name in i for i in real for name in RECEIVERS_OWN)
        assert len(set(ids)) == 60


def answer(*findings: dict[str, Any], **more: Any) -> dict[str, Any]:
    empty: dict[str, Any] = {"gap_before": 1.0, "gap_after": 0.0, "unexplained": None, "noise": {}}
    return {"findings": list(findings), **empty, **more}


def finding(effect: str, value: float) -> dict[str, Any]:
    parameters = {"p": {"value": value, "sd": 0.003, "unit": ""}}
    return {"effect": effect, "parameters": parameters, "evidence_nats": 50.0}


@pytest.fixture(scope="module")
def real_null() -> Drawn:
    if shared_drives() is None:
        pytest.skip("AUTOMAP_SHARED_DATA holds no drives with a reference")
    drawn = draw_case("null-2-real")
    replay = replace(drawn.setting.replay, recording="gsdc-mtv1-xl")  # type: ignore[type-var]
    return replace(drawn, setting=replace(drawn.setting, replay=replay))


def misfit(channel: str) -> dict[str, Any]:
    return {"channel": channel, "kind": "period", "where": "", "size": 1.0, "p_value": 1e-6}


@pytest.mark.parametrize(
    ("said", "outcome"),
    [
        (answer(finding("gnss_velocity_latency", 0.6)), "silent"),
        (answer(finding("imu_time_offset", 0.12)), "silent"),
        (answer(finding("imu_time_offset", 0.3)), "false alarm"),
        (answer(finding("imu_time_offset", -0.12)), "false alarm"),
        (answer(finding("gnss_lever_arm", 0.5)), "false alarm"),
        (answer(finding("gyro_misalignment", 0.01)), "false alarm"),
        (answer(unexplained={"channel": "position_along", "formula": "speed"}), "silent"),
        (answer(unexplained={"channel": "accel_x", "formula": "speed"}), "false alarm"),
    ],
)
def test_a_receivers_own_errors_are_no_false_alarm_and_all_others_are(
    real_null: Drawn, said: dict[str, Any], outcome: str
) -> None:
    assert judge(real_null, said).outcome == outcome


def test_misfits_of_positions_are_the_receivers_and_of_the_vehicle_are_not(
    real_null: Drawn,
) -> None:
    assert judge(real_null, answer(misfits=[misfit("velocity_n")])).misfits == []
    assert judge(real_null, answer(misfits=[misfit("nhc_y")])).misfits
    unsure = {**misfit("nhc_y"), "p_value": 0.01}
    assert judge(real_null, answer(misfits=[unsure])).misfits == []


def test_the_strongest_refused_candidate_is_kept_where_it_is_stated(real_null: Drawn) -> None:
    rows = [
        {"effect": "gnss_latency", "evidence_nats": 30.0, "p_value": 1e-9},
        {"effect": "accel_misalignment", "evidence_nats": 4.0, "p_value": 0.2},
        {"effect": "gyro_misalignment", "evidence_nats": 3.0, "p_value": 0.4},
    ]
    verdict = judge(real_null, answer(refused=rows))
    assert (verdict.refused, verdict.refused_p, verdict.refused_nats) == (
        "accel_misalignment",
        0.2,
        4.0,
    )
    assert judge(real_null, answer()).refused_p is None


def test_a_receivers_name_counts_where_it_cannot_be_told_from_what_is_hidden() -> None:
    replay = Replay("gsdc-mtv1", 0.0, False, 0.0, 1.0, 1.0, 1.0)
    late = finding("gnss_latency", 0.1) | {"confusable_with": ["imu_time_offset"]}
    slow = finding("gnss_velocity_latency", 0.3)
    assert strangers([late, slow], replay, {"imu_time_offset"}) == [late]
    assert strangers([late, slow], replay) == []
    assert strangers([late, slow], None) == [late, slow]
