"""How a run is judged: its exit, its verdict, and its errors over what it states of them."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from automap.evaluation.trajectory_errors import trajectory_errors
from automap.io.trajectory_table import read_trajectory
from automap.records import Trajectory
from tests.benchmarks.faults.catalogue import CONTROL, FAULTS
from tests.benchmarks.faults.fault import Reason, Stretch
from tests.benchmarks.faults.log import Floats

MOST_SIGMA = 3.0
"""RMS of error over sigma up to which sigmas are believed: errors wander, so that a drive of some
minutes has few independent ones, and an RMS of 3 is no chance there."""
MOST_MISSING = 0.1
"""Share of the truth's epochs that a path may leave out and still be of the whole drive."""
BAD_INPUT = 3
GIVEN, UNKNOWN = AXES = ("given", "unknown")
"""Whether the manifest says how the IMU is mounted."""
WARNING_STATES = ("doubtful", "unusable")
FILE = re.compile(r"\b(drive\.toml|imu\.csv|gnss\.(nmea|ubx|pos)|gnss_arrival\.csv)\b")


Case = tuple[str, str, str]
"""Names of a drive and of a fault, and one of AXES."""


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
    """A run; ``axes`` one of AXES, ``span`` the fault's stretch in seconds from the path's first
    row, ``missing`` the share of the truth's epochs that the path leaves out, ``told`` what an
    error said."""

    drive: str
    fault: str
    axes: str
    code: int
    state: str
    reasons: tuple[Reason, ...]
    whole: Errors | None
    stretch: Errors | None
    span: Stretch
    missing: float
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


def verdict_of(out: Path) -> tuple[str, tuple[Reason, ...]]:
    """State and reasons as run.json tells them; ``none`` where it tells none."""
    try:
        told = json.loads((out / "run.json").read_text(encoding="utf-8")).get("verdict")
    except (OSError, ValueError):
        return "none", ()
    if not told:
        return "none", ()
    reasons = [
        Reason(r["code"], r["text"], tuple((a, b) for a, b in r.get("spans_s") or ()))
        for r in told["reasons"]
    ]
    return str(told["state"]), tuple(reasons)


def row_of(case: Case, stretch: Stretch, truth: Trajectory, out: Path, code: int, told: str) -> Row:
    """What came of a run; ``stretch`` in GPS time, ``told`` what was written to its error
    stream."""
    state, reasons = verdict_of(out)
    whole = part = None
    missing, start = 1.0, float(truth.gps_s[0])
    if code == 0:
        estimate = read_trajectory(out / "trajectory.parquet")
        whole, part, missing = errors_of(estimate, truth, stretch)
        start, told = float(estimate.gps_s[0]), ""
    span = stretch[0] - start, stretch[1] - start
    return Row(*case, code, state, reasons, whole, part, span, missing, told)


def fitting(row: Row) -> list[str]:
    """Codes of the reasons that are about the fault of a run, where its verdict warns."""
    if row.state not in WARNING_STATES:
        return []
    fault = FAULTS[row.fault]
    return [reason.code for reason in row.reasons if fault.fits(reason, row.span)]


def outcome(row: Row) -> tuple[str, str]:
    """``passed``, ``failed`` or ``beyond`` what can be seen, and why."""
    fault, warned = FAULTS[row.fault], row.state in WARNING_STATES
    complete = row.missing <= MOST_MISSING
    held = row.whole is not None and row.whole.held and complete
    # what is wrong for some seconds must not be hidden by the rest of the drive
    held = held and (row.stretch is None or row.stretch.held)
    if fault.name == CONTROL:
        if warned:
            return "failed", "cries wolf"
        return ("passed", "within sigma") if held else ("failed", "beyond sigma")
    if row.code == BAD_INPUT:
        named = FILE.search(row.told) is not None
        return ("passed", "refused") if named else ("failed", "refused without a file's name")
    if row.code:
        return "failed", f"exit code {row.code}"
    fits = bool(fitting(row))
    other = ", told for another reason" if warned else ", not told"
    if held:
        return "passed", "within sigma" + (", told" if fits else other)
    if fits:
        return "passed", "told"
    if fault.beyond:
        return "beyond", fault.beyond
    return "failed", ("beyond sigma" if complete else "path with gaps") + other
