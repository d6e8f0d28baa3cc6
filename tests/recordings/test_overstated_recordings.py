"""Recorded fixes whose receiver states far more than they err by."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from automap.evaluation.trajectory_errors import trajectory_errors
from automap.io import names
from automap.io.trajectory_table import read_trajectory
from tests.benchmarks.faults.drives import phone
from tests.benchmarks.faults.judge import verdict_of
from tests.benchmarks.faults.run import automap


@pytest.mark.slow
def test_a_phone_that_states_twenty_metres_keeps_its_nose_ahead(
    shared_data: Path, tmp_path: Path
) -> None:
    """Its levels are found where its errors are: the nose was 7.6 deg off, and the IMU blamed."""
    recording = phone(shared_data / "drives" / "gsdc-mtv1")
    recording.log.now.dop[:] = 20.0
    drive, out = tmp_path / "drive", tmp_path / "out"
    recording.write_to(drive)
    code, told = automap("run", str(drive), "-o", str(out), "--to", "fuse", "--quiet")
    assert code == 0, told
    _, reasons = verdict_of(out)
    assert "path_sideways" not in {reason.code for reason in reasons}
    errors = trajectory_errors(read_trajectory(out / names.TRAJECTORY), recording.truth)
    ratio = errors.error[:, 8] / errors.sd[:, 8]
    assert float(np.mean(np.abs(ratio[np.isfinite(ratio)]) < 1.96)) > 0.9
    assert float(np.nanmedian(errors.sd[:, 8])) < np.radians(1.0)
