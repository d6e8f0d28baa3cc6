"""What a drive cannot tell apart, and what hardly shows on it."""

from __future__ import annotations

import numpy as np
import pytest

from automap.effects import CATALOGUE
from automap.fusion.layout import CH_POS, MAX_SCALARS
from automap.gap import base_model
from automap.gap.candidates import library
from automap.gap.columns import named_columns, term_columns
from automap.gap.drive import open_drive
from automap.gap.fit import Fit, fit_drive
from automap.gap.linear import Column, Direct
from automap.gap.naming import identifiability
from automap.gap.neighbours import Terms
from automap.gap.nodes import NodeMotion, motions_of
from automap.gap.result import BODY, MOUNT, STRETCHED, TURNED, elsewhere
from automap.gap.sensitivity import linearised
from automap.records import FloatArray, IntArray
from tests.unit.test_gap import simulated


@pytest.fixture(scope="module")
def town() -> Fit:
    model = base_model()
    return fit_drive(open_drive(simulated({}), model.options), model)


def test_twins_are_told_with_the_manoeuvre_that_would_tell(town: Fit) -> None:
    found = identifiability([town], library(frozenset(), False, True))
    pairs = {frozenset(a.effects): a for a in found.alike}
    twins = frozenset({"gnss_latency", "imu_time_offset"})
    # late fixes and late stamps are one thing to IMU and receiver
    assert pairs[twins].share > 0.99
    assert "tap the IMU" in pairs[twins].advice
    # a bend tells a lever arm from a scale
    assert frozenset({"gnss_lever_arm", "gyro_scale"}) not in pairs
    assert all(a.share >= b.share for a, b in zip(found.alike, found.alike[1:], strict=False))


def test_what_hardly_shows_is_listed(town: Fit) -> None:
    found = identifiability([town], library(frozenset(), False, True))
    # no receiver knows another datum, and without a thermometer nothing follows temperature
    assert {"gnss_datum_shift", "accel_temperature"} <= set(found.hidden)
    assert "gnss_lever_arm" not in found.hidden
    told = {e for a in found.alike for e in a.effects}
    assert not told & set(found.hidden)


def _way(at: NodeMotion) -> FloatArray:
    """NED [k, 3] m since the drive began."""
    motion = at.motion
    steps = 0.5 * (motion.vel[1:] + motion.vel[:-1]) * np.diff(motion.t)[:, None]
    way = np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])
    return np.stack([np.interp(at.t, motion.t, axis) for axis in way.T], axis=1)


def _moved(at: NodeMotion, told: str) -> Column:
    """Positions that are stretched or turned about where the drive begins."""
    way, by_channel = _way(at), np.zeros((len(at.t), MAX_SCALARS))
    level = way[:, :2] if told == STRETCHED else np.stack([-way[:, 1], way[:, 0]], axis=1)
    by_channel[:, CH_POS : CH_POS + 2] = level
    return Column(told, "k", 1.0, direct=Direct(by_channel))


@pytest.mark.parametrize(
    ("name", "terms", "told", "twin"),
    [
        ("gnss_velocity_scale", (), STRETCHED, ()),
        ("", (("velocity_across", "speed"),), TURNED, ()),
        (
            *("", (("nhc_y", "speed * lateral_acceleration"),), MOUNT),
            (("imu_yaw", "lateral_acceleration"),),
        ),
        ("", (("imu_yaw", "abs(rate_z)"),), BODY, (("nhc_y", "speed * abs(rate_z)"),)),
    ],
)
def test_what_is_said_to_be_the_same_leaves_the_same_traces(
    town: Fit, name: str, terms: Terms, told: str, twin: Terms
) -> None:
    assert elsewhere(name, terms) == told

    def columns(at: NodeMotion) -> list[Column]:
        own = named_columns([name], at) if name else term_columns(at, terms)
        # stretched positions ask for forces that are as much too large
        other = term_columns(at, twin) if twin else [_moved(at, told)]
        return [*own, *other, *named_columns(["accel_scale"], at)]

    info = linearised(motions_of([town]), columns, {}).info
    assert _explained(info, np.arange(1, len(info))) > 0.98
    assert _explained(info, np.arange(2, len(info))) < 0.6


def _explained(info: FloatArray, others: IntArray) -> float:
    """Share of what the first column shows that ``others`` show too."""
    unit = info / np.sqrt(np.outer(np.diag(info), np.diag(info)))
    by = unit[0, others]
    return float(by @ np.linalg.solve(unit[np.ix_(others, others)], by))


def test_most_effects_and_formulas_are_one_thing_alone() -> None:
    alone = [e for e in CATALOGUE if e not in ("gnss_velocity_scale", "vehicle_sideslip")]
    assert {elsewhere(e) for e in alone} == {""}
    other = [("accel_x", "speed"), ("velocity_across", "speed * sin(heading)"), ("nhc_y", "time")]
    assert {elsewhere("", [term]) for term in other} == {""}
    assert elsewhere("", [("imu_yaw", "time"), ("nhc_y", "time")]) == ""
