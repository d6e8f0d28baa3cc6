"""What a face is seen in a mirror: another crop of a sign, at times of another one."""

from __future__ import annotations

import re
from functools import cache

from automap.signs.classes import load_classes

_PLAIN = ("red-circle", "blue-circle", "red-triangle-up", "yellow-diamond")
"""Groups whose faces show arrows and pictures, no text."""
_SAME = ("regulatory--yield--g1", "regulatory--priority-road--g1")
_NOT_MIRRORED = re.compile("-limit-|no-overtaking|no-parking|steep-|narrows-|--stop")
"""Numbers and letters, and what shows sides of a road without saying so in its name."""


@cache
def mirrored_name(name: str) -> str | None:
    """The class that the mirrored face of a class is; None if it is none, or not known.

    Drivers keep left or right, animals run to either side: a picture means the same in a
    mirror unless its name tells left from right.
    """
    classes = load_classes()
    if name in _SAME:
        return name
    entry = classes.get(name)
    if entry is None or entry.group not in _PLAIN or _NOT_MIRRORED.search(name):
        return None
    if not re.search("left|right", name):
        return name
    swapped = re.sub("left|right", lambda m: "right" if m[0] == "left" else "left", _base(name))
    others = [n for n, e in classes.items() if _base(n) == swapped and e.group == entry.group]
    return others[0] if len(others) == 1 else None


def _base(name: str) -> str:
    return name.rsplit("--", 1)[0]
