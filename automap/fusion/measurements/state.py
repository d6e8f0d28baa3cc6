"""The state in which a node's measurements are predicted."""

from __future__ import annotations

from typing import NamedTuple

from automap.records import FloatArray


class AtNode(NamedTuple):
    """``pos`` [3] latitude, longitude rad, height m; ``vel`` and ``acc`` [3] NED over ground; ``c``
    [3, 3] attitude; ``rate`` [3] rad/s at the node without the noise of its reading, ``mean_rate``
    [3] over the interval before it; ``reading`` [6 + e] the last corrected reading and extra
    signals; ``place`` [9] the terms of the place (``mechanisation.earth_terms``); ``params`` [p];
    ``signals`` [4 + e] that terms are multiplied with; ``room`` [ROOM, 3] for their sums."""

    pos: FloatArray
    vel: FloatArray
    acc: FloatArray
    c: FloatArray
    rate: FloatArray
    mean_rate: FloatArray
    reading: FloatArray
    place: FloatArray
    params: FloatArray
    signals: FloatArray
    room: FloatArray
