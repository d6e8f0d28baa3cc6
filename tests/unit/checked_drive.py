"""A drive with something wrong in it, as `check` and the stage ingest see it."""

from __future__ import annotations

from pathlib import Path

from automap.io.drive import load_drive
from pipeline.check.command import CheckReport
from pipeline.run.stage import StageContext
from pipeline.run.stages import ingest
from pipeline.settings.load import Settings


def ingested(drive: Path, work: Path) -> StageContext:
    """What the stage ingest leaves of a drive; InputError where it stops."""
    work.mkdir(exist_ok=True)
    context = StageContext(load_drive(drive), drive / "_automap", work, Settings())
    ingest.run(context)
    return context


def edit(drive: Path, old: str, new: str) -> None:
    """Replace a text of drive.toml."""
    path = drive / "drive.toml"
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))


def errors_told(report: CheckReport) -> str:
    """Errors among the findings, a line each."""
    return "\n".join(
        f"{f.file}: {f.text} -> {f.advice}" for f in report.findings if f.severity == "error"
    )
