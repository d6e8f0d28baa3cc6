"""What a drive cannot tell apart, and what hardly shows on it."""

from __future__ import annotations

import pytest

from automap.gap import base_model
from automap.gap.candidates import library
from automap.gap.drive import open_drive
from automap.gap.fit import Fit, fit_drive
from automap.gap.naming import identifiability
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
