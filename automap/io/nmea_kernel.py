"""The loop that reads the fields of sentences; see :mod:`automap.io.nmea`."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from automap.io.kernel import Kernel
from automap.io.scan_kernel import Bytes
from automap.records import FloatArray, IntArray

SKIP, NUMBER, TIME, ANGLE, SIDE, TEXT, HEX = range(7)

MAX_DIGITS = 18
"""Digits of a number that are read; more would not fit an int64."""

POWERS = np.asarray([10**k for k in range(MAX_DIGITS + 1)], np.int64)


@Kernel
def _long_number(data: Bytes, start: int, end: int) -> float:
    """Size of the decimal number in a field, of which only 18 digits count."""
    mantissa = 0
    digits = 0
    exponent = 0
    point = False
    for j in range(start, end):
        c = data[j]
        if c == 46:
            point = True
        elif c != 45:
            if digits < MAX_DIGITS:
                mantissa = mantissa * 10 + (c - 48)
                digits += 1
                if point:
                    exponent -= 1
            elif not point:
                exponent += 1
    value = float(mantissa)
    if exponent < 0:
        value /= 10.0**-exponent
    if exponent > 200:
        # no receiver means a number of so many digits, and it may be none that a float holds
        return np.nan
    if exponent > 0:
        value *= 10.0**exponent
    return value


@Kernel
def _hex_number(data: Bytes, start: int, end: int) -> float:
    """Value of up to eight hexadecimal digits, NaN when there is another character."""
    code = 0
    for j in range(start, min(end, start + 8)):
        c = data[j]
        if 48 <= c <= 57:
            code = code * 16 + (c - 48)
        elif 65 <= c <= 70:
            code = code * 16 + (c - 55)
        elif 97 <= c <= 102:
            code = code * 16 + (c - 87)
        else:
            return np.nan
    return float(code)


@Kernel
def decode_kernel(
    data: Bytes,
    offset: IntArray,
    ops: npt.NDArray[np.int8],
    columns: IntArray,
    missing: FloatArray,
    powers: IntArray,
    out: FloatArray,
    n_fields: npt.NDArray[np.int32],
) -> None:
    """Split each sentence at its commas and read field k as ``ops[k]`` into ``out[columns[k]]``.

    ``offset`` [m] are sentences that the scan found: each has a star or a line end, which
    stops every loop here. A field that is absent or cannot be read gives ``missing[k]``; all
    of ``out`` [c, m] is written. ``n_fields`` [m] counts the fields that the sentence has
    after its address. A number is read as an integer of up to 18 digits and a power of ten;
    their quotient is the nearest float64 up to 15 digits, as every receiver's number has.
    """
    n_ops = len(ops)
    for row in range(len(offset)):
        i = offset[row]
        while data[i] != 44:
            i += 1
        k = 0
        c = data[i]
        while c == 44:
            i += 1
            start = i
            c = data[i]
            op = ops[k] if k < n_ops else SKIP
            value = missing[k] if k < n_ops else 0.0
            if op in (NUMBER, TIME, ANGLE):
                negative = c == 45
                if negative:
                    i += 1
                first = i
                mantissa = 0
                digit = data[i] - 48
                while 0 <= digit <= 9:
                    mantissa = mantissa * 10 + digit
                    i += 1
                    digit = data[i] - 48
                whole = mantissa
                digits = i - first
                decimals = 0
                if digit == -2:
                    i += 1
                    first = i
                    digit = data[i] - 48
                    while 0 <= digit <= 9:
                        mantissa = mantissa * 10 + digit
                        i += 1
                        digit = data[i] - 48
                    decimals = i - first
                    digits += decimals
                c = data[i]
                if c != 44 and c != 42 and c != 13 and c != 10:
                    pass
                elif digits > MAX_DIGITS:
                    if op == NUMBER:
                        value = _long_number(data, start, i)
                        value = -value if negative else value
                elif digits > 0:
                    scale = powers[decimals]
                    if op == NUMBER:
                        value = float(mantissa)
                        if decimals > 0:
                            value /= float(scale)
                        if negative:
                            value = -value
                    elif op == TIME:
                        hours = whole // 10000
                        minutes = whole // 100 - hours * 100
                        rest = mantissa - (hours * 10000 + minutes * 100) * scale
                        seconds = float(rest) / float(scale)
                        if (
                            digits >= 6
                            and hours < 24
                            and minutes < 60
                            and seconds < 61.0
                            and not negative
                        ):
                            value = float(hours * 3600 + minutes * 60) + seconds
                    elif digits - decimals >= 3 and decimals <= 13 and not negative:
                        degrees = whole // 100
                        minute = float(mantissa - degrees * 100 * scale) / float(scale)
                        if degrees <= 180 and minute < 60.0:
                            value = float(degrees) + minute / 60.0
            while c != 44 and c != 42 and c != 13 and c != 10:
                i += 1
                c = data[i]
            if op == TEXT:
                packed = 0
                for j in range(start, min(i, start + 6)):
                    packed = packed * 256 + data[j]
                value = float(packed)
            elif op == HEX and i > start:
                value = _hex_number(data, start, i)
            elif op == SIDE and i > start:
                side = data[start]
                value = out[columns[k], row]
                if side == 83 or side == 87:
                    value = -value
                elif side != 78 and side != 69:
                    value = np.nan
            if op != SKIP and (op != SIDE or i > start):
                out[columns[k], row] = value
            k += 1
        n_fields[row] = k
        while k < n_ops:
            if ops[k] != SKIP and ops[k] != SIDE:
                out[columns[k], row] = missing[k]
            k += 1
