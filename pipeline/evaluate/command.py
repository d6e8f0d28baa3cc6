"""``automap evaluate``: a run's results against the drive's truth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from automap.errors import AutoMapError, InputError
from automap.evaluation import limits
from automap.evaluation.reference import contradiction
from automap.evaluation.sign_matching import points_of, summarise_signs
from automap.evaluation.trajectory_errors import (
    position_rms,
    raw_fix_errors,
    summarise_trajectory,
    trajectory_errors,
)
from automap.io import names
from automap.io.atomic import write_json
from automap.io.sign_points import read_sign_points
from automap.io.trust import check_inside
from automap.io.truth_trajectory import read_truth_trajectory
from automap.records import NO_TIME, Fixes, FloatArray, SignPoints, Trajectory
from pipeline.evaluate.requirements import check_requirements
from pipeline.shared.run_record import drive_of, results_of

__all__ = ["check_requirements", "evaluate_run"]

_RESULTS = (names.TRAJECTORY, names.SIGNS_GEOJSON, names.SIGNS_RAW)


def evaluate_run(
    out: Path, truth_dir: Path | None = None, truth_sd: float | None = None
) -> dict[str, Any]:
    """Compare the results in ``out`` with the truth and write ``evaluation.json`` there.

    ``truth_dir`` defaults to the drive's ``truth`` folder. ``truth_sd`` is the one-sigma
    error in metres of the truth signs and then stands instead of their own ``sd_m``. What
    has no truth, or no result, is left out of the file. Raises InputError when nothing can
    be compared.
    """
    out = results_of(Path(out))
    if not out.is_dir():
        raise InputError(f"{out}: no such output folder; give the folder that a run wrote.")
    drive_dir = drive_of(out)[1]
    truth = Path(truth_dir) if truth_dir is not None else drive_dir / names.TRUTH_DIR
    trajectory_truth = truth / names.TRUTH_TRAJECTORY
    signs_truth = truth / names.TRUTH_SIGNS
    for path in (trajectory_truth, signs_truth):
        check_inside(path, drive_dir if truth_dir is None else truth, str(truth))
    if not any((out / name).is_file() for name in _RESULTS):
        raise InputError(f"{out} holds neither a trajectory nor signs; run the drive first.")
    if not trajectory_truth.is_file() and not signs_truth.is_file():
        raise InputError(
            f"{truth}: no truth found ({names.TRUTH_TRAJECTORY} or {names.TRUTH_SIGNS}); "
            "name its folder with --truth."
        )
    result: dict[str, Any] = {}
    if trajectory_truth.is_file() and (out / names.TRAJECTORY).is_file():
        result |= _evaluate_trajectory(out, trajectory_truth, drive_dir)
    if signs_truth.is_file():
        estimate = _result_signs(out)
        if estimate is not None:
            result["signs"] = summarise_signs(estimate, _truth_signs(signs_truth, truth_sd))
    if not result:
        raise InputError(
            f"{out}: holds neither a trajectory nor signs that {truth} has a truth for; "
            "run the stages first."
        )
    write_json(out / names.EVALUATION, result)
    return result


def _evaluate_trajectory(out: Path, truth_path: Path, drive_dir: Path) -> dict[str, Any]:
    from automap.io.tables import read_fixes
    from automap.io.trajectory_table import read_trajectory

    estimate = read_trajectory(out / names.TRAJECTORY)
    warnings: list[str] = []
    truth = read_truth_trajectory(truth_path, warnings)
    if len(estimate) == 0:
        raise InputError(f"{out / names.TRAJECTORY}: has no rows; run the fuse stage again.")
    errors = trajectory_errors(estimate, truth)
    if not np.isfinite(errors.error[:, 0]).any():
        raise InputError(
            f"{truth_path}: no epoch of the truth lies within the run's trajectory; "
            "check that both belong to the same drive and clock."
        )
    result = summarise_trajectory(errors)
    if told := contradiction(truth, errors):
        warnings.append(f"{truth_path}: {told}.")
    if (out / names.FIXES).is_file():
        raw = _raw_errors(read_fixes(out / names.FIXES), truth, estimate, drive_dir)
        if len(raw):
            result["raw_position_rms_m"] = position_rms(raw)
            if far := _far_off(result):
                warnings.append(f"{truth_path}: {far}.")
    if warnings:
        result["warnings"] = warnings
    return result


def _far_off(result: Mapping[str, Any]) -> str | None:
    """A sentence where path and fixes agree, and not with the truth."""
    told = ("position_rms_m", "raw_position_rms_m")
    path, fixes = (result[name]["horizontal"] or 0.0 for name in told)
    if min(path, fixes) < limits.FAR_M:
        return None
    return (
        f"path and fixes both lie far off the truth, {path:.0f} and {fixes:.0f} m: check that it "
        "is of this drive, that its gps_s are GPS seconds (18 s more than those of UTC), and its "
        "columns lat_deg and lon_deg"
    )


def _raw_errors(
    fixes: Fixes, truth: Trajectory, estimate: Trajectory, drive_dir: Path
) -> FloatArray:
    """Errors of the receiver's own fixes; a truth without GPS time borrows the run's clock."""
    if not np.isfinite(truth.gps_s).any() and truth.t_ns[0] != NO_TIME:
        base = truth.t_ns[0]
        gps_s = np.interp(
            (truth.t_ns - base) * 1e-9,
            (estimate.t_ns - base) * 1e-9,
            estimate.gps_s,
            left=np.nan,
            right=np.nan,
        )
        rows = np.flatnonzero(np.isfinite(gps_s))
        truth = replace(_rows(truth, rows), gps_s=gps_s[rows])
    return raw_fix_errors(fixes, truth, _antenna_lever_arm(drive_dir))


def _rows(trajectory: Trajectory, rows: np.ndarray[Any, np.dtype[np.int64]]) -> Trajectory:
    return Trajectory(
        **{name: getattr(trajectory, name)[rows] for name in Trajectory.__dataclass_fields__}
    )


def _antenna_lever_arm(drive_dir: Path) -> FloatArray:
    """IMU to antenna from the manifest, zero where there is none."""
    from automap.io.drive import load_drive

    try:
        arm = load_drive(drive_dir).gnss.lever_arm_m
    except (AutoMapError, AttributeError):
        return np.zeros(3)
    return np.zeros(3) if arm is None else np.asarray(arm, np.float64)


def _result_signs(out: Path) -> SignPoints | None:
    """The map's signs, or those of the geolocate stage where no map was written yet."""
    if (out / names.SIGNS_GEOJSON).is_file():
        return read_sign_points(out / names.SIGNS_GEOJSON)
    if not (out / names.SIGNS_RAW).is_file():
        return None
    from automap.io.signs_table import read_signs

    return points_of(read_signs(out / names.SIGNS_RAW))


def _truth_signs(path: Path, truth_sd: float | None) -> SignPoints:
    truth = read_sign_points(path)
    if truth_sd is None:
        return truth
    return replace(truth, sd_m=np.full(len(truth), truth_sd))
