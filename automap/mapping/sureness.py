"""How sure the class of a sign is, from how sure each drive was, or each track within a drive.

Each drive tells the probability of the class that it read; what it leaves goes in equal parts to
the classes that it may be mistaken for. Independent drives multiply such odds. These are not: a
face that the detector does not know, that is worn or looks like another one, every drive reads
wrong alike. So what n drives tell together counts as n / (1 + (n - 1) COMMON) of them (the design
effect of L. Kish, Survey Sampling, 1965, section 5.4).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from automap.mapping.limits import ALTERNATIVES
from automap.records import FloatArray, IntArray
from automap.signs.vocabulary import load_vocabulary

COMMON = 0.5
"""Correlation between what two drives tell of a sign's class: any number of drives counts as two at
most. Chosen: half of it is the face, which drives have in common, half light, distance and speed,
which they do not."""
SUREST = 1.0 - 1e-4
"""No drive's word counts for more, which is finer than probabilities are written."""


def group_probabilities(
    code: IntArray, classes: Sequence[str], told: FloatArray, sign: IntArray, merged: IntArray
) -> FloatArray:
    """``class_probabilities`` of the colour and shape that each of ``classes`` has."""
    vocabulary = load_vocabulary()
    names = [vocabulary.group_of(name) or name for name in classes]
    kinds = np.unique(np.array(names, str), return_inverse=True)[1].astype(np.int64)
    return class_probabilities(kinds[code], told, sign, kinds[merged])


def class_probabilities(
    code: IntArray, told: FloatArray, sign: IntArray, merged: IntArray
) -> FloatArray:
    """Probability [m] that each sign is of its ``merged`` class (a code [m]).

    ``code`` [n] the class that each sighting read, ``told`` [n] its probability of that (NaN
    unknown: the sighting says nothing), ``sign`` [n] the sign it is of (-1 none). NaN where none
    says anything.
    """
    m = len(merged)
    result = np.full(m, np.nan)
    rows = np.flatnonzero(np.isfinite(told) & (sign >= 0))
    order = rows[np.argsort(sign[rows], kind="stable")]
    edges = np.searchsorted(sign[order], np.arange(m + 1))
    # before any drive all of them are alike
    alike = 1.0 / (1.0 + ALTERNATIVES)
    for k in np.flatnonzero(np.diff(edges)).tolist():
        own = order[edges[k] : edges[k + 1]]
        p = np.clip(told[own], alike * 1e-2, SUREST)
        counts = 1.0 / (1.0 + (len(own) - 1) * COMMON)
        rest = (1.0 - p) / ALTERNATIVES
        asked = np.append(np.unique(code[own]), -1)
        if merged[k] not in asked:
            asked = np.append(asked, merged[k])
        # those that nobody read, -1, are alike among themselves
        told_of = np.array([np.log(np.where(code[own] == c, p, rest) / alike).sum() for c in asked])
        weight = np.where(asked == -1, max(1.0 + ALTERNATIVES - (len(asked) - 1), 0.0), 1.0)
        log = counts * told_of
        share = weight * np.exp(log - log.max())
        result[k] = float(share[asked == merged[k]].sum() / share.sum())
    return result
