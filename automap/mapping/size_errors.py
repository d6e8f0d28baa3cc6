"""What the drives' errors of one sign have in common: the size that all took it for.

A sign seen from afar only is as far as its size says. That it is larger than its class moves every
drive's place of it the same way: such an error shows in no scatter between the drives, and their
number does not average it away. With x_i = place + a_i s + e_i, s ~ N(0, 1) the same in all, a mean
effect A of a sign is split off: A s is common, (a_i - A) s and e_i are a sighting's own (s is a
considered parameter: Tapley, Schutz and Born, Statistical Orbit Determination, 2004, chapter 6). A
is the mean by weight of the sightings: a sign which one drive saw from near has nearly none.
"""

from __future__ import annotations

import numpy as np

from automap.mapping import limits
from automap.mapping.sightings import Sightings
from automap.records import FloatArray, IntArray
from automap.records.signs import BY_SIZE


def own_parts(
    sightings: Sightings, rows: IntArray, sign: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Own errors [n, 3, 3] east, north, up, m^2, of some ``rows`` [n] without the common part, and
    that: [m, 3] of every sign, one sigma in m. ``sign`` [n] whose each is."""
    effect = np.nan_to_num(np.column_stack([getattr(sightings, name)[rows] for name in BY_SIZE]))
    own = np.zeros((len(rows), 3, 3))
    own[:, :2, :2] = sightings.own[rows][:, [0, 1, 1, 2]].reshape(-1, 2, 2)
    own[:, 2, 2] = sightings.own_u[rows]
    alone, common = split_common(own, effect[:, :, None], sign)
    return alone, common[:, :, 0]


def split_common(
    own: FloatArray, effects: FloatArray, sign: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Own errors [n, a, a] without the common part, and that [m, a, e], of what each of some
    ``effects`` [n, a, e], parts of the errors ``own`` [n, a, a], moves."""
    information = np.asarray(np.linalg.inv(own))
    # an effect is part of the error, whatever rounding and later passes left of that
    part = np.linalg.eigvalsh(np.einsum("nie,nij,njf->nef", effects, information, effects))[:, -1]
    most = 1.0 - limits.LEAST_OWN_SHARE
    effects = effects * np.sqrt(most / np.maximum(part, most))[:, None, None]
    m = int(sign.max()) + 1
    total, pull = np.zeros((m, *own.shape[1:])), np.zeros((m, *effects.shape[1:]))
    np.add.at(total, sign, information)
    np.add.at(pull, sign, np.einsum("nij,nje->nie", information, effects))
    common = np.asarray(np.linalg.solve(total, pull), np.float64)
    rest = effects - common[sign]
    return np.asarray(own + rest @ rest.swapaxes(1, 2) - effects @ effects.swapaxes(1, 2)), common
