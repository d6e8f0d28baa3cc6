"""A model fitted to one drive: smoothed trajectory, innovations, the estimated effects."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from automap.earth import gravity
from automap.effects.gnss import low_pass
from automap.effects.user_fixes import acts_on_fixes
from automap.frames import quat_to_matrix
from automap.fusion.layout import N_NAV
from automap.fusion.measurements import FixModel
from automap.fusion.passes import Pass, run_passes
from automap.fusion.problem import VEL_LAG_STATE, Start, full_covariance, run_dense
from automap.gap.drive import OpenDrive
from automap.gap.model import GapModel, parameter_names, session_with
from automap.records import FloatArray

LAG_ROUNDS = 6
LAG_CHANGE = 0.03
LAG_MIN_S = 0.004


@dataclass(frozen=True)
class Motion:
    """The smoothed motion at the IMU's epochs.

    ``t`` [n] s, ``pos`` [n, 3] rad, rad, m, ``vel`` [n, 3] NED, ``dcm`` [n, 3, 3] body to NED,
    ``rate`` and ``force`` [n, 3] corrected readings, ``acc`` [n, 3] NED over ground.
    """

    t: FloatArray
    pos: FloatArray
    vel: FloatArray
    dcm: FloatArray
    rate: FloatArray
    force: FloatArray
    acc: FloatArray


@dataclass(frozen=True)
class Fit:
    """A model on a drive.

    ``values`` [p] and ``cov`` [p, p] of the estimated effects' parameters, ``names`` as
    (effect, parameter); ``score`` the log-likelihood in nats, marginal over all states and,
    by ``occam``, over the effects that are no states.
    """

    opened: OpenDrive
    model: GapModel
    last: Pass
    start: Start
    names: tuple[tuple[str, str], ...]
    values: FloatArray
    cov: FloatArray
    score: float
    occam: float = 0.0

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
    start: Start | None = None,
) -> Fit:
    """Run the passes under the model, with the effects ``estimate`` (effect -> factor on the
    prior sd) as states and all others of the model at their values."""
    estimate = estimate or {}
    if any(acts_on_fixes(e) for e in estimate):
        from automap.gap.fix_effects import fit_with_fix_effects

        return fit_with_fix_effects(opened, model, estimate, start)
    session, where = session_with(opened, model, estimate)
    last, found = run_passes(session, start, constrained=True)
    start = found.start
    before = 0.0
    for _ in range(LAG_ROUNDS):
        lag = _lag_of(last, where)
        if abs(lag - before) <= max(LAG_MIN_S, LAG_CHANGE * lag):
            break
        fixes = _without_remainder(session.fixes, last, lag)
        last, found = run_passes(replace(session, fixes=fixes), start, constrained=True)
        start, before = found.start, lag
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
    return Fit(opened, model, last, start, tuple(names), values, part, float(last.forward.score))


def _stated(opened: OpenDrive, names: list[tuple[str, str]]) -> FloatArray:
    """What the manifest already says of the parameters: only the lever arm has such."""
    arm = opened.drive.lever_arm
    known = {} if arm is None else dict(zip("xyz", np.asarray(arm), strict=True))
    return np.array([known.get(p, 0.0) if e == "gnss_lever_arm" else 0.0 for e, p in names])


def motion_of(last: Pass) -> Motion:
    """The smoothed motion of a pass at the IMU's epochs."""
    dense, readings = run_dense(
        last.problem, last.nodes, last.smooth.nominal, last.smooth.params, True, with_rates=True
    )
    bad = ~(np.isfinite(dense).all(axis=1) & np.isfinite(readings).all(axis=1))
    if bad.any():
        good = np.flatnonzero(~bad)
        nearest = good[np.clip(np.searchsorted(good, np.flatnonzero(bad)), 0, len(good) - 1)]
        dense[bad], readings[bad] = dense[nearest], readings[nearest]
    t = last.problem.t
    dcm = quat_to_matrix(dense[:, 6:10])
    step = max(float(np.median(np.diff(t))), 1e-4)
    from scipy.ndimage import uniform_filter1d

    width = max(2 * round(0.05 / step) + 1, 1)
    force = uniform_filter1d(readings[:, 3:], width, axis=0, mode="nearest")
    acc = np.einsum("nij,nj->ni", dcm, force)
    acc[:, 2] += float(gravity(float(dense[0, 0]), float(dense[0, 2])))
    return Motion(t, dense[:, :3], dense[:, 3:6], dcm, readings[:, :3], readings[:, 3:], acc)


def at_times(motion: Motion, signal: FloatArray, t: FloatArray) -> FloatArray:
    """A signal [n, k] of the motion at instants [m], linear between epochs."""
    flat = signal.reshape(len(motion.t), -1)
    out = np.stack([np.interp(t, motion.t, column) for column in flat.T], axis=1)
    return np.asarray(out.reshape((len(t), *signal.shape[1:])))


def lagged(motion: Motion, tau_s: float) -> FloatArray:
    """The velocity [n, 3] after a first-order low-pass of time constant ``tau_s``."""
    step = max(float(np.median(np.diff(motion.t))), 1e-4)
    grid = np.arange(motion.t[0], motion.t[-1] + step, step)
    even = np.stack([np.interp(grid, motion.t, v) for v in motion.vel.T], axis=1)
    passed = low_pass(even, step, tau_s)
    return np.stack([np.interp(motion.t, grid, v) for v in passed.T], axis=1)


def _lag_of(last: Pass, where: Mapping[str, Mapping[str, tuple[str, float]]]) -> float:
    """Time constant of the receiver's low-pass in s, 0 where the model has none."""
    if "gnss_velocity_lag" not in where or "gnss_velocity_latency" in where:
        return 0.0
    return max(last.totals().get(VEL_LAG_STATE, 0.0), 0.0)


def _without_remainder(fixes: FixModel, last: Pass, lag: float) -> FixModel:
    """Fixes less what a low-pass does to the antenna's velocity beyond a delay of ``lag`` s,
    which is how the filter sees it."""
    motion = motion_of(last)
    arm = np.array([last.totals().get(f"gnss_lever_arm_{a}", 0.0) for a in "xyz"])
    swing = np.einsum("nij,nj->ni", motion.dcm, np.cross(motion.rate, arm))
    antenna = replace(motion, vel=motion.vel + swing)
    t = last.shift.position_times(fixes.t)
    values = fixes.values.copy()
    values[:, 3:6] -= at_times(motion, lagged(antenna, lag), t)
    values[:, 3:6] += at_times(motion, antenna.vel, t - lag)
    return replace(fixes, values=values)
