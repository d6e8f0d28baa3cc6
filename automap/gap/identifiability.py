"""What a drive cannot tell: effects that look alike along it, and effects that hardly show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from automap.gap.advice import advice
from automap.gap.candidates import named_columns
from automap.gap.columns import ORIGIN
from automap.gap.fit import Fit
from automap.gap.linear import linearised
from automap.records import FloatArray, IntArray

SHOWS = 3.0
"""A parameter of its usual size shows where it stands out by so many sigmas."""
ALIKE = 0.8
"""So much of what a parameter shows may be another effect's, and what is left stays below
``SHOWS``: then the two cannot be told apart."""
PRIOR_ROOM = 5.0


@dataclass(frozen=True)
class Alike:
    """Two effects that a drive cannot tell apart, the share of the one's traces that the other
    leaves as well, and the manoeuvre that would tell."""

    effects: tuple[str, str]
    share: float
    advice: str


@dataclass(frozen=True)
class Identifiability:
    """``alike`` pairs, the most alike first; ``hidden`` effects that hardly show on the drive even
    at their usual size."""

    alike: tuple[Alike, ...] = ()
    hidden: tuple[str, ...] = ()


def identifiability(fits: Sequence[Fit], effects: Sequence[str]) -> Identifiability:
    """What the fitted drives together cannot tell of the effects."""
    info, layout, priors = _information(fits, effects)
    groups = {
        e: np.array([i for i, (name, _) in enumerate(layout) if name == e], np.int64)
        for e in effects
    }
    seen = priors * np.sqrt(np.maximum(np.diag(info), 0.0)) > SHOWS
    shown = {e: rows[seen[rows]] for e, rows in groups.items() if seen[rows].any()}
    found: dict[frozenset[str], Alike] = {}
    for one, rows in shown.items():
        for other in shown:
            if other == one:
                continue
            share = _share(info, rows, groups[other], priors)
            pair = frozenset({one, other})
            if share > 0.0 and (pair not in found or share > found[pair].share):
                found[pair] = Alike((one, other), share, advice(one, (other,)))
    alike = sorted(found.values(), key=lambda a: -a.share)
    return Identifiability(tuple(alike), tuple(e for e in effects if e not in shown))


def _information(
    fits: Sequence[Fit], effects: Sequence[str]
) -> tuple[FloatArray, list[tuple[str, str]], FloatArray]:
    """Information [c, c] of all parameters, their names, and prior sds [c]."""
    linear = linearised(fits, lambda *about: named_columns(effects, *about), {})
    # a skew's origin is no parameter of its own
    kept = [i for i, c in enumerate(linear.layout) if c.parameter != ORIGIN]
    layout = [(linear.layout[i].effect, linear.layout[i].parameter) for i in kept]
    return linear.info[np.ix_(kept, kept)], layout, linear.prior_sd[kept]


def _share(info: FloatArray, rows: IntArray, other: IntArray, priors: FloatArray) -> float:
    """The largest share of what one of ``rows`` shows that the ``other`` columns show too; zero
    where they can be told apart."""
    inner = info[np.ix_(other, other)] + np.diag((PRIOR_ROOM * priors[other]) ** -2.0)
    cross = info[np.ix_(rows, other)]
    explained = np.einsum("ij,ij->i", cross, np.linalg.solve(inner, cross.T).T)
    own = np.maximum(np.diag(info)[rows], 1e-300)
    left = priors[rows] * np.sqrt(np.maximum(own - explained, 0.0))
    share = np.where(left < SHOWS, explained / own, 0.0)
    return float(np.max(np.where(share > ALIKE, share, 0.0)))
