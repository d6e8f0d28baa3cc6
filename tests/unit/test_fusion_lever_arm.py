"""The antenna's arm where the gyro is noisy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from automap.fusion.engine import fuse_imu_gnss
from automap.fusion.limits import STATED_ARM_SD_M
from automap.fusion.options import FusionOptions
from automap.fusion.result import Prior
from automap.records import FixType
from tests.unit.fusion_drive import CLOCK, Sensor, record
from tests.unit.fusion_motion import city_drive
from tests.unit.fusion_receiver import GPS0, Receiver, receive

ARM = (0.6, -0.4, -0.9)
GYRO_NOISE = 2e-3
"""rad/s/sqrt(Hz): 0.02 rad/s in a single reading, as of the cheapest gyros on a rough road. The arm
that single readings give is 0.3 m off to the front, and more than five sigmas."""


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, pytest.param(3, marks=pytest.mark.slow)])
def test_noise_of_the_gyro_draws_no_arm_towards_nothing(seed: int) -> None:
    motion = city_drive(120.0, seed)
    receiver = Receiver(4.0, (0.0, 0.0, 0.0), white=(0.01, 0.01, 0.02), velocity=0.03, lever=ARM)
    fixes = receive(motion, receiver, seed)
    fixes = replace(fixes, fix_type=np.full(len(fixes), FixType.FIXED, np.int64))
    imu = record(motion, Sensor(gyro_noise=GYRO_NOISE), seed)
    result = fuse_imu_gnss(imu, fixes, CLOCK, FusionOptions(), Prior(0.0, 0.02), lever_arm=None)
    names = result.parameters.names
    # the car does not sway: nothing tells how high the antenna is
    for axis, true in zip("xy", ARM, strict=False):
        column = names.index(f"gnss_lever_arm_{axis}")
        value = result.parameters.values[-1, column]
        sd = result.parameters.sd[-1, column]
        assert sd < 0.1
        assert value == pytest.approx(true, abs=2.6 * sd)


def test_velocities_without_sway_do_not_lower_an_antenna() -> None:
    """A receiver smooths away what a roof does on springs, and its positions are good to 1 cm."""
    motion = city_drive(60.0, 5)
    receiver = Receiver(4.0, (0.0, 0.0, 0.0), white=(0.01, 0.01, 0.02), velocity=0.03, lever=ARM)
    fixes = receive(motion, receiver, 5)
    fixes = replace(fixes, fix_type=np.full(len(fixes), FixType.FIXED, np.int64))
    imu = record(motion, Sensor(), 5)
    t = (imu.t_ns - imu.t_ns[0]) * 1e-9
    rolls = 0.05 * np.sin(2.0 * np.pi * 1.3 * t)[:, None] * np.array([1.0, 0.5, 0.0])
    imu = replace(imu, gyro=imu.gyro + rolls)
    arm = np.array(ARM)
    result = fuse_imu_gnss(imu, fixes, CLOCK, FusionOptions(), Prior(0.0, 0.02), lever_arm=arm)
    path, column = result.trajectory, result.parameters.names.index("gnss_lever_arm_z")
    true = motion.at(path.gps_s - GPS0).height
    assert np.abs(path.height_m - true).max() < 0.1
    assert path.sd_pos_ned[:, 2].min() > STATED_ARM_SD_M
    assert result.parameters.sd[-1, column] == pytest.approx(STATED_ARM_SD_M, rel=0.01)
