"""Values as JSON and TOML have them, read so that anything may be missing or damaged."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from automap.io.json_text import parse_json


def json_object(path: Path) -> dict[str, Any]:
    """The object in a JSON file; empty when the file is missing, damaged or holds none."""
    try:
        return mapping(parse_json(path.read_text(encoding="utf-8")))
    except (FileNotFoundError, NotADirectoryError, IsADirectoryError, ValueError):
        return {}


def mapping(value: Any) -> dict[str, Any]:
    """A table as it is, an empty one in place of anything else."""
    return value if isinstance(value, dict) else {}


def number(value: Any) -> int | float | None:
    """A finite number as it is, None in place of anything else."""
    plain = isinstance(value, int | float) and not isinstance(value, bool)
    return value if plain and abs(value) < float("inf") else None


def listing(value: Any) -> list[Any]:
    """A list as it is, an empty one in place of anything else."""
    return value if isinstance(value, list) else []


def flatten(values: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested tables as one table with dotted keys."""
    flat: dict[str, Any] = {}
    for key, value in values.items():
        if isinstance(value, Mapping):
            flat.update(flatten(value, f"{prefix}{key}."))
        else:
            flat[prefix + key] = value
    return flat
