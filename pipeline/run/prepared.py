"""Drives run as far as another command needs them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from automap.errors import InputError
from automap.io import names
from pipeline.run import registry
from pipeline.run.fusion_inputs import FusionInputs, read_inputs
from pipeline.run.runner import Request, run_drive
from pipeline.settings.load import Settings


def run_to(last: str, drive: Path, out: Path, settings: Settings) -> list[str]:
    """Run the stages up to ``last`` that are not up to date; raises what stopped one. What they
    warn of."""
    stages = registry.select(last=last)
    outcome = run_drive(drive, out, Request(registry.load_stages(stages), stages, settings))
    if outcome.error is not None:
        raise outcome.error
    return [text for line in outcome.stages for text in line.warnings]


def prepared(
    drive: Path, out: Path, settings: Settings, warn: Callable[[str], None] = lambda text: None
) -> FusionInputs:
    """Ingest and synchronise a drive in ``out``, and read what its fusion starts from; ``warn`` is
    told what these stages warn of.

    Raises:
        InputError: the drive has no IMU or no fixes.
    """
    from automap.io.drive import load_drive

    for text in run_to("sync", drive, out, settings):
        warn(text if str(drive) in text else f"{drive}: {text}")
    for name, what in ((names.IMU, "an IMU recording"), (names.FIXES, "GPS fixes")):
        if not (out / name).exists():
            raise InputError(f"{drive}: it takes {what}, and the drive has none")
    return read_inputs(load_drive(drive), out, settings.fuse.imu_delay_sd_s)
