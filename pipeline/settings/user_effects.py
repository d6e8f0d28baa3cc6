"""The users' effects of a configuration become part of the catalogue."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from automap.effects import UserEffect
    from pipeline.settings.effects import EffectsSettings


def effects_of(settings: EffectsSettings, source: str = "the settings") -> list[UserEffect]:
    """The effects of a configuration; raises ConfigError naming the file and the key."""
    from automap.effects.user_files import effects_of_formulas, effects_of_python

    effects = [e for path in settings.paths() for e in effects_of_python(path)]
    return effects + effects_of_formulas(settings.formulas, source)


def activate(settings: EffectsSettings) -> None:
    """Make the configuration's effects, and no others, the users' effects of this process.

    Raises ConfigError for one that is wrong.
    """
    from automap.effects.user import set_user_effects

    set_user_effects(effects_of(settings))


def with_absolute_files(data: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """The content of a settings file in ``folder`` with the paths of its effects made whole."""
    section = data.get("effects")
    if not isinstance(section, Mapping) or not isinstance(section.get("files"), list):
        return dict(data)
    files = [str((folder / f).resolve()) if isinstance(f, str) else f for f in section["files"]]
    return {**data, "effects": {**section, "files": files}}
