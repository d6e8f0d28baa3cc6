"""How an IMU lies in its vehicle in each piece of a drive, by what it feels of the motion there."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from automap.earth import STANDARD_GRAVITY
from automap.gates import exceeds_ratio
from automap.records import ClockModel, Fixes, FloatArray, ImuData
from automap.robust import cauchy_weight
from automap.sync import limits
from automap.sync.axes_evidence import (
    AxesEvidence,
    Followed,
    RunningSums,
    axes_evidence,
    receiver_motion,
)
from automap.sync.motion import GnssMotion


@dataclass(frozen=True)
class MountPiece:
    """What readings from ``start_s`` to ``end_s``, s after the first one, show: the evidence
    ``seen`` of their axes; the direction [3] of the force on a level road at one speed, ``raw`` as
    if all roads were level and ``level`` with the climbs of the receiver's heights taken off, NaN
    where too little is driven; the ``azimuth`` rad of the vehicle's forward axis about up, and its
    sigma ``azimuth_sd``, infinite where the motion does not tell it."""

    start_s: float
    end_s: float
    seen: AxesEvidence
    raw: FloatArray
    level: FloatArray
    azimuth: float = 0.0
    azimuth_sd: float = math.inf


def mount_pieces(
    imu: ImuData, fixes: Fixes, clock: ClockModel, whole: AxesEvidence
) -> list[MountPiece]:
    """The pieces of a drive in which the receiver shows a motion to compare with; ``whole`` is the
    evidence of all of it."""
    motion = receiver_motion(fixes, clock, imu)
    if motion is None:
        return []
    sums = RunningSums(imu)
    forces = None if whole.surge is None else _forces(sums, motion, whole, fixes, clock, imu)
    stamps = np.asarray((clock.t_ns(fixes.gps_s) - int(imu.t_ns[0])) * 1e-9)
    first, last = max(float(motion.start[0]), 0.0), min(float(motion.end[-1]), float(sums.t[-1]))
    count = int(np.clip((last - first) / limits.PIECE_S, 2, limits.MOST_PIECES))
    edges = np.linspace(first, last, count + 1)
    found = []
    for start, end in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
        part = (stamps >= start) & (stamps < end)
        reach = limits.AXES_LAG_S + limits.AXES_WINDOW_S
        rows = slice(*np.searchsorted(sums.t, (start - reach, end + reach)))
        if rows.stop - rows.start < 2:
            continue
        there = replace(fixes, gps_s=np.where(part, fixes.gps_s, np.nan))
        seen = axes_evidence(imu.at(rows), there, clock)
        none = np.full(3, np.nan)
        raw, level = (none, none) if forces is None else forces.between(start, end)
        azimuth = forward_azimuth(seen, whole.up) or (0.0, math.inf)
        found.append(MountPiece(start, end, seen, raw, level, *azimuth))
    return found


@dataclass(frozen=True)
class _Forces:
    """Mean specific ``force`` [m, 3] m/s^2 over windows from ``start`` [m] s while the vehicle
    drives, beside its accelerations forward and to the right and the slope it climbs, times
    gravity, ``known`` [m, 3] m/s^2."""

    start: FloatArray
    force: FloatArray
    known: FloatArray

    def between(self, start_s: float, end_s: float) -> tuple[FloatArray, FloatArray]:
        """The direction [3] of the force of a level road, as if all were and by the slopes."""
        rows = np.flatnonzero((self.start >= start_s) & (self.start < end_s))
        if len(rows) < limits.LEAST_INTERVALS:
            return np.full(3, np.nan), np.full(3, np.nan)
        accelerations, climb = self.known[rows, :2], self.known[rows, 2:]
        return (
            _constant(self.force[rows], accelerations),
            _constant(self.force[rows], accelerations + np.pad(climb, ((0, 0), (0, 1)))),
        )


def _constant(force: FloatArray, explained: FloatArray) -> FloatArray:
    """The direction [3] of the part of forces [k, 3] that is there without what is ``explained``
    [k, j], robustly."""
    design = np.column_stack([np.ones(len(force)), explained])
    weight = np.ones(len(force))
    found = np.zeros((design.shape[1], 3))
    for _ in range(limits.LEVEL_ROUNDS):
        root = np.sqrt(weight)[:, None]
        found = np.linalg.lstsq(root * design, root * force, rcond=None)[0]
        square = ((force - design @ found) ** 2).sum(axis=1)
        weight = np.asarray(cauchy_weight(square / max(float(np.median(square)), 1e-12)))
    return np.asarray(found[0] / max(float(np.linalg.norm(found[0])), 1e-12))


def _forces(
    sums: RunningSums,
    motion: GnssMotion,
    whole: AxesEvidence,
    fixes: Fixes,
    clock: ClockModel,
    imu: ImuData,
) -> _Forces:
    """Forces beside what the receiver says of the motion, where the vehicle drives."""
    assert whole.surge is not None
    lag, length = whole.surge.lag_s, motion.end - motion.start
    turn_lag = lag if whole.lateral is None else whole.lateral.lag_s
    force = sums.between(motion.start + lag, motion.end + lag)[:, :3] / length[:, None]
    middle = 0.5 * (motion.start + motion.end)
    turn = np.interp(middle + lag - turn_lag, middle, np.nan_to_num(motion.turn))
    climb = _climbs(motion, middle, fixes, clock, imu)
    known = np.column_stack(
        [motion.surge / length, turn / length, STANDARD_GRAVITY * np.sin(np.arctan(climb))]
    )
    use = np.isfinite(force).all(axis=1) & (motion.speed > limits.SLOW_M_S)
    return _Forces(motion.start[use], force[use], known[use])


def _climbs(
    motion: GnssMotion, middle: FloatArray, fixes: Fixes, clock: ClockModel, imu: ImuData
) -> FloatArray:
    """The slope [m] of the road at times ``middle`` [m] s, by the receiver's heights over a
    hill's length of way; 0 where none are told."""
    stamps = np.asarray((clock.t_ns(fixes.gps_s) - int(imu.t_ns[0])) * 1e-9)
    good = np.flatnonzero(np.isfinite(stamps) & np.isfinite(fixes.height_m))
    if len(good) < 2:
        return np.zeros(len(middle))
    good = good[np.argsort(stamps[good], kind="stable")]
    way = np.concatenate([[0.0], np.cumsum(motion.speed[:-1] * np.diff(middle))])
    # at rest the way stays, and so does the height
    way = way + 1e-6 * middle
    half = 0.5 * limits.CLIMB_WAY_M
    ends = [np.interp(way + side * half, way, middle) for side in (-1.0, 1.0)]
    before, after = (np.interp(t, stamps[good], fixes.height_m[good]) for t in ends)
    span = np.interp(ends[1], middle, way) - np.interp(ends[0], middle, way)
    return np.asarray((after - before) / np.maximum(span, half))


def forward_azimuth(seen: AxesEvidence, up: FloatArray) -> tuple[float, float] | None:
    """The azimuth, rad, of the vehicle's forward axis in the readings, about ``up`` [3], and its
    sigma; None where the motion does not tell it."""
    level = level_axes(up)
    told = [
        azimuth
        for azimuth in (_azimuth(seen.surge, level, 0.0), _azimuth(seen.lateral, level, 0.5))
        if azimuth is not None
    ]
    if not told:
        return None
    weight = np.array([1.0 / sd**2 for _, sd in told])
    off = [math.remainder(azimuth - told[0][0], 2.0 * math.pi) for azimuth, _ in told]
    mean = float(weight @ off / weight.sum())
    # where the two contradict each other neither is as sure as it says
    scatter = float(weight @ (np.array(off) - mean) ** 2)
    return told[0][0] + mean, math.sqrt(max(scatter, 1.0) / weight.sum())


def level_axes(up: FloatArray) -> FloatArray:
    """Two directions [2, 3] square to ``up`` [3] and to each other."""
    helper = np.eye(3)[int(np.argmin(np.abs(up)))]
    first = np.cross(up, helper)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(up, first)])


def _by_chance(seen: Followed) -> float:
    """Probability that three channels explain as much of noise at one of the lags that were tried,
    which differ where they are further apart than what is compared is long."""
    ratio = seen.share / 3.0 / max((1.0 - seen.share) / (seen.count - 3.0), 1e-12)
    lags = 1.0 + 2.0 * limits.AXES_LAG_S / limits.AXES_WINDOW_S
    return lags * exceeds_ratio(ratio, 3, seen.count - 3.0)


def _azimuth(
    seen: Followed | None, level: FloatArray, quarters: float
) -> tuple[float, float] | None:
    """The azimuth of the force that goes with what was ``seen``, in the axes ``level`` [2, 3], less
    ``quarters`` of pi to the right, and its sigma by least squares."""
    if seen is None or seen.count <= 3.0 or _by_chance(seen) > limits.MISTAKEN_LAG:
        return None
    normal = level @ seen.xx @ level.T
    slope = np.linalg.solve(normal, level @ seen.xy)
    length = float(np.linalg.norm(slope))
    rest = max(seen.yy - float(slope @ level @ seen.xy), 0.0)
    if length <= 0.0:
        return None
    across = np.array([-slope[1], slope[0]]) / length
    var = rest / (seen.count - 3.0) * float(across @ np.linalg.solve(normal, across))
    # azimuths grow to the left, about up
    azimuth = math.atan2(slope[1], slope[0]) + quarters * math.pi
    return azimuth, math.sqrt(var) / length
