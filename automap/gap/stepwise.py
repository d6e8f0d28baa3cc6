"""Stepwise selection: which set of candidates a linear model is missing, by adding, swapping and
dropping while the posterior odds rise; and what may stand in the place of one that was chosen.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from automap.gap import limits
from automap.gap.evidence import apart
from automap.gap.linear import Part
from automap.gap.selection import Chosen, Key, Move, Selection

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
        for rival in rivals(selection, chosen, name)[: limits.RIVALS]:
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


@dataclass(frozen=True)
class Rival:
    """A candidate in the place of another: by how much its log odds are ahead of that one's, and
    the choice with it."""

    name: str
    ahead: float
    chosen: Chosen


def rivals(
    selection: Selection,
    chosen: Chosen,
    name: str,
    names: Sequence[str] | None = None,
    refused: frozenset[Key] | None = None,
    part: Part | None = None,
) -> list[Rival]:
    """What may stand in a candidate's place, or in that of a ``part`` of it, best first, of the
    candidates ``names``, but for parts that are ``refused``.

    Both explain much the same of the same data under the same noise. So the scatter of both
    scores is taken for the smaller of the two: what one of them has more is its own misfit, and
    shows in what it explains.
    """
    # what is free beside a candidate is nobody's to explain in its place
    beside = selection.always.joined(selection.candidates[name].beside, selection.linear, 1.0)
    free = replace(selection, always=beside)
    rest = chosen.without(name, part)
    own = free.odds_of(chosen, name)[1] if part is None else [free.alone(rest, name, part)]
    mine = max((m.evidence.overdispersion for m in own), default=1.0)
    out = []
    found = free.best(rest, names, refused=refused)
    for other in dict.fromkeys(m.name for m in found if m.name != name):
        candidate, instead = selection.candidates[other], rest
        moves: list[Move] = []
        for _ in candidate.parts:
            more = free.best(instead, (other,), refused=refused)
            if not more or (moves and more[0].odds <= 0.0):
                break
            moves.append(more[0])
            instead = instead.joined(other, more[0].part, more[0].evidence.scale)
        if not moves:
            continue
        common = min(mine, max(m.evidence.overdispersion for m in moves))
        odds = [
            sum(m.odds - m.evidence.nats + m.evidence.corrected(common) for m in side)
            for side in (moves, own)
        ]
        out.append(Rival(other, odds[0] - odds[1], instead))
    return sorted(out, key=lambda r: -r.ahead)


def told_apart(
    selection: Selection, rival: Rival, chosen: Chosen, name: str, part: Part | None = None
) -> bool:
    """Whether a chosen candidate, or a ``part`` of it, is needed even beside a rival of it, as
    any name is, or what it explains more than the rival in its place is beyond its scatter from
    stretch to stretch: two that do nearly the same leave little to each other, and noise that
    is not as modelled decides between them."""
    rest = chosen.without(name, part)
    mine = tuple(p for p in chosen.parts if p not in rest.parts)
    known = selection.given(rival.chosen)
    if any(known.shows(p) for _, p, _ in mine):
        if part is not None:
            odds = selection.alone(rival.chosen, name, part).odds
        else:
            odds = selection.odds_of(Chosen((*rival.chosen.parts, *mine)), name)[0]
        if odds >= limits.LEAST_ODDS:
            return True
    its = tuple(i for p in rival.chosen.parts if p not in rest.parts for i in p[1])
    own = tuple(i for _, p, _ in mine for i in p)
    return apart(selection.given(rest), own, its) > limits.APART


def close_rivals(
    selection: Selection, chosen: Chosen, name: str, barred: frozenset[Key] = frozenset()
) -> list[Rival]:
    """Rivals that a linear model cannot rule out: those nearly as likely, and beside a formula
    the likeliest names, however far behind; also what was tried beside others and not needed
    there, but nothing that is ``barred``."""
    own, _ = selection.odds_of(chosen, name)
    close = max(limits.CLOSE_NATS, limits.CHALLENGE * own)
    every = rivals(selection, chosen, name, refused=barred)
    formula = bool(selection.candidates[name].terms)
    names = [r for r in every if not selection.candidates[r.name].terms]
    near = [r for r in every if r not in names and -r.ahead <= close]
    names = [r for r in names if formula or -r.ahead <= close]
    return [*names[: limits.RIVALS], *near[: limits.RIVALS]]
