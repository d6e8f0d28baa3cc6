"""The least noise that a drive can have, and lasting errors that are not there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from automap.fusion.engine import fuse_imu_gnss
from automap.fusion.levels import VELOCITY_WANDER
from automap.fusion.limits import ABSENT
from automap.fusion.options import FusionOptions
from automap.fusion.rest_noise import least_levels, rest_density
from automap.fusion.result import Prior
from automap.records import ImuData
from tests.slow_cases import others_slow
from tests.unit.fusion_drive import CLOCK, Sensor, record
from tests.unit.fusion_motion import city_drive
from tests.unit.fusion_receiver import Receiver, receive


def noise(density: float, seconds: float = 60.0, rate: float = 100.0) -> tuple[np.ndarray, ...]:
    rng = np.random.default_rng(4)
    t = np.arange(round(seconds * rate)) / rate
    return t, rng.standard_normal((len(t), 3)) * density * np.sqrt(rate)


@pytest.mark.parametrize("rate", [20.0, 100.0, 400.0])
def test_the_density_of_white_noise_comes_back(rate: float) -> None:
    t, readings = noise(0.004, 120.0, rate)
    assert rest_density(t, readings, [(0.0, 50.0), (60.0, 119.0)]) == pytest.approx(0.004, rel=0.15)


def test_somebody_who_gets_in_is_no_noise() -> None:
    t, readings = noise(0.004)
    readings[2000:2200] += 0.5
    assert rest_density(t, readings, [(0.0, 60.0)]) == pytest.approx(0.004, rel=0.2)


def test_a_drive_without_rest_bounds_nothing() -> None:
    t, readings = noise(0.004)
    assert rest_density(t, readings, []) is None
    assert rest_density(t, readings, [(10.0, 12.0)]) is None
    imu = ImuData((t * 1e9).astype(np.int64), readings, readings, axes_known=True)
    assert least_levels(imu, t, [], FusionOptions()) == {}


def test_levels_do_not_fall_below_the_noise_at_rest() -> None:
    t, readings = noise(0.02)
    imu = ImuData((t * 1e9).astype(np.int64), 1e-2 * readings, readings, axes_known=True)
    least = least_levels(imu, t, [(0.0, 60.0)], FusionOptions())
    assert least["accel"] == pytest.approx(2.0, rel=0.2)
    assert least["gyro"] == pytest.approx(0.5, rel=0.2)


@pytest.mark.parametrize(("lasting", "absent"), others_slow([(0.0, True), (0.2, False)]))
def test_a_lasting_error_is_kept_where_there_is_one(lasting: float, absent: bool) -> None:
    motion = city_drive(300.0, 3, slip=True)
    result = fuse_imu_gnss(
        record(motion, replace(Sensor(), accel_noise=5e-3), 4),
        receive(motion, Receiver(lasting=lasting, lasting_tau=3.0), 5),
        CLOCK,
        FusionOptions(),
        Prior(0.0, 0.02),
        lever_arm=np.zeros(3),
    )
    factor = result.noise_factors[VELOCITY_WANDER]
    assert (factor == ABSENT) is absent
    # what a drive of seconds cannot tell stays as it was assumed
    if not absent:
        assert 0.4 < factor < 2.5
