"""Moved signs that all moved by the same way: rather the list, or the map, is off there.

Signs are moved each its own way. Where more of them go the same one than chance would bring
together, it is told as one finding: parts of a list too small or too near to be told from the ways
of all its signs (``inventory_displaced``) come out as moved entries.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from automap.inventory.findings import Finding, Inventory
from automap.inventory.limits import CIRCLE_95, LEAST_TURNS, TOLD_BY_CHANCE
from automap.records import FloatArray, IntArray

_NAMED = 10
"""Entries of a sentence; larger parts are mostly told as parts."""


@dataclass(frozen=True)
class MovedAlike:
    """``rows`` of the findings, and the way that they moved, ``east_m`` and ``north_m``."""

    rows: tuple[int, ...]
    east_m: float
    north_m: float


def alike(findings: Sequence[Finding], listed: Inventory) -> list[tuple[str, Sequence[int]]]:
    """A sentence for each such group, and its rows of the findings."""
    told: list[tuple[str, Sequence[int]]] = []
    for group in moved_alike(findings):
        ids = [str(listed.ids[findings[k].listed]) for k in group.rows]
        more = f" and {len(ids) - _NAMED} more" if len(ids) > _NAMED else ""
        told.append((
            f"{len(ids)} of its entries that are called moved lie off by the same way, "
            f"{np.hypot(group.east_m, group.north_m):.1f} m ({group.east_m:+.1f} m east, "
            f"{group.north_m:+.1f} m north): {', '.join(ids[:_NAMED])}{more}. Rather they are of "
            "another source or datum, or the map is off there, than that each was moved; look at "
            "one of them. They are not for work.",
            group.rows,
        ))  # fmt: skip
    return told


def moved_alike(findings: Sequence[Finding]) -> list[MovedAlike]:
    """Those called moved that go one way, where that is no chance; the most striking first."""
    left = np.array([k for k, f in enumerate(findings) if f.kind == "moved"], np.int64)
    found: list[MovedAlike] = []
    while len(left) >= LEAST_TURNS:
        ways = np.array([(findings[k].east_m, findings[k].north_m) for k in left.tolist()])
        own = _most_alike(ways, np.array([findings[k].sd_m for k in left.tolist()]))
        if own is None:
            break
        east, north = np.median(ways[own], axis=0).tolist()
        found.append(MovedAlike(tuple(left[own].tolist()), east, north))
        left = np.delete(left, own)
    return found


def _most_alike(ways: FloatArray, sd: FloatArray) -> IntArray | None:
    """Rows of the ways [n, 2], with their errors per axis [n], that agree with one of them more
    than chance would once in a thousand lists; None where none do."""
    from scipy.stats import binom

    length = np.hypot(*ways.T)
    best, chosen = TOLD_BY_CHANCE / len(ways), None
    for k in range(len(ways)):
        about = np.hypot(*(ways - ways[k]).T) < CIRCLE_95 * np.hypot(sd, sd[k])
        way = np.median(ways[about], axis=0)
        radius, far = CIRCLE_95 * sd, float(np.hypot(*way))
        near, opposite = (np.hypot(*(ways - each).T) < radius for each in (way, -way))
        if near.sum() < LEAST_TURNS or (near & opposite).any():
            continue
        # of the directions that a sign could go by its length, the share that ends as near
        cosine = (far**2 + length**2 - radius**2) / np.maximum(2.0 * far * length, 1e-9)
        usual = np.arccos(np.clip(cosine, -1.0, 1.0)) / np.pi
        # along a street signs go this way and the opposite one
        usual = np.maximum(usual, opposite.sum() / (near | opposite).sum())
        # one of them made the way; a binomial of the mean has the longer tail (W. Hoeffding, 1956)
        usual = np.delete(usual, int(np.argmax(near)))
        chance = float(binom.sf(int(near.sum()) - 2, len(usual), float(usual.mean())))
        if chance < best:
            best, chosen = chance, np.flatnonzero(near)
    return chosen
