"""Limits that a result must keep, as ``position_rms_m.horizontal<1.25``."""

from __future__ import annotations

import difflib
import math
import operator
import re
from collections.abc import Mapping, Sequence
from typing import Any

from automap.errors import ConfigError
from pipeline.shared.values import flatten

_OPERATORS = {
    "<=": operator.le,
    ">=": operator.ge,
    "<": operator.lt,
    ">": operator.gt,
}
_PATTERN = re.compile(r"\s*([\w.\-]+)\s*(<=|>=|<|>)\s*(\S+)\s*")


def check_requirements(result: Mapping[str, Any], requirements: Sequence[str]) -> list[str]:
    """One sentence for every requirement that ``result`` does not meet.

    A requirement is KEY<VALUE with a dotted key and one of < <= > >=. A figure that could
    not be computed (null) does not meet it. Raises ConfigError for a malformed requirement
    or an unknown key.
    """
    leaves = flatten(result)
    failures = []
    for text in requirements:
        parts = _PATTERN.fullmatch(text)
        try:
            if parts is None:
                raise ValueError(text)
            key, symbol, limit = parts[1], parts[2], float(parts[3])
            if math.isnan(limit):
                raise ValueError(text)
        except ValueError as error:
            raise ConfigError(
                f"The requirement '{text}' is not understood; write KEY<VALUE with one of "
                "< <= > >=, for example position_rms_m.horizontal<1.25."
            ) from error
        if key not in leaves:
            near = difflib.get_close_matches(key, leaves, n=1, cutoff=0.0)
            hint = f"; the nearest known key is {near[0]}" if near else ""
            raise ConfigError(f"The requirement '{text}' names no figure of the result{hint}.")
        value = leaves[key]
        if isinstance(value, bool) or not isinstance(value, int | float):
            if value is None:
                failures.append(f"{key} is not known, required {symbol} {limit:g}.")
                continue
            raise ConfigError(f"The requirement '{text}' names {key}, which is not a number.")
        if not _OPERATORS[symbol](value, limit):
            failures.append(f"{key} is {value:.6g}, required {symbol} {limit:g}.")
    return failures
