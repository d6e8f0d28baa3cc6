"""What follows a manoeuvre, at once or later, in a way that no formula says."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import cast

import numpy as np
import pytest

from automap.gap import base_model, limits
from automap.gap.drive import GapDrive, open_drive
from automap.gap.fit import Fit, fit_drive
from automap.gap.found import Beside
from automap.gap.misfit import AFTER
from automap.gap.motion import motion_of
from automap.gap.nodes import node_motion
from automap.gap.responses import MANOEUVRES, STEPS_S, Response, response_columns, responses
from automap.gap.selection import Chosen
from automap.records import FloatArray
from tests.unit.gap_linear import screened
from tests.unit.test_gap import simulated


@lru_cache
def plain() -> Fit:
    model = base_model()
    return fit_drive(open_drive(simulated({}), model.options), model)


def told(drive: GapDrive, held_out: Fit | None = None) -> tuple[str, ...]:
    model = base_model()
    fit = fit_drive(open_drive(drive, model.options), model)
    asked = Beside(screened(fit, ["accel_scale"]), Chosen(), lambda *about: [], {})
    found = responses(asked, [fit], [fit] if held_out is None else [held_out])
    assert all(m.kind == AFTER and m.p_value <= limits.SUSPECTED for m in found)
    return tuple(m.where for m in found)


def raised(up: FloatArray) -> GapDrive:
    """The drive with heights of the fixes that are too large, m [k]."""
    drive = simulated({})
    height = drive.fixes.height_m + up
    return replace(drive, fixes=replace(drive.fixes, height_m=height))


def test_steps_of_a_constant_are_that_constant_and_sum_up_what_was() -> None:
    motion = motion_of(plain().last)
    columns = response_columns(node_motion(plain(), motion))
    per = len(STEPS_S) - 1
    assert len(columns) % per == 0
    assert {c.effect.partition(f" {AFTER} ")[2] for c in columns} <= set(MANOEUVRES)
    of_speed = [c for c in columns if c.effect == f"accel_x {AFTER} changes of speed"]
    speed = np.linalg.norm(motion.vel, axis=1)
    first, last = (np.asarray(c.inertial[0].signal) for c in (of_speed[0], of_speed[-1]))
    assert len(of_speed) == per
    # within half a second a speed is nearly what it is
    assert np.abs(first - speed).max() < 2.5
    # before the beginning it was as then
    assert last[0] == pytest.approx(speed[0])
    assert speed.min() - 1e-9 <= last.min() <= last.max() <= speed.max() + 1e-9


def test_what_the_unit_gives_by_may_follow_whichever_way_the_car_pulls() -> None:
    at = node_motion(plain(), motion_of(plain().last))
    columns = response_columns(at)
    names = {c.effect for c in columns}
    assert {f"imu_{a} {AFTER} pulling or braking" for a in ("pitch", "yaw")} <= names
    first = next(c for c in columns if c.effect == f"accel_x {AFTER} pulling or braking")
    assert np.asarray(first.inertial[0].signal).min() >= 0.0


@pytest.mark.parametrize(
    ("odds", "gain", "there"),
    [
        (12.3, 1.2, True),
        (7.0, 3.0, True),
        (7.0, 1.2, False),
        (6.0, 9.0, False),
        (30.0, -0.1, False),
    ],
)
def test_what_fitted_drives_say_surely_short_held_out_ones_need_not_say_too(
    odds: float, gain: float, there: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = Response(f"imu_pitch {AFTER} pulling or braking", odds, 1e-5, 0, 1.2, np.zeros(8))
    monkeypatch.setattr("automap.gap.responses.strongest_responses", lambda *of: (found, None))
    monkeypatch.setattr("automap.gap.responses.gain_of", lambda *of: gain)
    assert bool(responses(cast("Beside", None), (), ())) == there


@pytest.mark.slow
def test_nothing_follows_where_nothing_is_missing() -> None:
    assert told(simulated({})) == ()


@pytest.mark.slow
def test_heights_that_swing_after_bends_are_told() -> None:
    fit, drive = plain(), simulated({})
    motion = motion_of(fit.last)
    sideways = node_motion(fit, motion).along.lateral_acceleration
    # what it was two to four seconds ago
    t = drive.fixes.gps_s - drive.fixes.gps_s[0]
    ago = np.mean([np.interp(t - s, motion.t, sideways) for s in np.linspace(2.0, 4.0, 9)], axis=0)
    (where,) = told(raised(1.5 * ago))
    assert where == f"height {AFTER} bends"
    # a drive that was held out does not have it
    assert told(raised(1.5 * ago), plain()) == ()
