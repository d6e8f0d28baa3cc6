"""What the filter's measurements are called on the page."""

from __future__ import annotations

import re
from collections.abc import Iterable

_WORDS = {
    "position": "GPS position",
    "velocity": "GPS velocity",
    "zupt": "Standstill, velocity",
    "zaru": "Standstill, turn rate",
}
_AXES = {"n": "north", "e": "east", "d": "down", "x": "x", "y": "y", "z": "z"}
_WHOLE = {
    "nhc_y": "No sideways motion",
    "nhc_z": "No motion through the road",
    "odometer": "Wheel speed",
}


def channel_name(channel: str) -> str:
    """A channel's name in words; its own name where it is none that is known."""
    if channel in _WHOLE:
        return _WHOLE[channel]
    parts = re.fullmatch(r"([a-z]+)_([nedxyz])", channel)
    if parts and parts[1] in _WORDS:
        return f"{_WORDS[parts[1]]} {_AXES[parts[2]]}"
    return channel


def channel_list(channels: Iterable[str]) -> str:
    """Several channels in words, those of one kind together with their axes."""
    axes: dict[str, list[str]] = {}
    for channel in channels:
        kind, _, axis = channel.rpartition("_")
        known = channel not in _WHOLE and kind in _WORDS and axis in _AXES
        words = _WORDS[kind] if known else channel_name(channel)
        axes.setdefault(words, []).extend([_AXES[axis]] if known else [])
    listed = [
        words[0].lower() + words[1:] + (f" ({', '.join(each)})" if each else "")
        for words, each in axes.items()
    ]
    return "; ".join(listed)


def is_rule(channel: str) -> bool:
    """Whether a channel is no reading but a rule of how cars move, kept loose on purpose."""
    return channel.partition("_")[0] in ("nhc", "zupt", "zaru")


def channel_order(channel: str) -> tuple[int, str]:
    """For sorting: what was measured before what was assumed, north before east before down."""
    kinds = ("position", "velocity", "zupt", "zaru", "nhc")
    kind, _, axis = channel.partition("_")
    place = kinds.index(kind) if kind in kinds else len(kinds)
    return place, kind + "".join(str("nedxyz".find(c)) for c in axis)
