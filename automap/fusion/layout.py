"""Where each state block stands in the error state, and what a node may carry.

The error state is position, velocity, attitude (NED, truth minus estimate; attitude phi with
``C_true = exp([phi x]) C``), then the inertial error parameters, then the measurement-side
states. A block that is switched off has the offset -1.
"""

from __future__ import annotations

# blocks of the navigation error
P_ID = 0
V_ID = 3
PHI_ID = 6
N_NAV = 9

# columns of the offsets row handed to the kernels
(
    LEVER,
    DELAY,
    VEL_LATENCY,
    WANDER,
    MOUNT,
    WHEEL,
    LATENCY,
    VEL_LAG,
    SKEW,
    DATUM,
    SIDESLIP,
    ODOMETER_SCALE,
    VEHICLE_PITCH,
    VEL_WANDER,
) = range(14)
N_BLOCKS = 14
BLOCK_SIZE = (3, 1, 1, 3, 3, 3, 1, 1, 1, 3, 1, 1, 1, 3)

# bits of a node's flags
HAS_POS_H = 1
HAS_POS_V = 2
HAS_VEL_H = 4
HAS_VEL_V = 8
STANDSTILL = 16
NHC = 32
ODOMETER = 64

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
MAX_SCALARS = 15
