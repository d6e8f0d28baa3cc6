"""Where the navigation errors stand in an error state: position, velocity, attitude.

NED, truth minus estimate; attitude phi with ``C_true = exp([phi x]) C``. The parameters of effects
follow.
"""

from __future__ import annotations

P_ID = 0
V_ID = 3
PHI_ID = 6
N_NAV = 9
