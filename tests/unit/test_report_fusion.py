"""What the page says of the fusion and of the truth."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import pytest
from export_inputs import FUSION

from automap.export.icons import words_apart
from automap.io import names
from pipeline.report.channels import channel_list, channel_name, channel_order, is_rule
from pipeline.report.evaluation_section import evaluation_section
from pipeline.report.fusion_section import fusion_section
from pipeline.report.map_data import sign_faces
from pipeline.report.verdict_section import verdict_section
from pipeline.run.geolocate_output import signs_verdict
from pipeline.shared.products import RunProducts

EVALUATION = {
    "position_rms_m": {"n": 0.5, "e": 0.3, "d": 0.9, "horizontal": 0.6},
    "raw_position_rms_m": {"n": 0.8, "e": 0.4, "d": 1.6, "horizontal": 0.9},
    "sigma_ratio": {"n": 1.1, "e": 0.5},
    "signs": {
        "gates": {"1": {"recall": 0.75, "precision": 0.9}, "5": {"recall": 1.0, "precision": 1.0}},
        "median_error_m": 0.64,
        "p95_error_m": 1.3,
        "coverage95": 0.93,
    },
}


def test_the_presets_in_use_are_told(tmp_path: Path) -> None:
    presets = {"imu": {"preset": "mpu9150", "name": "MPU-9150"}, "gnss": {"name": "u-blox M8"}}
    text = said(tmp_path, {**FUSION, "presets": presets})
    assert "The inertial sensor is of type MPU-9150 and the receiver is of type u-blox M8: " in text


def said(out: Path, content: Any) -> str:
    (out / names.FUSION).write_text(json.dumps(content))
    section = fusion_section(RunProducts(out))
    return " ".join([*section.sentences, *(text for _, text in section.verdicts)])


def test_a_turned_sensor_its_delay_and_noise_are_told(tmp_path: Path) -> None:
    text = said(tmp_path, FUSION)
    assert "125 ms (σ 4 ms) later than the positions show" in text
    assert "turned by 17" in text
    assert "stood still 2 times" in text
    assert "in times the setting: gyro noise 4" in text
    assert "accelerometer" not in text


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"imu_delay_s": -0.08, "delay_is_clock": True}, "handed its positions out 80 ms"),
        ({"imu_delay_s": 0.003}, "no more than its σ explains"),
        ({"align_margin_nats": 1.0}, "doubtful"),
        ({"noise_factors": {"gyro": 1.0}}, "as the settings and the receiver state it"),
        ({"mounting_rpy_deg": [0.1, 0.0, 0.2]}, "as the manifest says"),
        ({"standstill": []}, "never stood still"),
        ({"method": "gnss only"}, "fixes alone, smoothed"),
        ({"method": "finished trajectory"}, "nothing was fused"),
    ],
)
def test_other_cases_have_other_words(tmp_path: Path, changes: dict[str, Any], words: str) -> None:
    assert words in said(tmp_path, {**FUSION, **changes})


def test_wheel_speed_is_told_with_its_delay_and_scale(tmp_path: Path) -> None:
    wheels = {
        "odometer_rate_hz": 1.0,
        "odometer_step_m_s": 0.2778,
        "odometer_stuck": 12,
        "odometer_scale": 0.981,
        "odometer_scale_sd": 0.002,
        "odometer_time_offset_s": 0.42,
        "odometer_time_offset_sd_s": 0.013,
    }
    told = said(tmp_path, {"method": "inertial", "wheels": wheels})
    for part in ("1 times a second", "420 ms (σ 13 ms) late", "1.90% (σ 0.20%) too short"):
        assert part in told
    assert "steps of 0.28 m/s" in told
    assert "12 of its values, stuck" in told
    told = said(tmp_path, {"method": "inertial", "wheels": {"odometer_rate_hz": 1.0}})
    assert "wheel speed was left out" in told


def test_values_of_another_kind_are_passed_over(tmp_path: Path) -> None:
    strange = {key: "?" for key in FUSION} | {"method": "inertial"}
    assert "The path joins" in said(tmp_path, strange)
    assert fusion_section(RunProducts(tmp_path / "none")).absent


def test_the_truth_is_shown_once_it_was_compared(tmp_path: Path) -> None:
    assert evaluation_section(RunProducts(tmp_path)).absent
    path = tmp_path / names.EVALUATION
    path.write_text(json.dumps(EVALUATION))
    section = evaluation_section(RunProducts(tmp_path))
    text = " ".join(section.sentences)
    assert "0.6 m rms from the truth horizontally, the receiver's own fixes 0.9 m" in text
    assert "within 1 m 75% and 90%, within 5 m 100% and 100%" in text
    assert section.rows[0][2:] == ("0.5", "0.3", "0.9", "0.6")
    assert "older" not in text


def test_a_comparison_older_than_the_results_says_so(tmp_path: Path) -> None:
    (tmp_path / names.EVALUATION).write_text(json.dumps(EVALUATION))
    (tmp_path / names.SIGNS_GEOJSON).write_text("{}")
    os.utime(tmp_path / names.EVALUATION, (1e9, 1e9))
    assert "older than the results" in " ".join(evaluation_section(RunProducts(tmp_path)).sentences)


def test_a_verdict_is_told_with_its_reasons_and_where() -> None:
    spans = [[60.0 * k, 60.0 * k + 20.0] for k in range(1, 8)]
    reasons = [{"code": "off_the_fixes", "text": "fixes lie 9 m off", "spans_s": spans}]
    state, section = verdict_section({"verdict": {"state": "doubtful", "reasons": reasons}})
    assert state == "path doubtful"
    assert "widened" in section.sentences[0]
    ((grade, text),) = section.verdicts
    assert grade == "bad"
    assert text.startswith("Fixes lie 9 m off (1 min 00 s to 1 min 20 s, ")
    assert text.endswith("5 min 20 s and 2 more into the drive).")
    assert verdict_section({"verdict": {"state": "good", "reasons": []}})[1].verdicts == []


def test_signs_that_are_unsure_are_told_beside_a_good_path() -> None:
    record = {
        "verdict": {"state": "good", "reasons": []},
        "signs_verdict": signs_verdict(["ok", "doubtful", "single_view", "doubtful"], 40),
    }
    heading, section = verdict_section(record)
    assert heading == "path good, signs doubtful"
    ((grade, text),) = section.verdicts
    assert grade == "bad"
    assert "3 of 4 signs are placed uncertainly (2 doubtful, 1 single_view)" in text


@pytest.mark.parametrize(
    ("statuses", "boxes", "state"),
    [
        ([], 0, None),
        ([], 9, "doubtful"),
        (["ok"] * 3 + ["single_view"] * 3, 9, "good"),
        (["ok"] * 3 + ["single_view"] * 4, 9, "doubtful"),
        # one camera of two goes with no path
        (["ok"] * 9 + ["doubtful"], 9, "doubtful"),
    ],
)
def test_signs_are_relied_on_where_most_are_placed_well_and_no_camera_is_doubted(
    statuses: list[str], boxes: int, state: str | None
) -> None:
    told = signs_verdict(statuses, boxes)
    assert (told and told["state"]) == state


def test_what_is_to_be_known_of_a_good_path_is_no_reproach() -> None:
    reasons = [{"code": "velocity_of_positions", "text": "it tells nothing more"}]
    _, section = verdict_section({"verdict": {"state": "good", "reasons": reasons}})
    assert section.verdicts == [("good", "It tells nothing more.")]


@pytest.mark.parametrize("record", [{}, {"verdict": None}, {"verdict": {"state": "?"}}])
def test_without_a_verdict_the_page_tells_none(record: dict[str, Any]) -> None:
    assert verdict_section(record)[0] == ""


def test_channels_have_names_and_an_order() -> None:
    channels = ["nhc_y", "zupt_e", "velocity_d", "position_e", "position_n", "odometer"]
    assert sorted(channels, key=channel_order) == [
        *("position_n", "position_e", "velocity_d", "zupt_e", "nhc_y", "odometer")
    ]
    assert channel_name("position_e") == "GPS position east"
    assert channel_name("odometer") == "Wheel speed"
    assert is_rule("zaru_x")
    assert not is_rule("position_n")


def test_faces_are_drawn_for_known_classes_only() -> None:
    faces = sign_faces({"regulatory--stop--g1", "<script>"})
    assert set(faces) == {"regulatory--stop--g1", "<script>"}
    assert all(face.startswith("data:image/png;base64,") for face in faces.values())


def test_axes_of_one_kind_are_listed_with_it() -> None:
    channels = ["zupt_n", "zupt_e", "zaru_x", "nhc_y", "odometer", "own_x"]
    assert channel_list(channels) == (
        "standstill, velocity (north, east); standstill, turn rate (x); no sideways motion; "
        "wheel speed; own_x"
    )


def test_classes_that_are_said_alike_are_told_apart() -> None:
    names = ["warning--roundabout--g2", "regulatory--roundabout--g1", "regulatory--stop--g1", ""]
    assert list(words_apart(names).values()) == [
        "roundabout (warning)",
        "roundabout (regulatory)",
        "stop",
        "",
    ]
    versions = ["warning--children--g1", "warning--children--g2", "information--children--g1"]
    assert list(words_apart(versions[:2]).values()) == ["children (g1)", "children (g2)"]
    assert list(words_apart(versions).values()) == [
        "children (warning, g1)",
        "children (warning, g2)",
        "children (information)",
    ]
