"""Names of the noise levels that a drive can correct."""

from __future__ import annotations

WHITE_LEVELS = ("accel", "gyro", "position_h", "position_v", "velocity_h", "velocity_v")
RECEIVER_LEVELS = ("wander", "wander_v", "multipath", "velocity_wander")
"""Sizes of a receiver's errors that last: of the position level and down, for minutes, for
seconds, and of the velocity."""
VELOCITY_WANDER = "velocity_wander"
BIAS_LEVELS = ("accel_bias_walk", "gyro_bias_walk")
RUN_LEVELS = (*WHITE_LEVELS, *RECEIVER_LEVELS)
"""What every run asks its drive for."""
SLOPED_LEVELS = (*RUN_LEVELS, *BIAS_LEVELS)
"""Those along which the likelihood's slope is computed."""
LEVELS = (*SLOPED_LEVELS, "wander_tau")
VEHICLE_LEVELS = ("nhc_y", "nhc_z")
"""How far the vehicle slips and how far its springs move: fitted by the gap finder alone."""
TIME_LEVELS = ("wander_tau", "velocity_wander_tau")
"""How long a receiver's errors last: of the position, and of the velocity, which the gap finder
alone fits."""
ALL_LEVELS = (*LEVELS, *VEHICLE_LEVELS, TIME_LEVELS[1])
ROAD_ACCELERATION = "road_acceleration"
"""How much vehicles accelerate where no IMU tells it, or what one leaves of it."""
