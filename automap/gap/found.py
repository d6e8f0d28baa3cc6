"""What a search hands on: where it ended, and what of it carries over to another layout."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from automap.gap.confirm import Confirmed
from automap.gap.linear import Column
from automap.gap.noise import Fitted, Joint
from automap.gap.selection import Chosen, Selection


@dataclass(frozen=True)
class Found:
    """Where a search ended: the set as fitted, the base model's fit, the joint estimate with all
    parameters of each effect free, the last selection with what it chose, which effect stands for
    each candidate, which names the drives cannot tell from each, what of it held-out data let
    stand, the fit made linear as it is where nothing else acts, and nats of those of which the
    filter says how many."""

    base: Fitted
    fitted: Fitted
    full: Joint
    selection: Selection
    chosen: Chosen
    effects: Mapping[str, str]
    not_told_apart: Mapping[str, tuple[str, ...]]
    stands: Confirmed
    nothing_else: Selection
    nats: Mapping[str, float] = field(default_factory=dict)


def in_layout(chosen: Chosen, old: Sequence[Column], new: Selection) -> Chosen:
    """A choice of columns of an ``old`` layout with those of another; what that does not have is
    left out."""
    place = {(c.effect, c.parameter): i for i, c in enumerate(new.linear.layout)}
    parts = []
    for name, part, scale in chosen.parts:
        candidate = new.candidates.get(name)
        if candidate is None:
            continue
        if candidate.terms:
            parts.append((name, candidate.parts[0], scale))
            continue
        columns = [old[i] for i in part]
        rows = tuple(
            place[(c.effect, c.parameter)] for c in columns if (c.effect, c.parameter) in place
        )
        if len(rows) == len(part):
            parts.append((name, rows, scale))
    return Chosen(tuple(parts))
