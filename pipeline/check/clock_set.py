"""Clocks that were set by quarters of an hour while they recorded, as for summer time."""

from __future__ import annotations

import numpy as np

from automap.earth import local_ned
from automap.evaluation.plausibility import Finding
from automap.records import Fixes, FloatArray
from automap.timebase import QUARTER_S, gps_to_iso
from pipeline.check import limits

ADVICE = (
    "a clock was set while it recorded, as for summer time: correct the times from there on, or "
    "cut the drive in two there"
)
IMU_CODE, FIX_CODE = "imu_clock_set", "gnss_clock_set"


def fixes_set(fixes: Fixes) -> Finding | None:
    """An error for times of fixes that jump while the vehicle drives on as if they did not.

    It is where it would be one usual step later, at the same velocity: a vehicle that comes by
    again is there at a quarter of an hour to half a step once in 900 times at 1 Hz, if it comes by
    at all.
    """
    rows = np.flatnonzero(np.isfinite(fixes.gps_s) & np.isfinite(fixes.lat_rad))
    if len(rows) < 2:
        return None
    t = fixes.gps_s[rows]
    steps = np.diff(t)
    usual = float(np.median(steps))
    if usual <= 0.0:  # most have one time, which other checks tell
        return None
    size = _set_by(steps, usual, 0.5 * usual)
    reference = (float(fixes.lat_rad[rows[0]]), float(fixes.lon_rad[rows[0]]), 0.0)
    flat = np.zeros(len(rows))
    place = local_ned(fixes.lat_rad[rows], fixes.lon_rad[rows], flat, reference)[:, :2]
    wide = max(1, round(limits.SET_WAY_S / usual))  # steps, so that noise is little beside the way
    for k in np.flatnonzero(size):
        if k < wide or k + 1 + wide >= len(rows):
            continue
        before = (place[k] - place[k - wide]) / (t[k] - t[k - wide])
        after = (place[k + 1 + wide] - place[k + 1]) / (t[k + 1 + wide] - t[k + 1])
        speed = min(np.hypot(*before), np.hypot(*after))
        off = place[k + 1] - place[k] - 0.5 * (before + after) * (steps[k] - size[k])
        near = limits.SET_PART * speed
        if (
            speed >= limits.SET_SPEED_M_S
            and np.hypot(*(after - before)) < near
            and np.hypot(*off) < near * max(usual, limits.SET_WAY_S)
        ):
            text = (
                f"the times of the fixes jump by {size[k] / 60:.0f} min after "
                f"{gps_to_iso(float(t[k]))}, and the vehicle drives on from where it was"
            )
            return Finding("error", text, ADVICE, FIX_CODE)
    return None


def one_set(gps_s: FloatArray, fixes: Fixes) -> Finding | None:
    """An error for stamps of readings [n], GPS s, or of fixes, that jump away from the others'.

    A file that is lost leaves such a gap too; then the others go on behind it.
    """
    at = fixes.gps_s[np.isfinite(fixes.gps_s) & np.isfinite(fixes.lat_rad)]
    for stamps, others, what, alone, code in (
        (gps_s, at, "the IMU's stamps", "no fix lies", IMU_CODE),
        (at, gps_s, "the times of the fixes", "no reading lies", FIX_CODE),
    ):
        jump = _left_others(stamps, others)
        if jump is not None:
            text = (
                f"{what} jump by {jump[1] / 60:.0f} min after {gps_to_iso(jump[0])}: {alone} "
                "behind that, and those before it fit with the jump taken out"
            )
            return Finding("error", text, ADVICE, code)
    return None


def _left_others(stamps: FloatArray, others: FloatArray) -> tuple[float, float] | None:
    """Where ``stamps`` [n] jump, and by how much, s, if ``others`` [m] lie behind the jump only
    with it taken out."""
    steps = np.diff(stamps)
    if not len(steps):
        return None
    k = int(np.argmax(steps))
    usual = float(np.median(steps))
    size = float(_set_by(steps[k : k + 1], usual, max(usual, limits.SET_JITTER_S))[0])
    if not size:
        return None
    begin, end = stamps[k + 1], stamps[-1]
    fitting = others[(others >= begin - size) & (others <= end - size)]
    if np.any((others >= begin) & (others <= end)) or len(fitting) < 2:
        return None
    if np.ptp(fitting) < limits.SHORT_OVERLAP * (end - begin):
        return None
    return float(stamps[k]), size


def _set_by(steps: FloatArray, usual: float, tolerance: float) -> FloatArray:
    """The quarters of an hour [n], s, by which steps [n] are longer than usual; 0 for others."""
    longer = steps - usual
    size = QUARTER_S * np.round(longer / QUARTER_S)
    return np.where(np.abs(longer - size) <= tolerance, size, 0.0)
