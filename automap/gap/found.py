"""What a search hands on: where it ended, what of it carries over to another layout, and what was
found as that beside which more is looked for in any drives.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from automap.gap.confirm import Confirmed
from automap.gap.fit import Fit, Values
from automap.gap.joint import Joint
from automap.gap.linear import Column, Conditional, Linear, conditional
from automap.gap.nodes import NodeMotion, motions_of
from automap.gap.noise import Fitted
from automap.gap.selection import Chosen, Selection
from automap.gap.sensitivity import ColumnsOf, linearised


@dataclass(frozen=True)
class Found:
    """Where a search ended: the set as fitted, the base model's fit, the joint estimate with all
    parameters of each effect free, the last selection with what it chose, which effect stands for
    each candidate, which names the drives cannot tell from each, what of it held-out data let
    stand, the fit made linear as it is where nothing else acts, nats of those of which the filter
    says how many, which formula some names may be, and what a drift says nearly as well, the
    likeliest first, with the log odds of each."""

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
    resembling: Mapping[str, str] = field(default_factory=dict)
    as_drift: Mapping[str, Mapping[str, float]] = field(default_factory=dict)


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


@dataclass(frozen=True)
class Beside:
    """A choice of a selection: ``columns_of`` its columns along a drive, ``values`` at which fits
    have its effects."""

    selection: Selection
    chosen: Chosen
    columns_of: ColumnsOf
    values: Values

    def linear(self, fits: Sequence[Fit], more: ColumnsOf, may_act: bool) -> Linear:
        """Fits made linear in the choice and ``more`` columns, which may act or not."""

        def columns(at: NodeMotion) -> list[Column]:
            return [*self.columns_of(at), *more(at)]

        return linearised(motions_of(fits), columns, self.values, may_act)

    def known(self, linear: Linear) -> Conditional:
        """A linear model that has its columns with the choice marginalised."""
        return conditional(linear, self.selection.given_in(self.chosen, linear))

    @property
    def noise(self) -> float:
        """By how much scores are larger than noise as modelled makes them."""
        return self.selection.inflated.get(False, 1.0)
