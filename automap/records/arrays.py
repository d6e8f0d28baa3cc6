"""The arrays of the records, and the stamp that says "unknown"."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]
Image = npt.NDArray[np.uint8]
"""A picture [height, width, 3] in OpenCV's order, blue, green, red."""

NO_TIME = np.iinfo(np.int64).min
"""Marks an unknown int64 time stamp."""
