"""When a name is given, refused and asked for again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from automap.gap.evidence import Evidence
from automap.gap.model import SKEW, base_model
from automap.gap.naming import by_sign
from automap.gap.scoring import Joint
from automap.gap.screening import Candidate
from automap.gap.search import accept, candidates_of
from automap.gap.search_state import State, Trial

MODEL = base_model()


def trial(effect: str, value: float = 1.0, sd: float = 1.0, nats: float = 50.0) -> Trial:
    one = np.ones(1)
    candidate = Candidate(
        effect, ("p",), np.array([0]), one, Evidence(nats, one, one, 1.0, 1.0, nats), 0.0
    )
    joint = Joint(((effect, "p"),), np.array([value]), np.array([[sd**2]]), nats)
    return Trial(candidate, joint, (), MODEL, nats, 0.0, one)


@pytest.mark.parametrize(("value", "kept"), [(9e-6, False), (-1e-4, True), (2e-4, True)])
def test_clocks_whose_rates_do_not_differ_have_no_skew(value: float, kept: bool) -> None:
    found = by_sign([trial(SKEW, value, 2e-5)], [SKEW])
    assert bool(found) is kept


@pytest.mark.parametrize(
    "effect", ["gnss_velocity_latency", "gnss_velocity_lag", "vehicle_sideslip"]
)
def test_no_velocity_is_early_and_no_tyre_slips_inwards(effect: str) -> None:
    assert by_sign([trial(effect, -0.02, 1e-3)], [effect]) == []
    assert [t.effect for t in by_sign([trial(effect, 0.02, 1e-3)], [effect])] == [effect]


@pytest.mark.parametrize(("y", "kept"), [(2e-3, True), (-2e-3, False)])
def test_the_sign_of_several_axes_is_that_of_the_axis_that_shows(y: float, kept: bool) -> None:
    found = trial("gyro_dead_zone")
    names = tuple(("gyro_dead_zone", axis) for axis in "xyz")
    joint = replace(found.joint, names=names, values=np.array([-1e-4, y, 1e-4]))
    joint = replace(joint, cov=np.eye(3) * 2e-4**2)
    assert bool(by_sign([replace(found, joint=joint)], ["gyro_dead_zone"])) is kept


def test_velocities_may_be_less_late_than_their_fixes() -> None:
    found = trial("gnss_velocity_latency", -0.05, 1e-3)
    names = (("gnss_latency", "s"), ("gnss_velocity_latency", "s"))
    joint = replace(found.joint, names=names, values=np.array([0.07, -0.05]), cov=np.eye(2) * 1e-6)
    assert by_sign([replace(found, joint=joint)], ["gnss_velocity_latency"])


def test_what_was_refused_is_asked_for_again_once_something_is_named() -> None:
    state = State([], [], {}, MODEL, [])
    state.refused = {"imu_mounting": "held-out data do not confirm it"}
    state.warnings = ["a formula was not confirmed"]
    assert "imu_mounting" not in candidates_of(state, ())
    accept(state, trial("speed_vibration"), print)
    assert not state.refused
    assert "imu_mounting" in candidates_of(state, ())
    accept(state, trial("imu_mounting"), print)
    assert list(state.accepted) == ["speed_vibration", "imu_mounting"]
    assert [t.stage for t in state.trials] == [1, 2]
    assert state.warnings == ["a formula was not confirmed"]
