"""How the fusion's kernels are compiled."""

from __future__ import annotations

from numba import njit

# divisions by zero give infinity instead of a check at every division, and sums may be taken
# in any order; NaN and infinity keep their meaning
kernel = njit(cache=True, error_model="numpy", fastmath={"reassoc", "contract", "nsz", "arcp"})
"""Decorator of all numba functions of the fusion."""
