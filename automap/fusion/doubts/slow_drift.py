"""Positions that drift over minutes by more than their receiver's errors were taken to.

A level of noise is found by all that a drive shows of it, which is most of what lasts for seconds:
a bias that comes and goes over minutes, as of the air, is hardly in it. Waves of minutes are added
to the positions, and their sizes come by generalised least squares from the innovations of the
constant-velocity filter, as those of ``offsets`` do. By them the slow error has a size of its own,
the likeliest beside what is known beforehand of levels, as in ``adapt``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from automap.effects import CATALOGUE
from automap.fusion import limits
from automap.fusion.adapt import COARSE
from automap.fusion.doubts.limits import DRIFT_STEPS, DRIFT_WAVE_S, DRIFT_WINDOW_S
from automap.fusion.doubts.offsets import linear_fit, offset_doubts, receivers_own
from automap.fusion.doubts.reason import Reason
from automap.fusion.fix_axes import Epochs, usable_epochs, whitened_epochs
from automap.fusion.measurements.position import lasting_share
from automap.fusion.options import FusionOptions
from automap.records import Fixes, FloatArray, Trajectory

_PLANE = (0, 1)
_LAG_SD, _SCALE_SD = (
    CATALOGUE[effect].parameters[0].prior_sd
    for effect in ("gnss_course_latency", "gnss_velocity_scale")
)
_OWN_SD = np.array([_LAG_SD, _LAG_SD, _LAG_SD, _SCALE_SD, _SCALE_SD])
"""Of ``receivers_own``: lags, and shares of a velocity along it and across."""


@dataclass(frozen=True)
class Drift:
    """From ``start_s`` to ``end_s`` GPS s positions err by ``sd_m`` m an axis for minutes, beyond
    what was taken; by ``gain`` nats likelier than not."""

    start_s: float
    end_s: float
    sd_m: float
    gain: float


def pattern_doubts(
    fixes: Fixes,
    alone: Trajectory,
    options: FusionOptions,
    levels: Mapping[str, float],
    sd_m: float,
    told: Sequence[Reason],
    by_imu: Mapping[str, float] = MappingProxyType({}),
) -> tuple[list[Reason], list[Drift]]:
    """The reasons that offsets of the positions give, and their drifts where neither those nor any
    that were ``told`` make them; ``alone`` the path of ``fixes``, ``sd_m`` m an axis what the path
    that is judged is good to; ``levels`` as fixes alone tell them, ``by_imu`` as an IMU does."""
    at = usable_epochs(fixes, options)
    found = list(offset_doubts(at, alone, options, levels, sd_m))
    if any(reason.error_m or reason.late_s for reason in (*told, *found)):
        return found, []
    kinds = [levels]
    if by_imu:
        # a slow error that shows less than was stated leaves the rest to what lasts
        kinds += [{**by_imu, **{name: max(by_imu[name], 1.0) for name in ("wander", "multipath")}}]
    drifts = slow_drifts(at, alone, options, *kinds)
    return [*found, *drift_doubts(drifts, float(alone.gps_s[0]), sd_m)], drifts


def slow_drifts(
    at: Epochs, alone: Trajectory, options: FusionOptions, *levels: Mapping[str, float]
) -> list[Drift]:
    """Drifts of the epochs ``at`` [k], in windows of some minutes, by the smoothed path ``alone``
    [k] of them and each of the ``levels`` of their errors that were found, of which the largest
    counts; none where a drive shows no more than those."""
    span = float(at.t[-1] - at.t[0])
    count = max(math.ceil(span / DRIFT_WINDOW_S), 1)
    waves = int(2.0 * span / count / DRIFT_WAVE_S)
    found = []
    for edge in at.t[0] + span / count * np.arange(count) if waves else ():
        placed = at.used[:2, :, 0].all(axis=0) & (at.t >= edge) & (at.t <= edge + span / count)
        rows = np.flatnonzero(placed)
        if len(rows) < limits.LEAST_JUDGED:
            continue
        z = at.z[:, rows]
        # a filter begins where its first fix is
        z[..., 0] -= z[:, :1, 0]
        part = replace(
            at,
            t=at.t[rows],
            z=z,
            used=at.used[:, rows],
            stated_sd=at.stated_sd[rows],
            white=at.white[:, rows],
            row=at.row[rows],
        )
        sd, gain = max(_size(part, alone.vel_ned[rows, :2], waves, options, one) for one in levels)
        if sd > 0.0:
            gps_s = alone.gps_s[rows]
            found.append(Drift(float(gps_s[0]), float(gps_s[-1]), sd, gain - math.log(count)))
    return found


def _size(
    at: Epochs,
    velocity: FloatArray,
    waves: int,
    options: FusionOptions,
    levels: Mapping[str, float],
) -> tuple[float, float]:
    """Sigma, m an axis, of slow errors beyond those taken, and the nats that they gain."""
    t = at.t - at.t[0]
    order = np.arange(1, waves + 1)
    wave = np.cos(np.pi * np.outer(t / t[-1], order))
    # [k, position or velocity, north or east, of which axis the wave is, wave]
    errors = np.zeros((len(t), 2, 2, 2, waves))
    for axis in _PLANE:
        errors[:, 0, axis, axis] = wave
    both = np.concatenate([errors.reshape(len(t), 2, 2, -1), receivers_own(at.t, velocity)], axis=3)
    parts = [np.ascontiguousarray(both[:, :, axis]) for axis in _PLANE]
    rows = np.vstack([whitened_epochs(at, axis, options, levels, parts[axis]) for axis in _PLANE])
    # what is known beforehand of the receiver's own errors, as readings of them
    known = np.hstack([np.zeros((len(_OWN_SD), 1 + 2 * waves)), np.diag(1.0 / _OWN_SD)])
    rows = np.vstack([rows, known])
    fit = linear_fit(rows[:, 0], rows[:, 1:], 2 * waves)
    if fit is None:
        return 0.0, 0.0
    value, cov = fit
    taken = float(lasting_share(options, levels)[0] * np.median(at.stated_sd[:, :2]))
    # variances of the cosines of a first-order Gauss-Markov error of variance one
    x = options.wander_tau_s / t[-1]
    shape = np.tile(4.0 * x / (1.0 + (np.pi * order * x) ** 2), 2)
    factors = np.geomspace(1.0, COARSE.limit, DRIFT_STEPS)
    scores = [_score(value, cov + np.diag((f**2 - 1.0) * taken**2 * shape), f) for f in factors]
    best = int(np.argmax(scores))
    return taken * math.sqrt(factors[best] ** 2 - 1.0), scores[best] - scores[0]


def _score(value: FloatArray, cov: FloatArray, factor: float) -> float:
    """Nats of ``value`` [m] with covariance ``cov``, and of the factor beforehand."""
    _, logdet = np.linalg.slogdet(cov)
    square = float(value @ np.linalg.solve(cov, value))
    return -0.5 * (float(logdet) + square + (math.log(factor) / limits.LEVEL_SPREAD) ** 2)


def drift_doubts(drifts: list[Drift], start_gps_s: float, sd_m: float) -> Iterator[Reason]:
    """The reason that drifts give which chance hardly makes; ``start_gps_s`` of the path's first
    row, ``sd_m`` m an axis what the path is good to without them."""
    told = [drift for drift in drifts if drift.gain > COARSE.gain]
    if not told:
        return
    size = max(drift.sd_m for drift in told)
    sure = any(drift.gain > -math.log(limits.DOUBT_PROBABILITY) for drift in told)
    yield Reason(
        "positions_drift",
        f"over minutes positions drift by {size:.1f} m an axis against the velocities, more than "
        "the receiver states: the air, or reflections; the sigmas hold it, corrections (SBAS or a "
        "base station) would take it away",
        tuple((drift.start_s - start_gps_s, drift.end_s - start_gps_s) for drift in told),
        state="doubtful" if sure and size > sd_m else "good",
        handled=True,
    )


def drifting(path: Trajectory, drifts: list[Drift]) -> Trajectory:
    """The ``path`` as unsure as its fixes drift."""
    sd = np.zeros(len(path.gps_s))
    for drift in drifts:
        there = (path.gps_s >= drift.start_s) & (path.gps_s <= drift.end_s)
        sd[there] = np.maximum(sd[there], drift.sd_m)
    return replace(path, sd_pos_ned=np.hypot(path.sd_pos_ned, np.outer(sd, [1.0, 1.0, 0.0])))
