"""One drive against the map: which of its sightings are which map signs."""

from __future__ import annotations

import numpy as np

from automap.jit import kernel
from automap.mapping.candidates import (
    A_EE,
    A_EN,
    A_NN,
    A_U,
    B_E,
    B_N,
    B_U,
    CLASS_SLOTS,
    FACE_E,
    FACE_N,
    HEIGHT,
    LAT,
    LON,
    SUPPORT,
    Columns,
    MapSigns,
)
from automap.mapping.grid import delta, insert
from automap.mapping.limits import BID_STEP, LEAST_CONFIDENCE, MOST
from automap.mapping.offset_kernels import agreement
from automap.records import FloatArray, IntArray

_LEAST_INFORMATION = 1e-9
"""On the place of a sign without members, 1/m^2."""


@kernel
def assign(
    index: IntArray,
    values: FloatArray,
    offset: FloatArray,
    offset_var: FloatArray,
    chosen: IntArray,
    owner: IntArray,
    price: FloatArray,
) -> None:
    """Best one-to-one choice of candidates, ``chosen`` [n] (-1 a sign new to the map).

    Forward auction (D. P. Bertsekas, Annals of Operations Research 14, 1988): sightings bid for
    map signs, each may also stay alone at no gain. Within n times the bid step of the optimum.
    ``owner``, ``price`` [m] must come in as -1 and 0 and leave so.
    """
    n = len(index)
    gain = np.full((n, MOST), -1.0)
    for i in range(n):
        chosen[i] = -1
        for c in range(MOST):
            if index[i, c] < 0:
                break
            here = offset[i, 0], offset[i, 1], offset[i, 2]
            gain[i, c] = agreement(values[i, c], *here, offset_var[i, 0], offset_var[i, 1])
    waiting = np.empty(n, np.int64)
    for i in range(n):
        waiting[i] = n - 1 - i
    count = n
    while count > 0:
        count -= 1
        i = waiting[count]
        best, second, at = 0.0, 0.0, -1
        for c in range(MOST):
            if index[i, c] < 0:
                break
            net = gain[i, c] - price[index[i, c]]
            if net > best:
                best, second, at = net, best, c
            elif net > second:
                second = net
        if at < 0:
            continue
        k = index[i, at]
        price[k] += best - second + BID_STEP
        if owner[k] >= 0:
            chosen[owner[k]] = -1
            waiting[count] = owner[k]
            count += 1
        owner[k] = i
        chosen[i] = at
    for i in range(n):
        for c in range(MOST):
            if index[i, c] < 0:
                break
            price[index[i, c]] = 0.0
            owner[index[i, c]] = -1


@kernel
def add_member(
    k: int, i: int, sign: float, seen: Columns, offset: FloatArray, signs: MapSigns
) -> None:
    """Add sighting ``i``, moved by its drive's ``offset`` [3], to map sign ``k``.

    ``sign`` -1 takes out what +1 put in.
    """
    state, own, height, facing = signs.state, seen.own, seen.height, seen.facing
    det = own[i, 0] * own[i, 2] - own[i, 1] ** 2
    w_ee, w_en, w_nn = own[i, 2] / det, -own[i, 1] / det, own[i, 0] / det
    at = state[k, LAT], state[k, LON]
    de, dn = delta(seen.lat[i], seen.lon[i], *at, seen.per_lat[i], seen.per_lon[i])
    de, dn = de - offset[0], dn - offset[1]
    state[k, A_EE] += sign * w_ee
    state[k, A_EN] += sign * w_en
    state[k, A_NN] += sign * w_nn
    state[k, B_E] += sign * (w_ee * de + w_en * dn)
    state[k, B_N] += sign * (w_en * de + w_nn * dn)
    if height[i] == height[i] and state[k, HEIGHT] == state[k, HEIGHT]:
        state[k, A_U] += sign / seen.own_u[i]
        state[k, B_U] += sign * (height[i] - state[k, HEIGHT] - offset[2]) / seen.own_u[i]
    if facing[i] == facing[i]:
        state[k, FACE_N] += sign * np.cos(facing[i])
        state[k, FACE_E] += sign * np.sin(facing[i])
    state[k, SUPPORT] += sign
    weight = sign * max(seen.confidence[i], LEAST_CONFIDENCE)
    free = -1
    for slot in range(CLASS_SLOTS):
        if signs.slot_weight[k, slot] > 1e-6:
            if signs.slot_class[k, slot] == seen.code[i]:
                signs.slot_weight[k, slot] += weight
                return
        elif free < 0:
            free = slot
    if sign > 0.0 and free >= 0:
        signs.slot_class[k, free] = seen.code[i]
        signs.slot_weight[k, free] = weight


@kernel
def found_sign(k: int, i: int, seen: Columns, offset: FloatArray, signs: MapSigns) -> None:
    """Make map sign ``k``, still without members, where sighting ``i`` sees it."""
    state = signs.state
    state[k] = 0.0
    state[k, A_EE] = state[k, A_NN] = state[k, A_U] = _LEAST_INFORMATION
    state[k, LAT] = seen.lat[i] - offset[1] / seen.per_lat[i]
    state[k, LON] = seen.lon[i] - offset[0] / seen.per_lon[i]
    state[k, HEIGHT] = seen.height[i] - offset[2]
    signs.slot_weight[k] = 0.0
    signs.active[k] = True
    insert(signs.table, k, state[k, LAT], state[k, LON])
