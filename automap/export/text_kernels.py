"""Numbers to decimal digits and rows of text pieces to one text, as compiled loops."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
import numpy.typing as npt

from automap.records import FloatArray, IntArray

Bytes = npt.NDArray[np.uint8]

NUMBER_WIDTH = 32
"""Bytes kept for a number; the longest are 19 digits with sign and point."""

LARGEST = 9.0e15
"""Numbers are written digit by digit while their scaled value is an exact integer."""

_ZERO, _MINUS, _POINT, _PLUS, _E = 48, 45, 46, 43, 101

kernel: Any = numba.njit(cache=True, error_model="numpy", nogil=True)


@kernel
def _put_digits(out: Bytes, at: int, value: int, decimals: int) -> int:
    """Write a non-negative integer, its last ``decimals`` digits behind a point.

    Returns the place behind it.
    """
    # unsigned, because a division by a constant is then a multiplication
    rest = np.uint64(value)
    ten = np.uint64(10)
    count, power = 1, ten
    while count < 19 and rest >= power:
        count += 1
        power *= ten
    count = max(count, decimals + 1)
    end = at + count + (1 if decimals > 0 else 0)
    place = end - 1
    for _ in range(decimals):
        shorter = rest // ten
        out[place] = _ZERO + (rest - shorter * ten)
        rest = shorter
        place -= 1
    if decimals > 0:
        out[place] = _POINT
        place -= 1
    while place >= at:
        shorter = rest // ten
        out[place] = _ZERO + (rest - shorter * ten)
        rest = shorter
        place -= 1
    return end


@kernel
def _put_fixed(out: Bytes, at: int, value: float, scale: float, decimals: int) -> int:
    scaled = np.int64(np.rint(abs(value) * scale))
    if value < 0.0 and scaled > 0:
        out[at] = _MINUS
        at += 1
    return int(_put_digits(out, at, scaled, decimals))


@kernel
def fixed_digits(values: FloatArray, decimals: int, out: Bytes, length: IntArray) -> None:
    """Numbers [n] with a fixed number of decimals, each in its slot of NUMBER_WIDTH bytes.

    ``length`` [n] is set to the bytes used; -1 where the value is not finite, -2 where it is too
    large for this way of writing.
    """
    scale = 10.0**decimals
    for i in range(len(values)):
        value = values[i]
        if not np.isfinite(value):
            length[i] = -1
        elif abs(value) * scale > LARGEST:
            length[i] = -2
        else:
            start = i * NUMBER_WIDTH
            length[i] = _put_fixed(out, start, value, scale, decimals) - start


@kernel
def _put_significant(out: Bytes, at: int, value: float, digits: int) -> int:
    """Like C's ``%.{digits}g``: trailing zeros left out, an exponent where it is shorter."""
    if value < 0.0:
        out[at] = _MINUS
        at += 1
    size = abs(value)
    exponent = int(np.floor(np.log10(size)))
    shift = digits - 1 - exponent
    scaled = np.int64(np.rint(size * 10.0**shift if shift >= 0 else size / 10.0**-shift))
    limit = np.int64(10.0**digits)
    if scaled >= limit:
        scaled //= 10
        exponent += 1
    elif scaled * 10 < limit:
        # the logarithm of a power of ten may come out a step too high
        exponent -= 1
        scaled = np.int64(np.rint(size * 10.0 ** (digits - 1 - exponent)))
    count = digits
    while count > 1 and scaled % 10 == 0:
        scaled //= 10
        count -= 1
    if exponent < -4 or exponent >= digits:
        at = _put_digits(out, at, scaled, count - 1)
        out[at] = _E
        out[at + 1] = _MINUS if exponent < 0 else _PLUS
        if abs(exponent) < 10:
            out[at + 2] = _ZERO
            return int(_put_digits(out, at + 3, abs(exponent), 0))
        return int(_put_digits(out, at + 2, abs(exponent), 0))
    for _ in range(exponent + 1 - count):
        scaled *= 10
    return int(_put_digits(out, at, scaled, max(count - 1 - exponent, 0)))


@kernel
def significant_digits(values: FloatArray, digits: int, out: Bytes, length: IntArray) -> None:
    """Numbers [n] with so many significant digits (at most 9), as ``fixed_digits`` has them."""
    for i in range(len(values)):
        value = values[i]
        start = i * NUMBER_WIDTH
        if not np.isfinite(value):
            length[i] = -1
        elif value == 0.0:
            out[start] = _ZERO
            length[i] = 1
        elif not 1e-200 < abs(value) < 1e200:
            length[i] = -2
        else:
            length[i] = _put_significant(out, start, value, digits) - start


@kernel
def integer_digits(values: IntArray, out: Bytes, length: IntArray) -> None:
    """Integers [n] in decimal; the least int64 has no positive twin and gets length -2."""
    for i in range(len(values)):
        value = values[i]
        start = i * NUMBER_WIDTH
        at = start
        if value == np.iinfo(np.int64).min:
            length[i] = -2
            continue
        if value < 0:
            out[at] = _MINUS
            at += 1
            value = -value
        length[i] = _put_digits(out, at, value, 0) - start


@kernel
def rings_text(rings: FloatArray, decimals: int, out: Bytes, width: int, length: IntArray) -> None:
    """Rings [n, k, 2] of finite coordinates as ``x,y x,y ...``, each in a slot of ``width``."""
    scale = 10.0**decimals
    for i in range(rings.shape[0]):
        start = i * width
        at = start
        for k in range(rings.shape[1]):
            if k > 0:
                out[at] = 32
                at += 1
            at = _put_fixed(out, at, rings[i, k, 0], scale, decimals)
            out[at] = 44
            at = _put_fixed(out, at + 1, rings[i, k, 1], scale, decimals)
        length[i] = at - start


@kernel
def join_rows(data: Bytes, start: IntArray, length: IntArray, out: Bytes) -> None:
    """Copy the pieces [n, k] of ``data`` into ``out``, row by row."""
    at = 0
    for i in range(start.shape[0]):
        for k in range(start.shape[1]):
            first, count = start[i, k], length[i, k]
            for j in range(count):
                out[at + j] = data[first + j]
            at += count
