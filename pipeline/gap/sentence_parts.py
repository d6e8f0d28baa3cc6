"""What sentences about effects are made of.

Axes are the vehicle's: forward, right, down. What depends on the motion is told for one that a
driver knows: 20 m/s, 1 g, 10 K.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

DEGREES = math.degrees(1.0)
MINUTE = math.sqrt(60.0)
"""A random walk grows with the root of the time."""
AT_20_M_S = 20.0**2
HOUR = 3600.0
AXES = {"x": "forward", "y": "right", "z": "down"}
M_S2 = "m/s²"


@dataclass(frozen=True)
class Part:
    """One parameter: the words for values above and below zero, ``{}`` where the size stands, and
    the factor that makes the size one of ``unit``."""

    more: str
    less: str
    factor: float
    unit: str


@dataclass(frozen=True)
class Sentence:
    """A sentence of an effect, ``{}`` where the words of its parameters stand."""

    frame: str
    parts: Mapping[str, Part]


def one(
    name: str, more: str, less: str = "", factor: float = 1.0, unit: str = "s"
) -> dict[str, Part]:
    """A parameter; one that is never below zero has no words for that."""
    return {name: Part(more, less or more, factor, unit)}


def axes(more: str, less: str, factor: float, unit: str) -> dict[str, Part]:
    """A parameter an axis, whose name stands for ``[axis]``."""
    return {
        p: Part(more.replace("[axis]", name), (less or more).replace("[axis]", name), factor, unit)
        for p, name in AXES.items()
    }


def along(factor: float, unit: str) -> dict[str, Part]:
    """A reading that is too large or too small along an axis."""
    where = "along its [axis] axis"
    return axes("{} too much " + where, "{} too little " + where, factor, unit)


def around(factor: float, unit: str) -> dict[str, Part]:
    """The same about an axis."""
    where = "about its [axis] axis"
    return axes("{} too much " + where, "{} too little " + where, factor, unit)


def by_sign(about: str) -> dict[str, Part]:
    """A scale that differs with the sign of the reading."""
    # k |reading|: larger for readings above zero, smaller for those below
    return axes(
        "{} too much " + about + " the [axis] axis where it reads plus, and as much too little "
        "where it reads minus",
        "{} too little " + about + " the [axis] axis where it reads plus, and as much too much "
        "where it reads minus",
        100.0,
        "%",
    )


def pairs(names: str, more: str, less: str, factor: float, unit: str) -> dict[str, Part]:
    """Parameters named by the axis that reads, ``[out]``, and the one that acts, ``[by]``."""

    def said(text: str, name: str) -> str:
        return text.replace("[out]", AXES[name[0]]).replace("[by]", AXES[name[1]])

    return {n: Part(said(more, n), said(less, n), factor, unit) for n in names.split()}


LEANS = (
    "the [out] axis leans {} towards the [by] axis",
    "the [out] axis leans {} off the [by] axis",
)
ARM = {
    "x": Part("{} further forward", "{} further back", 1.0, "m"),
    "y": Part("{} further to the right", "{} further to the left", 1.0, "m"),
    "z": Part("{} lower", "{} higher", 1.0, "m"),
}
LOOKS = {
    "roll": Part("{} with its right side down", "{} with its left side down", DEGREES, "°"),
    "pitch": Part("{} upwards", "{} downwards", DEGREES, "°"),
    "yaw": Part("{} to the right", "{} to the left", DEGREES, "°"),
}
SITS = {
    "roll": Part("rolled {} right side down", "rolled {} left side down", DEGREES, "°"),
    "pitch": Part("tilted {} front up", "tilted {} front down", DEGREES, "°"),
    "yaw": Part("turned {} to the right", "turned {} to the left", DEGREES, "°"),
}


def wander(unit: str) -> dict[str, Part]:
    """An error that comes and goes: its size and how long it lasts."""
    return one("sigma", "by {}", unit=unit) | one("tau", "for some {} at a time")
