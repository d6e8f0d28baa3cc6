"""Numbers to decimal digits and rows of text pieces to one text, as compiled loops."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from numba.core import cgutils, types
from numba.extending import intrinsic

from automap.jit import kernel_with
from automap.records import FloatArray, IntArray

Bytes = npt.NDArray[np.uint8]

NUMBER_WIDTH = 32
"""Bytes kept for a number; the longest are 19 digits with sign and point."""

LARGEST = 9.0e15
"""Numbers are written digit by digit while their scaled value is an exact integer."""

_ZERO, _MINUS, _POINT, _PLUS, _E = 48, 45, 46, 43, 101

kernel: Any = kernel_with(nogil=True)


@kernel
def _digit_count(value: int) -> int:
    count, power = 1, np.uint64(10)
    while count < 19 and value >= power:
        count += 1
        power *= np.uint64(10)
    return count


@kernel
def _put_back(out: Bytes, place: int, value: int, count: int) -> None:
    """The last ``count`` digits of an unsigned 32-bit value, from ``place`` to the left.

    Unsigned and of 32 bits, because a division by a constant is then one multiplication.
    """
    rest = np.uint32(value)
    ten = np.uint32(10)
    for k in range(count):
        shorter = np.uint32(rest // ten)
        out[place - k] = _ZERO + np.uint8(rest - shorter * ten)
        rest = shorter


@kernel
def _put_digits(out: Bytes, at: int, value: int, decimals: int) -> int:
    """Write a non-negative integer, its last ``decimals`` digits behind a point.

    Returns the place behind it.
    """
    rest = np.uint64(value)
    count = max(_digit_count(rest), decimals + 1)
    end: int = at + count + (1 if decimals > 0 else 0)
    if rest < np.uint64(1 << 32):
        if decimals > 0:
            unit = np.uint32(1)
            for _ in range(decimals):
                unit *= np.uint32(10)
            low = np.uint32(rest)
            whole = np.uint32(low // unit)
            _put_back(out, end - 1, low - whole * unit, decimals)
            out[end - 1 - decimals] = _POINT
            _put_back(out, end - 2 - decimals, whole, count - decimals)
        else:
            _put_back(out, end - 1, rest, count)
        return end
    ten = np.uint64(10)
    for k in range(end - at):
        if k == decimals and decimals > 0:
            out[end - 1 - k] = _POINT
            continue
        shorter = rest // ten
        out[end - 1 - k] = _ZERO + (rest - shorter * ten)
        rest = shorter
    return end


@kernel
def _rounded_product(value: float, scale: float) -> int:
    """The integer next to the exact product of two positive numbers, the even one of two.

    A product is rounded to 53 bits, which can take it to a half or beyond. Where it lies so near to
    one, what the rounding left out decides (T. J. Dekker, Numerische Mathematik 18, 1971).
    """
    product = value * scale
    nearest = np.rint(product)
    # what the rounding left out is half a unit in the last place, at most
    if abs(abs(product - nearest) - 0.5) > product * 2.0**-52:
        return int(nearest)
    split = 134217729.0  # 2^27 + 1
    high, other = split * value, split * scale
    high, other = high - (high - value), other - (other - scale)
    low, rest = value - high, scale - other
    left = ((high * other - product) + high * rest + low * other) + low * rest
    whole = np.floor(product)
    part = (product - whole) - 0.5
    beyond = part + left
    if beyond > 0.0 or (beyond == 0.0 and whole % 2.0 == 1.0):
        return int(whole) + 1
    return int(whole)


@kernel
def _put_fixed(out: Bytes, at: int, value: float, scale: float, decimals: int) -> int:
    scaled = _rounded_product(abs(value), scale)
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


copying: Any = intrinsic
memcpy: Any = cgutils.raw_memcpy


@copying
def _copy_memory(typingctx: Any, target: Any, source: Any, count: Any) -> Any:
    """memcpy by address: a loop over bytes would take most of the time of writing a map."""
    signature = types.void(types.intp, types.intp, types.intp)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        pointer = context.get_value_type(types.voidptr)
        to, origin, size = arguments
        memcpy(builder, builder.inttoptr(to, pointer), builder.inttoptr(origin, pointer), size, 1)
        return context.get_dummy_value()

    return signature, generate


@kernel
def join_rows(address: IntArray, length: IntArray, rows: int, out: Bytes) -> None:
    """Copy the pieces [k, n] at these addresses into ``out``, row by row for the first rows.

    ``out`` must have room for all of them.
    """
    at = out.ctypes.data
    for i in range(rows):
        for k in range(address.shape[0]):
            count = length[k, i]
            if count > 0:
                _copy_memory(at, address[k, i], count)
                at += count
