"""Stage sync: the clock that leads from the drive's stamps to GPS time."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from automap.errors import InputError
from automap.io import names
from pipeline.run.stage import Stage, StageContext

if TYPE_CHECKING:
    from automap.io.drive import Drive
    from automap.records import ClockModel, Fixes, ImuData
    from automap.sync.result import SyncResult


def run(context: StageContext) -> None:
    """Write sync.json and, for a clock from arrival times, sync_delays.parquet."""
    from automap.io.clock_json import write_clocks
    from automap.io.tables import read_fixes, read_imu
    from automap.records import DriveClocks
    from automap.sync.receiver_filter import receiver_filter, taken_back

    imu_path, fixes_path = context.out / names.IMU, context.out / names.FIXES
    imu = read_imu(imu_path) if imu_path.exists() else None
    told = read_fixes(fixes_path) if fixes_path.exists() else None
    fixes, late_s = (None, 0.0) if told is None else _usable(told)
    base, result = _find_clock(context, imu, fixes)
    behind = None
    if imu is not None and fixes is not None:
        behind = receiver_filter(imu, fixes, result.clock, late_s)
    if told is not None and behind is not None:
        fixes, _ = _usable(taken_back(told, behind))
        base, result = _find_clock(context, imu, fixes)
    for text in result.warnings:
        context.warn(text)
    arrival = _arrival_clock(context, base, fixes)
    arrival_base = None if arrival is None else context.drive.gnss.arrival_time
    clocks = DriveClocks(result.clock, base, arrival, arrival_base, behind, result.shown_offset_s)
    write_clocks(context.work / names.SYNC, clocks, _diagnostics(result))
    if result.fit is not None and fixes is not None:
        _write_delays(context.work / names.SYNC_DELAYS, result, fixes)
    _metrics(context, result)
    context.result = _in_words(result)


def _usable(fixes: Fixes) -> tuple[Fixes, float]:
    """Fixes without what is wrong with them by themselves, as ``automap check`` compares them, and
    by how much, s, their velocities are later than their positions."""
    from automap.fusion.doubts.receiver import usable_fixes
    from automap.sync.velocity_consistency import velocity_consistency

    found = velocity_consistency(fixes)
    lags = [lag.value for lag in (found.match.speed_lag_s, found.match.course_lag_s) if lag]
    return usable_fixes(fixes, found), sum(lags) / max(len(lags), 1)


def _find_clock(
    context: StageContext, imu: ImuData | None, fixes: Fixes | None
) -> tuple[str, SyncResult]:
    """The name of the clock of the trajectory's stamps, and how it leads to GPS time."""
    from automap.sync.clock import has_arrival, stated_clock, synchronise, unknown_clock
    from automap.sync.finished import trajectory_clock
    from automap.sync.result import SyncResult

    drive = context.drive
    drift_sd = context.settings.sync.drift_sd_ppm * 1e-6
    if drive.trajectory_file is not None:
        from automap.io.trajectory_file import read_finished

        finished = read_finished(drive.trajectory_file)
        t_ns = finished.data.t_ns
        if finished.time == "both":
            return drive.imu.time, SyncResult(trajectory_clock(t_ns, finished.data.gps_s))
        stamps = "gps_ns" if finished.time == "gps_s" else drive.imu.time
        if stamps != "boot_ns":
            return stamps, SyncResult(stated_clock(t_ns, stamps))
        if imu is None and not (has_arrival(fixes) and drive.gnss.arrival_time == stamps):
            return stamps, unknown_clock(t_ns)
    base: str = drive.gnss.arrival_time if has_arrival(fixes) else "gps_ns"
    if imu is not None:
        base = _imu_time(context)
    result = synchronise(
        imu,
        fixes,
        imu_time=base,
        arrival_time=drive.gnss.arrival_time,
        output_delay_s=drive.gnss.output_delay_s,
        drift_sd=drift_sd,
    )
    return base, result


def _imu_time(context: StageContext) -> str:
    """The clock of the IMU stamps: the manifest's, unless they are the receiver's own."""
    import json

    path = context.out / names.INGEST
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return context.drive.imu.time
    except ValueError as error:
        raise InputError(f"{path} is damaged ({error}); run again with --force.") from error
    summary = found.get("imu") or {}
    return str(summary.get("time", context.drive.imu.time))


def _arrival_clock(context: StageContext, base: str, fixes: Fixes | None) -> ClockModel | None:
    """The clock of the arrival times where it is not that of the trajectory.

    Cameras stamped by the same host need it. A fit that fails is no harm without a camera.
    """
    from automap.sync.arrival import fit_arrival_clock
    from automap.sync.clock import has_arrival

    gnss = context.drive.gnss
    if fixes is None or not has_arrival(fixes) or gnss.arrival_time == base:
        return None
    try:
        fit = fit_arrival_clock(fixes.arrival_ns, fixes.gps_s, gnss.output_delay_s)
    except InputError as error:
        context.warn(f"{context.drive.arrival_file}: {error}")
        return None
    return fit.clock


_WAYS = {
    "identity": "stamps are GPS time",
    "arrival": "clock by arrival times",
    "unix": "clock by UNIX time",
    "correlation": "clock by comparing motions",
    "trajectory": "clock of the trajectory itself",
    "none": "no way to GPS time",
}


def _in_words(result: SyncResult) -> str:
    clock = result.clock
    words = _WAYS.get(clock.method, clock.method)
    if clock.method in ("none", "identity"):
        return words if clock.ref_ns else "nothing to synchronise"
    text = f"{words}, good to {1e3 * clock.sd_offset_s:.2g} ms"
    if clock.sd_drift < abs(clock.drift):
        text += f", rate off by {1e6 * clock.drift:+.1f} ppm"
    return text


def _diagnostics(result: SyncResult) -> dict[str, Any]:
    fit, lag = result.fit, result.lag
    content: dict[str, Any] = {
        "offset_s": result.clock.ref_gps_s - result.clock.ref_ns * 1e-9,
        "drift_ppm": result.clock.drift * 1e6,
        "imu_delay_s": lag.lag_s if lag is not None else None,
        "imu_delay_sd_s": lag.sd_s if lag is not None else None,
        "imu_delay_source": result.lag_source,
    }
    for source, item in result.lags.items():
        content[f"imu_delay_{source}_s"] = item.lag_s
        content[f"imu_delay_{source}_sd_s"] = item.sd_s
    if result.coarse is not None:
        content["motion_offset_s"] = result.coarse.offset_s
        content["motion_score_nats"] = result.coarse.score_nats
        content["motion_runner_up_nats"] = result.coarse.runner_up_nats
    if fit is not None:
        content |= {
            "epochs": len(fit.used),
            "epochs_used": int(fit.used.sum()),
            "epochs_early": fit.early,
            "waiting_median_s": fit.waiting_s,
            "waiting_shape": fit.shape,
            "clock_wander_s": fit.wander_s,
        }
    return content


def _write_delays(path: Path, result: SyncResult, fixes: Fixes) -> None:
    """Delay of every epoch that has an arrival time, and the line below them."""
    import numpy as np

    from automap.io.tables import write_columns

    assert result.fit is not None
    rows = np.flatnonzero(np.isfinite(result.fit.delay_s))
    least = result.clock.output_delay_s or 0.0
    write_columns(
        path,
        {
            "t_ns": fixes.arrival_ns[rows],
            "gps_s": fixes.gps_s[rows],
            "delay_s": result.fit.delay_s[rows],
            "envelope_s": np.full(len(rows), least),
            "used": result.fit.used[rows],
        },
    )


def _metrics(context: StageContext, result: SyncResult) -> None:
    clock = result.clock
    context.metric("sync_method", clock.method)
    context.metric("sync_offset_s", clock.ref_gps_s - clock.ref_ns * 1e-9)
    context.metric("sync_offset_sd_s", clock.sd_offset_s)
    context.metric("sync_drift_ppm", clock.drift * 1e6)
    context.metric("sync_drift_sd_ppm", clock.sd_drift * 1e6)
    context.metric("sync_output_delay_s", clock.output_delay_s)
    if result.fit is not None:
        context.metric("sync_waiting_median_s", result.fit.waiting_s)
    if result.lag is not None:
        context.metric("sync_imu_delay_s", result.lag.lag_s)
        context.metric("sync_imu_delay_sd_s", result.lag.sd_s)


def _inputs(drive: Drive) -> list[Path]:
    files = [drive.manifest_file]
    if drive.trajectory_file is not None:
        files.append(drive.trajectory_file)
    return files


STAGE = Stage(
    name="sync",
    version=12,
    run=run,
    inputs=_inputs,
    needs=(names.IMU, names.FIXES, names.INGEST),
    outputs=(names.SYNC, names.SYNC_DELAYS),
    settings=("sync",),
    blind=True,
)
