"""Axes of an IMU that stand still, in whatever axes the readings come."""

from __future__ import annotations

import numpy as np
import pytest

from automap.evaluation.plausibility import stuck_readings
from automap.frames import rpy_to_matrix
from automap.fusion.stuck_readings import clipped_axes, frozen_axes
from automap.io.axes import ImuAxes
from automap.records import FloatArray, ImuData

TURNED = rpy_to_matrix(np.radians([11.0, -7.0, 100.0]))


def recorded(gyro: FloatArray | None = None, accel: FloatArray | None = None) -> ImuData:
    rng = np.random.default_rng(3)
    n = 3000
    t_ns = np.arange(n, dtype=np.int64) * 10_000_000
    noise = rng.normal(0.0, 0.05, (n, 3))
    swing = 0.4 * np.sin(np.arange(n) / 60.0)[:, None] * np.array([0.1, 0.2, 1.0])
    gyro = noise + swing if gyro is None else gyro
    return ImuData(t_ns, gyro, rng.normal(0.0, 0.3, (n, 3)) if accel is None else accel)


def turned(imu: ImuData) -> ImuData:
    """The readings in vehicle axes, and back again as their triads gave them."""
    axes = ImuAxes(TURNED, TURNED)
    gyro, accel = axes.apply(imu.gyro, imu.accel)
    in_car = ImuData(imu.t_ns, gyro, accel)
    # in other axes nothing stands still
    assert clipped_axes(in_car) == []
    assert frozen_axes(in_car, np.ones(len(imu), np.bool_)) == []
    back = axes.as_read(in_car)
    np.testing.assert_allclose(back.gyro, imu.gyro, rtol=0.0, atol=1e-11)
    return back


@pytest.mark.parametrize("through_car_axes", [False, True])
def test_an_axis_that_ends_at_its_range_is_named(through_car_axes: bool) -> None:
    imu = recorded()
    clipped = ImuData(imu.t_ns, np.clip(imu.gyro, -0.3, 0.3), imu.accel)
    (axis,) = clipped_axes(turned(clipped) if through_car_axes else clipped)
    assert (axis.column, axis.value) == ("gz", pytest.approx(0.3))
    assert axis.seconds > 1.0
    (finding,) = stuck_readings(clipped)
    assert (finding.code, finding.severity) == ("imu_clipped", "warning")
    assert clipped_axes(imu) == []


def test_coarse_and_held_axes_do_not_end_at_a_range() -> None:
    imu = recorded()
    held = np.repeat(imu.gyro[::10], 10, axis=0)
    coarse = np.trunc(imu.gyro / 0.15) * 0.15
    for gyro in (held, coarse):
        seen = ImuData(imu.t_ns, gyro, imu.accel)
        assert clipped_axes(seen) == []
        # and do where it does, for longer than they stay elsewhere
        (axis,) = clipped_axes(ImuData(imu.t_ns, np.clip(gyro, -0.1, 0.1), imu.accel))
        assert axis.column == "gz"


@pytest.mark.parametrize("through_car_axes", [False, True])
def test_an_axis_that_keeps_its_reading_is_named(through_car_axes: bool) -> None:
    gyro = recorded().gyro
    gyro[1000:1700, 1] = gyro[1000, 1]
    imu = recorded(gyro)
    seen = turned(imu) if through_car_axes else imu
    (axis,) = frozen_axes(seen, np.ones(len(imu), np.bool_))
    assert axis.column == "gy"
    assert axis.spans == ((pytest.approx(10.0), pytest.approx(16.99)),)
    # only what counts does
    assert frozen_axes(seen, np.arange(len(imu)) > 1400) == []
    # it goes on later, so the sensor is not dead
    assert stuck_readings(imu) == []


def test_a_dead_axis_is_an_error_for_the_accelerometer_alone() -> None:
    imu = recorded()
    imu.accel[:, 0] = 5.6
    imu.gyro[:, 2] = 0.0
    found = [(f.severity, f.text) for f in stuck_readings(imu)]
    assert found == [("warning", "gz never changes"), ("error", "ax never changes")]
