"""Which way leads from the stamps of a drive to GPS time, and what the motions say of it."""

from __future__ import annotations

import numpy as np

from automap.errors import InputError
from automap.records import NO_TIME, ClockModel, Fixes, FloatArray, ImuData, IntArray
from automap.sync import limits
from automap.sync.arrival import fit_arrival_clock
from automap.sync.coarse import CoarseOffset, find_offset
from automap.sync.correlation import Lag, refine_lag
from automap.sync.motion import ImuMotion, imu_motion, position_motion
from automap.sync.motion_clock import (
    correlation_clock,
    gnss_motions,
    in_imu_time,
)
from automap.sync.result import SyncResult
from automap.timebase import gps_to_iso, gps_to_unix, leap_seconds_at_gps, unix_to_gps


def synchronise(
    imu: ImuData | None,
    fixes: Fixes | None,
    imu_time: str = "boot_ns",
    arrival_time: str = "boot_ns",
    output_delay_s: float | None = None,
    drift_sd: float = limits.DRIFT_SD,
) -> SyncResult:
    """Find the clock of a drive from what was recorded.

    ``imu_time`` and ``arrival_time`` name the clocks of the IMU stamps and of
    ``fixes.arrival_ns``: "boot_ns" (the host's own), "gps_ns" or "unix_ns". The model is
    that of the IMU stamps; without an IMU that of the arrival times, and without those that
    of GPS time in nanoseconds. Ways, in this order: stamps that are GPS time; arrival times
    in the clock of the stamps; UNIX time by the table of leap seconds; the motions that IMU
    and receiver both saw.

    Raises InputError when the clocks contradict one another, and says what was seen.
    """
    has_fixes = fixes is not None and bool(np.isfinite(fixes.gps_s).any())
    if imu is None or len(imu) == 0:
        return _without_imu(fixes if has_fixes else None, arrival_time, output_delay_s, drift_sd)
    result = _by_stamps(imu, fixes, imu_time, arrival_time, output_delay_s, drift_sd)
    if fixes is None or not has_fixes:
        return unknown_clock(imu.t_ns) if result is None else result
    if result is None:
        return correlation_clock(imu, fixes, drift_sd)
    check_overlap(result.clock, imu.t_ns, fixes.gps_s)
    return _compare_motions(result, imu, fixes)


def rough_clock(
    imu: ImuData,
    fixes: Fixes,
    imu_time: str = "boot_ns",
    arrival_time: str = "boot_ns",
    output_delay_s: float | None = None,
) -> ClockModel | None:
    """The same clock before motions are compared, good to some tenths of a second; None for fixes
    without times. Raises InputError as ``synchronise``."""
    found = _by_stamps(imu, fixes, imu_time, arrival_time, output_delay_s, limits.DRIFT_SD)
    if found is None and not np.isfinite(fixes.gps_s).any():
        return None
    return correlation_clock(imu, fixes).clock if found is None else found.clock


def contradiction(clock: ClockModel | None, imu: ImuData, fixes: Fixes | None) -> str | None:
    """The sentence with which ``synchronise`` refuses a ``clock`` of the stamps for the motions
    that IMU and receiver saw; None where they agree or tell nothing."""
    if clock is None or fixes is None or not len(fixes):
        return None
    try:
        _compare_motions(SyncResult(clock), imu, fixes)
    except InputError as error:
        return str(error)
    return None


def _by_stamps(
    imu: ImuData,
    fixes: Fixes | None,
    imu_time: str,
    arrival_time: str,
    output_delay_s: float | None,
    drift_sd: float,
) -> SyncResult | None:
    """What the stamps alone say, None where they have nothing in common with GPS time."""
    if imu_time == "gps_ns":
        return SyncResult(gps_clock(imu.t_ns))
    dated = fixes is not None and bool(np.isfinite(fixes.gps_s).any())
    if fixes is not None and dated and has_arrival(fixes) and arrival_time == imu_time:
        fit = fit_arrival_clock(fixes.arrival_ns, fixes.gps_s, output_delay_s, drift_sd)
        return SyncResult(fit.clock, fit=fit, warnings=list(fit.warnings))
    return SyncResult(unix_clock(imu.t_ns)) if imu_time == "unix_ns" else None


def stated_clock(t_ns: IntArray, time_base: str) -> ClockModel:
    """The clock of stamps [n] that the manifest states to be "gps_ns" or "unix_ns"."""
    return gps_clock(t_ns) if time_base == "gps_ns" else unix_clock(t_ns)


def gps_clock(t_ns: IntArray) -> ClockModel:
    """The clock of stamps [n] that are GPS time in nanoseconds."""
    ref = int(t_ns[0]) if len(t_ns) else 0
    return ClockModel(ref, ref * 1e-9, 0.0, limits.GPS_SD_S, limits.GPS_DRIFT_SD, "identity", 0.0)


def unix_clock(t_ns: IntArray) -> ClockModel:
    """The clock of stamps [n] that are UNIX time in nanoseconds, set as computers are."""
    ref = int(np.median(t_ns).astype(np.int64)) if len(t_ns) else 0
    gps_s = float(unix_to_gps(ref * 1e-9))
    return ClockModel(ref, gps_s, 0.0, limits.UNIX_SD_S, limits.UNIX_DRIFT_SD, "unix", None)


def unknown_clock(t_ns: IntArray) -> SyncResult:
    """Host stamps [n] that nothing ties to GPS time: taken as they are, and said."""
    ref = int(t_ns[0])
    return SyncResult(
        ClockModel(ref, ref * 1e-9, 0.0, float("inf"), limits.DRIFT_SD, "none", None),
        warnings=["no receiver and no absolute clock: times are the host's, not GPS time"],
    )


def check_overlap(clock: ClockModel, t_ns: IntArray, gps_s: FloatArray) -> None:
    """InputError when stamps [n] and epochs [m] share no time under a clock; says both spans."""
    first, last = (float(value) for value in clock.gps_s(t_ns[[0, -1]]))
    start, end = float(np.nanmin(gps_s)), float(np.nanmax(gps_s))
    if first <= end and start <= last:
        return
    apart = start - last if start > last else end - first
    unix_epoch = start - float(gps_to_unix(start))
    hints = {
        "The IMU stamps look like UNIX time": first - start + unix_epoch,
        "The IMU stamps look like GPS time": first - start - unix_epoch,
    }
    hint = next((f" {text}." for text, value in hints.items() if abs(value) < 7200.0), "")
    raise InputError(
        f"IMU and receiver do not overlap in time: the IMU runs from {_utc(first)} to "
        f"{_utc(last)}, the receiver from {_utc(start)} to {_utc(end)}, {abs(apart):.0f} s apart. "
        f"Check that both files are of the same drive and [imu] time in drive.toml.{hint}"
    )


def _utc(gps_s: float) -> str:
    if not np.isfinite(gps_s) or not 0.0 <= gps_s < 4e9:
        return f"GPS second {gps_s:.0f}"
    return gps_to_iso(gps_s)


def has_arrival(fixes: Fixes | None) -> bool:
    """Whether any epoch has an arrival time."""
    return fixes is not None and bool((fixes.arrival_ns != NO_TIME).any())


def _without_imu(
    fixes: Fixes | None, arrival_time: str, output_delay_s: float | None, drift_sd: float
) -> SyncResult:
    if fixes is None:
        return SyncResult(ClockModel(0, 0.0, 0.0, 0.0, 0.0, "identity", 0.0))
    if arrival_time != "gps_ns" and has_arrival(fixes):
        fit = fit_arrival_clock(fixes.arrival_ns, fixes.gps_s, output_delay_s, drift_sd)
        return SyncResult(fit.clock, fit=fit, warnings=list(fit.warnings))
    known = fixes.gps_s[np.isfinite(fixes.gps_s)]
    return SyncResult(gps_clock(np.rint(known[:1] * 1e9).astype(np.int64)))


def _compare_motions(result: SyncResult, imu: ImuData, fixes: Fixes) -> SyncResult:
    """Add the lag to a result, and refuse a clock that the motions contradict."""
    motion = imu_motion(imu)
    lags: dict[str, Lag] = {}
    coarse = None
    for source, gnss in gnss_motions(fixes):
        own = in_imu_time(gnss, result.clock, imu)
        if source == "velocity" or coarse is None:
            coarse = find_offset(motion, own, reach_s=limits.STATED_REACH_S) or coarse
        seen = refine_lag(motion, own, _middle_of_search(coarse), limits.LAG_REACH_S)
        if seen is not None:
            lags[source] = seen
    warnings, doubts = list(result.warnings), list[str]()
    if coarse is not None and coarse.certain and abs(coarse.offset_s) > limits.STATED_OFF_S:
        own = in_imu_time(position_motion(fixes), result.clock, imu)
        placed = find_offset(motion, own, reach_s=limits.STATED_REACH_S)
        if placed is not None and placed.certain and abs(placed.offset_s) <= limits.STATED_OFF_S:
            warnings.append(
                f"the receiver's velocities show the motion {-coarse.offset_s:+.1f} s late and its "
                "positions do not: its speeds and courses are smoothed; log those of an instant"
            )
            coarse = placed
        else:
            _refuse(result.clock, coarse, _near_zero(motion, result.clock, imu, fixes), doubts)
    best, lag = _best_lag(lags)
    shown_s = _off_by_motions(result.clock, coarse)
    if shown_s is not None and not doubts:
        doubts.append(
            f"the IMU stamps read {shown_s:+.1f} s against the receiver's motion (clock by "
            f"{result.clock.method}): the motions are believed; set the recorder's clock over the "
            "network, or log fixes of an instant if it is they that come late"
        )
    warnings += doubts
    return SyncResult(result.clock, result.fit, lag, best, lags, coarse, shown_s, warnings)


def _off_by_motions(clock: ClockModel, coarse: CoarseOffset | None) -> float | None:
    """By how much, s, the motions leave no doubt that a computer's clock is off: more than a
    receiver's velocities are late."""
    if clock.method != "unix" or coarse is None or not coarse.certain:
        return None
    return coarse.offset_s if abs(coarse.offset_s) > limits.DELAY_SD_S else None


def _middle_of_search(coarse: CoarseOffset | None) -> float:
    """About where a lag is searched: at what stands out, where that is near an end else."""
    if coarse is None or not coarse.certain or abs(coarse.offset_s) < 0.5 * limits.LAG_REACH_S:
        return 0.0
    return coarse.offset_s


def _near_zero(
    motion: ImuMotion, clock: ClockModel, imu: ImuData, fixes: Fixes
) -> CoarseOffset | None:
    for _, gnss in gnss_motions(fixes):
        near = find_offset(motion, in_imu_time(gnss, clock, imu), reach_s=limits.STATED_OFF_S)
        if near is not None:
            return near
    return None


def _refuse(
    clock: ClockModel, coarse: CoarseOffset, near: CoarseOffset | None, warnings: list[str]
) -> None:
    """An offset of seconds that the motions leave no doubt of is an error, else a warning; one that
    a receiver's smoothing makes is no error either."""
    better = coarse.score_nats - (near.score_nats if near is not None else 0.0)
    leap = float(leap_seconds_at_gps(clock.ref_gps_s))
    hint = ""
    if abs(abs(coarse.offset_s) - leap) < 1.0:
        hint = f", the {leap:.0f} leap seconds between GPS time and UTC"
    elif abs(coarse.offset_s - round(coarse.offset_s)) < 0.3:
        hint = ", nearly whole seconds"
    seen = (
        f"the IMU stamps read {coarse.offset_s:+.1f} s against the receiver's motion{hint} "
        f"(clock by {clock.method})"
    )
    if better > limits.DOUBTED_CLOCK_NATS and -limits.SMOOTHED_S < coarse.offset_s < 0.0:
        warnings.append(
            f"{seen}: the receiver smooths what it tells, so that it comes late, or one of the two "
            "clocks is wrong; log the receiver's own fixes, and check [imu] time in drive.toml"
        )
    elif better > limits.WRONG_CLOCK_NATS:
        by_motions = ' time = "boot_ns" there takes the clock from the motions.'
        raise InputError(
            f"{seen}: the two clocks contradict one another. Check [imu] time and [gnss] "
            "arrival_time in drive.toml, and that both files are of the same drive."
            + (by_motions if clock.method == "unix" else "")
        )
    elif better > limits.DOUBTED_CLOCK_NATS:
        warnings.append(f"{seen}, though the evidence is weak; check [imu] time in drive.toml")


def _best_lag(lags: dict[str, Lag]) -> tuple[str | None, Lag | None]:
    """The lag behind the positions where they tell it well, else behind the velocities."""
    position, velocity = lags.get("position"), lags.get("velocity")
    if position is not None and (
        velocity is None or position.sd_s < max(0.05, 1.5 * velocity.sd_s)
    ):
        return "position", position
    if velocity is not None:
        return "velocity", velocity
    return None, None
