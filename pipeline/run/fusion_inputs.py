"""What the fusion of a drive starts from, out of the files of ingest and sync."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO

import numpy as np

from automap.errors import InputError
from automap.fusion.doubts.own_velocities import own_velocities
from automap.fusion.doubts.receiver import usable_fixes
from automap.fusion.engine import fuse_imu_gnss
from automap.fusion.limits import MOST_ARM_M
from automap.fusion.options import FusionOptions
from automap.fusion.result import FusionResult, Prior
from automap.io import names
from automap.io.clock_json import read_clocks
from automap.io.drive import Drive
from automap.io.tables import read_fixes, read_imu, read_odometer
from automap.records import ClockModel, DriveClocks, Fixes, FloatArray, ImuData, WheelSpeed
from automap.sync.limits import DELAY_SD_S
from automap.sync.receiver_filter import taken_back
from automap.sync.stamps import in_trajectory_time
from automap.sync.velocity_consistency import velocity_consistency
from automap.sync.velocity_findings import VelocityConsistency
from pipeline.shared.progress import Progress

SEPARATE_CLOCK_SD_S = 0.1
"""IMU stamps already in GPS time carry the recorder's own delay, s."""
OUTPUT_DELAY = (0.1, 0.1)
"""Least output delay of a receiver that nobody measured: mean and one sigma, s."""


@dataclass(frozen=True)
class FusionInputs:
    """Recordings, clock and priors of one drive.

    ``delay_is_clock``: the delay between IMU stamps and fixes is an error of the clock model.
    ``lever_arm`` [3] m, None where the manifest gives none. ``fixes`` without what cannot be
    right, or tells nothing, by what ``receiver`` says of them; ``right_fixes`` with the latter.
    ``roll_sd`` rad how exactly the IMU sits as its axes say. The readings are read from
    ``imu_file`` whenever they are asked for: of a long drive they are large.
    """

    imu_file: Path
    fixes: Fixes
    clock: ClockModel
    delay: Prior
    delay_is_clock: bool
    lever_arm: FloatArray | None
    receiver: VelocityConsistency
    right_fixes: Fixes
    roll_sd: float
    odometer: WheelSpeed | None = None

    @property
    def imu(self) -> ImuData:
        """The readings of the IMU."""
        return read_imu(self.imu_file)

    def fuse(
        self,
        options: FusionOptions,
        fixes: Fixes | None = None,
        progress: Progress = lambda fraction, text: None,
        scratch: IO[bytes] | None = None,
    ) -> FusionResult:
        """Run the fusion, on other fixes if given; ``scratch`` as in ``fuse_imu_gnss``."""
        return fuse_imu_gnss(
            self.imu,
            self.fixes if fixes is None else fixes,
            self.clock,
            options,
            self.delay,
            lever_arm=self.lever_arm,
            roll_sd=self.roll_sd,
            delay_is_clock=self.delay_is_clock,
            odometer=self.odometer,
            progress=progress,
            scratch=scratch,
        )


def read_inputs(drive: Drive, out: Path, shared_clock_sd_s: float) -> FusionInputs:
    """Inputs from OUT after ingest and sync.

    ``shared_clock_sd_s``: IMU stamps against a clock shared with the receiver, one sigma.
    """
    clocks = read_clocks(out / names.SYNC)
    clock = clocks.clock
    delay, is_clock = _delay_prior(clocks, shared_clock_sd_s)
    arm = stated_arm(drive)
    right, receiver = _right_fixes(out)
    fixes = own_velocities(right, receiver)
    roll_sd = math.radians(drive.imu.axes_sigma_deg)
    odometer = _read_wheels(drive, out / names.ODOMETER, clocks)
    return FusionInputs(
        out / names.IMU, fixes, clock, delay, is_clock, arm, receiver, right, roll_sd, odometer
    )


def stated_arm(drive: Drive) -> FloatArray | None:
    """The arm [3] m that the manifest states; one that fits on no vehicle is none."""
    if drive.gnss.lever_arm_m is None or np.linalg.norm(drive.lever_arm) > MOST_ARM_M:
        return None
    return drive.lever_arm


def _read_wheels(drive: Drive, path: Path, clocks: DriveClocks) -> WheelSpeed | None:
    """Wheel speeds at stamps of the IMU's clock, None where there are none."""
    wheels = read_odometer(path) if path.exists() else None
    time = drive.manifest.odometer.time
    if wheels is None or time is None:
        return wheels
    try:
        return WheelSpeed(in_trajectory_time(wheels.t_ns, time, clocks), wheels.speed)
    except InputError as error:
        raise InputError(f"{drive.odometer_file}: {error}") from None


def read_usable_fixes(out: Path) -> tuple[Fixes, VelocityConsistency]:
    """Fixes of OUT without what cannot be right or tells nothing, and what they say of each
    other."""
    right, receiver = _right_fixes(out)
    return own_velocities(right, receiver), receiver


def _right_fixes(out: Path) -> tuple[Fixes, VelocityConsistency]:
    behind = read_clocks(out / names.SYNC).receiver_filter
    fixes = taken_back(read_fixes(out / names.FIXES), behind)
    receiver = replace(velocity_consistency(fixes), behind=behind)
    return usable_fixes(fixes, receiver), receiver


def delay_of_arrivals(clock: ClockModel) -> Prior:
    """By how much a clock that is from arrival times is late where nothing beside them tells it."""
    if clock.method == "arrival" and clock.output_delay_s is None:
        mean, sd = OUTPUT_DELAY
        return Prior(-mean, sd)
    return Prior(0.0, 0.0)


def _delay_prior(clocks: DriveClocks, shared_sd: float) -> tuple[Prior, bool]:
    """Prior of the delay between IMU stamps and fixes, and whether it is the clock's error."""
    clock = clocks.clock
    if clock.method == "identity":
        return Prior(0.0, SEPARATE_CLOCK_SD_S), False
    if clock.method == "arrival" and clock.output_delay_s is None:
        return delay_of_arrivals(clock), True
    sd_offset = min(clock.sd_offset_s, 1.0)
    if clock.method == "arrival":
        # the clock's own error dates the fixes, and is taken from the clock
        return Prior(0.0, shared_sd), False
    # what the motions show is late by as much as the receiver's velocities
    return Prior(clocks.shown_offset_s or 0.0, max(DELAY_SD_S, sd_offset)), True
