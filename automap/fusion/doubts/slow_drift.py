"""Positions that drift over minutes by more than their receiver's errors were taken to.

A level of noise is found by all that a drive shows of it, which is most of what lasts for seconds:
a bias that comes and goes over minutes, as of the air, is hardly in it. So waves of minutes are
looked for beside the velocities, and the path is as unsure as they are large. Where
velocities tell little of them, what is known of receivers beforehand counts.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from automap.fusion import limits
from automap.fusion.adapt import COARSE
from automap.fusion.doubts.drift_waves import about_path, take, waves_of
from automap.fusion.doubts.limits import (
    DRIFT_MEAN,
    DRIFT_WAVE_S,
    DRIFT_WINDOW_S,
    PATH_ACCELERATION,
)
from automap.fusion.doubts.offsets import offset_doubts
from automap.fusion.doubts.reason import Reason
from automap.fusion.fix_axes import Epochs, usable_epochs
from automap.fusion.levels import ROAD_ACCELERATION
from automap.fusion.options import FusionOptions
from automap.interpolation import Poses
from automap.records import Fixes, FloatArray, Trajectory


@dataclass(frozen=True)
class Drift:
    """At ``gps_s`` [k] s positions err for minutes by ``sd_m`` [k, 2] m north and east, beyond what
    was taken, which changes by ``rate_sd`` [k, 2] m/s; by ``gain`` nats likelier than not."""

    gps_s: FloatArray
    sd_m: FloatArray
    rate_sd: FloatArray
    gain: float

    @property
    def size(self) -> float:
        """Its mean size, m an axis."""
        return float(np.sqrt(np.mean(self.sd_m**2)))


def pattern_doubts(
    fixes: Fixes,
    alone: Trajectory,
    options: FusionOptions,
    levels: Mapping[str, float],
    sd_m: float,
    told: Sequence[Reason],
    path: Trajectory | None = None,
    by_imu: Mapping[str, float] = MappingProxyType({}),
) -> tuple[list[Reason], list[Drift]]:
    """The reasons that offsets of the positions give, and their drifts where neither those nor any
    that were ``told`` make them; ``alone`` the path of ``fixes``, ``sd_m`` m an axis what the path
    that is judged is good to; ``levels`` as fixes alone tell them, ``by_imu`` as an IMU does that
    has made a ``path``."""
    at = usable_epochs(fixes, options)
    begin = float(alone.gps_s[0] - at.t[0])
    at, motion, levels = beside_motion(at, alone, levels, path, by_imu)
    jumps: list[float] = []
    if any(reason.code == "positions_aside" for reason in told):
        # places between such jumps are told, and which of them are right
        parted = (reason for reason in told if reason.code == "positions_parted")
        jumps = [edge for reason in parted for span in reason.spans for edge in span]
    found = list(offset_doubts(at, motion, options, levels, sd_m, jumps, path is not None))
    doubted = (reason for reason in (*told, *found) if reason.state != "good")
    if any(reason.error_m or reason.late_s for reason in doubted):
        return found, []
    drifts = slow_drifts(at, motion, options, levels, begin)
    return [*found, *drift_doubts(drifts, float(alone.gps_s[0]), sd_m)], drifts


def beside_motion(
    at: Epochs,
    alone: Trajectory,
    levels: Mapping[str, float],
    path: Trajectory | None,
    by_imu: Mapping[str, float],
) -> tuple[Epochs, Trajectory | Poses, Mapping[str, float]]:
    """The epochs ``at`` [k], how the vehicle moved there, and the levels of their errors: by
    ``alone`` [k], which is smoothed of them, or off a ``path`` where it has them. Velocities that
    are not told, and not used, are those of the motion."""
    if path is None:
        untold, z = ~at.used[..., 1], at.z.copy()
        z[..., 1][untold] = alone.vel_ned.T[untold]
        return replace(at, z=z), alone, levels
    # a slow error that shows less than was stated leaves the rest to what lasts
    slow = {name: max(by_imu.get(name, 1.0), 1.0) for name in ("wander", "multipath")}
    levels = {**by_imu, **slow, ROAD_ACCELERATION: PATH_ACCELERATION}
    off, poses = about_path(at, path, alone.gps_s)
    off.z[..., 1][~off.used[..., 1]] = 0.0
    return off, poses, levels


def slow_drifts(
    at: Epochs,
    motion: Trajectory | Poses,
    options: FusionOptions,
    levels: Mapping[str, float],
    begin: float,
) -> list[Drift]:
    """Drifts of the epochs ``at`` [k], ``begin`` s of GPS time later, in windows of some minutes,
    beside the ``motion`` [k] of the vehicle; ``levels`` of their errors."""
    if not len(at.t):
        return []
    span = float(at.t[-1] - at.t[0])
    count = max(math.ceil(span / DRIFT_WINDOW_S), 1)
    waves = int(2.0 * span / count / DRIFT_WAVE_S)
    found = []
    for edge in at.t[0] + span / count * np.arange(count) if waves else ():
        placed = at.used[:2, :, 0].all(axis=0) & (at.t >= edge) & (at.t <= edge + span / count)
        if np.count_nonzero(placed) < limits.LEAST_JUDGED:
            continue
        one = waves_of(take(at, placed), motion.vel_ned[placed, :2], waves, options, levels)
        if one is not None:
            var = one.var + DRIFT_MEAN * one.var.mean(axis=0)
            gain = one.gain - math.log(count)
            found.append(Drift(begin + at.t[placed], np.sqrt(var), np.sqrt(one.rate_var), gain))
    return found


def drift_doubts(drifts: list[Drift], start_gps_s: float, sd_m: float) -> Iterator[Reason]:
    """The reason that drifts give which chance hardly makes; ``start_gps_s`` of the path's first
    row, ``sd_m`` m an axis what the path is good to without them."""
    told = [drift for drift in drifts if drift.gain > COARSE.gain]
    if not told:
        return
    size = max(drift.size for drift in told)
    sure = any(drift.gain > -math.log(limits.DOUBT_PROBABILITY) for drift in told)
    yield Reason(
        "positions_drift",
        f"over minutes positions drift by {size:.1f} m an axis against the velocities, more than "
        "the receiver states: the air, or reflections; the sigmas hold it, corrections (SBAS or a "
        "base station) would take it away",
        tuple(
            (float(drift.gps_s[0]) - start_gps_s, float(drift.gps_s[-1]) - start_gps_s)
            for drift in told
        ),
        state="doubtful" if sure and size > sd_m else "good",
        handled=True,
    )


def drifting(path: Trajectory, drifts: list[Drift]) -> Trajectory:
    """The ``path`` as unsure as its fixes drift, which it follows; before the first and behind the
    last of them as at these, between two windows in between."""
    if not drifts:
        return path
    gps_s = np.concatenate([drift.gps_s for drift in drifts])
    sd, rate = np.zeros((2, len(path.gps_s), 3))
    for whole, parts in (
        (sd, [drift.sd_m for drift in drifts]),
        (rate, [drift.rate_sd for drift in drifts]),
    ):
        for axis, one in enumerate(np.concatenate(parts).T):
            whole[:, axis] = np.interp(path.gps_s, gps_s, one)
    return replace(
        path,
        sd_pos_ned=np.hypot(path.sd_pos_ned, sd),
        sd_vel_ned=np.hypot(path.sd_vel_ned, rate),
    )
