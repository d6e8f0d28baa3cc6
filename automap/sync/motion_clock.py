"""Clock and delay of an IMU from the motions that it and the receiver both saw."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from automap.errors import InputError
from automap.records import ClockModel, Fixes, FloatArray, ImuData
from automap.sync import limits
from automap.sync.coarse import find_offset
from automap.sync.correlation import Lag, refine_lag
from automap.sync.motion import (
    GnssMotion,
    ImuMotion,
    imu_motion,
    position_motion,
    velocity_motion,
)
from automap.sync.result import SyncResult


def imu_gnss_delay(imu: ImuData, clock: ClockModel, fixes: Fixes) -> dict[str, Lag]:
    """How much later the IMU stamps read than the receiver's epochs, under a clock.

    Keys "velocity" (the Doppler velocity against the IMU) and "position" (differences of
    positions), each only where it can be told. The axes of the IMU need not be known.
    """
    motion = imu_motion(imu)
    found = {}
    for source, gnss in gnss_motions(fixes):
        lag = refine_lag(motion, in_imu_time(gnss, clock, imu), 0.0, limits.LAG_REACH_S)
        if lag is not None:
            found[source] = lag
    return found


def correlation_clock(imu: ImuData, fixes: Fixes, drift_sd: float = limits.DRIFT_SD) -> SyncResult:
    """The host clock by comparing motions alone, for logs without arrival times.

    The receiver's own latency cannot be told from the offset and is contained in it.
    Raises InputError when no offset stands out.
    """
    motion = imu_motion(imu)
    base = float(np.nanmin(fixes.gps_s))
    # either source can be missing or poor: the clearer one decides
    candidates = [
        (gnss.shifted(-base), find_offset(motion, gnss.shifted(-base)), source)
        for source, gnss in gnss_motions(fixes)
    ]
    found = [(gnss, coarse, source) for gnss, coarse, source in candidates if coarse is not None]
    spans = (
        f"the IMU covers {float(motion.t_s[-1]):.0f} s, "
        f"the receiver {float(np.nanmax(fixes.gps_s)) - base:.0f} s"
    )
    if not found:
        raise InputError(
            "IMU and receiver share too little motion to find the offset between their clocks "
            f"({spans}); record gnss_arrival.csv, or drive longer and with turns."
        )
    gnss, coarse, source = max(found, key=lambda item: item[1].score_nats)
    if not coarse.certain:
        raise InputError(
            "the offset between IMU clock and GPS time does not stand out from their motions "
            f"({spans}; best {coarse.score_nats:.0f} nats, next {coarse.runner_up_nats:.0f}): they "
            "may not belong to the same drive; record gnss_arrival.csv, or drive with more turns."
        )
    lag = refine_lag(motion, gnss, coarse.offset_s, 1.0)
    if lag is None:
        lag = Lag(coarse.offset_s, limits.OFFSET_STEP_S, coarse.score_nats, 0)
    offset, drift, sd_offset, sd_drift, middle = _lag_line(motion, gnss, lag, drift_sd)
    # IMU seconds = GPS seconds + offset + drift * (GPS seconds - middle)
    ref_ns = int(imu.t_ns[0]) + round((middle + offset) * 1e9)
    clock = ClockModel(
        ref_ns=ref_ns,
        ref_gps_s=base + middle,
        drift=1.0 / (1.0 + drift) - 1.0,
        sd_offset_s=sd_offset,
        sd_drift=sd_drift,
        method="correlation",
        output_delay_s=None,
    )
    warnings = [
        "no arrival times: the clocks were matched by their motion, good to "
        f"{sd_offset * 1e3:.0f} ms"
    ]
    lags = imu_gnss_delay(imu, clock, fixes)
    return SyncResult(
        clock,
        lag=lags.get(source),
        lag_source=source,
        lags=lags,
        coarse=coarse,
        warnings=warnings,
    )


def gnss_motions(fixes: Fixes) -> list[tuple[str, GnssMotion]]:
    """Receiver motions by source, "velocity" and "position", those long enough to compare."""
    motions = [("velocity", velocity_motion(fixes)), ("position", position_motion(fixes))]
    return [(s, motion) for s, motion in motions if len(motion.start) >= limits.LEAST_MOTIONS]


def in_imu_time(gnss: GnssMotion, clock: ClockModel, imu: ImuData) -> GnssMotion:
    """Receiver intervals in seconds after the first IMU stamp."""

    def seconds(gps_s: FloatArray) -> FloatArray:
        return np.asarray((clock.t_ns(gps_s) - imu.t_ns[0]) * 1e-9, np.float64)

    return GnssMotion(seconds(gnss.start), seconds(gnss.end), gnss.turn, gnss.surge, gnss.speed)


def _lag_line(
    motion: ImuMotion, gnss: GnssMotion, lag: Lag, drift_sd: float
) -> tuple[float, float, float, float, float]:
    """Lag and its rate by parts of the drive: (lag, rate, sd, sd of rate, GPS seconds)."""
    first, last = float(gnss.start[0]), float(gnss.start[-1])
    overlap_first = max(first, -lag.lag_s)
    overlap_last = min(last, float(motion.t_s[-1]) - lag.lag_s)
    count = int(np.clip((overlap_last - overlap_first) / limits.SEGMENT_S, 1, limits.MOST_SEGMENTS))
    middle = 0.5 * (overlap_first + overlap_last)
    if count < 3:
        return lag.lag_s, 0.0, lag.sd_s, drift_sd, middle
    edges = np.linspace(overlap_first, overlap_last, count + 1)
    rows = []
    for start, end in pairwise(edges):
        part = gnss.part(float(start), float(end))
        if len(part.start) >= limits.LEAST_INTERVALS:
            piece = refine_lag(motion, part, lag.lag_s, 0.6)
            if piece is not None and piece.gain_nats > limits.SEGMENT_NATS:
                rows.append((0.5 * (start + end) - middle, piece.lag_s, piece.sd_s))
    if len(rows) < 3:
        return lag.lag_s, 0.0, lag.sd_s, drift_sd, middle
    x, y, sd = (np.array(column) for column in zip(*rows, strict=True))
    design = np.column_stack([np.ones(len(x)), x]) / sd[:, None]
    normal = design.T @ design + np.diag([0.0, drift_sd**-2])
    covariance = np.linalg.inv(normal)
    offset, rate = covariance @ (design.T @ (y / sd))
    return (
        float(offset),
        float(rate),
        float(np.sqrt(covariance[0, 0])),
        float(np.sqrt(covariance[1, 1])),
        middle,
    )
