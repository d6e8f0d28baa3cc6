"""What the options of several commands have in common: paths, numbers, settings."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import click

F = TypeVar("F", bound=Callable[..., Any])

ANY_PATH = click.Path(path_type=Path, readable=False)
"""A path of any kind. Whether it can be read is found by the reader: it says what to do, and one
drive of several that cannot be read does not stop the others."""


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


def settings_options(
    config: str = "TOML file with settings that replace the defaults.",
    assignment: str = "Replace one setting.",
) -> Callable[[F], F]:
    """``--config`` and ``--set``, with their helps."""

    def decorated(function: F) -> F:
        one = click.option(
            "--set", "assignments", multiple=True, metavar="KEY=VALUE", help=assignment
        )
        return click.option("--config", type=ANY_PATH, help=config)(one(function))

    return decorated
