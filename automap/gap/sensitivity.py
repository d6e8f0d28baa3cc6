"""How every candidate would show in the innovations of a fit.

A candidate's columns say how it acts, on the readings of an axis or on measurements themselves;
the filter's own gains turn that into what its innovations would show of a unit of each. Effects
that the fit has already count from zero again: what their values explain is given back.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import islice

import numpy as np

from automap.gap.fit import Fit, whitened_innovations
from automap.gap.kernels import propagate_columns
from automap.gap.lean import LEANS, leaning
from automap.gap.linear import Column, Linear
from automap.gap.motion import Motion
from automap.gap.nodes import NodeMotion
from automap.gap.rows import Rows, moments, times
from automap.gap.whitening import whitened_rows
from automap.records import BoolArray, FloatArray, IntArray

BATCH = 96
"""Columns carried through the filter together: their rows stay in the processor's cache."""
ColumnsOf = Callable[[NodeMotion], Iterable[Column]]


def linearised(
    along: Sequence[NodeMotion],
    columns_of: ColumnsOf,
    values: Mapping[str, Mapping[str, float]],
    may_act: bool = True,
) -> Linear:
    """Fits ``along`` whose motion to ask, with effects held at ``values``, made linear in all
    columns, of which more than those ``may_act``."""
    layout: list[Column] = []
    place: dict[tuple[str, str], int] = {}
    raw: list[Rows] = []
    used: list[list[int]] = []
    lasts = [at.fit.last for at in along]
    for at in along:
        rows_of_drive, columns = _raw(at, columns_of)
        raw.append(rows_of_drive)
        for column in columns:
            key = (column.effect, column.parameter)
            if key not in place:
                place[key] = len(layout)
                layout.append(column)
        used.append([place[(c.effect, c.parameter)] for c in columns])
    # a motion is as long as the drive
    del along, at
    known = np.array([values.get(c.effect, {}).get(c.parameter, 0.0) for c in layout])
    sds = np.array([c.prior_sd for c in layout])
    raw = [_laid_out(r, own, known) for r, own in zip(raw, used, strict=True)]
    rows = whitened_rows(raw, known, sds, may_act)
    del raw
    score, info = (sum(each) for each in zip(*map(moments, rows), strict=True))
    if LEANS in place:
        row = place[LEANS]
        for lean, var in map(leaning, lasts):
            score[row] += lean / var
            info[row, row] += 1.0 / var
    return Linear(tuple(layout), rows, None, score, info, sds, known)


def _raw(at: NodeMotion, columns_of: ColumnsOf) -> tuple[Rows, list[Column]]:
    """Innovations over their sds with their sensitivities to the columns of one drive, and these
    as a layout has them."""
    whitened, t, channel = whitened_innovations(at.fit)
    columns = iter(columns_of(at))
    layout: list[Column] = []
    parts: list[FloatArray] = []
    # how a column acts is as long as the drive, and forgotten with its batch
    while batch := list(islice(columns, BATCH)):
        parts.append(sensitivities(at.fit, at.motion, batch).astype(np.float32))
        layout += [column.in_layout() for column in batch]
    phi: FloatArray = np.zeros((len(whitened), len(layout)), np.float32, "F")
    while parts:
        part = parts.pop()
        start = BATCH * len(parts)
        phi[:, start : start + BATCH] = part
    return Rows(whitened, phi, t, channel), layout


def _laid_out(rows: Rows, at: Sequence[int], known: FloatArray) -> Rows:
    """Rows whose columns stand where a layout has them, ``at``, with all effects left out."""
    phi = rows.phi
    if list(at) != list(range(len(known))):
        phi = np.zeros((len(phi), len(known)), np.float32, "F")
        phi[:, at] = rows.phi
    return replace(rows, w=rows.w + times(phi, known), phi=phi)


def sensitivities(fit: Fit, motion: Motion, columns: Sequence[Column]) -> FloatArray:
    """Whitened sensitivity [s, c] of the fit's scalars to the columns' parameters."""
    inertial = [i for i, c in enumerate(columns) if c.direct is None]
    direct = [i for i, c in enumerate(columns) if c.direct is not None]
    order = inertial + direct
    signals: list[FloatArray | BoolArray] = []
    index: dict[int, int] = {}
    terms: list[tuple[int, int, int, int, int]] = []
    for place, i in enumerate(order):
        for part in columns[i].inertial:
            for signal in (part.signal, part.times):
                if signal is not None and id(signal) not in index:
                    index[id(signal)] = len(signals)
                    signals.append(signal)
            factor = -1 if part.times is None else index[id(part.times)]
            terms.append((place, part.sensor, part.axis, index[id(part.signal)], factor))
    last = fit.last
    store = last.forward.store
    total = len(store.nu)
    node, channel = store.info[:, 0], store.info[:, 1]
    acting = np.zeros((total, len(direct)))
    for place, i in enumerate(direct):
        acts = columns[i].direct
        assert acts is not None
        acting[:, place] = acts.by_channel[node, channel]
    n = len(motion.t)
    table: IntArray = np.array(terms, dtype=np.int64).reshape(-1, 5)
    out = np.zeros((total, len(order)))
    propagate_columns(
        motion.t,
        motion.force,
        np.ascontiguousarray(motion.dcm),
        np.ascontiguousarray(np.stack(signals, axis=1, dtype=np.float64))
        if signals
        else np.zeros((n, 1)),
        table,
        last.nodes.t,
        store.trans,
        last.problem.model.tau,
        last.nodes.lasting_keep,
        last.problem.model.kept,
        store.scalars,
        store.h,
        store.gain,
        store.var,
        acting,
        out,
    )
    back = np.empty(len(order), dtype=np.int64)
    back[order] = np.arange(len(order))
    return np.asarray(out[:, back])
