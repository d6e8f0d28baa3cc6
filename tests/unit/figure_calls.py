"""Calls of kernels as Python, with figures of all that they leave behind."""

from __future__ import annotations

from collections.abc import Callable
from types import FunctionType
from typing import Any

import numpy as np


def plain(kernel: Any, made: dict[Any, Any] | None = None) -> Callable[..., Any]:
    """A kernel as the Python that it is written in, with all that it calls: for no test of some
    numbers anything is compiled."""
    made = {} if made is None else made
    function = getattr(kernel, "py_func", kernel)
    if function not in made:
        scope: dict[str, Any] = {}
        made[function] = FunctionType(function.__code__, scope, function.__name__)
        for name, value in function.__globals__.items():
            compiled = hasattr(value, "py_func")
            scope[name] = plain(value, made) if compiled else value
    told: Callable[..., Any] = made[function]
    return told


def levelled(array: np.ndarray) -> dict[str, np.ndarray]:
    """An array of numbers of all sizes: with its own, and such that a small one counts as well."""
    return {"own": array, "each": np.arcsinh(1e6 * array)}


def after(kernel: Any, *values: Any) -> dict[str, Any]:
    """What a kernel returns, and by how much it changed which arrays; ``values`` stay."""
    own = [np.array(v) if isinstance(v, np.ndarray) else v for v in values]
    told = plain(kernel)(*own)
    found: dict[str, Any] = {} if told is None else {"told": told}
    for k, (new, old) in enumerate(zip(own, values, strict=True)):
        if isinstance(new, np.ndarray) and not np.array_equal(new, old, equal_nan=True):
            found[str(k)] = levelled(np.where(np.isfinite(old), new - old, new))
    return found
