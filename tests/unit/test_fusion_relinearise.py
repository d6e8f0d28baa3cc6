"""Passes that begin about the path of another model's."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from automap.earth import metres_per_radian
from automap.fusion.relinearise import relinearise
from automap.gap import base_model
from automap.gap.drive import OpenDrive, open_drive
from automap.gap.fit import Fit, GapModel, fit_drive, session_with
from automap.gap.lean import told_by_weight
from tests.unit.test_gap import simulated

WRONG = {"imu_mounting": {"yaw": 0.03, "pitch": 0.02}, "gnss_lever_arm": {"x": 0.8, "z": -0.5}}


@pytest.fixture(scope="module")
def plain() -> Fit:
    model = base_model()
    return fit_drive(open_drive(simulated(WRONG), model.options), model)


@pytest.mark.parametrize("effect", ["imu_mounting", "gnss_lever_arm", "gnss_latency"])
def test_a_fit_linearised_at_another_is_the_fit_from_nothing(
    plain: Fit, effect: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    other = fit_drive(plain.opened, plain.model, {effect: 3.0}, linearised_at=plain)
    if effect == "imu_mounting":  # its roll is told by the weight along the other's path besides

        def told(opened: OpenDrive, model: GapModel, estimate: Mapping[str, float]) -> Any:
            session, where = session_with(opened, model, estimate)
            return told_by_weight(session, plain.last), where

        monkeypatch.setattr("automap.gap.fit.session_with", told)
    alone = fit_drive(plain.opened, plain.model, {effect: 3.0})
    sd = np.sqrt(np.diag(alone.cov))
    assert (np.abs(other.values - alone.values) < 0.2 * sd).all(), (other.values, alone.values, sd)
    assert other.score == pytest.approx(alone.score, abs=1.0)
    a, b = other.last.smooth.nominal, alone.last.smooth.nominal
    scale = metres_per_radian(float(a[0, 0]), float(a[0, 2]))
    assert np.abs((a[:, :2] - b[:, :2]) * np.array(scale)).max() < 0.01


def test_nothing_new_takes_one_pass(plain: Fit, monkeypatch: pytest.MonkeyPatch) -> None:
    import automap.fusion.relinearise as module

    passes = 0
    run = module.filter_and_smooth

    def counted(*args: object, **kwargs: object) -> object:
        nonlocal passes
        passes += 1
        return run(*args, **kwargs)  # type: ignore[arg-type]

    monkeypatch.setattr(module, "filter_and_smooth", counted)
    session, _ = session_with(plain.opened, plain.model, {})
    last, _ = relinearise(session, plain.last, plain.start)
    assert passes == 1
    assert last.forward.score == pytest.approx(plain.score, abs=0.5)
