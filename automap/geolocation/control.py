"""Surveyed signs as control points: which located sign each of them is."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from automap.assignment import assign
from automap.earth import local_ned
from automap.gates import gate
from automap.geolocation import limits
from automap.geolocation.trajectory_adjustment import Placed
from automap.records import FloatArray, SignPoints

_HEIGHT_SD_M = 1e3
"""Of a height that is not surveyed: says nothing."""


def match_control(
    control: SignPoints,
    names: Mapping[int, str],
    placed: Placed,
    origin: tuple[float, float, float],
) -> dict[int, tuple[FloatArray, FloatArray]]:
    """Number of a sign of class ``names``, as they are ``placed``: surveyed place [3] and
    covariance [3, 3], as far as they agree; surveyed are the signs of ``control``, to one sigma
    ``sd_m``, of a class or of "".

    One to one, by the horizontal distance in sigmas of both; a sign of another class costs
    extra. A surveyed sign that is nearly as likely a neighbour, which nobody surveyed, is none of
    both: what its errors tell of the trajectory would be the way between the two. Heights are not
    surveyed: the sign's own stands in, with a sigma that says nothing.
    """
    if len(control) == 0 or not names:
        return {}
    number = list(names)
    plan, covariances = placed.place[number, :2], placed.covariance[number, :2, :2]
    place = local_ned(control.lat_rad, control.lon_rad, np.full(len(control), origin[2]), origin)
    sd = np.maximum(control.sd_m, limits.LEAST_CONTROL_SD_M)
    cost = np.full((len(control), len(number)), np.inf)
    limit = gate(limits.MISSED_PROBABILITY, 2)
    for j, (k, middle, covariance) in enumerate(zip(number, plan, covariances, strict=True)):
        offset = place[:, :2] - middle
        for i in np.flatnonzero(np.hypot(*offset.T) < limits.CONTROL_REACH_M).tolist():
            total = covariance + sd[i] ** 2 * np.eye(2)
            square = float(offset[i] @ np.linalg.solve(total, offset[i]))
            differs = control.class_name[i] and control.class_name[i] != names[k]
            if square < limit:
                cost[i, j] = square + (limits.LINK_OTHER if differs else 0.0)
    result: dict[int, tuple[FloatArray, FloatArray]] = {}
    chosen = assign(cost, limit + limits.LINK_OTHER)
    elsewhere = np.linalg.norm(plan[:, None] - plan[None], axis=2) > limits.POST_REACH_M
    elsewhere[:, chosen[chosen >= 0]] = False
    for i, j in enumerate(chosen.tolist()):
        rival = np.min(cost[i, elsewhere[j]], initial=np.inf) if j >= 0 else 0.0
        if j >= 0 and rival - cost[i, j] > limits.CONTROL_RIVAL:
            surveyed = np.array([*place[i, :2], placed.place[number[j], 2]])
            result[number[j]] = (surveyed, np.diag([sd[i] ** 2, sd[i] ** 2, _HEIGHT_SD_M**2]))
    return result
