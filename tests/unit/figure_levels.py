"""Figures that tell a small number beside a large one: sums of both, and of their logarithms."""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

_SMALLEST = 1e-8
"""Of the largest number of an array: what is less counts by its own size."""


def levelled(value: Any) -> Any:
    """A result in which arrays of several units stand twice, as they are and by their sizes."""
    if is_dataclass(value) and not isinstance(value, type):
        return {f.name: levelled(getattr(value, f.name)) for f in fields(value)}
    if isinstance(value, dict):
        return {str(key): levelled(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        if value and all(isinstance(v, int | float | np.number) for v in value):
            return levelled(np.asarray(value))
        return [levelled(each) for each in value]
    if isinstance(value, np.ndarray) and value.dtype.kind == "f" and value.size > 1:
        known = np.abs(value[np.isfinite(value)])
        least = _SMALLEST * float(known.max(initial=0.0)) + 1e-300
        return {"own": value, "each": np.arcsinh(value / least)}
    return value
