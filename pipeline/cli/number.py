"""Numbers on the command line."""

from __future__ import annotations

import math
from typing import Any

import click


class Finite(click.FloatRange):
    """A float, perhaps within limits, that is neither NaN nor infinite.

    NaN passes every comparison that click makes with the limits of a range.
    """

    name = "number"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        """The number; a usage error for text that is none, or one outside the limits."""
        number = float(super().convert(value, param, ctx))
        if not math.isfinite(number):
            self.fail(f"{value} is no number that can be used.", param, ctx)
        return number

    def _describe_range(self) -> str:
        """Limits for the help, nothing where there are none."""
        return "" if self.min is None and self.max is None else super()._describe_range()
