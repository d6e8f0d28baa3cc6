"""Errors of a recorded receiver for a simulated drive: of a drive with truth, or of a table."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from automap.errors import InputError
from automap.evaluation.fix_errors import fix_errors
from automap.io import names
from automap.io.drive import load_drive
from automap.io.fix_errors_csv import read_fix_errors_csv
from automap.io.recording import read_drive_log
from automap.io.truth_trajectory import read_truth_trajectory
from automap.records import FixErrors


def recorded_errors(source: Path) -> FixErrors:
    """The errors of a drive folder's receiver against its truth, or those of a table (CSV).

    Raises InputError where there are none.
    """
    if not source.is_dir():
        return read_fix_errors_csv(source)
    drive = load_drive(source)
    if drive.gnss_file is None:
        raise InputError(f"{source} has no receiver whose errors could be replayed.")
    truth = read_truth_trajectory(source / names.TRUTH_DIR / names.TRUTH_TRAJECTORY)
    if not (np.isfinite(truth.gps_s).all() and np.isfinite(truth.vel_ned).any()):
        raise InputError(
            f"{source}: its truth has no GPS times or no velocities; give gps_s, vn, ve and vd."
        )
    fixes = read_drive_log(drive).fixes
    arm = np.zeros(3) if drive.gnss.lever_arm_m is None else np.array(drive.gnss.lever_arm_m)
    errors = fix_errors(fixes, truth, arm)
    if len(errors) < 2:
        raise InputError(
            f"{source}: no fix lies within the truth; check that they belong together."
        )
    return errors
