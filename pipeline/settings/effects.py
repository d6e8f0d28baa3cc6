"""Settings of the users' own effects."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pydantic import Field

from pipeline.settings.section import Section


class EffectsSettings(Section):
    """Section ``[effects]`` of the configuration: effects that users add."""

    files: tuple[str, ...] = ()
    """Python files with a list EFFECTS of effects of your own, relative to this file"""
    formulas: dict[str, dict[str, Any]] = Field(default_factory=dict)
    """effects as formulas: { name = { parameter = { on = "accel_x", formula = "sin(heading)",
    prior_sd = 0.05, unit = "m/s^2" } } }"""

    def paths(self) -> list[Path]:
        """The Python files."""
        return [Path(name) for name in self.files]
