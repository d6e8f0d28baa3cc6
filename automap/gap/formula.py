"""Effects that are in no library: regressors on the channels, as a formula.

A dictionary of physical quantities (speed, heading, turn rate, forces, temperature, time, their
powers and products, one-sided and decaying terms) on every axis of the sensors and on the
fixes is screened as the library is. What a catalogue effect already says is left out of it,
unless that effect is kept out of the library.
"""

from __future__ import annotations

import operator
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import reduce

import numpy as np

from automap.earth import metres_per_radian
from automap.fusion.layout import CH_NHC
from automap.gap.columns import Column, node_motion, sensitivities
from automap.gap.dictionary import CHANNELS, finer_texts, formula_columns, inertial_columns
from automap.gap.drive import OpenDrive
from automap.gap.evidence import Evidence, Scores, block_starts, evidence, null_maxima, p_value
from automap.gap.fit import Fit, Motion, motion_of
from automap.gap.screening import whitened_innovations
from automap.gap.whitening import WhiteRows, fit_whitener, white_rows
from automap.records import BoolArray, FloatArray

NULL_DRAWS = 2000
VEHICLE = (CH_NHC, CH_NHC + 1)
CONFLICT = 4.0
"""Sigmas between what measurements and what the vehicle constraint say of a coefficient. Beyond
them the constraint has no say: what slips or sways is the vehicle, not a sensor."""
BATCH = 96


@dataclass(frozen=True)
class Term:
    """One regressor on one channel; coefficient and sds in the unit of the channel per unit of the
    quantity."""

    channel: str
    text: str
    coefficient: float
    sd: float
    prior_sd: float


def coefficient_names(count: int) -> tuple[str, ...]:
    """k, k2, k3 and so on."""
    return ("k", *(f"k{i}" for i in range(2, count + 1)))


@dataclass(frozen=True)
class Formula:
    """A candidate formula: its strongest channel and text, the evidence, coefficient and sd in the
    unit of the channel per unit of the quantity.

    ``columns`` one a drive; ``others`` further terms: a formula of several is fitted as an effect
    and has no columns. ``spent`` what the choice of its terms from the dictionary costs in nats.
    """

    channel: str
    text: str
    evidence: Evidence
    coefficient: float
    sd: float
    p_value: float
    prior_sd: float
    columns: tuple[Column, ...]
    maxima: FloatArray
    others: tuple[Term, ...] = ()
    spent: float = 0.0

    @property
    def nats(self) -> float:
        """Evidence of the screening."""
        return self.evidence.nats

    @property
    def terms(self) -> tuple[Term, ...]:
        """All its terms."""
        first = Term(self.channel, self.text, self.coefficient, self.sd, self.prior_sd)
        return first, *self.others

    @property
    def equation(self) -> str:
        """What it adds, as a person writes it; the coefficient of a single term is k."""
        return "; ".join(
            f"{term.channel} += {name} * {term.text}"
            for name, term in zip(self.names, self.terms, strict=True)
        )

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the coefficients."""
        return coefficient_names(1 + len(self.others))

    def of_terms(self, numbers: Sequence[int]) -> Formula:
        """The formula of some of its terms by number, strongest first."""
        kept = [self.terms[i] for i in numbers]
        first = kept[0]
        share = len(kept) / len(self.terms)
        return replace(
            self,
            channel=first.channel,
            text=first.text,
            coefficient=first.coefficient,
            sd=first.sd,
            prior_sd=first.prior_sd,
            others=tuple(kept[1:]),
            spent=share * self.spent,
        )


def without_formula(opened: OpenDrive, fit: Fit, column: Column, coefficient: float) -> OpenDrive:
    """The drive with a formula's part taken out of its readings or fixes."""
    session = opened.session
    if column.inertial:
        gyro, accel = session.imu.gyro.copy(), session.imu.accel.copy()
        for part in column.inertial:
            target = gyro if part.sensor == 0 else accel
            target[:, part.axis] -= coefficient * part.signal
        imu = replace(session.imu, gyro=gyro, accel=accel)
        return replace(opened, session=replace(session, imu=imu))
    assert column.direct is not None
    fixes = session.fixes
    t = fit.last.shift.position_times(fixes.t)
    acts = coefficient * column.direct.by_channel
    at = np.stack([np.interp(t, fit.last.nodes.t, acts[:, c]) for c in range(6)], axis=1)
    values = fixes.values.copy()
    north, east = metres_per_radian(values[:, 0], values[:, 2])
    values[:, 0] -= at[:, 0] / north
    values[:, 1] -= at[:, 1] / east
    values[:, 2] += at[:, 2]
    values[:, 3:6] -= at[:, 3:6]
    return replace(opened, session=replace(session, fixes=replace(fixes, values=values)))


def screen_formulas(
    fits: Sequence[Fit],
    exclude: Collection[str] = (),
    correct_overdispersion: bool = True,
) -> list[Formula]:
    """The strongest formulas of fitted drives, best first.

    Without ``correct_overdispersion`` a score that scatters more than it should counts in full:
    under noise that is known to be too small everything scatters.
    """
    total: dict[tuple[str, str], Scores] = {}
    measured: dict[tuple[str, str], Scores] = {}
    sds: dict[tuple[str, str], float] = {}
    joint: Scores | None = None
    order: list[tuple[str, str]] = []
    kept: dict[tuple[str, str], list[Column]] = {}
    for fit in fits:
        motion = motion_of(fit.last)
        at = node_motion(fit, motion)
        columns = formula_columns(fit, motion, at, exclude)
        scores, seen = _scores(fit, motion, columns)
        names = [(c.effect, c.parameter) for c in columns]
        for i, (name, column) in enumerate(zip(names, columns, strict=True)):
            for known, part in ((total, scores), (measured, seen)):
                own = _single(part, i)
                known[name] = known[name] + own if name in known else own
            sds.setdefault(name, column.prior_sd)
            kept.setdefault(name, []).append(column)
        if joint is None or len(columns) > len(order):
            joint, order = scores, names
    assert joint is not None
    info = joint.info
    flat = Scores(joint.score, info, joint.blocks[:, :1], joint.block_info[:, :1, :1])
    groups = [(np.array([i]), np.array([sds[name]])) for i, name in enumerate(order)]
    maxima = null_maxima(flat, groups, NULL_DRAWS)
    out = []
    for name, part in total.items():
        found = _evidence(part, measured[name], sds[name], correct_overdispersion)
        out.append(
            Formula(
                name[0],
                name[1],
                found,
                float(found.estimate[0]),
                float(found.sd[0]),
                p_value(found.nats, maxima),
                sds[name],
                tuple(kept[name]),
                maxima,
            )
        )
    return sorted(out, key=lambda f: -f.evidence.nats)


def refined(fits: Sequence[Fit], formula: Formula, correct_overdispersion: bool = True) -> Formula:
    """The formula with the instant or time constant that the drives show best."""
    if formula.channel not in CHANNELS:
        return formula
    texts = finer_texts(formula.text, fits[0].last.problem.t[-1])
    if not texts:
        return formula
    per_drive: list[tuple[Scores, Scores]] = []
    columns: list[list[Column]] = []
    for fit in fits:
        motion = motion_of(fit.last)
        columns.append(inertial_columns(fit, motion, formula.channel, texts))
        per_drive.append(_scores(fit, motion, columns[-1]))
    best = formula
    for i, text in enumerate(texts):
        part = reduce(operator.add, (_single(every, i) for every, _ in per_drive))
        seen = reduce(operator.add, (_single(free, i) for _, free in per_drive))
        own = tuple(c[i] for c in columns)
        found = _evidence(part, seen, own[0].prior_sd, correct_overdispersion)
        if found.nats > best.nats:
            best = replace(
                formula,
                text=text,
                evidence=found,
                coefficient=float(found.estimate[0]),
                sd=float(found.sd[0]),
                p_value=p_value(found.nats, formula.maxima),
                prior_sd=own[0].prior_sd,
                columns=own,
            )
    return best


def _evidence(
    part: Scores, measured: Scores, prior_sd: float, correct_overdispersion: bool
) -> Evidence:
    """Evidence of one column; ``measured`` its scores without the vehicle constraint."""
    if _conflict(part, measured):
        part = measured
    if not correct_overdispersion:
        part = replace(part, blocks=part.blocks[:0], block_info=part.block_info[:0])
    return evidence(part, np.array([0]), np.array([prior_sd]))


def _single(scores: Scores, i: int) -> Scores:
    """Scores of one column alone; ``info`` may hold the diagonal only."""
    info = scores.info if scores.info.ndim == 1 else np.diag(scores.info)
    return Scores(
        scores.score[i : i + 1],
        info[i : i + 1, None],
        scores.blocks[:, i : i + 1],
        scores.block_info[:, i : i + 1, :],
    )


def _conflict(everything: Scores, measured: Scores) -> bool:
    """Whether measurements and the vehicle constraint contradict each other on a coefficient."""
    info = float(measured.info[0, 0])
    other = float(everything.info[0, 0]) - info
    if min(info, other) <= 0.0:
        return False
    score = float(measured.score[0])
    apart = score / info - (float(everything.score[0]) - score) / other
    return apart**2 > CONFLICT**2 * (1.0 / info + 1.0 / other)


def _scores(fit: Fit, motion: Motion, columns: Sequence[Column]) -> tuple[Scores, Scores]:
    """Scores of many columns: the full information, of the stretches the diagonal alone. Beside
    them those of all measurements without the vehicle constraint, with the diagonal only."""
    whitened, t, channel = whitened_innovations(fit)
    whitener = fit_whitener(whitened, channel)
    every: list[Scores] = []
    free: list[Scores] = []
    phi: FloatArray = np.zeros((0, len(columns)))
    for start in range(0, len(columns), BATCH):
        part = sensitivities(fit, motion, columns[start : start + BATCH])
        rows = white_rows(whitener, whitened, part, t, channel)
        if start == 0:
            phi = np.empty((len(rows.w), len(columns)))
        phi[:, start : start + BATCH] = rows.phi
        every.append(_diagonal(rows, np.ones(len(rows.w), dtype=bool)))
        free.append(_diagonal(rows, ~np.isin(rows.channel, VEHICLE)))
    return replace(_beside(every), info=phi.T @ phi), _beside(free)


def _diagonal(rows: WhiteRows, use: BoolArray) -> Scores:
    """Scores of columns each by itself, from the rows to be used; ``info`` [c] the diagonal."""
    starts = block_starts(rows.t)
    blocks = np.add.reduceat(rows.phi * np.where(use, rows.w, 0.0)[:, None], starts, axis=0)
    infos = np.add.reduceat(np.where(use[:, None], rows.phi**2, 0.0), starts, axis=0)
    return Scores(blocks.sum(axis=0), infos.sum(axis=0), blocks, infos[:, :, None])


def _beside(parts: Sequence[Scores]) -> Scores:
    """Diagonal scores of groups of columns as those of all."""
    return Scores(
        np.concatenate([p.score for p in parts]),
        np.concatenate([p.info for p in parts]),
        np.concatenate([p.blocks for p in parts], axis=1),
        np.concatenate([p.block_info for p in parts], axis=1),
    )
