"""Stage fuse: the trajectory, from whatever the drive has."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from automap.errors import InputError, StageError
from automap.io import names
from pipeline.run.stage import Stage, StageContext

if TYPE_CHECKING:
    from automap.fusion.result import FusionResult, WheelResult
    from automap.fusion.weighed import Weighed
    from automap.io.drive import Drive
    from automap.records import ClockModel, Trajectory
    from pipeline.settings.presets import Preset


def run(context: StageContext) -> None:
    """Write the trajectories, sensor errors, innovations and fusion.json."""
    from automap.io.clock_json import read_clock

    drive = context.drive
    if drive.trajectory_file is not None:
        _take_finished(context)
        return
    if not (context.out / names.FIXES).exists():
        if drive.bearings_file is not None:
            _write_summary(context, {"method": "none"})
            context.result = "no trajectory"
            return
        raise InputError(
            f"{drive.path}: there are no fixes, and without GPS nothing can be placed on a map; "
            "add the receiver's log (gnss.ubx or gnss.nmea) or a finished trajectory "
            "(trajectory.csv or trajectory.pos)"
        )
    clock = read_clock(context.out / names.SYNC)
    if not (context.out / names.IMU).exists():
        _smooth_fixes(context, clock, "no IMU recording")
        return
    try:
        _fuse(context)
    except StageError as error:
        # nobody asked for the receiver's own sensors: without them there is still its track
        if not _is_receivers_own(context):
            raise
        context.metrics.clear()
        context.warn(f"{error} (the receiver's own sensors served as the IMU)")
        _smooth_fixes(context, clock, "the receiver's own sensors are left out")


def _is_receivers_own(context: StageContext) -> bool:
    imu = _ingested(context).get("imu") or {}
    return bool(imu.get("source") == "receiver")


def _ingested(context: StageContext) -> dict[str, Any]:
    """What ingest wrote of the recordings."""
    import json

    path = context.out / names.INGEST
    return dict(json.loads(path.read_text(encoding="utf-8"))) if path.exists() else {}


def _take_finished(context: StageContext) -> None:
    """A trajectory from other software, completed and passed on."""
    from automap.io.clock_json import read_clock
    from automap.io.trajectory_file import read_finished

    assert context.drive.trajectory_file is not None
    finished = read_finished(context.drive.trajectory_file)
    trajectory = finished.data
    if finished.time == "t_ns" and (context.out / names.SYNC).exists():
        clock = read_clock(context.out / names.SYNC)
        trajectory = replace(trajectory, gps_s=clock.gps_s(trajectory.t_ns))
    # what is wrong with the file was said by ingest
    _write_trajectory(context, trajectory, names.TRAJECTORY)
    _write_summary(context, {"method": "finished trajectory"})
    context.result = f"{len(trajectory)} rows of the finished trajectory"


def _smooth_fixes(context: StageContext, clock: ClockModel, reason: str) -> None:
    from automap.fusion.doubts.reason import Reason
    from automap.fusion.verdict_alone import weigh_alone
    from pipeline.check.same_drive import OTHER_CODE
    from pipeline.run.fusion_inputs import delay_of_arrivals, read_usable_fixes, stated_arm
    from pipeline.settings.presets import fusion_options

    other = _ingested(context).get("other_drive")
    told = [] if other is None else [Reason(OTHER_CODE, other, handled=True)]
    reason = "the IMU is left out" if told else reason
    context.warn(
        f"{reason}: the trajectory is the smoothed GPS track alone, with headings from the "
        "course; positions of signs will be less sure"
    )
    fixes, receiver = read_usable_fixes(context.out)
    options, presets = fusion_options(context.drive, context.settings.fuse)
    weighed = weigh_alone(
        fixes,
        clock,
        options,
        receiver,
        stated_arm(context.drive),
        told,
        delay_of_arrivals(clock),
    )
    _write_trajectory(context, weighed.trajectory, names.TRAJECTORY)
    context.verdict = weighed.verdict.as_dict()
    content = {"method": "gnss only", "epochs": weighed.rows, "verdict": context.verdict}
    _write_summary(context, content | {"presets": _note_presets(context, presets)})
    context.result = f"{weighed.rows} epochs from GPS alone, smoothed"


def _fuse(context: StageContext) -> None:
    from automap.fusion.aside import put_aside
    from automap.fusion.judged import judged
    from automap.fusion.verdict import weigh
    from automap.io.atomic import scratch_file
    from automap.io.trajectory_table import write_trajectory
    from pipeline.run.fusion_inputs import read_inputs
    from pipeline.settings.presets import fusion_options
    from pipeline.settings.user_effects import activate
    from pipeline.shared.freed import give_freed_back

    settings = context.settings.fuse
    activate(context.settings.effects)
    inputs = read_inputs(context.drive, context.out, settings.imu_delay_sd_s)
    give_freed_back()
    options, presets = fusion_options(context.drive, settings)
    is_clock = inputs.delay_is_clock
    # of a long drive path, filter and samples are gigabytes: put into files, and let go
    with scratch_file(context.work) as file:
        with scratch_file(context.work) as scratch:
            result = inputs.fuse(options, progress=context.progress, scratch=scratch)
            for text in result.warnings:
                context.warn(text)
            write_trajectory(context.work / names.TRAJECTORY_FILTER, result.filter_run())
            fused = put_aside(result.path_run(), result.t_ns, file)
        result = replace(result, path_run=_let_go, filter_run=_let_go)
        drive = judged(
            *(result, fused, inputs.fixes, inputs.clock, options, inputs.delay, is_clock),
            *(inputs.receiver, inputs.lever_arm),
        )
        weighed = weigh(drive, lambda: inputs.imu, context.drive.imu_axes.as_read)
        context.verdict = weighed.verdict.as_dict()
        write_trajectory(context.work / names.TRAJECTORY, weighed.run())
    if weighed.unread_m > 0.0:
        context.warn(
            f"there are no IMU readings for {weighed.unread_m:.0f} m of the way: there the path "
            "rests on the fixes alone, with headings from the course, and signs are less sure; "
            "look for a full or slow card, a loose plug or an IMU on late or off early"
        )
    _write_innovations(context, result)
    _write_parameters(context, result)
    _report(context, result, weighed, is_clock, _note_presets(context, presets))
    if options.tune:
        _write_tuned(context, result, presets)
    metrics = context.metrics
    alone = " alone" if weighed.alone else ""
    context.result = (
        f"{weighed.rows} epochs from {result.n_fixes_used} fixes{alone}, horizontal sd "
        f"{metrics['horizontal_sd_m']:.2f} m, {_delay_text(result.delay.mean, is_clock)}"
    )
    if result.wheels is not None:
        context.result += f", {_wheels_text(result.wheels)}"


def _let_go() -> Iterator[Trajectory]:
    raise StageError("the trajectory was written and let go")


def _delay_text(delay_s: float, is_clock: bool) -> str:
    """The delay in the stage's line: the receiver's where the clock comes from its arrivals."""
    late_ms = -1e3 * delay_s if is_clock else 1e3 * delay_s
    return f"{'receiver' if is_clock else 'IMU'} delay {late_ms:.0f} ms"


def _wheels_text(wheels: WheelResult) -> str:
    """Wheel speed in the stage's line."""
    if wheels.scale is None or wheels.late is None:
        return "wheel speed left out"
    late, side = 1e3 * abs(wheels.late.mean), "late" if wheels.late.mean >= 0.0 else "early"
    return (
        f"wheel speed at {wheels.found.rate_hz:.3g} Hz {late:.0f} ms {side}, "
        f"scale {wheels.scale.mean:.4f}"
    )


def _wheel_figures(wheels: WheelResult) -> dict[str, Any]:
    """Wheel speed for run.json and fusion.json."""
    found = wheels.found
    figures: dict[str, Any] = {
        "odometer_rate_hz": found.rate_hz,
        "odometer_samples": found.count,
        "odometer_stuck": found.stuck,
        "odometer_step_m_s": found.step,
        "odometer_used": wheels.scale is not None,
    }
    if wheels.scale is not None and wheels.late is not None:
        figures |= {
            "odometer_scale": wheels.scale.mean,
            "odometer_scale_sd": wheels.scale.sd,
            "odometer_time_offset_s": wheels.late.mean,
            "odometer_time_offset_sd_s": wheels.late.sd,
        }
    return figures


def _write_trajectory(context: StageContext, trajectory: Trajectory, name: str) -> None:
    from automap.io.trajectory_table import write_trajectory

    write_trajectory(context.work / name, trajectory)


def _write_parameters(context: StageContext, result: FusionResult) -> None:
    from automap.io.tables import write_columns

    history = result.parameters
    columns: dict[str, Any] = {"t_ns": history.t_ns}
    for i, name in enumerate(history.names):
        columns[name] = history.values[:, i]
        columns[f"sd_{name}"] = history.sd[:, i]
    write_columns(context.work / names.IMU_ERRORS, columns)


def _write_innovations(context: StageContext, result: FusionResult) -> None:
    from automap.io.tables import write_columns

    table = result.innovations
    write_columns(
        context.work / names.INNOVATIONS,
        {
            "t_ns": table.t_ns,
            "channel": table.channel,
            "innovation": table.innovation,
            "sd": table.sd,
            "nis": table.nis,
            "accepted": table.accepted,
        },
    )


def _write_tuned(context: StageContext, result: FusionResult, presets: list[Preset]) -> None:
    """The noise levels that were found, as a file for --config."""
    from automap.io.atomic import write_text

    begun = " and ".join(preset.file.stem for preset in presets)
    lines = [
        "# Noise levels found by likelihood on this drive; use them with --config on others.",
        *([f"# They multiply what {begun} say: name the same there."] if begun else []),
        "[fuse]",
        "adapt = false",
        "[fuse.factors]",
        *(f"{name} = {value:.6g}" for name, value in result.noise_factors.items()),
    ]
    write_text(context.work / names.TUNED, "\n".join(lines) + "\n")


def _note_presets(context: StageContext, presets: list[Preset]) -> dict[str, Any]:
    """The presets in use, as metrics and for fusion.json."""
    for preset in presets:
        context.metric(f"{preset.role}_preset", preset.file.stem)
    return {preset.role: preset.as_dict() for preset in presets}


def _report(
    context: StageContext,
    result: FusionResult,
    weighed: Weighed,
    is_clock: bool,
    presets: dict[str, Any],
) -> None:
    """Figures for run.json and fusion.json."""
    from dataclasses import asdict

    import numpy as np

    from automap.fusion.consistency import channel_consistency

    table = result.innovations
    channels = channel_consistency(table)
    refused = 1.0 - float(table.accepted.mean()) if len(table.accepted) else 0.0
    # run.json tells each channel's size (1 is right) and whiteness (0 is right)
    context.metric("innovations_rms", {n: c.normalised_rms for n, c in channels.items()})
    context.metric("innovations_lag1", {n: c.lag1 for n, c in channels.items()})
    rest = sum(stop - start for start, stop in result.standstill)
    context.metric("imu_delay_s", result.delay.mean)
    context.metric("imu_delay_sd_s", result.delay.sd)
    if is_clock:
        context.metric("output_delay_s", -result.delay.mean)
        context.metric("output_delay_sd_s", result.delay.sd)
    context.metric("mounting_rpy_deg", [float(a) for a in np.degrees(result.mounting.rpy)])
    context.metric("mounting_rpy_sd_deg", [float(a) for a in np.degrees(result.mounting.sd)])
    wheels = {} if result.wheels is None else _wheel_figures(result.wheels)
    for name, value in wheels.items():
        context.metric(name, value)
    context.metric("standstill_s", rest)
    context.metric("fixes_used", result.n_fixes_used)
    context.metric("horizontal_sd_m", weighed.horizontal_sd)
    _write_summary(
        context,
        {
            "method": "gnss only" if weighed.alone else "inertial",
            "presets": presets,
            "imu_delay_s": result.delay.mean,
            "imu_delay_sd_s": result.delay.sd,
            "delay_is_clock": is_clock,
            "age_sd_s": result.age_sd,
            "mounting_rpy_deg": [float(a) for a in np.degrees(result.mounting.rpy)],
            "mounting_rpy_sd_deg": [float(a) for a in np.degrees(result.mounting.sd)],
            "align_margin_nats": float(result.align_margin),
            "noise_factors": result.noise_factors,
            "nodes": result.n_nodes,
            "fixes_used": result.n_fixes_used,
            "refused_share": refused,
            "worse_stretches": None if result.worse is None else result.worse.as_dict(),
            "standstill": [[float(a), float(b)] for a, b in result.standstill],
            "wheels": wheels,
            "channels": {name: asdict(item) for name, item in channels.items()},
            "verdict": context.verdict,
        },
    )


def _write_summary(context: StageContext, content: dict[str, Any]) -> None:
    from automap.io.atomic import write_json

    write_json(context.work / names.FUSION, content)


def _inputs(drive: Drive) -> list[Path]:
    from pipeline.settings.presets import preset_files

    files = [drive.manifest_file, *preset_files(drive)]
    files += [f for f in (drive.imu_calibration, drive.trajectory_file) if f is not None]
    return files


STAGE = Stage(
    name="fuse",
    version=51,
    run=run,
    inputs=_inputs,
    needs=(names.IMU, names.FIXES, names.ODOMETER, names.SYNC, names.INGEST),
    outputs=(
        names.TRAJECTORY,
        names.TRAJECTORY_FILTER,
        names.IMU_ERRORS,
        names.INNOVATIONS,
        names.FUSION,
        names.TUNED,
    ),
    settings=("effects", "fuse"),
    setting_files=lambda settings: settings.effects.paths(),
    blind=True,
)
