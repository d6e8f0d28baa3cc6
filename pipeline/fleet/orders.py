"""What is to be done with every drive of a store, and a name for it."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from automap.errors import ConfigError
from pipeline.fleet.store import DONE, SETTINGS, Store
from pipeline.run.named_files import without_folders
from pipeline.run.registry import load_stages
from pipeline.settings.load import Settings, load_settings, settings_of_echo


@dataclass(frozen=True)
class Order:
    """Settings as ``echo`` has them; ``key`` names them and the versions of the stages: what was
    made with another may be different. ``outside`` folders that drives may name files in;
    ``memory`` bytes that a drive may take."""

    echo: dict[str, Any]
    key: str
    outside: tuple[str, ...]
    memory: int

    def settings(self) -> Settings:
        """The settings; ConfigError where this version of automap makes something else of them."""
        settings = settings_of_echo(self.echo, "the store's settings")
        if key_of(settings) != self.key:
            raise ConfigError(
                "this machine has another version of automap, or of a file that the settings "
                "name, than the one that gave the order; install the same one."
            )
        return settings


def settings_of(store: Store, config: Path | None, assignments: Sequence[str]) -> Settings:
    """The store's settings, or those given, which then are the store's; ConfigError where none are
    given and the store's are damaged."""
    told = store.read(SETTINGS)
    if config is None and not assignments and store.place.read(SETTINGS) is not None:
        where = f"{store.place.url}/{SETTINGS}"
        if not isinstance(told.get("settings"), dict):
            # the usual ones would run every drive anew
            raise ConfigError(
                f"{where} is damaged; give the store's settings with --config, or remove it for "
                "the usual ones."
            )
        settings = settings_of_echo(told["settings"], where)
    else:
        settings = load_settings(config, assignments)
    now = {"settings": settings.echo(), "key": key_of(settings)}
    if now != told:
        # the key is another with another version too: status counts what is done by it
        store.write(SETTINGS, now)
    return settings


def key_of(settings: Settings) -> str:
    """Of the settings, the stages' versions, and the content of files that the settings name."""
    stages = load_stages()
    files = list(dict.fromkeys(p for stage in stages for p in stage.setting_files(settings)))
    told = {
        "settings": without_folders(settings.echo(), files),
        "stages": {stage.name: stage.version for stage in stages},
        "files": [[path.name, _digest(path)] for path in files],
    }
    return hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()[:20]


def current_key(store: Store) -> str | None:
    """The name of the store's settings by this version of automap; None where it has none, or this
    version makes nothing of them."""
    told = store.read(SETTINGS)
    if not told.get("settings"):
        return None
    try:
        return key_of(settings_of_echo(told["settings"], f"{store.place.url}/{SETTINGS}"))
    except ConfigError:
        return None


def keep_done(store: Store, key: str) -> int:
    """Let what was done with other settings stand for done with these; how many there were."""
    older = [entry for entry in store.entries() if entry.done and entry.done["key"] != key]
    for entry in older:
        made_with = entry.done.get("made_with", entry.done["key"])
        store.mark(entry.digest, DONE, {**entry.done, "key": key, "made_with": made_with})
    return len(older)


def _digest(path: Path) -> str:
    if not path.is_file():
        return ""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
