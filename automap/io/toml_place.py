"""Where in the text of a TOML file a key stands, for messages."""

from __future__ import annotations

import re


def keys_in_file(location: list[str], text: str) -> list[str]:
    """The leading parts of a location that stand in the text as words."""
    kept: list[str] = []
    for part in location:
        if part.isdigit() or not re.search(rf"(?<![\w-]){re.escape(part)}(?![\w-])", text):
            break
        kept.append(part)
    return kept or location[:1]


def line_of(keys: list[str], text: str) -> int | None:
    """The line where a key, or the inline table it is in, stands, by following the table headers;
    None where it is not found."""
    return _exact_line(keys, text) or (_exact_line(keys[:-1], text) if len(keys) > 2 else None)


def _exact_line(keys: list[str], text: str) -> int | None:
    table: list[str] = []
    fallback = None
    for number, line in enumerate(text.splitlines(), start=1):
        stripped = line.strip()
        header = re.match(r"^\[\s*([^\[\]]+?)\s*\]", stripped)
        if header:
            table = [part.strip().strip("\"'") for part in header.group(1).split(".")]
            if table == keys:
                return number
            if table[: len(keys)] == keys and fallback is None:
                fallback = number
            continue
        assigned = re.match(r"^([\w.\"'-]+)\s*=", stripped)
        if assigned:
            parts = [part.strip("\"'") for part in assigned.group(1).split(".")]
            if table + parts == keys:
                return number
    return fallback
