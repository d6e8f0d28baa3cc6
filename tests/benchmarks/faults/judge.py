"""How a run is judged: its exit, its verdict, and its errors over what it states of them."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from automap.errors import InputError
from automap.evaluation.trajectory_errors import trajectory_errors
from automap.io.trajectory_table import read_trajectory
from automap.records import Trajectory
from tests.benchmarks.faults.catalogue import CONTROL
from tests.benchmarks.faults.fault import Fault, Stretch
from tests.benchmarks.faults.log import Floats

MOST_SIGMA = 3.0
"""RMS of error over sigma up to which sigmas are believed: errors wander, so that a drive of some
minutes has few independent ones, and an RMS of 3 is no chance there."""
MOST_MISSING = 0.1
"""Share of the truth's epochs that a path may leave out and still be of the whole drive."""
BAD_INPUT = 3
WARNING_STATES = ("doubtful", "unusable")


@dataclass(frozen=True)
class Errors:
    """RMS of errors in m, of stated sigmas in m, and of error over sigma by axis NED."""

    horizontal_m: float
    vertical_m: float
    stated_m: float
    ratio: tuple[float, float, float]

    @property
    def held(self) -> bool:
        """Whether the stated sigmas hold the errors on every axis."""
        return all(r <= MOST_SIGMA for r in self.ratio)


@dataclass(frozen=True)
class Row:
    """A line of the table. ``outcome``: ``passed``, ``failed``, or ``beyond`` what can be seen;
    ``how`` says why; ``told`` what the program said of an error."""

    drive: str
    fault: str
    code: int
    state: str
    reasons: tuple[str, ...]
    whole: Errors | None
    stretch: Errors | None
    missing: float
    outcome: str
    how: str
    told: str = ""


def errors_of(estimate: Trajectory, truth: Trajectory, stretch: Stretch) -> tuple[Any, ...]:
    """Errors over the whole truth and over a stretch of it (None where there is nothing to
    compare), and the share of the truth's epochs that the estimate leaves out."""
    found = trajectory_errors(estimate, truth)
    inside = (truth.gps_s >= stretch[0]) & (truth.gps_s <= stretch[1])
    missing = found.n_not_covered / max(len(truth), 1)
    whole, part = (_errors(found.error[rows], found.sd[rows]) for rows in (slice(None), inside))
    return whole, part, missing


def _errors(error: Floats, sd: Floats) -> Errors | None:
    known = np.isfinite(error[:, :3]).all(axis=1)
    if not known.any():
        return None
    e, s = error[known, :3], sd[known, :3]
    with np.errstate(divide="ignore", invalid="ignore"):
        # a sigma that is not stated holds nothing
        ratios = np.where(s > 0.0, e / s, np.inf)
        ratio = np.sqrt(np.mean(ratios**2, axis=0))
    horizontal, stated = (
        float(np.sqrt(np.mean(x[:, 0] ** 2 + x[:, 1] ** 2))) for x in (e, np.nan_to_num(s))
    )
    vertical = float(np.sqrt(np.mean(e[:, 2] ** 2)))
    return Errors(horizontal, vertical, stated, (float(ratio[0]), float(ratio[1]), float(ratio[2])))


def verdict_of(out: Path) -> tuple[str, tuple[str, ...]]:
    """State and reasons as run.json tells them; ``none`` where it tells none."""
    try:
        told = json.loads((out / "run.json").read_text(encoding="utf-8")).get("verdict")
    except (OSError, ValueError):
        return "none", ()
    if not told:
        return "none", ()
    return str(told["state"]), tuple(_text(reason) for reason in told.get("reasons", ()))


def _text(reason: Any) -> str:
    return " ".join(map(str, reason.values())) if isinstance(reason, dict) else str(reason)


def judge(
    drive: str,
    fault: Fault,
    stretch: Stretch,
    truth: Trajectory,
    out: Path,
    code: int,
    message: str,
    files: tuple[str, ...],
) -> Row:
    """The line of one run. ``message`` is what it wrote to its error stream, ``files`` the names
    of the drive's files."""
    state, reasons = verdict_of(out)
    whole = part = None
    missing = 1.0
    if code == 0:
        try:
            estimate = read_trajectory(out / "trajectory.parquet")
            whole, part, missing = errors_of(estimate, truth, stretch)
        except (OSError, InputError) as error:
            message = str(error)
    outcome, how = _outcome(fault, code, state, reasons, whole, missing, message, files)
    told = message if code else ""
    return Row(drive, fault.name, code, state, reasons, whole, part, missing, outcome, how, told)


def _outcome(
    fault: Fault,
    code: int,
    state: str,
    reasons: tuple[str, ...],
    whole: Errors | None,
    missing: float,
    message: str,
    files: tuple[str, ...],
) -> tuple[str, str]:
    held = whole is not None and whole.held and missing <= MOST_MISSING
    if fault.name == CONTROL:
        if state in WARNING_STATES:
            return "failed", "cries wolf"
        return ("passed", "within sigma") if held else ("failed", "beyond sigma")
    if code == BAD_INPUT:
        named = any(name in message for name in files)
        return ("passed", "refused") if named else ("failed", "refused without a file's name")
    if code:
        return "failed", f"exit code {code}"
    if held:
        return "passed", "within sigma"
    if state in WARNING_STATES and any(fault.fits(reason) for reason in reasons):
        return "passed", "told"
    if fault.beyond:
        return "beyond", fault.beyond
    if state in WARNING_STATES:
        return "failed", "told for another reason"
    if whole is not None and whole.held:
        return "failed", "path with gaps"
    return "failed", "beyond sigma, not told"
