"""How well the classes of two sightings speak for one sign."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from automap.mapping import limits
from automap.records import FloatArray
from automap.signs.vocabulary import load_vocabulary


def class_evidence(classes: Sequence[str]) -> FloatArray:
    """Evidence [k, k] in nats that two sightings of these classes are one sign.

    Faces of one colour and shape are taken for one another more easily than others; a class
    that only names colour and shape fits all of its group.
    """
    vocabulary = load_vocabulary()
    generic = set(vocabulary.groups.values())
    group = [vocabulary.group_of(name) for name in classes]
    result = np.full((len(classes), len(classes)), limits.DIFFERENT)
    for i, first in enumerate(classes):
        for j, second in enumerate(classes):
            if first == second:
                result[i, j] = limits.SAME
            elif not first or not second:
                result[i, j] = limits.UNKNOWN_FACE
            elif group[i] is not None and group[i] == group[j]:
                vague = first in generic or second in generic
                result[i, j] = limits.UNKNOWN_FACE if vague else limits.SAME_GROUP
    return result
