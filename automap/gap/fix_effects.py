"""Users' effects on the fixes: how they would show, and their values on a drive.

The filter has no states for them. Their values are found by Gauss and Newton's iteration: take
out what is known, score what is left, move on. The score comes through the filter's own gains,
so all states are marginalised, and for an effect that is linear one step is exact.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from automap.effects.user_fixes import acts_on_fixes, unit_errors
from automap.fusion.layout import CH_POS, CH_VEL, MAX_SCALARS
from automap.gap.columns import Column, Direct, NodeMotion, node_motion, sensitivities
from automap.gap.drive import OpenDrive
from automap.gap.evidence import scores_of
from automap.gap.fit import Fit, Motion, fit_drive, motion_of
from automap.gap.model import GapModel, parameter_names, prior_sd
from automap.gap.motion_signals import motion_signals
from automap.gap.screening import whitened_innovations
from automap.gap.whitening import fit_whitener, white_rows

ROUNDS = 4
SETTLED = 0.1
"""Enough when a value moves by no more than this share of its sd."""


def fix_columns(
    effect: str, fit: Fit, motion: Motion, at: NodeMotion, prior_sds: Mapping[str, float]
) -> list[Column]:
    """Columns of a user's effect on the fixes."""
    signals = motion_signals(fit, motion).at(at.t + fit.opened.drive.begin_s)
    out = []
    for parameter in parameter_names(effect):
        position, velocity = unit_errors(effect, parameter, signals)
        by_channel = np.zeros((len(at.t), MAX_SCALARS))
        by_channel[:, CH_POS : CH_POS + 3] = position
        by_channel[:, CH_VEL : CH_VEL + 3] = velocity
        out.append(Column(effect, parameter, prior_sds[parameter], direct=Direct(by_channel)))
    return out


def fit_with_fix_effects(
    opened: OpenDrive, model: GapModel, estimate: Mapping[str, float], near: Fit | None
) -> Fit:
    """``fit_drive`` where some of the effects to be estimated act on the fixes."""
    sought = [e for e in estimate if acts_on_fixes(e)]
    others = {e: s for e, s in estimate.items() if e not in sought}
    keys = [(e, p) for e in sought for p in parameter_names(e)]
    sd = np.array([estimate[e] * prior_sd(model.options, e, p) for e, p in keys])
    begin = np.array([model.values.get(e, {}).get(p, 0.0) for e, p in keys])
    theta = begin.copy()
    for number in range(ROUNDS):
        known: dict[str, dict[str, float]] = {e: {} for e in sought}
        for (e, p), value in zip(keys, theta, strict=True):
            known[e][p] = float(value)
        fit = fit_drive(opened, replace(model, values={**model.values, **known}), others, near)
        near = fit
        motion = motion_of(fit.last)
        at = node_motion(fit, motion)
        columns = [
            c for e in sought for c in fix_columns(e, fit, motion, at, dict.fromkeys(known[e], 1.0))
        ]
        phi = sensitivities(fit, motion, columns)
        whitened, t, channel = whitened_innovations(fit)
        rows = white_rows(fit_whitener(whitened, channel), whitened, phi, t, channel)
        scores = scores_of(rows)
        cov = np.linalg.inv(scores.info + np.diag(sd**-2.0))
        move = cov @ (scores.score - (theta - begin) / sd**2)
        if number == ROUNDS - 1 or np.all(np.abs(move) < SETTLED * np.sqrt(np.diag(cov))):
            break
        theta = theta + move
    off = (theta - begin) / sd
    occam = 0.5 * float(np.linalg.slogdet(cov / np.outer(sd, sd))[1] - off @ off)
    names = tuple((e, p) for e in estimate for p in parameter_names(e))
    place = {key: i for i, key in enumerate(names)}
    values, full = np.zeros(len(names)), np.zeros((len(names), len(names)))
    for part_names, part, part_cov in ((fit.names, fit.values, fit.cov), (keys, theta, cov)):
        rows_at = np.array([place[k] for k in part_names], np.int64)
        values[rows_at] = part
        full[np.ix_(rows_at, rows_at)] = part_cov
    return replace(
        fit,
        model=model,
        names=names,
        values=values,
        cov=full,
        score=fit.score + occam,
        occam=occam,
    )
