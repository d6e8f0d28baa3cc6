"""Which sightings of many drives are one sign, each drive under an offset of its own."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from automap.jit import kernel
from automap.mapping.association_kernels import add_member, assign, found_sign
from automap.mapping.candidates import CLASS_SLOTS, PLACES, STATE, SUPPORT, find_candidates
from automap.mapping.classes import class_evidence
from automap.mapping.grid import empty_table
from automap.mapping.limits import MOST, ROUNDS, TAU_S
from automap.mapping.offset_kernels import smooth, vote
from automap.mapping.sightings import Sightings
from automap.records import BoolArray, FloatArray, IntArray

_SETTLING = 3
"""Turns of assignment and smoothing."""


@dataclass(frozen=True)
class Association:
    """``sign`` [n] the map sign of every sighting, numbered from 0 in the order of first
    mention; ``offset`` [n, 3] m east, north, up by which its drive is off there, relative to
    the map as a whole, and ``offset_var`` [n, 3]."""

    sign: IntArray
    offset: FloatArray
    offset_var: FloatArray

    @property
    def n_signs(self) -> int:
        """Number of map signs."""
        return int(self.sign.max()) + 1 if len(self.sign) else 0


def associate(
    sightings: Sightings,
    tau_s: float = TAU_S,
    rounds: int = ROUNDS,
    progress: Callable[[float], None] = lambda fraction: None,
) -> Association:
    """Group the sightings into signs.

    Drive after drive is laid over the map of those before it: its offset found by vote and
    smoothed along the drive, its sightings then given to map signs one to one, the rest made
    new signs. In further rounds each drive is taken out and laid over the map of all others.
    """
    n = len(sightings)
    sign = np.full(n, -1, np.int64)
    offset, offset_var = np.zeros((n, 3)), np.zeros((n, 3))
    if n == 0:
        return Association(sign, offset, offset_var)
    evidence = class_evidence(sightings.classes)
    room = n * (rounds + 1)
    state = np.empty((room, STATE))
    slot_class = np.empty((room, CLASS_SLOTS), np.int64)
    slot_weight = np.empty((room, CLASS_SLOTS))
    active = np.zeros(room, np.bool_)
    owner, price = np.full(room, -1, np.int64), np.zeros(room)
    table = empty_table(room)
    count = 0
    for turn in range(rounds + 1):
        for drive in range(sightings.n_drives):
            lo, hi = int(sightings.first[drive]), int(sightings.first[drive + 1])
            if hi > lo:
                count = _lay_over(
                    lo,
                    hi,
                    turn > 0,
                    count,
                    tau_s,
                    sightings.time_s,
                    sightings.lat,
                    sightings.lon,
                    sightings.height,
                    sightings.per_lat,
                    sightings.per_lon,
                    sightings.own,
                    sightings.own_u,
                    sightings.shared_sd,
                    sightings.facing,
                    sightings.code,
                    sightings.confidence,
                    evidence,
                    *table,
                    state,
                    slot_class,
                    slot_weight,
                    active,
                    owner,
                    price,
                    sign,
                    offset,
                    offset_var,
                )
            progress((turn + (drive + 1) / sightings.n_drives) / (rounds + 1))
    return Association(renumbered(sign), offset, offset_var)


def renumbered(sign: IntArray) -> IntArray:
    """The same groups, numbered from 0 in the order of first mention."""
    _, first, inverse = np.unique(sign, return_index=True, return_inverse=True)
    rank = np.empty(len(first), np.int64)
    rank[np.argsort(first)] = np.arange(len(first))
    return np.asarray(rank[inverse], np.int64)


@kernel
def _lay_over(
    lo: int,
    hi: int,
    again: bool,
    count: int,
    tau_s: float,
    time_s: FloatArray,
    lat: FloatArray,
    lon: FloatArray,
    height: FloatArray,
    per_lat: FloatArray,
    per_lon: FloatArray,
    own: FloatArray,
    own_u: FloatArray,
    shared_sd: FloatArray,
    facing: FloatArray,
    code: IntArray,
    confidence: FloatArray,
    evidence: FloatArray,
    head: IntArray,
    following: IntArray,
    cells: IntArray,
    state: FloatArray,
    slot_class: IntArray,
    slot_weight: FloatArray,
    active: BoolArray,
    owner: IntArray,
    price: FloatArray,
    sign: IntArray,
    offset: FloatArray,
    offset_var: FloatArray,
) -> int:
    """Associate one drive, rows lo to hi; returns how many map signs there are now."""
    n = hi - lo
    if again:
        for i in range(lo, hi):
            k = sign[i]
            add_member(
                k, i, -1.0, lat, lon, height, per_lat, per_lon, own, own_u, facing, code,
                confidence, offset[i], state, slot_class, slot_weight,
            )  # fmt: skip
            active[k] = state[k, SUPPORT] > 0.5
    index = np.empty((n, MOST), np.int64)
    values = np.empty((n, MOST, PLACES))
    find_candidates(
        lo, hi, lat, lon, height, per_lat, per_lon, own, own_u, shared_sd, facing, code,
        evidence, head, following, cells, state, slot_class, slot_weight, active, index, values,
    )  # fmt: skip
    here, here_var = offset[lo:hi], offset_var[lo:hi]
    chosen = np.empty(n, np.int64)
    vote(time_s[lo:hi], shared_sd[lo:hi], tau_s, index, values, here)
    here_var[:] = 0.0
    for _ in range(_SETTLING):
        assign(index, values, here, here_var, chosen, owner, price)
        smooth(time_s[lo:hi], shared_sd[lo:hi], tau_s, chosen, values, here, here_var)
    assign(index, values, here, here_var, chosen, owner, price)
    for i in range(lo, hi):
        c = chosen[i - lo]
        k = index[i - lo, c] if c >= 0 else -1
        if k < 0:
            k = count
            count += 1
            found_sign(
                k, i, lat, lon, height, per_lat, per_lon, offset[i], head, following, cells,
                state, slot_weight, active,
            )  # fmt: skip
        add_member(
            k, i, 1.0, lat, lon, height, per_lat, per_lon, own, own_u, facing, code,
            confidence, offset[i], state, slot_class, slot_weight,
        )  # fmt: skip
        sign[i] = k
    return count
