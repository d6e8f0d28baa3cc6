"""Rows of a linear model, and what is summed over them in double precision."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from automap.records import FloatArray, IntArray

STRETCH = 2048
"""Rows that are multiplied together in double precision; bounds the memory."""


@dataclass(frozen=True)
class Rows:
    """Rows of one drive: ``w`` [s] with all effects left out, ``phi`` [s, c], times ``t`` [s] in s,
    ``channel`` [s]; once white, phi' w is a score and phi' phi its information. Each column of phi
    lies in one piece: they are asked for one by one."""

    w: FloatArray
    phi: FloatArray
    t: FloatArray
    channel: IntArray


def moments(rows: Rows) -> tuple[FloatArray, FloatArray]:
    """Score phi' w [c] and information phi' phi [c, c] of white rows in double precision, a stretch
    at a time: the rows themselves are in single."""
    c = rows.phi.shape[1]
    score: FloatArray = np.zeros(c)
    info: FloatArray = np.zeros((c, c))
    for part, used, f in pieces(rows.phi, np.float64):
        score[used] += f.T @ rows.w[part]
        info[np.ix_(used, used)] += f.T @ f
    return score, info


def pieces(
    phi: FloatArray, precision: type[np.float32] | type[np.float64]
) -> Iterator[tuple[slice, IntArray, FloatArray]]:
    """A stretch of rows [s, c] at a time: which, the columns [u] that have something there, and
    these rows of them [r, u] in a precision. A box of time shows nothing before it."""
    for start in range(0, len(phi), STRETCH):
        part = slice(start, start + STRETCH)
        used = np.flatnonzero(phi[part].any(axis=0))
        yield part, used, phi[part, used].astype(precision)


def times(phi: FloatArray, values: FloatArray) -> FloatArray:
    """phi times values [s] in double precision, a stretch at a time, of the columns that count."""
    used = np.flatnonzero(values)
    out = np.zeros(len(phi))
    for start in range(0, len(phi) if len(used) else 0, STRETCH):
        part = phi[start : start + STRETCH]
        if len(used) < len(values):
            part = part[:, used]
        out[start : start + STRETCH] = part.astype(np.float64) @ values[used]
    return out
