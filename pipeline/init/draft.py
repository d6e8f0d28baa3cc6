"""A manifest under way: values with the reason for each, written so that people can correct it."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from automap.io.toml_file import toml_value

_WIDTH = 100
AS_UTC = "taken as UTC: write the zone's hours if it is not"
NOTES = ("Each line says why. Correct what is wrong, then automap check.",)
"""What stands above all sections."""


@dataclass
class Draft:
    """Sections of ``drive.toml``: key -> value and its reason. Files are paths. ``doubts`` are what
    the user is told at once."""

    folder: Path
    sections: dict[str, dict[str, tuple[Any, str]]] = field(default_factory=dict)
    notes: dict[str, list[str]] = field(default_factory=dict)
    doubts: list[str] = field(default_factory=list)

    def set(self, section: str, key: str, value: Any, why: str) -> None:
        """Put a value in, in place of one that was there."""
        self.sections.setdefault(section, {})[key] = (value, why)

    def get(self, section: str, key: str) -> Any:
        """A value, None where it was not said."""
        return self.sections.get(section, {}).get(key, (None, ""))[0]

    def why(self, section: str, key: str) -> str:
        """The reason of a value."""
        return str(self.sections.get(section, {}).get(key, (None, ""))[1])

    def note(self, section: str, text: str) -> None:
        """A line for the user in a section, which may have no values."""
        self.sections.setdefault(section, {})
        self.notes.setdefault(section, []).append(text)

    def doubt(self, section: str, text: str) -> None:
        """A line for the user that is more than a wish: a value may well be wrong."""
        self.note(section, text)
        self.doubts.append(self._told(section, text))

    def _told(self, section: str, text: str) -> str:
        """A doubt with the file that it is about."""
        file = self.get(section, "file")
        return f"[{section}]: {text}" if file is None else f"{file}: {text}"

    def withdraw(self, section: str, text: str) -> None:
        """Take back a doubt that was settled."""
        self.notes[section].remove(text)
        self.doubts.remove(self._told(section, text))

    def text(self, absolute: bool = False) -> str:
        """The sections as TOML; files relative to the drive folder unless ``absolute``."""
        blocks = []
        for section, values in self.sections.items():
            lines = [f"[{section}]"] if values else [f"# [{section}]"]
            for key, (value, why) in values.items():
                lines += _line(f"{key} = {_toml(self._written(value, absolute))}", why)
            for note in self.notes.get(section, ()):
                lines += _comment(note)
            blocks.append("\n".join(lines) + "\n")
        return "\n".join(blocks)

    def manifest(self, name: str, absolute: bool = False) -> str:
        """The whole file."""
        head = f"# Written by automap init. {NOTES[0]}\n"
        head += f'schema = "automap.drive/1"\nname = {toml_value(name)}\n\n'
        return head + self.text(absolute)

    def _written(self, value: Any, absolute: bool) -> Any:
        if isinstance(value, list):
            return [self._written(item, absolute) for item in value]
        if not isinstance(value, Path):
            return value
        # as it stands in the folder: a link may well lead out of it
        if not absolute and value.is_relative_to(self.folder):
            return value.relative_to(self.folder).as_posix()
        return str(value.absolute())


def _toml(value: Any) -> str:
    """A value as a person would write it, keys of a table without quotes."""
    if not isinstance(value, Mapping):
        return toml_value(value)
    return "{ " + ", ".join(f"{key} = {toml_value(each)}" for key, each in value.items()) + " }"


def _line(text: str, why: str) -> list[str]:
    """A value with its reason, which stands above it where the line would be too long."""
    why = _plain(why)
    if not why:
        return [text]
    if len(text) + len(why) + 4 <= _WIDTH:
        return [f"{text}  # {why}"]
    return [*_comment(why), text]


def _comment(text: str) -> list[str]:
    return textwrap.wrap(_plain(text), _WIDTH, initial_indent="# ", subsequent_indent="# ")


def _plain(text: str) -> str:
    """Text in one line without what a TOML file must not hold."""
    return "".join(c if c.isprintable() else "?" for c in " ".join(text.split()))
