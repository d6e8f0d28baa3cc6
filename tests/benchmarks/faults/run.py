"""One fault in one drive: written, run by the command line, judged, and cleared away."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

from tests.benchmarks.faults.catalogue import FAULTS, put
from tests.benchmarks.faults.drives import DRIVES
from tests.benchmarks.faults.fault import DoesNotApplyError
from tests.benchmarks.faults.judge import Row, row_of

PROJECT = Path(__file__).resolve().parent.parent.parent.parent
PROGRAM = str(Path(sys.executable).with_name("automap"))
TIMEOUT_S = 900.0
TIMED_OUT = 124


def run_case(data: Path, drive: str, name: str, work: Path, keep: bool = False) -> Row | str:
    """Run a fault; a sentence where it does not apply to the drive."""
    recording = DRIVES[drive](data / "drives" / drive)
    try:
        stretch = put(FAULTS[name], recording)
    except DoesNotApplyError as reason:
        return str(reason)
    folder, out = work / drive / name / "drive", work / drive / name / "out"
    recording.write_to(folder)
    shutil.rmtree(out, ignore_errors=True)
    code, message = automap_run(folder, out)
    row = row_of(drive, FAULTS[name], stretch, recording.truth, out, code, message)
    if not keep:
        shutil.rmtree(folder)
        for path in out.glob("*.parquet"):
            path.unlink()
    return row


def automap_run(drive: Path, out: Path) -> tuple[int, str]:
    """Exit code and error stream of ``automap run`` up to the path."""
    command = [PROGRAM, "run", str(drive), "-o", str(out), "--to", "fuse"]
    environment = os.environ | {"PYTHONPATH": str(PROJECT)}
    try:
        done = subprocess.run(
            [*command, "--quiet"],
            capture_output=True,
            text=True,
            timeout=TIMEOUT_S,
            env=environment,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return TIMED_OUT, f"no end after {TIMEOUT_S:.0f} s"
    return done.returncode, done.stderr.strip()
