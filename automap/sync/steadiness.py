"""Whether the clocks of IMU and receiver keep their distance over a drive.

The offset between the motions that both saw is estimated in pieces of the drive. A clock of
another rate, from the start or from some time on, bends the offsets; one that was set steps them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Literal

import numpy as np

from automap.records import BoolArray, ClockModel, Fixes, FloatArray, ImuData
from automap.sync import limits
from automap.sync.coarse import find_offset
from automap.sync.correlation import refine_lag
from automap.sync.motion import GnssMotion, ImuMotion, imu_motion
from automap.sync.motion_clock import gnss_motions, in_imu_time

_ALLOWED = {"jump": limits.STEP_ERROR_S, "rate": limits.MAX_RATE}


@dataclass(frozen=True)
class Piece:
    """From ``start_s`` to ``end_s`` after the first reading, one sigma ``sd_s``, the IMU's stamps
    read ``lag_s`` more than the receiver's epochs."""

    start_s: float
    end_s: float
    lag_s: float
    sd_s: float


@dataclass(frozen=True)
class ClockChange:
    """The IMU's stamps go wrong by ``size`` (s of a "jump", s/s of a "rate"), one sigma ``sd``,
    between ``first_s`` and ``last_s`` after the first reading; a rate, from the start where both
    are zero. ``probability`` of the like where the clocks keep their distance."""

    kind: Literal["jump", "rate"]
    first_s: float
    last_s: float
    size: float
    sd: float
    probability: float


def lags_by_piece(imu: ImuData, fixes: Fixes, clock: ClockModel | None) -> list[Piece]:
    """The lags of those pieces in which one stands out, by velocities or else by positions.

    ``clock`` is what the stamps themselves say; without one the lags are found as far apart as
    the clocks may be. What the receiver saw while there are no readings has no lag: the best one
    would be that of another motion.
    """
    motion = imu_motion(imu)
    best: list[Piece] = []
    for _, gnss in gnss_motions(fixes):
        reach_s: float | None = limits.STATED_REACH_S
        if clock is not None:
            seconds = in_imu_time(gnss, clock, imu)
        else:
            seconds, reach_s = gnss.shifted(-float(gnss.start[0])), None
            whole = find_offset(motion, seconds)
            if whole is None:
                continue
            seconds = seconds.shifted(whole.offset_s)
        found = _pieces(motion, seconds, reach_s)
        best = found if len(found) > len(best) else best
    return best


def clock_change(pieces: Sequence[Piece]) -> ClockChange | None:
    """The likeliest change of a clock that chance makes more seldom than
    ``CHANGE_PROBABILITY``, in all the places where it was looked for; None where there is none.

    By Student's t of weighted least squares, of what exceeds a sound clock's rate and a step that
    is none. The scatter of the lags is the drive's own, for receivers' delays vary, beside what
    other drives showed. Nor may it be pieces whose lags were mistaken, and chance in all others.
    """
    if len(pieces) < 2 * limits.SIDE_PIECES:
        return None
    lag = np.array([piece.lag_s for piece in pieces])
    sd = np.array([piece.sd_s for piece in pieces])
    # a piece that seems much surer than the others is no surer of its receiver's delay
    sd = np.maximum(sd, np.median(sd))
    tried = [(change, _fitted(change, lag, sd)) for change in _changes(pieces)]
    likely = limits.CHANGE_PROBABILITY / len(tried)
    for change, found in sorted(tried, key=lambda item: item[1].probability):
        if found.probability >= likely:
            return None
        # the place is known by now, so that nothing is tried any more
        if _mistaken(change, lag, sd) < limits.CHANGE_PROBABILITY:
            return found
    return None


def _mistaken(change: _Shape, lag: FloatArray, sd: FloatArray) -> float:
    """Probability that some pieces' lags [n], one sigma ``sd`` [n] s, are those of other motions,
    as ``MISTAKEN_LAG`` of them are, and the change is chance in all others.

    A lag that is mistaken lies anywhere in the search: two of them are seldom as near to what a
    change makes of them as two lags of one clock.
    """
    design, value, _, found = _least_squares(change, lag, sd, change.use)
    off = np.zeros(len(lag))
    off[change.use] = sd[change.use] * np.abs(value - design @ found)
    near = np.minimum(np.maximum(off, sd) / limits.STATED_REACH_S, 1.0)
    used = np.flatnonzero(change.use).tolist()
    total = 0.0
    for count in range(1, len(used)):
        each = limits.MISTAKEN_LAG**count
        if each < limits.CHANGE_PROBABILITY:
            break
        for without in combinations(used, count):
            # the first one may be anywhere: the size of the change is what it says
            alike = float(np.prod(np.sort(near[list(without)])[1:]))
            total += each * alike * _fitted(change, lag, sd, without).probability
    return total


def _pieces(motion: ImuMotion, gnss: GnssMotion, reach_s: float | None) -> list[Piece]:
    first, last = float(gnss.start[0]), float(gnss.end[-1])
    length = max(limits.PIECE_S, (last - first) / limits.MOST_PIECES)
    found = []
    for start in np.arange(first, last - 0.5 * length, length).tolist():
        part = gnss.part(start, start + length)
        read = np.isfinite(motion.between(part.start, part.end)[:, 0])
        if not len(read) or read.mean() * length < limits.LEAST_OVERLAP_S:
            continue
        near = motion
        if reach_s is not None:
            near = motion.part(start - reach_s, start + length + reach_s)
        coarse = find_offset(near, part, reach_s)
        if coarse is None or not coarse.certain:
            continue
        lag = refine_lag(near, part, coarse.offset_s, limits.LAG_REACH_S)
        if lag is not None:
            ends = (float(part.start[0]) + lag.lag_s, float(part.end[-1]) + lag.lag_s)
            found.append(Piece(*ends, lag.lag_s, lag.sd_s))
    return found


@dataclass(frozen=True)
class _Shape:
    """A change to try: lags are a constant and a size times ``shape`` [n] in the pieces ``use``."""

    kind: Literal["jump", "rate"]
    first_s: float
    last_s: float
    shape: FloatArray
    use: BoolArray


def _changes(pieces: Sequence[Piece]) -> Iterator[_Shape]:
    start, end, lag = (
        np.array([getattr(piece, name) for piece in pieces])
        for name in ("start_s", "end_s", "lag_s")
    )
    felt = 0.5 * (start + end)
    middle = felt - lag
    count, side = len(pieces), limits.SIDE_PIECES
    whole = np.ones(count, np.bool_)
    yield _Shape("rate", 0.0, 0.0, middle - middle[0], whole)
    for i in range(side, count - side + 1):
        later = (np.arange(count) >= i).astype(float)
        yield _Shape("jump", start[i - 1], end[i], later, whole)
        bent = np.maximum(middle - 0.5 * (middle[i - 1] + middle[i]), 0.0)
        yield _Shape("rate", start[i - 1], end[i], bent, whole)
        if i + side < count:
            # the piece within which a clock jumps has a lag of neither side
            yield _Shape("jump", felt[i - 1], felt[i + 1], later, np.arange(count) != i)


def _least_squares(
    change: _Shape, lag: FloatArray, sd: FloatArray, use: BoolArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Design [k, 2] and lags [k] of the pieces in ``use`` [n], by their sigmas; the covariance
    [2, 2] of a constant and of the size of a change, and both [2]."""
    design = np.column_stack([np.ones(len(lag)), change.shape])[use] / sd[use, None]
    value = lag[use] / sd[use]
    covariance = np.asarray(np.linalg.inv(design.T @ design))
    return design, value, covariance, covariance @ design.T @ value


def _fitted(
    change: _Shape, lag: FloatArray, sd: FloatArray, without: Sequence[int] = ()
) -> ClockChange:
    """The size of a change by lags [n], where those ``without`` are given by all others."""
    from scipy.special import stdtr

    use = change.use & ~np.isin(np.arange(len(lag)), without)
    told = ClockChange(change.kind, change.first_s, change.last_s, 0.0, np.inf, 1.0)
    if len(np.unique(change.shape[use])) < 2:
        return told
    design, value, covariance, found = _least_squares(change, lag, sd, use)
    worth, usual = limits.SCATTER_PIECES, limits.LAG_SCATTER**2
    dof = len(value) - 2 + worth
    scatter = (worth * usual + float(((value - design @ found) ** 2).sum())) / dof
    size, spread = float(found[1]), float(np.sqrt(scatter * covariance[1, 1]))
    beyond = max(abs(size) - _ALLOWED[change.kind], 0.0) / spread
    return replace(told, size=size, sd=spread, probability=2.0 * float(stdtr(dof, -beyond)))
