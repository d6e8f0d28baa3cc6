"""Formulas of several terms, built one term at a time from the dictionary.

An effect of a triad or of a whole receiver acts on several channels at once. Which terms those are
is chosen by forward selection with the joint evidence of all coefficients, then terms that the
others have made unnecessary are dropped (as in sparse regression, Miller 2002, *Subset Selection
in Regression*, chapter 3). Every term pays for having been chosen among all of the dictionary.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from automap.gap.columns import Column, node_motion, sensitivities
from automap.gap.dictionary import formula_columns, inertial_columns
from automap.gap.evidence import (
    PRIOR_SCALES,
    Evidence,
    Scores,
    evidence,
    null_maxima,
    p_value,
)
from automap.gap.fit import Fit, motion_of
from automap.gap.formula import NULL_DRAWS, Formula, Term
from automap.gap.screening import whitened_innovations
from automap.gap.whitening import WhiteRows, fit_whitener, white_rows
from automap.records import BoolArray, FloatArray, IntArray

MOST_TERMS = 6
SLOW = re.compile(r"(?!.*\b(speed|step)\b).*\b(time|temperature)\b")
"""Formulas of time or temperature alone, without steps."""
TERM_NATS = 8.0
"""A further term must bring the logarithm of the dictionary's length, 6, and be likely itself."""


@dataclass(frozen=True)
class _Table:
    """White rows of all drives, ``columns`` of each, ``count`` of them; prior sds [c]."""

    rows: tuple[WhiteRows, ...]
    columns: tuple[tuple[Column, ...], ...]
    count: int
    prior_sd: FloatArray


def composite_for(fits: Sequence[Fit], exclude: Collection[str]) -> Formula | None:
    """The formula that explains most of what fits leave, None where not even one term is likely.

    Terms on the fixes and such on the sensors are not mixed.
    """
    table = _table(fits, exclude)
    if table.count == 0:
        return None
    sums = _sums(table)
    chosen = _backward(sums, table, _forward(sums, table))
    return _formula(table, sums, chosen) if chosen else None


def slow_formulas(
    fits: Sequence[Fit],
    exclude: Collection[str],
    sensors: Collection[str],
    steps: Collection[tuple[str, str]] = (),
) -> dict[str, tuple[list[Formula], list[Formula]]]:
    """Of each sensor ("accel", "gyro") one formula of its ``steps`` (channel and text), where there
    are any, and those of one slow quantity on all of its axes, the likeliest first. A quantity
    pays for having been chosen once."""
    table = _table(fits, exclude, steps)
    sums = _sums(table)
    out = {}
    for sensor in sensors:
        axes = {f"{sensor}_{axis}" for axis in "xyz"}
        places: dict[str, list[int]] = {}
        jumping = []
        for i, column in enumerate(table.columns[0]):
            if column.effect in axes and _key(column) in steps:
                jumping.append(i)
            elif column.effect in axes and SLOW.match(column.parameter):
                places.setdefault(column.parameter, []).append(i)
        jumps = [_formula(table, sums, jumping, len(jumping))] if jumping else []
        found = [_formula(table, sums, rows, 1) for rows in places.values()]
        out[sensor] = (jumps, sorted(found, key=lambda formula: -formula.nats))
    return out


def _table(
    fits: Sequence[Fit], exclude: Collection[str], more: Collection[tuple[str, str]] = ()
) -> _Table:
    """The dictionary's columns, and those of ``more`` channels and texts."""
    found: list[tuple[list[Column], WhiteRows]] = []
    for fit in fits:
        motion = motion_of(fit.last)
        columns = formula_columns(fit, motion, node_motion(fit, motion), exclude)
        for on, text in more:
            columns += inertial_columns(fit, motion, on, [text])
        whitened, t, channel = whitened_innovations(fit)
        phi = sensitivities(fit, motion, columns)
        rows = white_rows(fit_whitener(whitened, channel), whitened, phi, t, channel)
        found.append((columns, rows))
    # instants and time constants go by a drive's length: what all drives have
    known = [{_key(c): i for i, c in enumerate(columns)} for columns, _ in found]
    shared = [name for name in known[0] if all(name in place for place in known)]
    out_rows, out_columns = [], []
    for (columns, rows), place in zip(found, known, strict=True):
        keep = [place[name] for name in shared]
        out_columns.append(tuple(columns[i] for i in keep))
        out_rows.append(replace(rows, phi=rows.phi[:, keep]))
    sds = np.array([c.prior_sd for c in out_columns[0]])
    return _Table(tuple(out_rows), tuple(out_columns), len(shared), sds)


def _key(column: Column) -> tuple[str, str]:
    return column.effect, column.parameter


def _sums(table: _Table) -> Scores:
    """Score and full information of all columns, without those of stretches."""
    c = len(table.prior_sd)
    score: FloatArray = np.zeros(c)
    info: FloatArray = np.zeros((c, c))
    for rows in table.rows:
        score = score + rows.phi.T @ rows.w
        info = info + rows.phi.T @ rows.phi
    return Scores(score, info, np.zeros((0, c)), np.zeros((0, c, c)))


def _joint(sums: Scores, chosen: Sequence[int], table: _Table) -> Evidence:
    at: IntArray = np.array(chosen, np.int64)
    return evidence(sums, at, table.prior_sd[at])


def _forward(sums: Scores, table: _Table) -> list[int]:
    """The terms that together explain most, one by one."""
    chosen: list[int] = []
    sds: list[float] = []
    open_: BoolArray = np.ones(table.count, dtype=bool)
    inertial = np.array([bool(c.inertial) for c in table.columns[0]])
    while len(chosen) < MOST_TERMS:
        gains, scales = _gains(sums, table, chosen, sds)
        i = int(np.argmax(np.where(open_, gains, -np.inf)))
        if not open_[i] or gains[i] < TERM_NATS:
            break
        chosen.append(i)
        sds.append(float(scales[i] * table.prior_sd[i]))
        open_[i] = False
        open_ &= inertial == inertial[chosen[0]]
    return chosen


def _gains(
    sums: Scores, table: _Table, chosen: Sequence[int], sds: Sequence[float]
) -> tuple[FloatArray, FloatArray]:
    """What each column [c] adds in nats to those ``chosen`` of prior ``sds``, and the factor on
    its own prior sd that suits it."""
    score, info = sums.score, np.diag(sums.info)
    if chosen:
        at = np.array(chosen, np.int64)
        inner = sums.info[np.ix_(at, at)] + np.diag(np.array(sds) ** -2.0)
        through = np.linalg.solve(inner, sums.info[at])
        score = score - through.T @ sums.score[at]
        info = np.maximum(info - np.einsum("qc,qc->c", sums.info[at], through), 0.0)
    best: FloatArray = np.full(len(score), -np.inf)
    scales: FloatArray = np.ones(len(score))
    for scale in PRIOR_SCALES:
        room = (scale * table.prior_sd) ** 2
        shown = 1.0 + info * room
        gain = 0.5 * score**2 * room / shown - 0.5 * np.log(shown) - np.log(2.0) * (scale > 1.0)
        scales = np.where(gain > best, scale, scales)
        best = np.maximum(best, gain)
    return best, scales


def _backward(sums: Scores, table: _Table, chosen: list[int]) -> list[int]:
    """The terms less those that the others have made unnecessary."""
    nats = _joint(sums, chosen, table).nats if chosen else 0.0
    for i in list(chosen):
        fewer = [j for j in chosen if j != i]
        if fewer and (left := _joint(sums, fewer, table).nats) > nats - TERM_NATS:
            chosen, nats = fewer, left
    return chosen


def _formula(table: _Table, sums: Scores, chosen: list[int], choices: int | None = None) -> Formula:
    """Chosen columns as a formula; ``choices`` how often one was chosen, each term by default."""
    found = _joint(sums, chosen, table)
    spent = float(np.log(table.count)) * (len(chosen) if choices is None else choices)
    order = sorted(range(len(chosen)), key=lambda i: -abs(found.estimate[i]) / found.sd[i])
    terms = [
        Term(
            table.columns[0][chosen[i]].effect,
            table.columns[0][chosen[i]].parameter,
            float(found.estimate[i]),
            float(found.sd[i]),
            float(table.prior_sd[chosen[i]]),
        )
        for i in order
    ]
    first = terms[0]
    # chosen among all of the dictionary, for which the null's draws of single terms stand
    singles = [(np.array([i]), table.prior_sd[i : i + 1]) for i in range(table.count)]
    maxima = null_maxima(sums, singles, NULL_DRAWS)
    nats = found.nats - spent
    return Formula(
        first.channel,
        first.text,
        replace(found, nats=nats),
        first.coefficient,
        first.sd,
        p_value(nats, maxima),
        first.prior_sd,
        (),
        maxima,
        tuple(terms[1:]),
        spent=spent,
    )
