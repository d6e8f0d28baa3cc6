"""The configuration of a run: defaults, then ``--config FILE``, then ``--set KEY=VALUE``."""

from __future__ import annotations

import difflib
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from automap.errors import ConfigError
from automap.io.toml_file import read_toml
from pipeline.settings.detect import DetectSettings
from pipeline.settings.effects import EffectsSettings
from pipeline.settings.export import ExportSettings
from pipeline.settings.fuse import FuseSettings
from pipeline.settings.geolocate import GeolocateSettings
from pipeline.settings.ingest import IngestSettings
from pipeline.settings.privacy import PrivacySettings
from pipeline.settings.report import ReportSettings
from pipeline.settings.section import Section
from pipeline.settings.sync import SyncSettings
from pipeline.settings.user_effects import effects_of, with_absolute_files
from pipeline.shared.configs import configs_dir


class Settings(Section):
    """All settings of a run, one section per stage."""

    ingest: IngestSettings = IngestSettings()
    sync: SyncSettings = SyncSettings()
    effects: EffectsSettings = EffectsSettings()
    fuse: FuseSettings = FuseSettings()
    detect: DetectSettings = DetectSettings()
    geolocate: GeolocateSettings = GeolocateSettings()
    export: ExportSettings = ExportSettings()
    report: ReportSettings = ReportSettings()
    privacy: PrivacySettings = PrivacySettings()

    def echo(self, sections: Sequence[str] | None = None) -> dict[str, Any]:
        """The settings as JSON-able values, all sections or the named ones."""
        return self.model_dump(mode="json", include=None if sections is None else set(sections))


def load_settings(path: Path | None = None, assignments: Sequence[str] = ()) -> Settings:
    """Read the defaults, overlay the TOML file ``path`` and the ``KEY=VALUE`` assignments.

    An assignment's key is ``section.key``, its value is TOML; a value that is no TOML is
    taken as text. Raises ConfigError naming the file or option, the key and what to do.
    """
    merged = read_toml(configs_dir() / "default.toml")
    _check_keys(merged, "configs/default.toml")
    own: dict[str, Any] = {}
    if path is not None:
        overlay = with_absolute_files(read_toml(path), path.parent)
        _check_keys(overlay, str(path))
        merged, own = _overlay(merged, overlay), _overlay(own, overlay)
        built = _build(merged, str(path))
        built.geolocate.check_fixed(effects_of(built.effects, str(path)), str(path))
    for text in assignments:
        overlay = _assignment(text)
        _check_keys(overlay, f"--set {text}")
        merged, own = _overlay(merged, overlay), _overlay(own, overlay)
        built = _build(merged, f"--set {text}")
        built.geolocate.check_fixed(effects_of(built.effects, f"--set {text}"), f"--set {text}")
    return _build(_overlay(merged, _stated(merged, own)), "configs/default.toml")


def settings_of_echo(echo: Mapping[str, Any], source: str) -> Settings:
    """The settings that ``Settings.echo`` gave; ConfigError where they are those of another
    version."""
    _check_keys(echo, source)
    return _build(echo, source)


def _stated(merged: Mapping[str, Any], own: Mapping[str, Any]) -> dict[str, Any]:
    """What the user set himself in the fusion's section: no preset may replace it."""
    from automap.io.receiver_file import FIGURES

    of_sensors = {"accel_noise", "gyro_noise", "accel_bias_walk", "gyro_bias_walk", "effects"}
    given = (of_sensors | set(FIGURES)) & set(own.get("fuse", {}))
    return {"fuse": {"stated": sorted(given | set(merged["fuse"]["stated"]))}}


def known_keys(model: type[Section] = Settings, prefix: str = "") -> Iterator[str]:
    """Dotted names of all sections and keys."""
    for name, info in model.model_fields.items():
        yield prefix + name
        nested = info.annotation
        if isinstance(nested, type) and issubclass(nested, Section):
            yield from known_keys(nested, f"{prefix}{name}.")


def nearest(word: str, known: Sequence[str]) -> str | None:
    """The known name most like ``word``, looking also at the last part of dotted names."""
    found = difflib.get_close_matches(word, known, n=1, cutoff=0.6)
    if found:
        return found[0]
    last = {name.rsplit(".", 1)[-1]: name for name in known}
    found = difflib.get_close_matches(word.rsplit(".", 1)[-1], list(last), n=1, cutoff=0.6)
    return last[found[0]] if found else None


def _check_keys(
    data: Mapping[str, Any], source: str, model: type[Section] = Settings, prefix: str = ""
) -> None:
    for key, value in data.items():
        name = prefix + key
        info = model.model_fields.get(key)
        if info is None:
            guess = nearest(name, list(known_keys()))
            advice = f"did you mean {guess}?" if guess else "see configs/default.toml for the keys"
            raise ConfigError(f"{source}: unknown key {name}; {advice}")
        nested = info.annotation
        if isinstance(nested, type) and issubclass(nested, Section):
            if not isinstance(value, Mapping):
                raise ConfigError(
                    f"{source}: {name} is a section, not a value; write {name}.KEY = VALUE"
                )
            _check_keys(value, source, nested, name + ".")


def _overlay(base: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    merged = dict(base)
    for key, value in over.items():
        old = merged.get(key)
        both = isinstance(old, Mapping) and isinstance(value, Mapping)
        merged[key] = _overlay(old, value) if both else value  # type: ignore[arg-type]
    return merged


def _assignment(text: str) -> dict[str, Any]:
    key, sign, value = text.partition("=")
    key = key.strip()
    if not sign or not all(part for part in key.split(".")):
        raise ConfigError(f"--set {text}: write it as SECTION.KEY=VALUE, for example detect.x=1")
    try:
        parsed: Any = tomllib.loads(f"value = {value}")["value"]
    except tomllib.TOMLDecodeError:
        parsed = value.strip()
    for part in reversed(key.split(".")):
        parsed = {part: parsed}
    return dict(parsed)


def _build(data: Mapping[str, Any], source: str) -> Settings:
    try:
        return Settings.model_validate(data)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        place = ".".join(str(part) for part in first["loc"])
        reason = first["msg"].removeprefix("Value error, ")
        raise ConfigError(
            f"{source}: {place} = {first['input']!r} is not accepted: {reason}"
        ) from None
