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
from dataclasses import asdict, fields, replace
from datetime import datetime
from pathlib import Path
from typing import Any

from automap.earth import metres_per_radian
from automap.errors import InputError
from automap.io.atomic import write_failure, write_json
from automap.io.json_text import parse_json
from automap.records import NO_TIME, PlacedSign, ReviewAction, ReviewKind, SeenIn

SCHEMA = "automap.review/2"
"""The second has signs that are added, split and merged, facings, heights and reviewers."""
_READ = ("automap.review/1", SCHEMA)
_LOCK = ".review.lock"
_KINDS = typing.get_args(ReviewKind)
_NUMBERS = (
    *("seen_lon_deg", "seen_lat_deg", "lon_deg", "lat_deg", "sd_m", "facing_deg"),
    *("height_above_road_m", "other_seen_lon_deg", "other_seen_lat_deg"),
)
_TEXTS = (
    *("id", "time", "sign", "seen_class", "class_name", "note", "undoes", "reviewer", "other"),
    "other_seen_class",
)
_MOST_VIEWS = 100_000
"""Of one action: an hour of a camera in view of one sign."""
_LONGEST = 200
"""Characters of a reviewer's name: longer ones are no names."""


_FARTHEST_M = 1000.0
"""How far a correction may move a sign: it is seen from 80 m at most, and a path that is off by
several hundreds of metres is worth no review."""


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
    if not isinstance(actions, list) or content.get("schema") not in _READ:
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
        write_json(path, {"schema": SCHEMA, "actions": [plain_action(a) for a in actions]})
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
    found: dict[str, Any] = {"kind": value["kind"]}
    for name in _TEXTS:
        text = value.get(name)
        if text is not None and not isinstance(text, str):
            raise ValueError(f"its {name} is no text")
        if text is not None:
            found[name] = text
    for name in _NUMBERS:
        number = value.get(name)
        if number is None:
            continue
        if isinstance(number, bool) or not isinstance(number, int | float):
            raise ValueError(f"its {name} is no number")
        if not math.isfinite(number):
            raise ValueError(f"its {name} is not finite")
        found[name] = float(number)
    for name in ("id", "time", "sign"):
        if not found.get(name):
            raise ValueError(f"it has no {name}")
    found |= _nested(value)
    _check(found)
    return ReviewAction(**found)


def _check(found: dict[str, Any]) -> None:
    """ValueError where values are out of their range, or an action lacks what makes it one."""
    for name, limit in (("lon_deg", 180.0), ("lat_deg", 90.0), ("facing_deg", 360.0)):
        if abs(found.get(name, 0.0)) > limit:
            raise ValueError(f"its {name} is beyond {limit:.0f} degrees")
    if not 0.0 < found.get("sd_m", 1.0) <= 1000.0:
        raise ValueError("its sd_m is not more than 0 and at most 1000 m")
    if all(name in found for name in ("lon_deg", "lat_deg", "seen_lon_deg", "seen_lat_deg")):
        lat = math.radians(found["lat_deg"] - found["seen_lat_deg"])
        lon = math.radians(math.remainder(found["lon_deg"] - found["seen_lon_deg"], 360.0))
        north, east = metres_per_radian(math.radians(found["seen_lat_deg"]), 0.0)
        moved_m = math.hypot(north * lat, east * lon)
        if moved_m > _FARTHEST_M:
            raise ValueError(
                f"it moves its sign by {moved_m * 1e-3:.0f} km; its lat_deg and lon_deg may be "
                "swapped"
            )
    try:
        datetime.fromisoformat(found["time"])
    except ValueError:
        raise ValueError(
            f"its time {found['time']!r} is none of ISO 8601, such as 2026-03-14T09:20:00Z"
        ) from None
    if not -20.0 <= found.get("height_above_road_m", 0.0) <= 50.0:
        raise ValueError("its height_above_road_m is not between -20 and 50 m")
    if len(found.get("reviewer", "")) > _LONGEST:
        raise ValueError(f"its reviewer has more than {_LONGEST} characters")
    needed = {"add": ("class_name", "place"), "split": ("other", "place", "other_place", "views"),
              "merge": ("other", "place")}.get(found["kind"], ())  # fmt: skip
    for name in needed:
        if not found.get(name):
            raise ValueError(f"it has no {name}")
    if needed and found.get("other") == found["sign"]:
        raise ValueError("its sign and the other are one")


def _nested(value: dict[str, Any]) -> dict[str, Any]:
    """What of an action is no text and no number."""
    found: dict[str, Any] = {}
    if (settles := value.get("settles")) is not None:
        if not isinstance(settles, bool):
            raise ValueError("its settles is neither true nor false")
        found["settles"] = settles
    for name in ("place", "other_place"):
        if value.get(name) is not None:
            found[name] = _place_of(value[name], name)
    views = value.get("views")
    if views is not None:
        if not isinstance(views, list) or len(views) > _MOST_VIEWS:
            raise ValueError("its views are no list, or far too many")
        found["views"] = tuple(seen_in(view) for view in views)
    return found


def seen_in(value: Any) -> SeenIn:
    """A view from [drive, camera, frame] or that with x and y in pixels; ValueError else."""
    if not isinstance(value, list) or len(value) not in (3, 5):
        raise ValueError("a view is no list of drive, camera, frame, and x and y perhaps")
    drive, camera, frame, *at = value
    if not (isinstance(drive, str) and isinstance(camera, str) and _is_whole(frame)):
        raise ValueError("a view does not name drive, camera and frame")
    if not all(_is_number(v) for v in at):
        raise ValueError("where a view was clicked is no number")
    return SeenIn(drive, camera, frame, *(float(v) for v in at))


def _place_of(value: Any, name: str) -> PlacedSign:
    if not isinstance(value, dict):
        raise ValueError(f"its {name} is no object")
    known = {field.name: field for field in fields(PlacedSign)}
    found: dict[str, Any] = {}
    for key, part in value.items():
        if key not in known:
            raise ValueError(f"its {name} has an unknown key {key!r}")
        if key == "cov_m2":
            told = isinstance(part, list) and len(part) == 4
            if not told or not all(v is None or _is_number(v) for v in part):
                raise ValueError(f"its {name} has no four numbers cov_m2")
            found[key] = tuple(math.nan if v is None else float(v) for v in part)
        elif key == "side":
            if not isinstance(part, str):
                raise ValueError(f"its {name} has a side that is no text")
            found[key] = part
        elif key in ("n_views", "first_seen_ns", "last_seen_ns"):
            if not _is_whole(part):
                raise ValueError(f"its {name} has no whole number {key}")
            found[key] = part
        elif not _is_number(part):
            raise ValueError(f"its {name} has no number {key}")
        else:
            found[key] = float(part)
    for key, limit in (("lon_deg", 180.0), ("lat_deg", 90.0)):
        if abs(found.get(key, math.inf)) > limit:
            raise ValueError(f"its {name} has no {key} within {limit:.0f} degrees")
    if "cov_m2" not in found:
        raise ValueError(f"its {name} has no cov_m2")
    return PlacedSign(**found)


def _is_number(value: Any) -> bool:
    plain = isinstance(value, int | float) and not isinstance(value, bool)
    return plain and math.isfinite(value)


def _is_whole(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and abs(value) < 2**63


def plain_action(action: ReviewAction) -> dict[str, Any]:
    """The action as JSON's types, without what it does not say."""
    values = _told(asdict(replace(action, place=None, other_place=None, views=())))
    for name, place in (("place", action.place), ("other_place", action.other_place)):
        if place is not None:
            told = _told(asdict(place))
            told["cov_m2"] = [None if math.isnan(v) else v for v in place.cov_m2]
            values[name] = told
    if action.views:
        values["views"] = [
            [v.drive, v.camera, v.frame, *([] if math.isnan(v.x_px) else [v.x_px, v.y_px])]
            for v in action.views
        ]
    return values


def _told(values: dict[str, Any]) -> dict[str, Any]:
    """What is said of anything: a zero is a value."""
    return {name: value for name, value in values.items() if not _is_unsaid(name, value)}


def _is_unsaid(name: str, value: Any) -> bool:
    if value is None or value is False or value == ():
        return True
    if isinstance(value, str):
        return not value and name not in ("note", "class_name", "undoes")
    return value == NO_TIME or (isinstance(value, float) and math.isnan(value))


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
