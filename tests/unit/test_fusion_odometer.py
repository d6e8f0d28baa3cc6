"""Wheel speed: the file, the measurement's row, and what it does in an outage."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from automap.errors import InputError
from automap.frames import matrix_to_quat, rpy_to_matrix
from automap.fusion import kernels
from automap.fusion.layout import N_NAV, UNSIGNED
from automap.fusion.mechanisation import quat_to_dcm
from automap.fusion.model import build_state_model
from automap.fusion.options import FusionOptions
from automap.io.odometer_csv import read_odometer_csv
from tests.unit.measured_node import WHEELS, measured

EFFECTS = ("accel_bias", "imu_mounting", "nhc_lever_arm", "odometer_scale")


def test_row_agrees_with_the_numeric_derivative() -> None:
    model = build_state_model(FusionOptions(effects=EFFECTS))
    attitude = rpy_to_matrix(np.array([0.02, -0.05, 1.1]))
    state = np.concatenate([[0.6, 1.0, 50.0], [6.0, 11.0, -0.3], matrix_to_quat(attitude)])
    params = 0.5 * model.prior_sd * np.random.default_rng(1).standard_normal(len(model.prior_sd))
    rate = np.array([0.03, -0.02, 0.3])

    def evaluate(row: np.ndarray, xi: np.ndarray) -> tuple[np.ndarray, float]:
        c = np.zeros((3, 3))
        quat_to_dcm(row[6:10], c)
        h, z = measured(WHEELS, model, row[:3], row[3:6], c, xi, speed=12.0, rate=rate)
        return h[0], float(z[0])

    h, _ = evaluate(state, params)
    for j in range(model.size):
        step = 1e-5 if j < N_NAV else 1e-4
        ends = []
        for sign in (1.0, -1.0):
            moved, xi = state[None].copy(), params[None].copy()
            dx = np.zeros((1, model.size))
            dx[0, j] = sign * step
            kernels.apply_correction(moved, xi, dx)
            ends.append(evaluate(moved[0], xi[0])[1])
        assert h[j] == pytest.approx((ends[1] - ends[0]) / (2 * step), abs=2e-4), j


def test_straight_ahead_the_speed_is_the_reading() -> None:
    model = build_state_model(FusionOptions(effects=EFFECTS))
    xi = np.zeros(model.size - N_NAV)
    xi[model.names.index("odometer_scale_relative")] = 0.02
    vel, c = np.array([0.0, 10.0, 0.0]), rpy_to_matrix(np.array([0.0, 0.0, np.pi / 2]))
    _, z = measured(WHEELS, model, np.array([0.6, 1.0, 50.0]), vel, c, xi, speed=10.2)
    assert z[0] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize(
    ("told", "forward", "taken"),
    [(3.0, -3.2, -3.0), (3.0, 2.8, 3.0), (0.5, -0.4, 0.0), (0.5, 0.4, 0.0), (9.0, -9.0, 9.0)],
)
def test_a_speed_without_a_sign_is_of_the_way_the_vehicle_goes(
    told: float, forward: float, taken: float
) -> None:
    """Slow ones may be either way; nobody reverses fast. With a sign it is what is told."""
    model = build_state_model(FusionOptions(effects=EFFECTS))
    xi = np.zeros(model.size - N_NAV)
    vel, c = np.array([0.0, forward, 0.0]), rpy_to_matrix(np.array([0.0, 0.0, np.pi / 2]))
    for flag, speed in ((UNSIGNED, taken), (0, told)):
        place = np.array([0.6, 1.0, 50.0])
        _, z = measured(WHEELS, model, place, vel, c, xi, speed=told, more_flags=flag)
        assert z[0] == pytest.approx(speed - forward, abs=1e-9)


def test_file_is_sorted_and_cleaned(tmp_path: Path) -> None:
    path = tmp_path / "odometer.csv"
    path.write_text("t_ns,speed_m_s\n200,2.0\n100,1.0\n200,2.5\n300,nan\n")
    found = read_odometer_csv(path)
    wheels, warnings = found.data, found.warnings
    assert wheels.t_ns.tolist() == [100, 200]
    assert wheels.speed.tolist() == [1.0, 2.0]
    assert len(warnings) == 2


def test_speeds_in_another_unit_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "odometer.csv"
    path.write_text("t_ns,speed_m_s\n" + "".join(f"{i},{3600 + i}\n" for i in range(50)))
    with pytest.raises(InputError, match="too much for m/s; write units"):
        read_odometer_csv(path)
