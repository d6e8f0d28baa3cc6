"""Whether a sign is of the class that a list says, by what its single views look like.

What the views of a sign give to its true class on average is seldom next to nothing, even where
they are called otherwise or no class was sure enough to be named; to another class, which a list
has by mistake, they give next to nothing. How much the one tells from the other is a likelihood
ratio that logistic regression fitted (as for speakers: N. Brummer and J. du Preez, Computer Speech
and Language 20, 2006), on passes of signs that the classifier was not trained on.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import lru_cache

from automap.inventory import limits
from automap.signs.classes import load_classes
from automap.signs.codes import face_of
from automap.signs.vocabulary import load_vocabulary

_SHAPELESS = "other"
"""The group of what has none of the shapes, as a cross: pictures of it look like any of them."""


def same_face(a: str, b: str) -> bool | None:
    """Whether two classes are of one face; None where one tells no more than a look."""
    if not a or not b:
        return None
    if face_of(a) == face_of(b):
        return True
    generic = set(load_vocabulary().groups.values())
    one, other = groups_of(a), groups_of(b)
    if (a in generic or b in generic) and (one & other or _SHAPELESS in one | other):
        return None
    return False


@lru_cache(maxsize=4096)
def groups_of(name: str) -> frozenset[str]:
    """The shapes and colours that the face of a class is drawn in: children are warned of by a
    triangle here and a diamond there, and words in a list say neither."""
    classes, group_of = load_classes(), load_vocabulary().group_of
    drawn = [c for c in classes if face_of(c) == face_of(name)] if name in classes else []
    return frozenset(group for c in (name, *drawn) if (group := group_of(c)))


def of_another_class(shares: Mapping[str, float], listed: str, at_home: bool = True) -> float:
    """Probability that a sign, of whose class its views give ``shares``, is not of the class
    ``listed``, where beforehand the one is as likely as the other; ``at_home`` whether they were
    read with the classes of their country alone."""
    shift, slope = limits.CLASS_AT_HOME if at_home else limits.CLASS_ELSEWHERE
    ratio = shift + slope * class_ratio(shares, listed)
    return min(1.0 / (1.0 + math.exp(-ratio)), limits.MOST_SURE)


def class_ratio(shares: Mapping[str, float], listed: str) -> float:
    """Logarithm of what the views give to the best of the other classes, and in part to all of
    another shape or colour, over what they give to the class ``listed``."""
    face, classes, groups = face_of(listed), load_classes(), groups_of(listed) - {_SHAPELESS}
    own = sum(share for name, share in shares.items() if face_of(name) == face)
    others = [s for name, s in shares.items() if name in classes and face_of(name) != face]
    looks = [s for name, s in shares.items() if groups_of(name) and not groups_of(name) & groups]
    other = max(others, default=0.0) + limits.OTHER_LOOK * (sum(looks) if groups else 0.0)
    return math.log((other + limits.FAINT_SHARE) / (own + limits.FAINT_SHARE))


def listed_wrong(shares: Mapping[str, float], listed: str, at_home: bool = True) -> float:
    """Probability that a list has the class of a face wrong that the map does not name."""
    another = of_another_class(shares, listed, at_home)
    wrong, right = another * limits.STALE, (1.0 - another) * (1.0 - limits.STALE)
    return wrong / (wrong + right)
