"""Names of the noise levels that a drive can correct."""

from __future__ import annotations

WHITE_LEVELS = ("accel", "gyro", "position_h", "position_v", "velocity_h", "velocity_v")
RECEIVER_LEVELS = ("wander", "wander_v", "multipath", "velocity_wander")
"""Sizes of a receiver's errors that last: of the position level and down, for minutes, for
seconds, and of the velocity."""
VELOCITY_WANDER, VELOCITY_TAU, POSITION_TAU = "velocity_wander", "velocity_wander_tau", "wander_tau"
"""The lasting error of the velocity, and how long it and that of the position last."""
BIAS_LEVELS = ("accel_bias_walk", "gyro_bias_walk")
RUN_LEVELS = (*WHITE_LEVELS, *RECEIVER_LEVELS, VELOCITY_TAU)
"""What every run asks its drive for."""
LEVELS = (*RUN_LEVELS, *BIAS_LEVELS, POSITION_TAU)
VEHICLE_LEVELS = ("nhc_y", "nhc_z")
"""How far the vehicle slips and how far its springs move: fitted by the gap finder alone."""
ALL_LEVELS = (*LEVELS, *VEHICLE_LEVELS)
ROAD_ACCELERATION = "road_acceleration"
"""How much vehicles accelerate where no IMU tells it, or what one leaves of it."""
