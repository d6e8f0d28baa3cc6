"""Inertial readings that cannot be: single wild ones, and ones that stay the same or go straight.

They are bridged by the readings beside them, and the filter takes what lies between as unknown: a
gap inside the recording.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from automap.fusion import limits
from automap.records import BoolArray, FloatArray, ImuData


@dataclass(frozen=True)
class Bridged:
    """A recording whose unusable readings are replaced: ``imu``, how long each replaced stretch is
    at its samples, ``stretch_s`` [n] s, zero elsewhere, and what was found: instants of the wild
    readings [w] and intervals (start, stop) of frozen ones, s from the first sample."""

    imu: ImuData
    stretch_s: FloatArray
    wild_s: FloatArray
    frozen: list[tuple[float, float]]


def bridge_unusable(imu: ImuData) -> Bridged:
    """Replace wild and frozen readings by lines between their good neighbours."""
    t = np.asarray((imu.t_ns - imu.t_ns[0]) * 1e-9)
    readings = np.concatenate([imu.gyro, imu.accel], axis=1)
    frozen = _frozen(t, readings)
    wild = _wild(t, readings, ~frozen)
    bad = wild | frozen
    stretch = np.zeros(len(t))
    if not bad.any() or bad.all():
        return Bridged(imu, stretch, np.zeros(0), [])
    good = ~bad
    filled = np.stack([np.interp(t, t[good], column[good]) for column in readings.T], axis=1)
    for first, stop in _runs(bad):
        before, after = max(first - 1, 0), min(stop, len(t) - 1)
        stretch[before:after] = t[after] - t[before]
    intervals = [(float(t[a]), float(t[b - 1])) for a, b in _runs(frozen)]
    bridged = replace(imu, gyro=filled[:, :3], accel=filled[:, 3:])
    return Bridged(bridged, stretch, t[wild], intervals)


def bridge_noise(stretch_s: FloatArray, force_sd: float, rate_sd: float) -> FloatArray:
    """PSD [n, 2] of force and rate across bridges: errors of one sigma ``force_sd`` m/s^2 and
    ``rate_sd`` rad/s that last as long as the bridge."""
    return np.asarray(stretch_s[:, None] * np.array([force_sd, rate_sd]) ** 2)


def gap_noise(
    t: FloatArray,
    gyro: FloatArray,
    accel: FloatArray,
    longest_s: float,
    force_sd: float,
    rate_sd: float,
) -> FloatArray:
    """PSD [n, 2] of force and rate over the steps from instants ``t`` [n] s to the next ones: none
    over steps up to ``longest_s``, for a gap what a line over it errs by.

    In a short gap that is the root mean square by which the drive's readings lie off the middle of
    the two that are half the gap to either side; in one that may hold a bend or a stop of its own,
    and at most, it is ``force_sd`` m/s^2 and ``rate_sd`` rad/s.
    """
    width = np.diff(t, append=t[-1:])
    lost = np.flatnonzero(width > longest_s)
    psd = np.zeros((len(t), 2))
    psd[lost] = width[lost, None] * np.array([force_sd, rate_sd]) ** 2
    lost = lost[width[lost] <= limits.SHORT_GAP_S]
    half = np.rint(0.5 * width[lost] / np.median(width)).astype(np.int64)
    # some rows tell the mean as well as all of a long drive
    rows = np.arange(0, len(t), max(len(t) // limits.GAP_ROWS, 1))
    for count in np.unique(half).tolist():
        gaps = lost[half == count]
        apart = 0.5 * float(width[gaps].mean())
        for column, readings in enumerate((accel, gyro)):
            off = [
                axis[rows] - 0.5 * sum(np.interp(t[rows] + s, t, axis) for s in (-apart, apart))
                for axis in readings.T
            ]
            seen = width[gaps] * np.mean(np.square(off), axis=1).max()
            psd[gaps, column] = np.minimum(psd[gaps, column], seen)
    return psd


def _wild(t: FloatArray, readings: FloatArray, known: BoolArray) -> BoolArray:
    """Readings that are no motion of a vehicle, and far off the median of their neighbourhood by
    what the drive's others are off."""
    from scipy.ndimage import median_filter

    out = np.zeros(len(t), dtype=bool)
    step = float(np.median(np.diff(t))) if len(t) > 1 else 1.0
    width = max(2 * round(0.5 * limits.WILD_WINDOW_S / step) + 1, 5)
    if len(t) < width or not known.any():
        return out
    for sensor, most in (
        (slice(0, 3), limits.MOST_RATE),
        (slice(3, 6), limits.MOST_FORCE),
    ):
        part = readings[:, sensor]
        beyond = np.abs(part).max(axis=1) > most
        if beyond.any():
            away = np.abs(part - median_filter(part, size=(width, 1), mode="nearest")).max(axis=1)
            usual = float(np.percentile(away[known], limits.USUAL_READINGS_PERCENT))
            # where they usually are so far off it is another unit
            out |= beyond & (away > limits.WILD_RATIO * usual)
    return out


def _frozen(t: FloatArray, readings: FloatArray) -> BoolArray:
    """Readings that repeat all six values, or go on lines, for longer than noise allows."""
    same = np.zeros(len(t), dtype=bool)
    same[1:] = (readings[1:] == readings[:-1]).all(axis=1)
    if len(t) > 2:
        share = (t[1:-1] - t[:-2]) / (t[2:] - t[:-2])
        straight = np.ones(len(share), dtype=bool)
        for column in readings.T:
            bend = np.abs(column[1:-1] - (1.0 - share) * column[:-2] - share * column[2:])
            straight &= bend < limits.STRAIGHT_BEND * np.median(bend)
        same[1:-1] |= straight
    out = np.zeros(len(t), dtype=bool)
    for first, stop in _runs(same):
        if t[stop - 1] - t[first - 1] >= limits.FROZEN_S:
            # the first of them may have been read
            out[first:stop] = True
    return out


def _runs(mask: BoolArray) -> list[tuple[int, int]]:
    """First and one past the last index of each stretch that is set."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(np.int8), [0]])))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]
