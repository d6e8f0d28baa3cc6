"""How videos turn against the path: ``camera_turns.json``, by camera."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from automap.errors import InputError
from automap.io.atomic import write_json
from automap.io.json_text import parse_json
from automap.records import PictureTurns


def write_camera_turns(path: Path, turns: Mapping[str, PictureTurns]) -> None:
    """Write what the bends of each camera's video said."""
    write_json(path, {name: asdict(one) for name, one in turns.items()})


def read_camera_turns(path: Path) -> dict[str, PictureTurns]:
    """The same by camera; InputError where the file is damaged."""
    try:
        content = parse_json(path.read_bytes())
        return {str(name): _turns(one) for name, one in content.items()}
    except (OSError, ValueError, TypeError, KeyError, AttributeError, OverflowError):
        raise InputError(f"{path} is damaged; run the stage detect again") from None


def _turns(one: Mapping[str, Any]) -> PictureTurns:
    numbers = {k: float(one[k]) for k in ("offset_s", "offset_sd_s", "rate")}
    bends, at_ns, unlike = (int(one[k]) for k in ("bends", "at_ns", "unlike"))
    pictures, allowed = one["pictures"], one["allowed"]
    if not isinstance(pictures, list) or not isinstance(allowed, bool):
        raise ValueError
    if not all(abs(x) < 1e6 for x in numbers.values()):
        raise ValueError
    told = tuple(map(str, pictures))
    return PictureTurns(bends, at_ns, **numbers, pictures=told, unlike=unlike, allowed=allowed)
