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


def table(records: Any) -> dict[str, Any]:
    """The fields of many records of one kind, each as a column of numbers or of texts."""
    found: dict[str, Any] = {}
    for name in (f.name for f in fields(records[0])) if records else ():
        values = [getattr(record, name) for record in records]
        if all(isinstance(v, bool | int | float | np.number) for v in values):
            found[name] = levelled(np.array(values, np.float64))
        elif all(isinstance(v, np.ndarray) for v in values):
            found[name] = levelled(np.concatenate([v.ravel() for v in values]))
        elif is_dataclass(values[0]):
            found[name] = table(values)
        else:
            found[name] = " ".join(map(str, values))
    return found
