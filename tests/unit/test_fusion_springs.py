"""A body on its springs tells the filter nothing of the scale of its readings."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from automap.fusion.engine import fuse_imu_gnss
from automap.fusion.layout import CH_NHC, MAX_SCALARS, NHC
from automap.fusion.measurements.constraint import on_springs, sd_on_springs
from automap.fusion.options import FusionOptions
from automap.fusion.result import Prior
from tests.unit.fusion_drive import CLOCK, Sensor, record
from tests.unit.fusion_motion import city_drive
from tests.unit.fusion_receiver import Receiver, receive


def test_what_lasts_seconds_is_held_and_the_rest_is_not() -> None:
    t = 0.2 * np.arange(400)
    flags = np.where((t > 20.0) & (t < 60.0), NHC, 0)
    var = np.ones((len(t), MAX_SCALARS))
    swing = 0.1 * np.sin(2.0 * np.pi * 1.25 * t)
    rest = on_springs(t, flags, var, 0.3 + swing, 4.0)
    inside = (t > 23.0) & (t < 57.0)
    # to one of the nodes of a mean
    assert rest[inside] == pytest.approx(swing[inside], abs=0.1 / 18)
    assert not rest[flags == 0].any()
    # a node that counts for little moves no mean
    var[200, CH_NHC + 1] = 1e12
    jump = np.where(np.arange(len(t)) == 200, 50.0, 0.3)
    others = inside & (jump < 1.0)
    assert on_springs(t, flags, var, jump, 4.0)[others] == pytest.approx(0.0, abs=1e-9)


def test_noise_of_the_readings_is_taken_for_springs() -> None:
    """Of what is held, integrated noise of the accelerometer is off so far."""
    step, noise = 0.02, 0.08
    flags = np.full(100_000, NHC)
    walk = np.cumsum(np.random.default_rng(5).normal(0.0, noise * np.sqrt(step), len(flags)))
    held = on_springs(
        step * np.arange(len(walk)), flags, np.ones((len(walk), MAX_SCALARS)), walk, 4.0
    )
    told = sd_on_springs(flags, noise, 4.0)
    # some 500 means that share nothing
    assert held[200:-200].std() == pytest.approx(told[0], rel=0.1)
    assert not sd_on_springs(np.zeros(3, np.int64), noise, 4.0).any()


@pytest.mark.parametrize(("mean_s", "drawn"), [(0.0, True), (4.0, False)])
def test_a_scale_is_not_drawn_by_a_body_that_bounces(mean_s: float, drawn: bool) -> None:
    """Readings that were smaller by their scale would bounce less, as the constraint wants it."""
    motion = city_drive(90.0, seed=3, start_speed=10.0)
    t = motion.velocity.x
    bounce = 0.1 * np.sin(2.0 * np.pi * 1.3 * t)
    velocity = motion.velocity(t) + np.outer(bounce, [0.0, 0.0, 1.0])
    motion = replace(motion, velocity=CubicSpline(t, velocity))
    loose = {"accel_scale": {"*": 0.1}, "accel_bias": {"*": 2.0}}
    options = FusionOptions(prior_sd=loose, adapt=False, nhc_mean_s=mean_s)
    imu = record(motion, Sensor(), 5)
    result = fuse_imu_gnss(
        imu, receive(motion, Receiver(rate=2.0), 6), CLOCK, options, Prior(0.0, 0.05), np.zeros(3)
    )
    names = result.parameters.names
    i = names.index("accel_scale_z")
    off = abs(result.parameters.values[-1, i] - Sensor().accel_scale[2])
    assert (off > 0.1) == drawn
