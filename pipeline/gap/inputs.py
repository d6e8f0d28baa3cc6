"""Drives and model of ``automap gap``, from folders and a configuration file."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from automap.fusion.result import Prior
from automap.gap import GapDrive, GapModel, base_model
from automap.gap.drive import KNOWN
from automap.gap.fit import base_options
from automap.io.atomic import make_folder
from automap.io.toml_file import read_toml
from automap.records import ClockModel
from pipeline.run.prepared import prepared
from pipeline.settings.load import Settings, load_settings
from pipeline.settings.user_effects import activate

ARRIVAL_SD_S = 5e-4
"""A clock from arrival times is never taken for better than this, s."""
UNKNOWN_DELAY = Prior(-0.1, 0.1)
"""IMU stamps against fixes whose output delay nobody stated: minus the delay."""
FREE_SD_S = 0.1


def gap_model(config: Path | None) -> tuple[GapModel, Settings]:
    """The model of a configuration file, and all its settings.

    What the file does not say of nuisances and lasting velocity errors is as in the base model,
    not as in an ordinary run.
    """
    settings = load_settings(config)
    activate(settings.effects)
    given = read_toml(config).get("fuse", {}) if config is not None else {}
    model = base_model(base_options(settings.fuse.options(), given))
    return model, settings


def gap_drives(
    paths: Sequence[Path],
    runs: Path,
    settings: Settings,
    warn: Callable[[str], None] = lambda text: None,
) -> list[GapDrive]:
    """Ingest and synchronise drive folders, as ``automap run`` does; ``warn`` is told what is wrong
    with a drive, which no search should be left to name.

    Raises InputError where a drive has no IMU or no fixes.
    """
    return [_gap_drive(path, runs / _name(path, paths), settings, warn) for path in paths]


def run_folder(path: Path, paths: Sequence[Path], runs: Path) -> Path:
    """Where the run of a drive, one of ``paths``, for its camera stands."""
    return runs / f"{_name(path, paths)}-camera"


def _name(path: Path, paths: Sequence[Path]) -> str:
    same = [p for p in paths if p.resolve().name == path.resolve().name]
    name = path.resolve().name
    return name if len(same) == 1 else f"{name}-{same.index(path) + 1}"


def _gap_drive(path: Path, out: Path, settings: Settings, warn: Callable[[str], None]) -> GapDrive:
    inputs = prepared(path, make_folder(out) / "run", settings, warn)
    arm = inputs.lever_arm
    fixed = settings.fuse.options().fixed.get("gnss_lever_arm")
    if fixed is not None:
        arm = np.array([fixed.get(a, 0.0) for a in "xyz"])
    return GapDrive(
        imu=inputs.imu,
        # what age and arm velocities have is asked here, whatever they were made of
        fixes=inputs.right_fixes,
        clock=inputs.clock,
        name=path.resolve().name,
        lever_arm=arm,
        delay=delay_prior(inputs.clock),
        odometer=inputs.odometer,
    )


def delay_prior(clock: ClockModel) -> Prior:
    """What the clock leaves open of the time between IMU and fixes."""
    if clock.method == "identity":
        return KNOWN
    if clock.method == "arrival":
        if clock.output_delay_s is None:
            return UNKNOWN_DELAY
        return Prior(0.0, max(clock.sd_offset_s, ARRIVAL_SD_S))
    return Prior(0.0, max(FREE_SD_S, min(clock.sd_offset_s, 1.0)))
