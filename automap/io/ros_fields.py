"""Fields of ROS messages by their paths, such as ``imu.angular_velocity.x``.

A path's parts are names of fields; those of an array are its numbers, counted from 0.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from automap.errors import InputError

_LONGEST_ARRAY = 9
"""Arrays that may be a vector or a covariance; longer ones are pictures and scans."""


def leaves(message: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Every number and text of a message with its path; a time is one, as nanoseconds.

    The header and what ROS keeps of the type itself are left out.
    """
    for name, value in vars(message).items():
        if name.startswith("__") or name == "header":
            continue
        yield from _below(value, f"{path}.{name}" if path else name)


def _below(value: Any, path: str) -> Iterator[tuple[str, Any]]:
    if _is_time(value):
        yield path, nanoseconds(value)
    elif isinstance(value, bool | int | float | str | np.generic):
        yield path, value
    elif isinstance(value, np.ndarray | list):
        if 0 < len(value) <= _LONGEST_ARRAY:
            for at, item in enumerate(value):
                yield from _below(item, f"{path}.{at}")
    elif hasattr(value, "__msgtype__"):
        yield from leaves(value, path)


def value_at(message: Any, path: str, topic: str) -> Any:
    """The value of a path; InputError names the fields there are where it leads nowhere."""
    value = message
    for part in path.split("."):
        try:
            value = value[int(part)] if part.isdigit() else getattr(value, part)
        except (AttributeError, IndexError, TypeError):
            there = ", ".join(name for name, _ in leaves(message))
            raise InputError(f"{topic} has no field {path}; it has: {there}.") from None
    return value


def vector_parts(value: Any) -> tuple[str, str, str] | None:
    """What to append to the path of a vector for its three numbers, None for no vector."""
    if isinstance(value, np.ndarray | list) and len(value) == 3:
        return ".0", ".1", ".2"
    return (".x", ".y", ".z") if all(hasattr(value, axis) for axis in "xyz") else None


def _is_time(value: Any) -> bool:
    return hasattr(value, "sec") and hasattr(value, "nanosec")


def nanoseconds(value: Any) -> int:
    """Nanoseconds of a ROS time."""
    return int(value.sec) * 10**9 + int(value.nanosec)
