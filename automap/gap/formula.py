"""Effects that are in no library: one regressor on one channel, as a formula.

A dictionary of physical quantities (speed, heading, turn rate, forces, temperature, time, their
powers and products, one-sided and decaying terms) on every axis of the sensors and on the
fixes is screened as the library is. What a catalogue effect already says is left out of it,
unless that effect is kept out of the library.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from automap.earth import metres_per_radian
from automap.gap.columns import (
    Column,
    NodeMotion,
    node_motion,
    sensitivities,
)
from automap.gap.dictionary import formula_columns
from automap.gap.drive import OpenDrive
from automap.gap.evidence import Evidence, Scores, block_starts, evidence, null_maxima, p_value
from automap.gap.fit import Fit, Motion, motion_of
from automap.gap.screening import whitened_innovations
from automap.gap.whitening import WhiteRows, fit_whitener, white_rows
from automap.records import FloatArray

NULL_DRAWS = 2000
BATCH = 96


@dataclass(frozen=True)
class Formula:
    """A candidate formula: its channel and text, the evidence, coefficient and sd in the unit
    of the channel per unit of the quantity."""

    channel: str
    text: str
    evidence: Evidence
    coefficient: float
    sd: float
    p_value: float
    prior_sd: float
    columns: tuple[Column, ...]
    maxima: FloatArray

    @property
    def nats(self) -> float:
        """Evidence of the screening."""
        return self.evidence.nats


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
    users: Callable[[Fit, Motion, NodeMotion], list[Column]] | None = None,
) -> list[Formula]:
    """The strongest formulas of fitted drives, best first."""
    total: dict[tuple[str, str], Scores] = {}
    sds: dict[tuple[str, str], float] = {}
    joint: Scores | None = None
    order: list[tuple[str, str]] = []
    kept: dict[tuple[str, str], list[Column]] = {}
    for fit in fits:
        motion = motion_of(fit.last)
        at = node_motion(fit, motion)
        columns = formula_columns(fit, motion, at, exclude)
        if users is not None:
            columns += users(fit, motion, at)
        scores = _scores(fit, motion, columns)
        names = [(c.effect, c.parameter) for c in columns]
        for i, (name, column) in enumerate(zip(names, columns, strict=True)):
            own = Scores(
                scores.score[i : i + 1],
                scores.info[i : i + 1, i : i + 1],
                scores.blocks[:, i : i + 1],
                scores.block_info[:, i : i + 1, :],
            )
            total[name] = total[name] + own if name in total else own
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
    zero = np.array([0])
    for name, part in total.items():
        found = evidence(part, zero, np.array([sds[name]]))
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


def _scores(fit: Fit, motion: Motion, columns: Sequence[Column]) -> Scores:
    """Scores of many columns: the full information, of the stretches the diagonal alone."""
    whitened, t, channel = whitened_innovations(fit)
    whitener = fit_whitener(whitened, channel)
    parts: list[WhiteRows] = []
    for start in range(0, len(columns), BATCH):
        phi = sensitivities(fit, motion, columns[start : start + BATCH])
        parts.append(white_rows(whitener, whitened, phi, t, channel))
    rows = parts[0]
    phi = np.concatenate([p.phi for p in parts], axis=1)
    starts = block_starts(rows.t)
    blocks = np.add.reduceat(phi * rows.w[:, None], starts, axis=0)
    block_info = np.add.reduceat(phi**2, starts, axis=0)[:, :, None]
    return Scores(phi.T @ rows.w, phi.T @ phi, blocks, block_info)
