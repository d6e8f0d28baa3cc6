"""Whether a value that is told as one number is one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from automap.gap import base_model
from automap.gap.columns import named_columns
from automap.gap.constancy import drifts
from automap.gap.drive import GapDrive, open_drive
from automap.gap.fit import ORIGIN, SKEW, Values, fit_drive
from automap.gap.found import Beside
from automap.gap.linear import Column
from automap.gap.nodes import NodeMotion
from automap.gap.result import Drift
from automap.gap.selection import Chosen
from automap.records import FloatArray
from tests.unit.gap_linear import screened
from tests.unit.gap_values import value_of
from tests.unit.test_gap import simulated

EFFECT, SIZE = "gyro_scale", 0.03
DRIVE = simulated({})
T = (DRIVE.imu.t_ns - DRIVE.imu.t_ns[0]) * 1e-9
HALF = 0.5 * float(T[-1])


def scaled(share: FloatArray) -> GapDrive:
    """The drive with turns about the vertical that are told too large, by a share [n] of SIZE."""
    gyro = DRIVE.imu.gyro.copy()
    gyro[:, 2] *= 1.0 + SIZE * share
    return replace(DRIVE, imu=replace(DRIVE.imu, gyro=gyro))


def told(*drives: GapDrive) -> dict[str, Drift]:
    """How the scale changes beside a constant one, which is held at half of SIZE."""
    return beside({EFFECT: {"x": 0.0, "y": 0.0, "z": 0.5 * SIZE}}, "z", *drives)


def beside(values: Values, parameter: str, *drives: GapDrive) -> dict[str, Drift]:
    """How an effect that is held at its values changes along drives."""
    (effect,) = values
    model = replace(base_model(), values=values)
    fits = [fit_drive(open_drive(d, model.options), model) for d in drives]
    selection = screened(fits[0], [effect])
    column = [c.parameter for c in selection.linear.layout].index(parameter)
    chosen = Chosen(((effect, (column,), 1.0),))

    def columns(at: NodeMotion) -> list[Column]:
        return named_columns([effect], at)

    return drifts(Beside(selection, chosen, columns, values), fits)


@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_a_constant_is_told_as_one_whatever_it_is(share: float) -> None:
    assert told(scaled(np.full(len(T), share))) == {}


def test_a_step_is_told_with_its_size_and_instant() -> None:
    drift = told(scaled((T > HALF).astype(np.float64)))[EFFECT]
    assert (drift.parameter, drift.kind, drift.sure) == ("z", "step", True)
    assert abs(drift.at - HALF) < HALF / 4.0
    assert drift.change == pytest.approx(SIZE, abs=4.0 * drift.sd)
    assert "z by +0.0" in str(drift)


def test_a_drift_is_told_with_what_it_comes_to() -> None:
    drift = told(scaled(T / T[-1]))[EFFECT]
    assert drift.change == pytest.approx(SIZE, abs=max(4.0 * drift.sd, SIZE / 3.0))


def test_a_value_that_goes_with_the_speed_is_told_so() -> None:
    speed = np.linalg.norm(DRIVE.fixes.vel_ned, axis=1)
    along = np.interp(DRIVE.clock.gps_s(DRIVE.imu.t_ns), DRIVE.fixes.gps_s, speed)
    # it bends at 7 to 10 m/s
    drift = told(scaled((along > 8.0).astype(np.float64)))[EFFECT]
    assert (drift.parameter, drift.quantity, drift.sure) == ("z", "speed", True)
    assert drift.change == pytest.approx(SIZE, abs=4.0 * drift.sd)
    assert "at a speed above 7" in str(drift)


def test_another_value_on_another_drive_is_told_so() -> None:
    none = np.zeros(len(T))
    drift = told(scaled(none), scaled(none + 1.0))[EFFECT]
    assert (drift.kind, drift.at) == ("drive", 1.0)
    assert drift.change == pytest.approx(SIZE, abs=4.0 * drift.sd)
    assert "from one drive to another" in str(drift)


@pytest.mark.slow
@pytest.mark.parametrize("step_s", [0.15, 0.0])
def test_a_clock_that_steps_is_none_that_runs_fast(step_s: float) -> None:
    late = np.where(T > HALF, step_s, 0.0 if step_s else 1e-3 * T)
    imu = replace(DRIVE.imu, t_ns=DRIVE.imu.t_ns + np.rint(late * 1e9).astype(np.int64))
    drive, model = replace(DRIVE, imu=imu), base_model()
    fit = fit_drive(open_drive(drive, model.options), model, {SKEW: 1.0})
    found = beside({SKEW: value_of(fit, SKEW)}, "skew", drive)
    assert (SKEW in found) is (step_s > 0.0)
    if step_s:
        assert (found[SKEW].parameter, found[SKEW].kind, found[SKEW].unit) == (ORIGIN, "step", "s")
        assert found[SKEW].at == pytest.approx(HALF, abs=HALF / 4.0)
        assert found[SKEW].change == pytest.approx(step_s, abs=4.0 * found[SKEW].sd)


def test_what_is_there_or_not_has_no_value_that_changes() -> None:
    model = base_model()
    fit = fit_drive(open_drive(DRIVE, model.options), model)
    selection = screened(fit, ["earth_rotation"])
    chosen = Chosen((("earth_rotation", (0,), 1.0),))

    def columns(at: NodeMotion) -> list[Column]:
        return named_columns(["earth_rotation"], at)

    assert drifts(Beside(selection, chosen, columns, {}), [fit]) == {}
