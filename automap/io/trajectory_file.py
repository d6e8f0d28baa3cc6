"""A finished trajectory from other software, in whichever of its forms."""

from __future__ import annotations

from pathlib import Path

from automap.io.finished import FinishedTrajectory
from automap.io.trajectory_csv import read_trajectory_csv
from automap.io.trajectory_pos import read_trajectory_pos


def read_finished(path: Path) -> FinishedTrajectory:
    """Read a finished trajectory, ``.csv`` or RTKLIB's ``.pos``; InputError when unusable."""
    return (read_trajectory_pos if path.suffix.lower() == ".pos" else read_trajectory_csv)(path)
