"""What nobody needs to know of when two runs are compared, beside ``change.Tolerance``."""

from __future__ import annotations

import numpy as np

EPOCHS_FLOOR = np.array([0.005] * 3 + [0.002] * 3 + [np.radians(0.005)] * 3)
"""Nobody needs to know of less, whatever sigma is stated (m, m/s, rad)."""
SIGN_FLOOR_M = 0.01
"""The same of a sign."""
ROUNDING = 16.0
"""Units in the last place: less is no move, however small the stated sigma."""
SAME_SIGN_M = 10.0
"""Signs further apart are not one that has moved: two posts at a crossing are."""
LEAST_UNITS = 2.0
"""Reference computations by which a stage must be slower to be told; some tenths of a second."""
