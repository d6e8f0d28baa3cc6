"""One fault in one drive: written, run by the command line, judged, and cleared away."""

from __future__ import annotations

import shutil
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path

from pipeline.cli.root import run_command
from tests.benchmarks.faults.catalogue import FAULTS, put
from tests.benchmarks.faults.drives import DRIVES
from tests.benchmarks.faults.fault import DoesNotApplyError
from tests.benchmarks.faults.judge import UNKNOWN, Case, Row, row_of

SIMULATED = "simulated"


def simulate(drive: str, work: Path) -> None:
    """Make a simulated drive anew, for ``run_case``; nothing where it is a recorded one."""
    scenario = DRIVES[drive].scenario
    if scenario is not None:
        shutil.rmtree(work / SIMULATED / drive, ignore_errors=True)
        code, told = automap("simulate", str(scenario), "-o", str(work / SIMULATED / drive))
        if code:
            raise RuntimeError(told)


def run_case(data: Path, case: Case, work: Path, keep: bool = False) -> Row | str:
    """Run a fault; a sentence where it does not apply to the drive."""
    drive, name, axes = case
    source = DRIVES[drive]
    recorded = data / "drives" if source.scenario is None else work / SIMULATED
    recording = source.read(recorded / drive)
    if axes == UNKNOWN:
        recording.state_axes('"unknown"')
    try:
        stretch = put(FAULTS[name], recording)
    except DoesNotApplyError as reason:
        return str(reason)
    folder, out = (work / drive / f"{name}-{axes}" / part for part in ("drive", "out"))
    recording.write_to(folder)
    shutil.rmtree(out, ignore_errors=True)
    code, message = automap("run", str(folder), "-o", str(out), "--to", "fuse", "--quiet")
    row = row_of(case, stretch, recording.truth, out, code, message)
    if not keep:
        shutil.rmtree(folder)
        for path in out.glob("*.parquet"):
            path.unlink()
    return row


def automap(*arguments: str) -> tuple[int, str]:
    """Exit code and error stream of the command line, run in this process."""
    told = StringIO()
    with redirect_stderr(told), redirect_stdout(StringIO()):
        code = run_command(list(arguments))
    return code, told.getvalue().strip()
