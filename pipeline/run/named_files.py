"""Files that settings name, told by what is in them: on another machine they lie elsewhere."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any


def without_folders(values: Any, files: Sequence[Path]) -> Any:
    """Values of settings in which a text that is the path of one of ``files`` is its name alone;
    what the file holds is told beside them."""
    if isinstance(values, dict):
        return {key: without_folders(value, files) for key, value in values.items()}
    if isinstance(values, list):
        return [without_folders(value, files) for value in values]
    if isinstance(values, str) and values:
        path = Path(values)
        return path.name if path in files or path.expanduser() in files else values
    return values


def names_of(files: Iterable[Path], folder: Path) -> dict[str, Path]:
    """Files by their names in ``folder``; those elsewhere by their last part, numbered in their
    order where several have the same."""
    named: dict[str, Path] = {}
    for path in dict.fromkeys(files):
        inside = path.is_relative_to(folder)
        first = str(path.relative_to(folder)) if inside else path.name
        name, count = first, 1
        while name in named:
            count += 1
            name = f"{first} ({count})"
        named[name] = path
    return named
