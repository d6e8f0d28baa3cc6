"""What hangs where on one post: the order of its faces from the top, and whose a plate is."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from automap.signs.vocabulary import load_vocabulary

SUPPLEMENTARY = "complementary--"
"""Family of the classes of plates that say more of the sign above them."""
PLATE_GAP_M = 0.3
"""A rectangle that nobody could read is a plate where it hangs no further below its sign. Chosen:
plates are fixed right below it, and centres and heights of faces err by a decimetre or two."""
ONE_SIDE_RAD = 0.5 * math.pi
"""Faces turned from one another by less are read by the same traffic."""


class Face(Protocol):
    """What of a ``records.Sign`` says where it hangs."""

    @property
    def id(self) -> str: ...
    @property
    def class_name(self) -> str: ...
    @property
    def height_m(self) -> float: ...
    @property
    def size_m(self) -> float: ...
    @property
    def facing_rad(self) -> float: ...
    @property
    def support(self) -> str: ...


@dataclass(frozen=True)
class OnPost:
    """Where signs [n] hang: ``order`` from the top among the faces of one post that look the same
    way, 1 the uppermost (None without a post or a height); ``main`` the id of the sign that a plate
    belongs to (None for other signs, and where none hangs above)."""

    order: list[int | None]
    main: list[str | None]


def on_post(signs: Sequence[Face]) -> OnPost:
    """Order and relations of the signs that share a ``support``.

    A plate belongs to the nearest sign above it that was read and is no plate itself. A rectangle
    that could not be read is one where it hangs right below such a sign, or below such a plate.
    """
    order: list[int | None] = [None] * len(signs)
    main: list[str | None] = [None] * len(signs)
    posts: dict[str, list[int]] = {}
    for k, sign in enumerate(signs):
        if sign.support and math.isfinite(sign.height_m):
            posts.setdefault(sign.support, []).append(k)
    for members in posts.values():
        members.sort(key=lambda k: (-signs[k].height_m, signs[k].id))
        for place, k in enumerate(members):
            above = [j for j in members[:place] if _same_side(signs[j], signs[k])]
            order[k] = len(above) + 1
            heads = [j for j in above if not (is_plate(signs[j]) or _unread(signs[j]))]
            if heads and (is_plate(signs[k]) or _right_below(signs[k], signs[above[-1]])):
                main[k] = signs[heads[-1]].id
    return OnPost(order, main)


def is_plate(sign: Face) -> bool:
    """Whether a sign is a plate that says more of another."""
    return sign.class_name.startswith(SUPPLEMENTARY)


def _right_below(sign: Face, above: Face) -> bool:
    """Whether a sign is an unread rectangle whose upper edge is at the lower one of another."""
    gap = above.height_m - sign.height_m - 0.5 * (above.size_m + sign.size_m)
    return _unread(sign) and abs(gap) < PLATE_GAP_M


def _unread(sign: Face) -> bool:
    """Whether a sign is a rectangle of which the detector read no more than the colour."""
    vocabulary = load_vocabulary()
    group = str(vocabulary.group_of(sign.class_name))
    return group.endswith("-square") and sign.class_name == vocabulary.groups.get(group)


def _same_side(one: Face, other: Face) -> bool:
    """Whether the same traffic reads both; faces of unknown direction count as such."""
    turn = one.facing_rad - other.facing_rad
    return not (math.isfinite(turn) and math.cos(turn) < math.cos(ONE_SIDE_RAD))
