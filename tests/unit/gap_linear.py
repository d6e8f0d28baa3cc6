"""Linear models for the tests of the search: made by hand, or of a fit and effects by name."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from automap.fusion.layout import CH_ZUPT
from automap.gap.candidates import candidates_of
from automap.gap.columns import named_columns
from automap.gap.fit import Fit, whitened_innovations
from automap.gap.linear import Column, Linear
from automap.gap.nodes import motions_of
from automap.gap.rows import Rows
from automap.gap.selection import Selection
from automap.gap.sensitivity import linearised
from automap.records import BoolArray, FloatArray

STEP_S = 0.1
PRIOR_SD = 0.5


def linear_of(
    phi: FloatArray, w: FloatArray, layout: Sequence[Column], step_s: float = STEP_S
) -> Linear:
    """A drive of white rows [s] with columns [s, c]."""
    n = len(w)
    rows = Rows(w, phi, np.arange(n, dtype=np.float64) * step_s, np.zeros(n, np.int64))
    sds = np.array([c.prior_sd for c in layout])
    return Linear(tuple(layout), (rows,), None, phi.T @ w, phi.T @ phi, sds, np.zeros(phi.shape[1]))


def columns_named(*names: str) -> list[Column]:
    """Columns of effects that are written as effect.parameter."""
    return [Column(*_halves(name), PRIOR_SD) for name in names]


def _halves(name: str) -> tuple[str, str]:
    effect, _, parameter = name.partition(".")
    return effect, parameter


def screened(fit: Fit, effects: Sequence[str]) -> Selection:
    """A fit made linear in effects by name, and these as candidates."""
    linear = linearised(motions_of([fit]), lambda at: named_columns(effects, at), {})
    return Selection(linear, {c.name: c for c in candidates_of(linear.layout, effects)})


def changes(before: Fit, after: Fit) -> tuple[FloatArray, BoolArray]:
    """By how much the innovations of receiver and vehicle constraint differ between two fits of a
    drive [k], and which scalars of the first [s] that is: not what only one of them gated out."""
    scalars = [[tuple(row) for row in f.last.forward.store.info[:, :2]] for f in (before, after)]
    common = set(scalars[0]) & set(scalars[1])
    sides = []
    for fit, rows in zip((before, after), scalars, strict=True):
        whitened, _, channel = whitened_innovations(fit)
        inside = np.array([row in common for row in rows]) & (channel < CH_ZUPT)
        sides.append((whitened, inside))
    (first, at), (second, there) = sides
    return first[at] - second[there], at
