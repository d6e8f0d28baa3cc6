from datetime import UTC, datetime
from typing import Any
import numpy as np
from automap.gap import GapDrive
from automap.simulation.scenario import Gnss, Imu, Leg, Route, Scenario, Start, Stop, Vehicle
from automap.simulation.sensors import random_streams, simulate_sensors
ARM = np.array([0.3, -0.2, -1.0])


def scenario_with(errors: dict[str, Any], noise: float = 1.0) -> Scenario:
    """Some two minutes through a town, with a halt."""
    legs = []
    for side in (-1.0, 1.0):
        legs += [
            Leg(length_m=180.0, speed_m_s=15.0),
            Leg(turn_deg=90.0 * side, radius_m=18.0, speed_m_s=7.0),
            Leg(length_m=120.0, speed_m_s=10.0),
            Leg(turn_deg=-75.0 * side, radius_m=30.0, speed_m_s=9.0),
            Leg(length_m=100.0, speed_m_s=14.0),
            Leg(turn_deg=70.0, radius_m=25.0, speed_m_s=9.0),
        ]
    return Scenario(
        schema="automap.scenario/1",
        name="gap",
        start=Start(
            utc=datetime(2026, 3, 14, 9, 20, tzinfo=UTC),
            lat_deg=-35.28,
            lon_deg=149.13,
            height_m=580.0,
            heading_deg=62.0,
        ),
        vehicle=Vehicle(),
        route=Route(legs=legs, stops=[Stop(at_m=500.0, hold_s=6.0)]),
        imu=Imu(),
        gnss=Gnss(lever_arm_m=(0.3, -0.2, -1.0), sigma_velocity=(0.05 * noise,) * 3),
        errors={
            "accel_bias": {"x": 0.06, "y": -0.09, "z": 0.11},
            "gyro_bias": {"x": 0.003, "y": -0.002, "z": 0.0016},
            **errors,
        },
    )


def simulated(errors: dict[str, Any], seed: int = 3, noise: float = 1.0) -> GapDrive:
    """That drive recorded."""
    sensors = simulate_sensors(scenario_with(errors, noise), random_streams(seed))
    assert sensors.fixes is not None
    return GapDrive(sensors.imu, sensors.fixes, sensors.clock, "gap", ARM)


