"""What was found, as that beside which more is looked for in any drives."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from automap.gap.fit import Fit, Values
from automap.gap.linear import Column, Conditional, Linear, NodeMotion, conditional, linearised
from automap.gap.motion import Motion
from automap.gap.selection import Chosen, Selection

ColumnsOf = Callable[[Fit, Motion, NodeMotion], list[Column]]


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

        def columns(fit: Fit, motion: Motion, at: NodeMotion) -> list[Column]:
            return self.columns_of(fit, motion, at) + more(fit, motion, at)

        return linearised(fits, columns, self.values, may_act)

    def known(self, linear: Linear) -> Conditional:
        """A linear model that has its columns with the choice marginalised."""
        return conditional(linear, self.selection.given_in(self.chosen, linear))

    @property
    def noise(self) -> float:
        """By how much scores are larger than noise as modelled makes them."""
        return self.selection.inflated.get(False, 1.0)
