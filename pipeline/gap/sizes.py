"""Numbers as a person reads them: digits by their standard deviation, angles in degrees."""

from __future__ import annotations

import math

MOST_DIGITS = 6


def with_sd(value: float, sd: float, unit: str) -> tuple[str, str]:
    """A size and its standard deviation as texts, with the digits that the latter justifies."""
    digits = _digits(sd if math.isfinite(sd) and sd > 0.0 else 1e-3 * abs(value))
    return _text(abs(value), digits, unit), _text(abs(sd), digits, unit)


def about(value: float, unit: str, least: float) -> str:
    """A size to two digits; below ``least``, which is of the same unit, only that it is."""
    size = abs(value)
    if size < least:
        return f"less than {least:g} {unit}"
    digits = min(max(0, 1 - math.floor(math.log10(size))), MOST_DIGITS)
    return _text(size, digits, unit)


def _digits(sd: float) -> int:
    """Digits after the point: one of the sd's, two where that begins with a one."""
    if sd <= 0.0:
        return 3
    power = math.floor(math.log10(sd))
    one = sd / 10.0**power < 1.95
    return min(max(0, -power + (1 if one else 0)), MOST_DIGITS)


def _text(size: float, digits: int, unit: str) -> str:
    text = f"{size:.{digits}f}"
    if unit in ("%", "°"):
        return text + (" " if unit == "%" else "") + unit
    return f"{text} {unit}".rstrip()
