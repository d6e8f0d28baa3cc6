"""An effect that the simulator puts into a drive comes out of the fusion with its value.

Simulator and filter are written apart and share nothing but the effect's name and definition,
so a sign or a unit that differs shows here.
"""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any

import numpy as np
import pytest

from automap.effects import CATALOGUE
from automap.fusion.engine import fuse_imu_gnss
from automap.fusion.options import DEFAULT_EFFECTS, FusionOptions
from automap.fusion.result import FusionResult, Prior
from automap.simulation.scenario import (
    Gnss,
    Imu,
    Leg,
    Odometer,
    Route,
    Scenario,
    Start,
    Stop,
    Vehicle,
)
from automap.simulation.sensors import random_streams, simulate_sensors

pytestmark = pytest.mark.slow

BASE = {
    "accel_bias": {"x": 0.06, "y": -0.09, "z": 0.11},
    "gyro_bias": {"x": 0.003, "y": -0.002, "z": 0.0016},
}
INSTEAD = {
    "gnss_latency": "imu_time_offset",
    "imu_clock_skew": "imu_time_offset",
    "gnss_velocity_lag": "gnss_velocity_latency",
}
"""Effects that look alike: one is estimated in place of the other."""


def _scenario(errors: dict[str, Any], roughness_deg: float = 0.05) -> Scenario:
    """Some three minutes through a town, with two halts, on a road that rocks the car so much."""
    legs = []
    for side in (-1.0, 1.0, -1.0):
        legs += [
            Leg(length_m=220.0, speed_m_s=15.0),
            Leg(turn_deg=90.0 * side, radius_m=18.0, speed_m_s=7.0),
            Leg(length_m=120.0, speed_m_s=10.0),
            Leg(turn_deg=75.0, radius_m=30.0, speed_m_s=9.0),
            Leg(length_m=60.0, speed_m_s=14.0),
            Leg(turn_deg=-70.0, radius_m=25.0, speed_m_s=9.0),
        ]
    return Scenario(
        schema="automap.scenario/1",
        name="recovery",
        start=Start(
            utc=datetime(2026, 3, 14, 9, 20, tzinfo=UTC),
            lat_deg=-35.28,
            lon_deg=149.13,
            height_m=580.0,
            heading_deg=62.0,
        ),
        vehicle=Vehicle(road_roughness_deg=roughness_deg, pitch_per_accel_deg=0.1),
        route=Route(legs=legs, stops=[Stop(at_m=500.0, hold_s=6.0), Stop(at_m=900.0, hold_s=5.0)]),
        imu=Imu(),
        gnss=Gnss(),
        odometer=Odometer() if any(CATALOGUE[e].needs_wheels for e in errors) else None,
        errors={**BASE, **errors},
    )


def _fuse(
    errors: dict[str, Any],
    prior_sd: float | None,
    seed: int = 1,
    noise_only: bool = False,
    roughness_deg: float = 0.05,
) -> FusionResult:
    """The drive with these errors, which are estimated unless they only make noise."""
    sensors = simulate_sensors(_scenario(errors, roughness_deg), random_streams(seed))
    assert sensors.fixes is not None
    hidden = {INSTEAD[e] for e in errors if e in INSTEAD}
    effects = tuple(e for e in DEFAULT_EFFECTS if e not in hidden)
    own = ("odometer_scale", "odometer_time_offset", "gnss_lever_arm")
    if not noise_only:
        effects += tuple(e for e in errors if e not in effects and e not in own)
    options = FusionOptions(
        effects=effects,
        prior_sd={} if prior_sd is None else {e: {"*": prior_sd} for e in errors},
        accel_noise=2e-3,
        gyro_noise=1.5e-4,
    )
    arm = None if "gnss_lever_arm" in errors else np.zeros(3)
    return fuse_imu_gnss(
        sensors.imu,
        sensors.fixes,
        sensors.clock,
        options,
        Prior(0.0, 0.1),
        arm,
        odometer=sensors.odometer,
    )


@pytest.mark.parametrize(
    ("effect", "values", "prior_sd"),
    [
        ("gnss_latency", {"s": 0.08}, None),
        ("gnss_velocity_latency", {"s": 0.12}, None),
        ("gnss_velocity_lag", {"tau": 0.15}, None),
        ("imu_time_offset", {"s": -0.07}, None),
        ("imu_clock_skew", {"skew": 4e-4}, 5e-4),
        ("gnss_lever_arm", {"x": 0.9, "y": -0.5}, None),
        ("imu_mounting", {"pitch": 0.02, "yaw": -0.03}, None),
        ("nhc_lever_arm", {"x": -1.4}, None),
        ("vehicle_sideslip", {"coefficient": 0.012}, 0.02),
        ("odometer_scale", {"relative": 0.03}, None),
        ("odometer_time_offset", {"s": 0.45}, None),
        ("gyro_scale", {"z": 0.012}, None),
        ("gyro_misalignment", {"xz": 0.02, "yz": -0.02}, 0.02),
        ("accel_misalignment", {"yx": 0.02, "zx": 0.03}, 0.03),
        ("gyro_scale_asymmetry", {"z": 0.012}, 0.02),
        ("accel_scale_asymmetry", {"x": 0.02, "y": 0.02}, 0.03),
        ("gyro_g_sensitivity", {"zx": 1e-3}, 1e-3),
        ("accel_temperature", {"x": 0.01, "y": -0.01}, None),
        ("gyro_temperature", {"z": 5e-4}, None),
        ("speed_vibration", {"x": 1e-3, "z": -1e-3}, 2e-3),
        ("gyro_speed_vibration", {"y": 1e-5, "z": -1e-5}, None),
        ("imu_filter_delay", {"x": 0.05, "y": 0.03}, 0.05),
        ("imu_filter_delay", {"x": -0.05, "y": -0.05}, 0.05),
        ("accel_saturation", {"y": 6e-3}, 1e-2),
        ("gyro_saturation", {"z": 0.3}, 0.3),
        ("accel_dead_zone", {"x": 0.02, "y": 0.02}, None),
        ("gyro_dead_zone", {"z": 4e-3}, 5e-3),
        ("accel_warm_up", {"x": 0.2, "y": -0.2, "z": 0.3}, 0.3),
        ("gyro_warm_up", {"z": 5e-3}, None),
    ],
)
def test_an_injected_effect_is_found_again(
    effect: str, values: dict[str, float], prior_sd: float | None
) -> None:
    history = _fuse({effect: values}, prior_sd).parameters
    for parameter, true in values.items():
        i = history.names.index(f"{effect}_{parameter}")
        found, sd = history.values[-1, i], history.sd[-1, i]
        assert abs(found - true) < 4.0 * sd, parameter
        # and not because nothing is known
        assert sd < 0.3 * abs(true), parameter


def test_the_height_of_the_antenna_shows_where_the_road_rocks_the_car() -> None:
    history = _fuse({"gnss_lever_arm": {"z": -1.2}}, None, roughness_deg=0.2).parameters
    i = history.names.index("gnss_lever_arm_z")
    found, sd = history.values[-1, i], history.sd[-1, i]
    assert abs(found + 1.2) < 4.0 * sd
    assert sd < 0.3 * 1.2


def test_fixes_noisier_than_they_say_are_noticed() -> None:
    plain = _fuse({}, None).noise_factors
    noisy = _fuse({"gnss_noise_scale": {"factor": 2.0}}, None, noise_only=True).noise_factors
    for level in ("position_h", "velocity_h"):
        assert 1.4 <= noisy[level] / plain[level] <= 2.9, level


def test_a_drive_without_the_effects_has_none() -> None:
    history = _fuse({"odometer_scale": {"relative": 0.0}}, None).parameters
    for name in ("gnss_velocity_latency_s", "imu_time_offset_s", "odometer_scale_relative"):
        i = history.names.index(name)
        assert abs(history.values[-1, i]) < 4.0 * history.sd[-1, i], name
