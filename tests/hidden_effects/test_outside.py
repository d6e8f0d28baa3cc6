"""Errors of no library: each acts, each can be judged, and an answer's formula is computed."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.hidden_effects.camera import camera_nats, film, plant_signs
from tests.hidden_effects.cases import Drawn, draw_case
from tests.hidden_effects.evidence import Scene, make_scene, shifts_of
from tests.hidden_effects.geodesy import meridian_radius
from tests.hidden_effects.hide import PIXEL_SD
from tests.hidden_effects.judge import judge, judge_refusal
from tests.hidden_effects.judge_outside import equivalent, outside_outcome
from tests.hidden_effects.motion import Motion, Path, to_body
from tests.hidden_effects.noise import GnssNoise, ImuNoise
from tests.hidden_effects.outside import Outside, all_makers
from tests.hidden_effects.route import Style, draw_plan
from tests.hidden_effects.setting import draw_scene, information
from tests.hidden_effects.strapdown import integrate
from tests.hidden_effects.told import Term, evaluate, told_extras

# the benchmark's own tests: beside it, at night
pytestmark = pytest.mark.slow

PLACE = (np.radians(47.0), np.radians(8.0), 400.0)
SECONDS = 90.0
KINDS = list(all_makers())


def drive(**style: Any) -> Motion:
    rng = np.random.default_rng(5)
    plan = draw_plan(rng, Style(stop_every_m=300.0, **style), SECONDS)
    return Motion(plan, PLACE, SECONDS, rng)


@pytest.fixture(scope="module")
def scene() -> Scene:
    return make_scene(drive(), np.arange(1.0, SECONDS), np.array([0.4, 0.1, -1.2]))


def test_there_are_forty_and_names_say_which() -> None:
    assert len(KINDS) >= 40
    for kind, maker in all_makers().items():
        assert maker(np.random.default_rng(1), SECONDS).kind == kind


INERTIAL = [kind for kind in KINDS if not kind.startswith("camera_")]


@pytest.mark.parametrize("kind", INERTIAL)
def test_a_larger_error_carries_more_evidence(scene: Scene, kind: str) -> None:
    outside = all_makers()[kind](np.random.default_rng(1), SECONDS)
    setting = replace(
        draw_case("null-0").setting,
        imu=ImuNoise(2e-4, 5e-3),
        gnss=GnssNoise(0.1, 0.2, 60.0, 0.03, rate_hz=1.0),
    )
    sizes = (outside.small, float(np.sqrt(outside.small * outside.large)), outside.large)
    nats = [
        0.5 * float(information(scene, setting, [{}], (), outside.extras(size))[0, 0])
        for size in sizes
    ]
    assert nats[0] < nats[1] < nats[2]
    assert nats[0] < 500.0
    assert nats[2] > 60.0
    assert outside.told(0.01).startswith(outside.channel)
    assert "{}" not in outside.told(0.01)


@pytest.mark.parametrize("kind", ["camera_nods", "camera_warps"])
def test_a_camera_that_flexes_is_seen_in_its_boxes(scene: Scene, kind: str) -> None:
    rng = np.random.default_rng(2)
    outside = all_makers()[kind](rng, SECONDS)
    plates = plant_signs(scene.motion, rng)
    nats = []
    for size in (0.1 * outside.small, 0.2 * outside.small, outside.large):
        flex = outside.extras(size).flex
        assert flex is not None
        boxes = film(scene.motion, {}, np.random.default_rng(2), PIXEL_SD, plates, flex)
        nats.append(camera_nats(scene.motion, {}, boxes, PIXEL_SD, flex))
    assert nats[1] == pytest.approx(4.0 * nats[0], rel=0.2)
    assert nats[2] > 60.0


def test_a_bent_body_is_felt_rightly_and_shows_in_the_constraint(scene: Scene) -> None:
    outside = all_makers()["kerb_bends_axle"](np.random.default_rng(1), SECONDS)
    body = outside.extras(0.02).body
    assert body is not None
    motion = scene.motion.bent(body)
    t = np.arange(100 * int(SECONDS) + 1) / 100.0
    true = motion.at(t)
    place, vel, turn = integrate(true, true.force, true.rate, 0.01)
    north = (place[:, 0] - true.lat[::2]) * meridian_radius(true.lat[::2])
    assert np.abs(north).max() < 0.02
    assert np.abs(vel - true.vel_ned[::2]).max() < 1e-3
    assert np.abs(turn - true.C_n_b[::2]).max() < 1e-5
    straight = scene.motion.at(t)
    change = to_body(true.C_n_b, true.vel_ned) - to_body(straight.C_n_b, straight.vel_ned)
    shifts = shifts_of(scene, [{}], (20.0, 15.0, 100.0), outside.extras(0.02))
    np.testing.assert_allclose(shifts.nhc[:, 0, 0], -change[:, 1], atol=2e-3)
    assert np.abs(change[:, 1]).max() > 0.1
    path = motion.path_at(t)
    assert isinstance(path, Path)
    np.testing.assert_allclose(path.speed, true.speed)


def test_formulas_of_the_manual_are_computed_and_nothing_else_is() -> None:
    known = {"speed": np.array([1.0, 4.0]), "rate_z": np.array([-0.5, 0.2])}
    np.testing.assert_allclose(evaluate("speed^2 * abs(rate_z)", known), [0.5, 3.2])
    np.testing.assert_allclose(evaluate("max(rate_z, 0) - 2 / speed", known), [-2.0, -0.3])
    np.testing.assert_allclose(evaluate("step(speed - 2) * cos(pi)", known), [0.0, -1.0])
    for wrong in ("__import__('os')", "speed.real", "unheard_of", "speed if 1 else 0", "speed +"):
        with pytest.raises(ValueError, match="no formula"):
            evaluate(wrong, known)


def test_a_told_formula_acts_where_it_says(scene: Scene) -> None:
    terms = [
        Term("accel_x", "sin(heading)", 0.1),
        Term("height", "speed", 0.2),
        Term("velocity_along", "speed", 0.01),
        Term("nhc_y", "speed", 0.05),
    ]
    shifts = shifts_of(scene, [{}], (20.0, 15.0, 100.0), told_extras(terms))
    speed, state = scene.fix.speed, scene.state
    np.testing.assert_allclose(shifts.accel[:, 0, 0], 0.1 * np.sin(state.rpy[:, 2]), atol=1e-12)
    np.testing.assert_allclose(shifts.pos[:, 2, 0], -0.2 * speed, atol=1e-6)
    along = np.cos(scene.fix.rpy[:, 2]) * shifts.vel[:, 0, 0]
    along += np.sin(scene.fix.rpy[:, 2]) * shifts.vel[:, 1, 0]
    np.testing.assert_allclose(along, 0.01 * speed, atol=1e-6)
    np.testing.assert_allclose(shifts.nhc[:, 0, 0], -0.05 * state.speed, atol=1e-12)


@pytest.fixture(scope="module")
def settling() -> Drawn:
    """An accelerometer that settles, on roads of two minutes."""
    drawn = draw_case("outside-accel_settling-0")
    rng = np.random.default_rng(4)
    scenes = [draw_scene(rng, replace(s, seconds=120.0), {}) for s in (drawn.setting, drawn.again)]
    # seen well, whatever was drawn
    return replace(drawn, scene=scenes[0], held_out=scenes[1], size=0.3)


def answer(*findings: dict[str, Any], **more: Any) -> dict[str, Any]:
    empty: dict[str, Any] = {"gap_before": 1.0, "gap_after": 0.0, "unexplained": None, "noise": {}}
    return {"findings": list(findings), **empty, **more}


def finding(effect: str, parameter: str, value: float, **more: Any) -> dict[str, Any]:
    parameters = {parameter: {"value": value, "sd": 0.1 * value, "unit": ""}}
    return {"effect": effect, "parameters": parameters, "evidence_nats": 50.0} | more


def formula(channel: str, text: str, k: float, **more: Any) -> dict[str, Any]:
    terms = [{"channel": channel, "formula": text, "coefficient": k, "sd": 0.01}]
    return {"channel": channel, "formula": f"{channel} += k * {text}", "terms": terms} | more


def misfit(channel: str, kind: str) -> dict[str, Any]:
    return {"channel": channel, "kind": kind, "where": "at first", "size": 1.0, "p_value": 1e-6}


def test_the_truth_in_other_words_is_right_and_half_of_it_is_not(settling: Drawn) -> None:
    assert isinstance(settling.formula, Outside)
    channel = settling.formula.channel
    tau = float(settling.formula.truth.split("constant ")[1].split()[0])
    right = answer(unexplained=formula(channel, f"exp(-time / {tau})", 0.3))
    verdict = judge(settling, right)
    assert (verdict.outcome, verdict.flagged, verdict.formula_right) == (
        "formula right",
        True,
        True,
    )
    share = equivalent(settling, right, {})
    assert share is not None
    assert share > 0.98
    half = answer(unexplained=formula(channel, f"exp(-time / {tau})", 0.15))
    share = equivalent(settling, half, {})
    assert share == pytest.approx(0.75, abs=0.02)
    assert judge(settling, half).outcome == "flagged"
    # what two formulas say together is what is said
    two = answer(unexplained=half["unexplained"], formulas=[half["unexplained"]] * 2)
    assert judge(settling, two).outcome == "formula right"


def test_a_unit_that_turns_or_its_vehicle_is_the_vehicle_where_both_are_told() -> None:
    drawn = draw_case("outside-torque_steers-0")
    body = drawn.extras().body
    assert body is not None
    text = "max(lag(acceleration, 0.3), 0)"
    alone = formula("imu_yaw", text, drawn.size)
    both = {**alone, "same_as": "a vehicle, the unit with it, that turns by as much"}
    shares = [equivalent(drawn, answer(unexplained=one), {}) for one in (alone, both)]
    assert shares[0] is not None
    assert shares[1] == pytest.approx(1.0, abs=0.01)
    assert shares[0] < 0.9
    wrong = {**both, **formula("imu_yaw", text, -drawn.size)}
    assert (equivalent(drawn, answer(unexplained=wrong), {}) or 0.0) < 0.0


@pytest.mark.parametrize(
    ("more", "outcome"),
    [
        ({"misfits": [misfit("velocity_n", "time")]}, "misfit right"),
        ({"misfits": [misfit("velocity_n", "turn")]}, "flagged"),
        ({"misfits": [misfit("image_u", "time")]}, "elsewhere"),
        ({"misfits": [{**misfit("velocity_n", "time"), "p_value": 0.05}]}, "silent"),
        ({}, "silent"),
        ({"unexplained": formula("gyro_z", "speed", 1e-4)}, "elsewhere"),
        ({"noise_claims": [{"level": "accel", "factor": 2.0, "p_value": 1e-5}]}, "as noise"),
    ],
)
def test_what_is_said_without_a_name(settling: Drawn, more: dict[str, Any], outcome: str) -> None:
    verdict = judge(settling, answer(**more))
    assert (verdict.outcome, verdict.wrong) == (outcome, [])
    assert verdict.flagged == (outcome in ("misfit right", "flagged"))


def test_a_sure_name_alone_is_wrong_and_with_a_doubt_is_not(settling: Drawn) -> None:
    name = finding("gyro_scale", "x", 1e-3)
    verdict = judge(settling, answer(name))
    assert (verdict.outcome, verdict.wrong, verdict.flagged) == ("wrong", ["gyro_scale"], False)
    assert "settles by" in verdict.why
    doubt = finding("gyro_scale", "x", 1e-3, resembles="accel_x += k * exp(-time / 20)")
    assert judge(settling, answer(doubt)).outcome == "resembles"
    beside = judge(settling, answer(name, misfits=[misfit("velocity_e", "time")]))
    assert (beside.outcome, beside.wrong) == ("misfit right", [])
    walk = judge(settling, answer(finding("accel_bias_walk", "x", 1e-3)))
    assert (walk.outcome, walk.wrong, walk.flagged) == ("as noise", [], False)


def test_a_run_that_stops_for_the_clock_is_right_only_where_the_clock_errs(
    settling: Drawn,
) -> None:
    text = "imu.csv: the clock jumps by 0.1 s"
    assert judge_refusal(settling, text).outcome == "refused"
    clock = replace(settling, formula=all_makers()["clock_step"](np.random.default_rng(1), SECONDS))
    assert judge_refusal(clock, text).outcome == "flagged"
    assert judge_refusal(clock, "no fixes").outcome == "refused"


def test_what_the_library_has_by_this_name_since_is_right() -> None:
    hidden = all_makers()["gyro_dead_zone"](np.random.default_rng(1), 200.0)
    named = [{"effect": "gyro_dead_zone", "parameters": {}}]
    assert outside_outcome(hidden, answer(*named), named, 0.0) == ("alike", [])
    other = [{"effect": "gyro_quadratic", "parameters": {}}]
    assert outside_outcome(hidden, answer(*other), other, 0.0) == ("wrong", ["gyro_quadratic"])
