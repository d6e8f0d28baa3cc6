"""Positions that go straight where the vehicle turns: put on the polylines of a map's roads.

Their scatter across the travel is that of the map, corners are cut or lie at a point, and no
innovation of a bend is noise.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.special import bdtrc

from automap.gates import sd_by_median
from automap.records import BoolArray
from automap.sync import limits
from automap.sync.receiver_path import ComplexArray, ReceiverPath


def straight_in_bends(path: ReceiverPath, right: ComplexArray, use: BoolArray) -> float:
    """How far, m rms, positions of rows ``use`` [n] lie aside of ``right`` [n], the path of their
    velocities, within bends, where beyond doubt too many of them lie on straight lines; else 0.

    Of three positions ``BEND_S`` apart the middle one lies off the line through the others, in a
    bend by several of the sigmas that it does on straights. Of sound positions, few lie on that
    line all the same: at the ends of bends, which velocities tell a little early or late.
    """
    t, place = path.t[use], path.place[use]
    if len(t) < 3:
        return 0.0
    step = max(1, round(limits.BEND_S / float(np.median(np.diff(t)))))
    if len(t) < 2 * step + limits.LEAST_INTERVALS:
        return 0.0
    before, middle, after = slice(None, -2 * step), slice(step, -step), slice(2 * step, None)
    length = t[after] - t[before]
    way = place[after] - place[before]
    even = np.abs((t[middle] - t[before]) / length - 0.5) < 0.5 * limits.EVEN_STEP
    even &= (length < 3.0 * limits.BEND_S) & (np.abs(way) > limits.DRIVING_M_S * length)

    def across(places: ComplexArray) -> ComplexArray:
        off = places[middle] - 0.5 * (places[before] + places[after])
        return off[even] / (way[even] / np.abs(way[even]))

    seen, told = across(place).imag, across(right[use]).imag
    if len(told) < limits.LEAST_INTERVALS:
        return 0.0
    straight = np.abs(told) <= np.median(np.abs(told))
    # half of what a middle one of three rounded ones is off squared is its own
    sd = max(sd_by_median(seen[straight] - told[straight]), math.sqrt(1.5) * path.rounded_m)
    bends = np.abs(told) > max(limits.BEND_SIGMAS * sd, limits.LEAST_BEND_M)
    # neighbours share all but a step of their ways
    many = int(np.count_nonzero(bends)) // step
    if not many:
        return 0.0
    share = float(np.mean(np.abs(seen[bends] / told[bends]) < limits.STRAIGHT_SHARE))
    chance = float(bdtrc(max(math.floor(share * many) - 1, 0), many, limits.BEND_ENDS))
    if share <= limits.BEND_ENDS or chance > math.exp(-limits.CERTAIN_LEAD_NATS):
        return 0.0
    return float(np.sqrt(np.mean((seen - told)[bends] ** 2)))
