"""Which manoeuvre tells effects apart that a drive could not: the catalogue's."""

from __future__ import annotations

from collections.abc import Collection

from automap.effects import CATALOGUE

GENERAL = (
    "drive figures of eight at two speeds, brake and accelerate hard on a straight, and stand "
    "still for half a minute in between"
)
GENERAL_FILM = "film more signs, near and far, in bends and at several speeds"


def advice(effect: str, confusable: Collection[str]) -> str:
    """The manoeuvre that tells an effect from those it is confusable with, nothing without any."""
    if not confusable:
        return ""
    known = [text for other in confusable if (text := _manoeuvre(effect, other))]
    general = GENERAL_FILM if CATALOGUE[effect].family == "camera" else GENERAL
    return "; ".join(dict.fromkeys(known)) or general


def _manoeuvre(one: str, other: str) -> str:
    """What tells two apart; nothing where none is known, or one is a formula."""
    for first, second in ((one, other), (other, one)):
        if first in CATALOGUE and second in (known := dict(CATALOGUE[first].told_apart)):
            return known[second]
    return ""
