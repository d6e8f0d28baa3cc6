"""Settings of the users' own effects."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pydantic import Field

from pipeline.settings.section import Section


class EffectsSettings(Section):
    """Section ``[effects]`` of the configuration: effects that users add."""

    files: tuple[str, ...] = ()
    """Python files with a list EFFECTS; relative to the file of settings."""
    formulas: dict[str, dict[str, Any]] = Field(default_factory=dict)
    """Effects as formulas: name, parameter, then on, formula, prior_sd and unit."""

    def paths(self) -> list[Path]:
        """The Python files."""
        return [Path(name) for name in self.files]
