"""Axes of a sensor that nobody described, as far as gravity tells them."""

from __future__ import annotations

from contextlib import suppress
from itertools import product

import numpy as np

from automap.errors import ConfigError
from automap.io.axes import axes_matrix
from automap.records import FloatArray

_LEAST_SHARE = 0.9
"""Share of gravity that must lie on one axis."""


def level_axes(accel: FloatArray) -> str | None:
    """Axes, such as "FLU", of specific forces [n, 3] in any unit of a sensor near level.

    Which way is forward is not in them: an axis that is level is taken. None where gravity is
    on no axis.
    """
    mean = np.mean(accel, axis=0)
    axis = int(np.argmax(np.abs(mean)))
    if abs(mean[axis]) < _LEAST_SHARE * float(np.linalg.norm(mean)):
        return None
    vertical = "U" if mean[axis] > 0 else "D"
    for letters in product("FLRB", repeat=2):
        word = [*letters]
        word.insert(axis, vertical)
        with suppress(ConfigError):
            axes_matrix("".join(word))
            return "".join(word)
    return None
