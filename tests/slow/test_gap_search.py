"""The whole search: an effect that the simulator hid is named, and a clean drive is silent."""

from __future__ import annotations

import re
from typing import Any

import pytest

from automap.effects.user import set_user_effects
from automap.effects.user_tables import effects_of_formulas
from automap.gap import find_gaps
from tests.unit.test_gap import simulated

pytestmark = pytest.mark.slow


@pytest.mark.parametrize(
    ("effect", "values"),
    [
        ("gnss_lever_arm", {"x": 0.5}),
        ("gnss_latency", {"s": 0.05}),
        ("imu_mounting", {"yaw": 0.03}),
        ("nhc_lever_arm", {"x": -1.2}),
        ("gyro_scale", {"z": 0.01}),
        ("vehicle_sideslip", {"coefficient": 0.006}),
    ],
)
def test_a_hidden_effect_is_named_and_recovered(effect: str, values: dict[str, float]) -> None:
    held = simulated({effect: values}, seed=8)
    result = find_gaps([simulated({effect: values})], [held])
    assert [f.effect for f in result.findings] == [effect]
    finding = result.findings[0]
    for parameter, true in values.items():
        found = finding.parameters[parameter]
        assert abs(found.value - true) < 4.0 * found.sd, parameter
    assert finding.p_value < 1e-3
    assert result.gap_after < 0.5 * result.gap_before
    assert result.formulas == ()


@pytest.mark.parametrize("seed", [3, 5, 6])
def test_a_drive_without_errors_has_no_findings(seed: int) -> None:
    result = find_gaps([simulated({}, seed=seed)])
    assert result.findings == ()
    assert result.formulas == ()
    assert result.misfits == ()


STEPS = [("imu_time", 0.12), ("imu_yaw", 0.04), ("antenna_x", 1.0)]


@pytest.mark.parametrize(("on", "size"), STEPS)
def test_a_clock_a_mount_or_an_antenna_that_steps_is_told_as_one(on: str, size: float) -> None:
    table = {"k": {"on": on, "formula": "step(time - 60)", "prior_sd": 0.1}}
    set_user_effects(effects_of_formulas({"steps": table}, "x"))
    hidden: dict[str, Any] = {"steps": {"k": size}}
    drive, held = simulated(hidden), simulated(hidden, seed=8)
    set_user_effects([])
    result = find_gaps([drive], [held])
    (told,) = result.formulas
    assert told.channel == on
    assert told.formula.startswith(f"{on} += k * step(time - ")
    assert abs(told.coefficient - size) < 4.0 * told.sd
    assert not {"imu_clock_skew", "imu_time_offset", "imu_mounting"} & {
        f.effect for f in result.findings
    }


def test_an_effect_kept_out_of_the_library_is_not_given_another_name() -> None:
    hidden: dict[str, Any] = {"gyro_scale": {"z": 0.02}}
    drive, held = simulated(hidden), simulated(hidden, seed=8)
    result = find_gaps([drive], [held], exclude=("gyro_scale",))
    assert "gyro_z" in [formula.channel for formula in result.formulas]


def test_a_name_that_only_resembles_what_is_missing_does_not_stand_alone() -> None:
    hidden: dict[str, Any] = {"gyro_misalignment": {"xz": 0.01, "yz": -0.008}}
    drive, held = simulated(hidden), simulated(hidden, seed=8)
    result = find_gaps([drive], [held], exclude=("gyro_misalignment",))
    told = [formula.formula for formula in result.formulas]
    told += [rival for f in result.findings for rival in f.confusable_with]
    assert any(re.search(r"gyro_[xy] \+= k\d* \* rate_z", text) for text in told)
