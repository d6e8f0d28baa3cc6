"""JSON from files that may be damaged."""

from __future__ import annotations

import json
from typing import Any

_LONGEST = 20


def parse_json(text: str | bytes) -> Any:
    """The value of a JSON text; ValueError for any text that is none, however it is damaged."""
    if isinstance(text, str):
        # of editors on Windows; bytes are looked at by the parser itself
        text = text.removeprefix("\ufeff")
    try:
        return json.loads(text, parse_int=_whole)
    except RecursionError:
        raise ValueError("its values are nested too deeply") from None


def _whole(digits: str) -> int:
    """A whole number of 64 bits; ValueError for one that no array could hold."""
    number = int(digits) if len(digits) <= _LONGEST else 1 << 64
    if not -(1 << 63) <= number < 1 << 63:
        raise ValueError(f"a whole number in it has more than 64 bits ({len(digits)} digits)")
    return number
