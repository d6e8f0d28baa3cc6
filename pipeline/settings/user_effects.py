"""The users' effects of a configuration become part of the catalogue.

They are formulas in its tables, or stand in Python files that it names: each has a list ``EFFECTS``
of what ``automap.effects.user_effect`` returns.
"""

from __future__ import annotations

import runpy
import traceback
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from automap.errors import ConfigError

if TYPE_CHECKING:
    from automap.effects import UserEffect
    from pipeline.settings.effects import EffectsSettings

LIST = "EFFECTS"


def effects_of(settings: EffectsSettings, source: str = "the settings") -> list[UserEffect]:
    """The effects of a configuration; raises ConfigError naming the file and the key."""
    from automap.effects.user_tables import effects_of_formulas

    effects = [e for path in settings.paths() for e in effects_of_python(path)]
    return effects + effects_of_formulas(settings.formulas, source)


def effects_of_python(path: Path) -> list[UserEffect]:
    """The effects of a Python file, which is run for it.

    Raises:
        ConfigError: no such file, an error in it (with its line), or no list of effects.
    """
    from automap.effects import UserEffect

    if not path.is_file():
        raise ConfigError(f"{path}: there is no such file of effects; check effects.files")
    try:
        content = runpy.run_path(str(path))
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from None
    except SyntaxError as error:
        raise ConfigError(f"{path}: line {error.lineno}: {error.msg}; correct it") from None
    except Exception as error:
        lines = [
            f.lineno for f in traceback.extract_tb(error.__traceback__) if f.filename == str(path)
        ]
        place = f"line {lines[-1]}: " if lines else ""
        raise ConfigError(f"{path}: {place}{type(error).__name__}: {error}; correct it") from error
    found = content.get(LIST)
    if not isinstance(found, list | tuple) or not found:
        raise ConfigError(f"{path}: there is no list {LIST} in it; put the effects there")
    for item in found:
        if not isinstance(item, UserEffect):
            raise ConfigError(
                f"{path}: {LIST} holds {item!r}; put there what automap.effects.user_effect returns"
            )
    return list(found)


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
