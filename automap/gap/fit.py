"""A model fitted to one drive: smoothed trajectory, innovations, the estimated effects."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from automap.fusion.filtered import full_covariance
from automap.fusion.kernel_runs import Start
from automap.fusion.layout import N_NAV
from automap.fusion.passes import Pass, Session, run_passes
from automap.fusion.relinearise import relinearise
from automap.gap.delays import Delays, delays_of, has_delays, linear_in_delays
from automap.gap.drive import OpenDrive
from automap.gap.model import GapModel, parameter_names, session_with
from automap.gap.motion import Motion, at_times, lagged, motion_of
from automap.records import FloatArray, IntArray

DELAY_ROUNDS = 8


@dataclass(frozen=True)
class Fit:
    """A model on a drive.

    ``values`` [p] and ``cov`` [p, p] of the estimated effects' parameters, ``names`` as
    (effect, parameter); ``score`` the log-likelihood in nats, marginal over all states; ``delays``
    what was taken out of the fixes beyond the first order.
    """

    opened: OpenDrive
    model: GapModel
    last: Pass
    start: Start
    names: tuple[tuple[str, str], ...]
    values: FloatArray
    cov: FloatArray
    score: float
    delays: Delays = field(default_factory=Delays)

    def value_of(self, effect: str) -> dict[str, float]:
        """Estimated parameters of an effect."""
        return {
            p: float(v) for (e, p), v in zip(self.names, self.values, strict=True) if e == effect
        }

    def sd_of(self, effect: str) -> dict[str, float]:
        """One sigma of an effect's parameters."""
        sd = np.sqrt(np.maximum(np.diag(self.cov), 0.0))
        return {p: float(v) for (e, p), v in zip(self.names, sd, strict=True) if e == effect}


def fit_drive(
    opened: OpenDrive,
    model: GapModel,
    estimate: Mapping[str, float] | None = None,
    linearised_at: Fit | None = None,
) -> Fit:
    """Run the passes under the model, with the effects ``estimate`` (effect -> factor on the
    prior sd) as states and all others of the model at their values.

    ``linearised_at`` another model's fit to the same drive: the passes begin about its path.
    """
    estimate = estimate or {}
    session, where = session_with(opened, model, estimate)
    delays = Delays()
    if linearised_at is None:
        last, found = run_passes(session, None, constrained=True)
        start = found.start
    else:
        last, start = linearised_at.last, linearised_at.start
        if linearised_at.delays != delays and has_delays(session.options.effects):
            delays = linearised_at.delays
        last, start = _repeat_passes(session, last, start, delays)
    for _ in range(DELAY_ROUNDS):
        found_delays = delays_of(last, where)
        if found_delays.close_to(delays, session.span[1]):
            break
        delays = found_delays
        last, start = _repeat_passes(session, last, start, delays)
    model_names = last.problem.model.names
    n = last.problem.model.size
    names, rows, signs = [], [], []
    for effect in estimate:
        for parameter in parameter_names(effect):
            state, sign = where[effect][parameter]
            names.append((effect, parameter))
            rows.append(model_names.index(state))
            signs.append(sign)
    final = np.array([last.totals()[name] for name in model_names])
    sign_row = np.array(signs)
    at = np.array(rows, dtype=np.int64)
    values = sign_row * final[at] - _stated(opened, names)
    cov = full_covariance(last.forward.store.cov[-1:], n)[0]
    part = cov[np.ix_(at + N_NAV, at + N_NAV)] * np.outer(sign_row, sign_row)
    return Fit(
        opened,
        model,
        last,
        start,
        tuple(names),
        values,
        part,
        float(last.forward.score),
        delays=delays,
    )


def whitened_innovations(fit: Fit) -> tuple[FloatArray, FloatArray, IntArray]:
    """Innovations over sd [s], their times [s] in s and channels [s]."""
    store = fit.last.forward.store
    node, channel = store.info[:, 0], store.info[:, 1]
    return store.nu / np.sqrt(store.var), fit.last.nodes.t[node], channel


def _repeat_passes(
    session: Session, last: Pass, start: Start, delays: Delays
) -> tuple[Pass, Start]:
    """The passes again about the path of ``last``, without what ``delays`` do to the fixes beyond
    the first order."""
    if delays != Delays():
        fixes, change = linear_in_delays(session.fixes, last, motion_of(last), delays)
        session = replace(session, fixes=fixes, late_change=change)
    return relinearise(session, last, start)


def _stated(opened: OpenDrive, names: list[tuple[str, str]]) -> FloatArray:
    """What the manifest already says of the parameters: only the lever arm has such."""
    arm = opened.drive.lever_arm
    known = {} if arm is None else dict(zip("xyz", np.asarray(arm), strict=True))
    return np.array([known.get(p, 0.0) if e == "gnss_lever_arm" else 0.0 for e, p in names])


__all__ = ["Fit", "Motion", "at_times", "fit_drive", "lagged", "motion_of", "whitened_innovations"]
