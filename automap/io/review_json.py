"""``review.json``: the actions of a review, appended one by one and never lost.

The file is only ever replaced by itself with one action more, in one step, while a lock on a
file beside it keeps other processes and threads from doing the same.
"""

from __future__ import annotations

import math
import os
import typing
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

from automap.errors import InputError
from automap.io.atomic import write_failure, write_json
from automap.io.json_text import parse_json
from automap.records import ReviewAction, ReviewKind

SCHEMA = "automap.review/1"
_LOCK = ".review.lock"
_KINDS = typing.get_args(ReviewKind)
_NUMBERS = ("seen_lon_deg", "seen_lat_deg", "lon_deg", "lat_deg", "sd_m")
_TEXTS = ("id", "time", "sign", "seen_class", "class_name", "note", "undoes")


def read_review(path: Path) -> list[ReviewAction]:
    """The actions in their order; none when there is no file.

    Raises InputError when the file is damaged or is no review.
    """
    try:
        content = parse_json(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return []
    except (OSError, ValueError) as error:
        raise InputError(
            f"{path} cannot be read as a review ({error}); correct it, or move it away to go on "
            "without it."
        ) from error
    actions = content.get("actions") if isinstance(content, dict) else None
    if not isinstance(actions, list) or content.get("schema") != SCHEMA:
        raise InputError(f"{path} is no review ({SCHEMA}); move it away to go on without it.")
    read = []
    for number, value in enumerate(actions, start=1):
        try:
            read.append(action_of(value))
        except (TypeError, ValueError, KeyError) as error:
            raise InputError(
                f"{path}, action {number}: {error}; correct it, or move the file away."
            ) from error
    return read


def append_action(path: Path, action: ReviewAction) -> int:
    """Add one action to the file, durably; returns how many it has then.

    Raises InputError for a damaged file, which stays as it is, and StageError when it cannot
    be written.
    """
    with _locked(path.with_name(_LOCK)):
        actions = [*read_review(path), action]
        write_json(path, {"schema": SCHEMA, "actions": [_plain(a) for a in actions]})
    return len(actions)


def action_of(value: Any) -> ReviewAction:
    """An action from JSON's types; ValueError says what is wrong with it."""
    if not isinstance(value, dict):
        raise ValueError("it is no object")
    unknown = sorted(set(value) - set(ReviewAction.__dataclass_fields__))
    if unknown:
        raise ValueError(f"it has an unknown key {unknown[0]!r}")
    if value.get("kind") not in _KINDS:
        raise ValueError(f"its kind is none of {', '.join(_KINDS)}")
    fields: dict[str, Any] = {"kind": value["kind"]}
    for name in _TEXTS:
        text = value.get(name)
        if text is not None and not isinstance(text, str):
            raise ValueError(f"its {name} is no text")
        if text is not None:
            fields[name] = text
    for name in _NUMBERS:
        number = value.get(name)
        if number is None:
            continue
        if isinstance(number, bool) or not isinstance(number, int | float):
            raise ValueError(f"its {name} is no number")
        if not math.isfinite(number):
            raise ValueError(f"its {name} is not finite")
        fields[name] = float(number)
    for name in ("id", "time", "sign"):
        if not fields.get(name):
            raise ValueError(f"it has no {name}")
    for name, limit in (("lon_deg", 180.0), ("lat_deg", 90.0)):
        if abs(fields.get(name, 0.0)) > limit:
            raise ValueError(f"its {name} is beyond {limit:.0f} degrees")
    if not 0.0 <= fields.get("sd_m", 0.0) <= 1000.0:
        raise ValueError("its sd_m is not between 0 and 1000 m")
    return ReviewAction(**fields)


def _plain(action: ReviewAction) -> dict[str, Any]:
    values = asdict(action)
    return {
        name: value
        for name, value in values.items()
        if value is not None and not (isinstance(value, float) and math.isnan(value))
    }


@contextmanager
def _locked(path: Path) -> Iterator[None]:
    """Wait until nobody else writes the review; the kernel's lock ends with its holder."""
    try:
        handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
    except OSError as error:
        raise write_failure(path, error) from error
    try:
        # a system or file system without locks is used without one
        with suppress(ImportError, OSError):
            import fcntl

            fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)
