"""The judge: right answers pass, wrong ones are found out, whatever the answer says of itself."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.benchmarks.hidden_effects import COUNTS, all_cases, read_results
from tests.hidden_effects.cases import Drawn, draw_case, write_case
from tests.hidden_effects.formula_text import formula_is_right
from tests.hidden_effects.formulas import KINDS
from tests.hidden_effects.judge import Verdict, judge
from tests.hidden_effects.own_filter import closed_share, own_sd, shortfall
from tests.hidden_effects.rates import clopper_pearson, report
from tests.hidden_effects.real_receiver import Replay
from tests.hidden_effects.setting import draw_scene
from tests.hidden_effects.sizes import SCALES

# the benchmark's own tests: beside it, at night
pytestmark = pytest.mark.slow


def short(case_id: str) -> Drawn:
    """The case on roads of one minute."""
    drawn, rng = draw_case(case_id), np.random.default_rng(4)
    scenes = {}
    for name, setting in (("scene", drawn.setting), ("held_out", drawn.again)):
        scenes[name] = draw_scene(rng, replace(setting, seconds=60.0), drawn.case.effects)
    return replace(drawn, **scenes)


@pytest.fixture(scope="module")
def vibration() -> Drawn:
    return short("effect-speed_vibration-1")


def finding(effect: str, values: dict[str, float], **more: Any) -> dict[str, Any]:
    parameters = {p: {"value": v, "sd": 0.1 * abs(v) + 1e-6, "unit": ""} for p, v in values.items()}
    return {"effect": effect, "parameters": parameters, "evidence_nats": 99.0} | more


def answer(*findings: dict[str, Any], unexplained: dict[str, Any] | None = None) -> dict[str, Any]:
    return {
        "gap_before": 1.0,
        "gap_after": 0.01,
        "findings": list(findings),
        "unexplained": unexplained,
        "noise": {},
    }


def test_the_same_name_draws_the_same_case_and_files(tmp_path: Path) -> None:
    one, two = draw_case("null-3"), draw_case("null-3")
    assert one.case == two.case
    for name, drawn in (("a", one), ("b", two)):
        write_case(drawn, tmp_path / name)
    for part in ("drive/imu.csv", "holdout/gnss.ubx", "base.toml"):
        assert (tmp_path / "a" / part).read_bytes() == (tmp_path / "b" / part).read_bytes()
    assert draw_case("null-4").case.level != one.case.level


def test_the_truth_is_named_covered_and_closes_the_gap(vibration: Drawn) -> None:
    true = vibration.case.effects["speed_vibration"]
    verdict = judge(vibration, answer(finding("speed_vibration", true)))
    assert (verdict.outcome, verdict.top_right, verdict.wrong) == ("named", True, [])
    assert verdict.counted == verdict.covered >= len(true)
    assert verdict.closed == pytest.approx(1.0, abs=1e-9)
    assert verdict.closed_told == pytest.approx(0.99)


def test_a_value_that_is_off_is_not_covered_and_leaves_a_gap(vibration: Drawn) -> None:
    off = {p: 1.5 * v for p, v in vibration.case.effects["speed_vibration"].items()}
    verdict = judge(vibration, answer(finding("speed_vibration", off)))
    assert verdict.outcome == "named"
    assert verdict.covered < verdict.counted
    assert verdict.closed == pytest.approx(0.75, abs=0.01)


def test_a_wrong_name_is_wrong_unless_the_truth_is_said_to_be_confusable(
    vibration: Drawn,
) -> None:
    other = finding("accel_temperature", {"x": 1e-3})
    verdict = judge(vibration, answer(other))
    assert (verdict.outcome, verdict.top_right) == ("wrong", False)
    assert verdict.wrong == ["accel_temperature"]
    assert "short of the truth" in verdict.why
    other = finding("accel_temperature", {"x": 1e-3}, confusable_with=["speed_vibration"])
    verdict = judge(vibration, answer(other))
    assert (verdict.outcome, verdict.top_right, verdict.wrong) == ("pair", True, [])


def test_one_name_too_many_is_wrong(vibration: Drawn) -> None:
    true = finding("speed_vibration", vibration.case.effects["speed_vibration"])
    verdict = judge(vibration, answer(true, finding("accel_temperature", {"x": 1e-3})))
    assert (verdict.outcome, verdict.wrong) == ("named with more", ["accel_temperature"])
    assert judge(vibration, answer()).outcome == "missed"


def test_null_drives_are_silent_or_false_alarms() -> None:
    quiet, dirty = draw_case("null-1"), draw_case("null-2")
    assert judge(quiet, answer()).outcome == "silent"
    outliers = finding("gnss_outliers", {"fraction": 0.01})
    assert judge(quiet, answer(outliers)).outcome == "false alarm"
    assert judge(dirty, answer(outliers)).outcome == "silent"
    odd = {"channel": "accel_x", "formula": "speed^2"}
    assert judge(quiet, answer(unexplained=odd)).outcome == "false alarm"


def test_delay_seen_from_two_sides_falls_nothing_short_and_a_stranger_does() -> None:
    drawn = short("effect-imu_time_offset-0")
    total = shortfall(drawn, [])
    assert total > 10.0
    assert shortfall(drawn, ["gnss_latency"]) < 0.05 * total
    assert shortfall(drawn, ["accel_temperature"]) > 0.5 * total


def test_of_a_delay_that_a_recorded_receiver_has_itself_no_interval_is_asked() -> None:
    drawn = short("effect-gnss_latency-0")
    said = answer(finding("gnss_latency", {"s": 3.0}))
    assert judge(drawn, said).counted == 1
    recorded = Replay("somewhere", 0.0, False, 0.0, 1.0, 1.0, 1.0)
    there = replace(drawn, setting=replace(drawn.setting, replay=recorded))
    assert judge(there, said).counted == 0


def test_own_sd_says_what_a_drive_determines(vibration: Drawn) -> None:
    sds = own_sd(vibration, ["speed_vibration", "imu_mounting"])
    assert sds["speed_vibration", "x"] < 1e-5
    # without a sign or a slope that is known the roll of a mounting is the vehicle's
    assert sds["imu_mounting", "roll"] > 5.0 * sds["imu_mounting", "yaw"]
    assert closed_share(vibration, {}) == pytest.approx(0.0, abs=1e-9)


RIGHT = {
    "heading_sine": ("accel_x", "sin(heading)"),
    "rate_squared": ("gyro_x", "omega_z^2"),
    "force_times_rate": ("accel_z", "f_x * omega_z"),
    "speed_cubed": ("accel_x", "speed^3"),
    "warm_up": ("gyro_z", "exp(-t/30)"),
    "one_sided": ("accel_y", "max(f_x, 0)"),
    "speed_times_lateral": ("accel_x", "speed * f_y"),
    "step": ("accel_y", "step(t - 60)"),
    "position_speed_squared": ("position_forward", "speed^2"),
    "hysteresis": ("accel_z", "sign(f_x)"),
}


@pytest.mark.parametrize("kind", KINDS)
def test_formulas_are_graded_by_channel_and_factors(kind: str) -> None:
    channel, formula = RIGHT[kind]
    assert formula_is_right(kind, {"channel": channel, "formula": formula})
    assert not formula_is_right(kind, {"channel": "gyro_y", "formula": formula})
    assert not formula_is_right(kind, {"channel": channel, "formula": "temperature"})


def test_outside_the_library_silence_and_wrong_names_count_apart() -> None:
    drawn = draw_case("formula-step-0")
    step = {"channel": "accel_y", "formula": "step(t - 100 s)"}
    assert judge(drawn, answer(unexplained=step)).outcome == "formula right"
    assert judge(drawn, answer()).outcome == "missed"
    named = finding("accel_temperature", {"y": 1e-3})
    assert judge(drawn, answer(named)).outcome == "mis-named"
    both = judge(drawn, answer(named, unexplained={"channel": "accel_y", "formula": "t"}))
    assert (both.outcome, both.wrong) == ("flagged", [])


def test_intervals_are_clopper_and_pearsons() -> None:
    # Table of their paper's kind: 0 and 1 of 200, 95 of 100
    np.testing.assert_allclose(clopper_pearson(0, 200), (0.0, 0.018275), atol=1e-5)
    np.testing.assert_allclose(clopper_pearson(95, 100), (0.887165, 0.983571), atol=1e-5)
    assert clopper_pearson(0, 0) == (0.0, 1.0)


def test_report_counts_and_lists_every_miss() -> None:
    hit = Verdict("effect-accel_scale-0", "effect", "usual", 99.0, "named", ["accel_scale"])
    hit.top_right, hit.closed, hit.closed_told, hit.seconds = True, 0.99, 0.98, 600.0
    miss = Verdict("null-7", "null", "dirty", 0.0, "false alarm", ["gyro_scale"])
    miss.why, miss.seconds = "said: gyro_scale", 120.0
    text = "\n".join(report([hit, miss]))
    assert "1/1 = 100.0 %" in text
    assert "null-7 (dirty, 120 s, 0 nats) false alarm: said: gyro_scale" in text
    assert "99.00 % by the drawn drive" in text


@pytest.mark.parametrize(("nats", "counted"), [(17.0, 1), (0.0, 0)])
def test_what_a_drive_does_not_show_at_all_counts_for_no_silence(nats: float, counted: int) -> None:
    silent = Verdict("outside-velocity_dips-7-real", "outside", "usual", nats, "silent")
    (line,) = (text for text in report([silent]) if "nothing said" in text)
    assert (f"{counted}/{counted}" in line) == bool(counted)


def test_a_second_call_goes_on_and_a_torn_line_is_left_out(tmp_path: Path) -> None:
    path = tmp_path / "results.jsonl"
    rows = [{"version": v, "verdict": {"id": i}} for v, i in (("a", "null-0"), ("b", "null-1"))]
    path.write_text("".join(json.dumps(r) + "\n" for r in rows) + '{"version": "b", "ver')
    assert list(read_results(path, "b")) == ["null-1"]
    assert list(read_results(path, None)) == ["null-0", "null-1"]
    assert read_results(tmp_path / "none", None) == {}


def test_the_list_has_every_effect_and_enough_of_each_kind() -> None:
    cases = all_cases(list(COUNTS), "")
    assert len(cases) == len(set(cases)) == sum(COUNTS.values())
    for effect in SCALES:
        assert sum(c.startswith(f"effect-{effect}-") for c in cases) >= 5
        assert effect in ("accel_scale", "gyro_scale") or f"removed-{effect}-0" in cases
    assert COUNTS["null"] >= 200
    assert COUNTS["triple"] >= 20
    assert all(sum(c.startswith(f"formula-{kind}-") for c in cases) >= 3 for kind in KINDS)


@pytest.mark.parametrize(
    ("told", "outcome"),
    [
        ("accel_z += k * force_x; accel_z += k2 * force_y", "formula beside a name"),
        ("accel_z += k * force_x; gyro_x += k2 * rate_z", "mis-named"),
        ("accel_y += k * force_x", "mis-named"),
        ("gyro_g_sensitivity", "mis-named"),
    ],
)
def test_a_left_out_effect_told_as_a_rival_formula_is_not_silent(told: str, outcome: str) -> None:
    drawn = short("removed-accel_misalignment-0")
    assert set(drawn.case.effects["accel_misalignment"]) == {"zx", "zy"}
    name = finding("gnss_datum_shift", {"north": 0.1}, confusable_with=[told])
    assert judge(drawn, answer(name)).outcome == outcome


@pytest.mark.parametrize(("factor", "outcome"), [(1.6, "as noise"), (1.0, "missed")])
def test_a_noise_taken_out_of_the_library_is_told_by_its_level(factor: float, outcome: str) -> None:
    drawn = short("removed-gyro_bias_walk-0")
    assert judge(drawn, answer() | {"noise": {"gyro_bias_walk": factor}}).outcome == outcome
