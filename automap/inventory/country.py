"""Which country's signs a list has: by its codes, or else by the set that its classes are of.

A face is one of those that stand in the country, or now and then a strange one, as the classifier
takes it to be. What every set has tells nothing, and a face tells once, however often it stands
there.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from functools import cache

from automap.inventory.limits import SURE, TOLD_BY_CHANCE
from automap.signs.classes import country_set
from automap.signs.codes import countries_of, face_of
from automap.vision.limits import FOREIGN

_SETS = ("DE", "AU")
"""Countries by whose sets the table of classes goes."""


def country_of_list(codes: Iterable[str], listed: Iterable[str]) -> str | None:
    """The country of nine in ten of the ``codes`` that tell one, in ISO 3166; by the classes
    ``listed`` where none does."""
    told = countries_of(codes)
    del told["VIENNA"]
    if not told:
        return country_of_classes(listed)
    country, count = told.most_common(1)[0]
    return country if count >= SURE * told.total() else None


def country_of_classes(listed: Iterable[str]) -> str | None:
    """The country whose set the classes ``listed`` are surely of ("" not told), in ISO 3166; None
    where they may be of a country without a set. Beforehand each is as likely."""
    sets, every = {place: _faces(place) for place in _SETS}, _faces(None)
    common = frozenset.intersection(*sets.values())
    told = ({face_of(name) for name in listed} & every) - common
    # a country without a set may have any of them
    odds: dict[str | None, float] = {None: -len(told) * math.log(len(every - common))}
    for place, faces in sets.items():
        whole = len(faces - common) + FOREIGN * len(every - faces)
        odds[place] = len(told - faces) * math.log(FOREIGN) - len(told) * math.log(whole)
    best = max(odds, key=lambda place: odds[place])
    likely = 1.0 / sum(math.exp(value - odds[best]) for value in odds.values())
    return best if likely >= 1.0 - TOLD_BY_CHANCE else None


@cache
def _faces(country: str | None) -> frozenset[str]:
    return frozenset(face_of(name) for name in country_set(country))
