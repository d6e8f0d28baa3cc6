"""When a stage has to run again, and why."""

from __future__ import annotations

import hashlib
import json
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from automap.io import names
from automap.io.manifest import CAMERA_KEYS
from pipeline.run.digests import DigestCache
from pipeline.run.named_files import names_of, without_folders
from pipeline.run.stage import Stage
from pipeline.shared.values import flatten

if TYPE_CHECKING:
    from automap.io.drive import Drive
    from pipeline.settings.load import Settings


@dataclass(frozen=True)
class Ingredients:
    """Everything that a stage's result depends on.

    ``settings`` and ``manifest`` are flattened to dotted keys; ``inputs`` and ``needs`` map
    file names to content digests, a need that is not there to None.
    """

    version: int
    settings: dict[str, Any]
    manifest: dict[str, Any]
    inputs: dict[str, str]
    needs: dict[str, str | None]

    def as_json(self) -> dict[str, Any]:
        """The form in which it stands in run.json."""
        return {
            "version": self.version,
            "settings": self.settings,
            "manifest": self.manifest,
            "inputs": self.inputs,
            "needs": self.needs,
        }

    def key(self, name: str) -> str:
        """One digest of all of it."""
        text = json.dumps([name, self.as_json()], sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(text.encode()).hexdigest()


def gather(
    stage: Stage,
    drive: Drive,
    out: Path,
    settings: Settings,
    digests: DigestCache,
    earlier: Sequence[Mapping[str, Any]],
) -> Ingredients:
    """What the stage would use now. ``earlier`` are the records of the stages before it."""
    manifest = drive.path / names.MANIFEST
    named = stage.setting_files(settings)
    inputs = {}
    for name, path in names_of((*stage.inputs(drive), *named), drive.path).items():
        value = digests.digest(path)
        if value is not None and path != manifest:
            inputs[name] = value
    needs: dict[str, str | None] = {}
    for need in stage.needs:
        needs[need] = _history(earlier) if need == names.RUN else digests.digest(out / need)
    return Ingredients(
        version=stage.version,
        settings=flatten(without_folders(settings.echo(stage.settings), named)),
        manifest=_manifest(manifest, stage.manifest, stage.blind),
        inputs=inputs,
        needs=needs,
    )


def why_run(
    now: Ingredients,
    before: Mapping[str, Any] | None,
    out: Path,
    digests: DigestCache,
    producers: Mapping[str, str],
    ran: Sequence[str],
) -> str | None:
    """The reason for running a stage, or None when what it wrote still holds.

    ``before`` is the stage's record of an earlier run, ``producers`` maps files in OUT to
    the stages that write them, ``ran`` names the stages that ran, or would run, before it
    in this run.
    """
    if before is None:
        return "never ran"
    status = before.get("status")
    if status != "done":
        return "was interrupted" if status in ("interrupted", "running") else "failed last time"
    if before.get("version") != now.version:
        return f"version {before.get('version')} -> {now.version}"
    reasons = _value_changes("settings", _mapping(before, "settings"), now.settings)
    reasons += _value_changes(names.MANIFEST, _mapping(before, "manifest"), now.manifest)
    reasons += _file_changes(_mapping(before, "inputs"), now.inputs)
    reasons += _need_changes(_mapping(before, "needs"), now.needs, producers, ran)
    for name, recorded in _mapping(before, "outputs").items():
        current = digests.digest(out / name)
        if current is None:
            reasons.append(f"output {name} is missing")
        elif not isinstance(recorded, Mapping) or current != recorded.get("sha256"):
            reasons.append(f"output {name} was changed")
    unique = list(dict.fromkeys(reasons))
    if len(unique) > 3:
        unique = [*unique[:3], f"{len(unique) - 3} more changes"]
    return "; ".join(unique) or None


def _manifest(path: Path, sections: tuple[str, ...] | None, blind: bool) -> dict[str, Any]:
    # by content, so that comments and layout do not matter
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    if sections is not None:
        content = {key: value for key, value in content.items() if key in sections}
    plain: dict[str, Any] = json.loads(json.dumps(content, default=str))
    values = flatten(plain)
    return {key: value for key, value in values.items() if not (blind and _of_camera(key))}


def _of_camera(key: str) -> bool:
    section, _, rest = key.partition(".")
    return section == "video" and rest.rpartition(".")[2] in CAMERA_KEYS


def _history(earlier: Sequence[Mapping[str, Any]]) -> str:
    stamps = [[record.get("key"), record.get("started")] for record in earlier]
    return hashlib.sha256(json.dumps(stamps).encode()).hexdigest()


def _mapping(record: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    value = record.get(key)
    return value if isinstance(value, Mapping) else {}


def _value_changes(what: str, old: Mapping[str, Any], new: Mapping[str, Any]) -> list[str]:
    changes = []
    for key in sorted({*old, *new}):
        if key not in old:
            changes.append(f"{what} {key} is new")
        elif key not in new:
            changes.append(f"{what} {key} is gone")
        elif old[key] != new[key]:
            changes.append(f"{what} {key} changed from {_short(old[key])} to {_short(new[key])}")
    return changes


def _file_changes(old: Mapping[str, Any], new: Mapping[str, str]) -> list[str]:
    changes = []
    for name in sorted({*old, *new}):
        if old.get(name) != new.get(name):
            verb = "is new" if name not in old else "is gone" if name not in new else "changed"
            changes.append(f"{name} {verb}")
    return changes


def _need_changes(
    old: Mapping[str, Any],
    new: Mapping[str, str | None],
    producers: Mapping[str, str],
    ran: Sequence[str],
) -> list[str]:
    changes = []
    for name in sorted({*old, *new}):
        if old.get(name) == new.get(name):
            continue
        source = producers.get(name)
        if name == names.RUN:
            changes.append(f"stage {ran[-1]} ran again" if ran else "an earlier stage ran again")
        elif source in ran:
            changes.append(f"stage {source} ran again")
        else:
            changes.append(f"{name} changed" + (f" (from stage {source})" if source else ""))
    return changes


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 40 else text[:37] + "..."
