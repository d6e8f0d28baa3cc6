"""Small stages that stand for the real ones in tests of the runner."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from pipeline.run.stage import Stage, StageContext

Action = Callable[[StageContext], None]


def make_drive(folder: Path, imu: str = "t_ns,gx,gy,gz,ax,ay,az\n0,0,0,0,0,0,-9.8\n") -> Path:
    """A drive folder that can be loaded; the fake stages read its IMU file as text."""
    folder.mkdir(parents=True)
    (folder / "drive.toml").write_text('schema = "automap.drive/1"\n')
    (folder / "imu.csv").write_text(imu)
    return folder


def reader(action: Action | None = None, version: int = 1) -> Stage:
    """``ingest``: takes the number of lines of the IMU file."""

    def run(context: StageContext) -> None:
        if action is not None:
            action(context)
        lines = (context.drive.path / "imu.csv").read_text().splitlines()
        (context.work / "lines.txt").write_text(str(len(lines)))
        context.metric("n_lines", len(lines))
        context.result = f"{len(lines)} lines"

    return Stage(
        name="ingest",
        version=version,
        run=run,
        inputs=lambda drive: [drive.path / "imu.csv", drive.path / "drive.toml"],
        needs=(),
        outputs=("lines.txt",),
        settings=("ingest",),
        manifest=("imu",),
    )


def doubler(action: Action | None = None) -> Stage:
    """``detect``: writes twice the number, and a second file when the setting says so."""

    def run(context: StageContext) -> None:
        number = int((context.out / "lines.txt").read_text())
        (context.work / "double.txt").write_text(str(2 * number))
        if context.settings.detect.min_score > 0.5:
            (context.work / "extra.txt").write_text("extra")
        context.warn("doubling is not an estimate")
        if action is not None:
            action(context)

    return Stage(
        name="detect",
        version=1,
        run=run,
        inputs=lambda drive: [],
        needs=("lines.txt",),
        outputs=("double.txt", "extra.txt"),
        settings=("detect",),
        manifest=(),
    )


def teller() -> Stage:
    """``report``: shows the record of the run."""

    def run(context: StageContext) -> None:
        record = (context.out / "run.json").read_text()
        (context.work / "story.txt").write_text(record)

    return Stage(
        name="report",
        version=1,
        run=run,
        inputs=lambda drive: [],
        needs=("double.txt", "run.json"),
        outputs=("story.txt",),
        manifest=(),
    )
