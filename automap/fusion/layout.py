"""What a node may carry: flags, values, channels of innovations.

The error state is position, velocity, attitude (NED, truth minus estimate; attitude phi with
``C_true = exp([phi x]) C``), then the inertial error parameters, then those of the effects on
measurements.
"""

from __future__ import annotations

from automap.effects.navigation import N_NAV, P_ID, PHI_ID, V_ID

# bits of a node's flags
HAS_POS_H, HAS_POS_V, HAS_VEL_H, HAS_VEL_V = 1, 2, 4, 8
STANDSTILL, NHC, ODOMETER = 16, 32, 64
UNSIGNED = 128
"""A wheel speed that does not tell whether the vehicle reverses."""

# columns of a node's values: latitude, longitude, height, velocity NED, wheel speed, and the speed
# downwards of the body on its springs
WHEEL_SPEED, ON_SPRINGS = 6, 7
N_VALUES = 8

# channels in innovation tables, by code
CHANNELS = (
    "position_n",
    "position_e",
    "position_d",
    "velocity_n",
    "velocity_e",
    "velocity_d",
    "nhc_y",
    "nhc_z",
    "zupt_n",
    "zupt_e",
    "zupt_d",
    "zaru_x",
    "zaru_y",
    "zaru_z",
    "odometer",
)
CH_POS, CH_VEL, CH_NHC, CH_ZUPT, CH_ZARU, CH_ODOMETER = 0, 3, 6, 8, 11, 14
MAX_SCALARS = len(CHANNELS)
ROWS_OF_FLAG = (
    (HAS_POS_H, 2),
    (HAS_POS_V, 1),
    (HAS_VEL_H, 2),
    (HAS_VEL_V, 1),
    (NHC, 2),
    (ODOMETER, 1),
    (STANDSTILL, 6),
)
"""How many scalars each flag of a node brings."""
BESIDE_FIXES = NHC | STANDSTILL | ODOMETER
"""What is left out where the noise of receiver and IMU is asked for."""

__all__ = [
    "BESIDE_FIXES",
    "CHANNELS",
    "CH_NHC",
    "CH_ODOMETER",
    "CH_POS",
    "CH_VEL",
    "CH_ZARU",
    "CH_ZUPT",
    "HAS_POS_H",
    "HAS_POS_V",
    "HAS_VEL_H",
    "HAS_VEL_V",
    "MAX_SCALARS",
    "NHC",
    "N_NAV",
    "N_VALUES",
    "ODOMETER",
    "ON_SPRINGS",
    "PHI_ID",
    "P_ID",
    "ROWS_OF_FLAG",
    "STANDSTILL",
    "UNSIGNED",
    "V_ID",
    "WHEEL_SPEED",
]
