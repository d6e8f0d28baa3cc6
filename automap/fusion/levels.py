"""Names of the noise levels that a drive can correct."""

from __future__ import annotations

WHITE_LEVELS = ("accel", "gyro", "position_h", "position_v", "velocity_h", "velocity_v")
SLOW_LEVELS = ("accel_bias_walk", "gyro_bias_walk", "wander", "wander_tau")
LEVELS = WHITE_LEVELS + SLOW_LEVELS
SLOPED_LEVELS = tuple(level for level in LEVELS if level != "wander_tau")
"""Those along which the likelihood's slope is computed."""
VEHICLE_LEVELS = ("nhc_y", "nhc_z")
"""How far the vehicle slips and how far its springs move: fitted by the gap finder alone."""
VELOCITY_WANDER = "velocity_wander"
"""The part of a receiver's velocity error that lasts longer than an epoch: for the gap finder."""
ALL_LEVELS = (*LEVELS, *VEHICLE_LEVELS, VELOCITY_WANDER)
