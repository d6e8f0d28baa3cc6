"""Stepwise selection: which set of candidates a linear model is missing, by adding, swapping and
dropping while the posterior odds rise.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from automap.gap import limits
from automap.gap.evidence import nats_of_parts, plain_nats
from automap.gap.selection import Chosen, Selection, twins_of

TRIES = 40
"""Moves of one selection at most: each raises the odds, so this bounds the time only."""


def select(selection: Selection, chosen: Chosen, limit: int) -> Chosen:
    """Add, swap and drop candidates until nothing raises the odds any more; at most ``limit``."""
    strongest = 0.0
    for _ in range(TRIES):
        moves = [m for m in selection.best(chosen) if selection.holds(m)]
        if moves:
            best = moves[0]
            strongest = max(strongest, best.odds)
            room = len(chosen.names) < limit or best.name in chosen.names
            if room and best.odds >= limits.WEAK_SHARE * strongest:
                chosen = chosen.joined(best.name, best.part, best.evidence.scale)
                chosen = _swapped(selection, chosen, limit)
                continue
        fewer = pruned(selection, chosen)
        if fewer == chosen:
            break
        chosen = fewer
    return chosen


def _swapped(selection: Selection, chosen: Chosen, limit: int) -> Chosen:
    """The choice with a candidate in the place of another where that raises the odds, with what
    stands out beside either: two effects may together do what one that is not there does nearly."""
    names = chosen.names[:-1]
    alone = _extended(selection, chosen)[0] if names else 0.0
    for name in names:
        own, _ = selection.odds_of(chosen, name)
        best, instead = alone, chosen
        for rival in selection.rivals(chosen, name)[: limits.RIVALS]:
            if rival.ahead < -0.5 * own or (name, rival.name) in selection.outdone:
                continue
            more, with_more = _extended(selection, rival.chosen)
            if rival.ahead + more > best + 1.0 and len(with_more.names) <= limit:
                best, instead = rival.ahead + more, with_more
        if instead != chosen:
            return instead
    return chosen


def _extended(selection: Selection, chosen: Chosen) -> tuple[float, Chosen]:
    """Odds of the part that stands out most beside a choice, and the choice with it."""
    moves = [m for m in selection.best(chosen) if selection.holds(m)]
    if not moves:
        return 0.0, chosen
    best = moves[0]
    return best.odds, chosen.joined(best.name, best.part, best.evidence.scale)


def pruned(selection: Selection, chosen: Chosen) -> Chosen:
    """The choice without the candidate, or the part of one, that is needed least, if it is not
    needed beside the others."""
    odds = {name: selection.odds_of(chosen, name) for name in chosen.names}
    for name in sorted(odds.keys() - selection.needed, key=lambda n: (odds[n][0], n)):
        total, moves = odds[name]
        if total < limits.LEAST_ODDS:
            return chosen.without(name)
        for move in moves if len(moves) > 1 else ():
            rest = Chosen(tuple(p for p in chosen.parts if p[:2] != (name, move.part)))
            found = selection.evidence(selection.given(rest), name, move.part)
            if found.nats + selection.candidates[name].log_choice < 0.0:
                return rest
    return chosen


def swallowed(selection: Selection, chosen: Chosen, least: Mapping[int, float]) -> Chosen:
    """The choice with the effect on one sensor whose axes together have the highest odds under
    steadier biases beyond ``least``, sensor -> by how many nats drives are less likely where its
    biases are so steady; none where there is no such.

    Each axis alone scatters there with what the others do, so no part need hold by itself.
    """
    known, barred = selection.given(chosen), twins_of(chosen.names)
    open_to, prior = [], []
    for c in selection.candidates.values():
        sensors = {s for part in c.parts for i in part for s in selection.linear.layout[i].sensors}
        # what must be alike on all axes is no drift
        if c.name in chosen.names or c.name in barred or c.isotropic or len(sensors) != 1:
            continue
        parts = [
            part
            for part in c.parts
            if known.shows(part) and selection.key(c.name, part) not in selection.refused
        ]
        if len(parts) > 1:
            open_to.append((c.name, parts))
            prior.append(c.log_prior + len(parts) * c.log_choice - least[sensors.pop()])
    if not open_to:
        return chosen
    wholes = [tuple(i for part in parts for i in part) for _, parts in open_to]
    odds = nats_of_parts(known, wholes) + prior
    at = int(np.argmax(odds))
    if odds[at] <= 0.0:
        return chosen
    name, parts = open_to[at]
    scale = plain_nats(known, wholes[at])[1]
    more = chosen
    for part in parts:
        more = more.joined(name, part, scale)
    # less the axes that are not needed beside the others
    own = replace(selection, needed=frozenset(chosen.names))
    while (fewer := pruned(own, more)) != more:
        more = fewer
    return more
