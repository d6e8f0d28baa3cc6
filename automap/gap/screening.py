"""Which missing effect explains what the innovations of fitted drives still show."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from automap.gap.columns import Column, node_motion, sensitivities
from automap.gap.effect_library import library_columns
from automap.gap.evidence import (
    Evidence,
    Scores,
    evidence,
    null_maxima,
    p_value,
    scores_of,
)
from automap.gap.fit import Fit, motion_of
from automap.gap.whitening import Whitener, WhiteRows, fit_whitener, white_rows
from automap.records import FloatArray, IntArray

NULL_DRAWS = 4000


@dataclass(frozen=True)
class Candidate:
    """An effect with its evidence; ``parameters`` [p] in the order of the estimate."""

    effect: str
    parameters: tuple[str, ...]
    columns: IntArray
    prior_sd: FloatArray
    evidence: Evidence
    p_value: float


@dataclass(frozen=True)
class Screening:
    """All candidates, best first; ``scores`` of all ``columns``; ``maxima`` the largest evidence
    where nothing is missing, sorted."""

    candidates: tuple[Candidate, ...]
    columns: tuple[Column, ...]
    scores: Scores
    maxima: FloatArray


def whitened_innovations(fit: Fit) -> tuple[FloatArray, FloatArray, IntArray]:
    """Innovations over sd [s], their times [s] in s and channels [s]."""
    store = fit.last.forward.store
    node, channel = store.info[:, 0], store.info[:, 1]
    return store.nu / np.sqrt(store.var), fit.last.nodes.t[node], channel


def rows_of(fit: Fit, effects: Sequence[str]) -> tuple[list[Column], WhiteRows, Whitener]:
    """Columns and white rows of one drive."""
    motion = motion_of(fit.last)
    at = node_motion(fit, motion)
    columns = library_columns(effects, fit, motion, at)
    phi = sensitivities(fit, motion, columns)
    whitened, t, channel = whitened_innovations(fit)
    whitener = fit_whitener(whitened, channel)
    return columns, white_rows(whitener, whitened, phi, t, channel), whitener


def screen(fits: Sequence[Fit], effects: Sequence[str]) -> Screening:
    """Rank the effects by the evidence of all drives together."""
    total: Scores | None = None
    layout: list[Column] = []
    per_drive = [rows_of(fit, effects) for fit in fits]
    for columns, _, _ in per_drive:
        known = {(c.effect, c.parameter) for c in layout}
        layout += [c for c in columns if (c.effect, c.parameter) not in known]
    place = {(c.effect, c.parameter): i for i, c in enumerate(layout)}
    for columns, rows, _ in per_drive:
        phi = np.zeros((len(rows.w), len(layout)))
        phi[:, [place[(c.effect, c.parameter)] for c in columns]] = rows.phi
        part = scores_of(WhiteRows(rows.w, phi, rows.t, rows.channel))
        total = part if total is None else total + part
    assert total is not None
    return _ranked(total, layout, effects)


def _ranked(scores: Scores, layout: list[Column], effects: Sequence[str]) -> Screening:
    groups: Mapping[str, IntArray] = {
        e: np.array([i for i, c in enumerate(layout) if c.effect == e], np.int64) for e in effects
    }
    groups = {e: rows for e, rows in groups.items() if len(rows)}
    priors = {e: np.array([layout[i].prior_sd for i in rows]) for e, rows in groups.items()}
    maxima = null_maxima(scores, [(groups[e], priors[e]) for e in groups], NULL_DRAWS, sparse=True)
    found = []
    for effect, rows in groups.items():
        item = evidence(scores, rows, priors[effect], sparse=True)
        parameters = tuple(layout[i].parameter for i in rows)
        found.append(
            Candidate(effect, parameters, rows, priors[effect], item, p_value(item.nats, maxima))
        )
    found.sort(key=lambda c: -c.evidence.nats)
    return Screening(tuple(found), tuple(layout), scores, maxima)
