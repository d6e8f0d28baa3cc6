"""One drive run afresh in a process of its own, and what is kept of it."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from automap.errors import AutoMapError
from automap.io import names
from pipeline.regress.reference import processor_seconds, reference_seconds
from pipeline.shared.progress import Reporter, StageLine

if TYPE_CHECKING:
    from automap.records import Trajectory
    from automap.regression import scalars
    from automap.regression.record import DriveRecord
    from pipeline.settings.load import Settings

_COUNTS = ("fixes", "fixes_used", "n_detections", "detections_used")
_PATH_TOLERANCE_M, _PATH_LIMIT = 0.5, 80
"""The path that is stored for drawing: how far off it may be, m, and its points at most."""
_DIGEST_LENGTH = 12
_TRUTH = ("position_rms_m", "velocity_rms", "attitude_rms_deg")


@dataclass(frozen=True)
class Task:
    """A drive to run into ``out``; with ``stages`` only these, for their time alone."""

    drive: Path
    out: Path
    settings: Settings
    stages: tuple[str, ...] = ()


@dataclass(frozen=True)
class Measured:
    """What came of a task: the exit code with its sentence, and times of the stages in units
    of the reference computation."""

    exit_code: int
    error: str = ""
    timing: dict[str, float] = field(default_factory=dict)


class _StageTimes(Reporter):
    """Processor time of each stage that ran, in units of the reference computation, which runs
    before and after it."""

    def __init__(self) -> None:
        self.ratio: dict[str, float] = {}
        self._unit = reference_seconds()
        self._started = 0.0

    def stage_started(self, name: str, reason: str) -> None:
        """Start the clock of the stage."""
        self._started = processor_seconds()

    def stage_finished(self, line: StageLine) -> None:
        """Stop it."""
        if line.state != "ran":
            return
        seconds = processor_seconds() - self._started
        before, self._unit = self._unit, reference_seconds()
        self.ratio[line.name] = seconds / (0.5 * (before + self._unit))


def measure(task: Task) -> Measured:
    """Run the stages of the task, whatever is there of an earlier run, and time them."""
    from pipeline.run import registry
    from pipeline.run.runner import Request, run_drive
    from pipeline.shared.kernel_cache import ensure_kernel_cache

    ensure_kernel_cache()
    request = Request(
        stages=registry.load_stages(registry.ORDER),
        selected=task.stages or registry.ORDER,
        settings=task.settings,
        force=True,
        command=("automap", *sys.argv[1:]),
    )
    times = _StageTimes()
    outcome = run_drive(task.drive, task.out, request, times)
    return Measured(
        exit_code=outcome.exit_code,
        error=str(outcome.error) if outcome.error is not None else "",
        timing=times.ratio,
    )


def read_trajectory_of(out: Path) -> Trajectory | None:
    """The trajectory of a run, None where it made none."""
    if not (out / names.TRAJECTORY).is_file():
        return None
    from automap.io.trajectory_table import read_trajectory

    return read_trajectory(out / names.TRAJECTORY)


def read_record(task: Task, timing: dict[str, float]) -> DriveRecord:
    """The figures of the finished run in ``task.out``."""
    from automap.io.signs_table import read_signs
    from automap.io.tables import floats, read_table
    from automap.regression import epochs, scalars, signs
    from automap.regression.record import DriveRecord
    from pipeline.shared.run_record import read_record as read_run

    out = task.out
    run = read_run(out)
    stages: dict[str, Any] = run.get("stages", {})
    metrics = {name: stage.get("metrics", {}) for name, stage in stages.items()}
    trajectory = read_trajectory_of(out)
    found = read_signs(out / names.SIGNS_RAW) if (out / names.SIGNS_RAW).is_file() else []
    calibration: scalars.Figures = {}
    for stage in ("fuse", "geolocate"):
        calibration |= scalars.from_metrics(metrics.get(stage, {}))
    if (out / names.IMU_ERRORS).is_file():
        table = read_table(out / names.IMU_ERRORS)
        calibration |= scalars.from_errors(
            {name: floats(table, name) for name in table.column_names if name != "t_ns"}
        )
    merged = run.get("metrics", {})
    calibration |= _residuals(merged)
    return DriveRecord(
        epochs=epochs.sample(trajectory) if trajectory is not None else epochs.from_json({}),
        path_en_m=_path(trajectory) if trajectory is not None else [],
        signs=signs.reduce_signs(found),
        sync=scalars.from_metrics(metrics.get("sync", {})),
        calibration=calibration,
        counts={
            **{key: int(merged[key]) for key in _COUNTS if key in merged},
            "epochs": len(trajectory) if trajectory is not None else 0,
        },
        timing=timing,
        truth=_truth(task),
        inputs=_inputs(task.drive, run),
        settings=_settings(task.settings),
    )


def _residuals(metrics: dict[str, Any]) -> scalars.Figures:
    """The scatter of the boxes about the signs, px: what shows a detector first.

    Its sigma is that of a root mean square of so many Gaussian pairs.
    """
    rms, used = metrics.get("residual_rms_px"), metrics.get("detections_used")
    if not isinstance(rms, float) or not isinstance(used, int) or rms <= 0.0 or used < 1:
        return {}
    return {"residual_rms_px": (rms, rms / float(np.sqrt(4.0 * used)))}


def _path(trajectory: Trajectory) -> list[list[float]]:
    """The path for drawing [n][2]: metres east and north of the first stored epoch."""
    from automap.earth import metres_per_radian
    from automap.export.simplify import keep_indices
    from automap.frames import wrap_pi

    known = np.flatnonzero(np.isfinite(trajectory.lat_rad) & np.isfinite(trajectory.lon_rad))
    if len(known) == 0:
        return []
    rows = known[:: max(1, len(known) // 4000)]
    lat, lon = trajectory.lat_rad[rows], trajectory.lon_rad[rows]
    north, east = metres_per_radian(lat[0], 0.0)
    metres = np.column_stack([wrap_pi(lon - lon[0]) * east, (lat - lat[0]) * north])
    # by the way driven and not by time: stops need no points
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(metres, axis=0).T) + 1e-6)])
    kept = keep_indices(way, metres, _PATH_TOLERANCE_M, _PATH_LIMIT)
    return [[round(float(e), 1), round(float(n), 1)] for e, n in metres[kept]]


def _truth(task: Task) -> dict[str, float]:
    """Errors against the drive's truth, where it has one and it can be compared."""
    from pipeline.evaluate.command import evaluate_run
    from pipeline.shared.values import flatten

    try:
        result = evaluate_run(task.out, task.drive / names.TRUTH_DIR)
    except AutoMapError:
        return {}
    wanted = {key: result[key] for key in _TRUTH if key in result}
    flat = {k: v for k, v in flatten(wanted).items() if isinstance(v, int | float)}
    signs = result.get("signs", {})
    for key in ("median_error_m", "coverage95", "class_accuracy"):
        if isinstance(signs.get(key), int | float):
            flat[f"signs.{key}"] = signs[key]
    return {key: float(value) for key, value in flat.items()}


def _inputs(drive: Path, run: dict[str, Any]) -> dict[str, str]:
    """Short digests of the files that went in, by their path in the drive folder."""
    import hashlib

    folder = drive.parent if drive.name == names.MANIFEST else drive
    manifest = hashlib.sha256((folder / names.MANIFEST).read_bytes()).hexdigest()
    digests = {names.MANIFEST: manifest, **run.get("inputs", {})}
    return {name: str(digest)[:_DIGEST_LENGTH] for name, digest in sorted(digests.items())}


def _settings(settings: Settings) -> dict[str, Any]:
    """Settings that are not the defaults, by dotted name."""
    from pipeline.settings.load import load_settings
    from pipeline.shared.values import flatten

    plain, mine = flatten(load_settings().echo()), flatten(settings.echo())
    return {key: value for key, value in mine.items() if plain.get(key) != value}


def _end_with_parent() -> None:
    """A run whose command was killed ends too, and does not hold the folder's lock."""
    import multiprocessing
    import os
    import threading

    parent = multiprocessing.parent_process()
    if parent is None:
        return

    def watch() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def run_tasks(tasks: Sequence[Task], jobs: int) -> list[Measured]:
    """Measure each task in a fresh process, ``jobs`` at a time, in the order given.

    A process of its own for each drive: what one has loaded and compiled shall not make the
    next one faster.
    """
    import multiprocessing
    from concurrent.futures import ProcessPoolExecutor
    from concurrent.futures.process import BrokenProcessPool

    others = set(multiprocessing.active_children())
    context = multiprocessing.get_context("spawn")
    workers = max(1, min(jobs, len(tasks)))
    pool = ProcessPoolExecutor(
        workers, mp_context=context, max_tasks_per_child=1, initializer=_end_with_parent
    )
    try:
        futures = [pool.submit(measure, task) for task in tasks]
        results = []
        for task, future in zip(tasks, futures, strict=True):
            try:
                results.append(future.result())
            except BrokenProcessPool:
                results.append(
                    Measured(
                        4,
                        f"{task.drive}: the process that ran it was ended from outside, perhaps "
                        "for want of memory; run fewer drives at once with --jobs.",
                    )
                )
        return results
    except KeyboardInterrupt:
        # a run that nobody waits for any more would hold the command for minutes
        for child in set(multiprocessing.active_children()) - others:
            child.terminate()
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
