"""Which sightings of many drives are one sign, each drive under an offset of its own."""

from __future__ import annotations

import numpy as np

from automap.jit import kernel
from automap.mapping import limits
from automap.mapping.candidates import (
    PLACES,
    SUPPORT,
    Columns,
    MapSigns,
    add_member,
    agreement,
    columns_of,
    empty_map,
    find_candidates,
    found_sign,
)
from automap.mapping.classes import class_evidence
from automap.mapping.offset_kernels import smooth, vote
from automap.mapping.sightings import Sightings
from automap.records import BoolArray, FloatArray, IntArray

_SETTLING = 20
"""Turns of assignment and smoothing, at most."""


def associate(
    sightings: Sightings, sign: IntArray | None = None, offset: FloatArray | None = None
) -> IntArray:
    """The map sign [n] of every sighting, numbered from 0 in the order of first mention.

    Drive after drive is laid over the map: its offset found by vote and smoothed along the drive,
    its sightings then given to map signs one to one, the rest made new signs. The map is of the
    drives before it, or, with a ``sign`` [n] of each sighting and an ``offset`` [n, 3] m east,
    north, up by which its drive is off there, of all others.
    """
    n = len(sightings)
    found = np.full(n, -1, np.int64) if sign is None else sign.copy()
    moved = np.zeros((n, 3)) if offset is None else offset.copy()
    if n:
        evidence = class_evidence(sightings.classes)
        signs, seen = empty_map(2 * n), columns_of(sightings)
        _associate(sightings.first, seen, evidence, signs, found, moved)
    return renumbered(found)


class Members:
    """The sightings of every sign, found without a search."""

    def __init__(self, sign: IntArray) -> None:
        self.order = np.argsort(sign, kind="stable")
        count = int(sign.max()) + 1 if len(sign) else 0
        self.edges = np.searchsorted(sign[self.order], np.arange(count + 1))

    def of(self, signs: IntArray) -> tuple[IntArray, IntArray]:
        """Rows [n] of the sightings of ``signs`` [k], and the place in ``signs`` of each."""
        starts, stops = self.edges[signs], self.edges[signs + 1]
        lengths = stops - starts
        place = np.repeat(np.arange(len(signs)), lengths)
        within = np.arange(int(lengths.sum())) - np.repeat(np.cumsum(lengths) - lengths, lengths)
        return self.order[np.repeat(starts, lengths) + within], place


def renumbered(sign: IntArray) -> IntArray:
    """The same groups, numbered from 0 in the order of first mention."""
    _, first, inverse = np.unique(sign, return_index=True, return_inverse=True)
    rank = np.empty(len(first), np.int64)
    rank[np.argsort(first)] = np.arange(len(first))
    return np.asarray(rank[inverse], np.int64)


@kernel
def assign(
    index: IntArray,
    values: FloatArray,
    offset: FloatArray,
    offset_var: FloatArray,
    chosen: IntArray,
    taken: BoolArray,
) -> None:
    """One-to-one choice of candidates, the surest first, ``chosen`` [n] (-1 a sign new to the map).

    ``taken`` [m] must come in as false and leaves so.
    """
    chosen[:] = -1
    gain = np.full(index.size, -1.0)
    for i in range(len(index)):
        for c in range(limits.MOST):
            if index[i, c] < 0:
                break
            gain[i * limits.MOST + c] = agreement(values[i, c], offset[i], offset_var[i])
    for place in np.argsort(-gain):
        i, c = divmod(place, limits.MOST)
        if gain[place] <= 0.0:
            break
        if chosen[i] < 0 and not taken[index[i, c]]:
            chosen[i], taken[index[i, c]] = c, True
    for i in range(len(index)):
        if chosen[i] >= 0:
            taken[index[i, chosen[i]]] = False


@kernel
def _associate(
    first: IntArray,
    seen: Columns,
    evidence: FloatArray,
    signs: MapSigns,
    sign: IntArray,
    offset: FloatArray,
) -> None:
    taken = np.zeros(len(signs.active), np.bool_)
    count = 0
    for i in range(len(sign)):
        if sign[i] >= 0:
            if sign[i] >= count:
                found_sign(sign[i], i, seen, offset[i], signs)
                count = sign[i] + 1
            add_member(sign[i], i, 1.0, seen, offset[i], signs)
    for drive in range(len(first) - 1):
        lo, hi = first[drive], first[drive + 1]
        for i in range(lo, hi):
            k = sign[i]
            if k >= 0:
                add_member(k, i, -1.0, seen, offset[i], signs)
                signs.active[k] = signs.state[k, SUPPORT] > 0.5
        index = np.empty((hi - lo, limits.MOST), np.int64)
        values = np.empty((hi - lo, limits.MOST, PLACES))
        find_candidates(lo, hi, seen, evidence, signs, index, values)
        time_s, shared_sd = seen.time_s[lo:hi], seen.shared_sd[lo:hi]
        here, here_var = offset[lo:hi], np.empty((hi - lo, 3))
        chosen = np.empty(hi - lo, np.int64)
        vote(time_s, shared_sd, index, values, here, here_var)
        assign(index, values, here, here_var, chosen, taken)
        for _ in range(_SETTLING):
            before = chosen.copy()
            smooth(time_s, shared_sd, chosen, values, here, here_var)
            assign(index, values, here, here_var, chosen, taken)
            if (chosen == before).all():
                break
        for i in range(lo, hi):
            c = chosen[i - lo]
            k = index[i - lo, c] if c >= 0 else -1
            if k < 0:
                k = count
                count += 1
                found_sign(k, i, seen, offset[i], signs)
            add_member(k, i, 1.0, seen, offset[i], signs)
            sign[i] = k
