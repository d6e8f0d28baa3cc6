"""A drive as the gap finder takes it, and its preparation for the filter."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from automap.effects.signals import calm_readings
from automap.errors import InputError
from automap.fusion.engine import fuse_imu_gnss
from automap.fusion.layout import HAS_POS_H
from automap.fusion.limits import REST_BIAS_SD
from automap.fusion.nodes import FixModel, as_shown, model_fixes
from automap.fusion.options import FusionOptions
from automap.fusion.passes import Session
from automap.fusion.problem import samples_of
from automap.fusion.result import Prior
from automap.fusion.screening import screen_fixes
from automap.fusion.shocks import shock_noise
from automap.fusion.standstill import find_standstill, rest_gyro_bias, shown_speed
from automap.fusion.wheels import prepare_wheels
from automap.records import BoolArray, ClockModel, Fixes, FloatArray, ImuData, WheelSpeed

KNOWN = Prior(0.0, 0.0)
MIN_SAMPLES, MIN_FIXES = 100, 10
"""A drive with fewer readings or fixes is refused. Chosen: it can say nothing of a dozen states."""
EDGE_S = 0.35
"""Fixes so close to the ends of the IMU recording are left out: delays of as much stay inside."""


@dataclass(frozen=True)
class GapDrive:
    """Recordings of one drive and what is known beforehand.

    ``lever_arm`` [3] m IMU to antenna as stated, None counts as zero. ``delay``: prior of how
    much later than the fixes' clock the IMU stamps run; with an sd above zero it is estimated
    on every drive anew and is never a finding, as where nobody stated the receiver's output
    delay. ``mounting_sd`` [3] rad: zero where the IMU's axes are the vehicle's as stated. A part
    of a drive begins ``begin_s`` after it.
    """

    imu: ImuData
    fixes: Fixes
    clock: ClockModel
    name: str = "drive"
    lever_arm: FloatArray | None = None
    delay: Prior = KNOWN
    odometer: WheelSpeed | None = None
    mounting_sd: FloatArray = field(default_factory=lambda: np.zeros(3))
    begin_s: float = 0.0

    @property
    def length_s(self) -> float:
        """Seconds of the IMU recording."""
        return float((self.imu.t_ns[-1] - self.imu.t_ns[0]) * 1e-9)

    def part(self, start_s: float, stop_s: float, name: str) -> GapDrive:
        """The stretch between two instants, in s from the first sample."""
        t = (self.imu.t_ns - self.imu.t_ns[0]) * 1e-9
        rows = np.flatnonzero((t >= start_s) & (t <= stop_s))
        imu = replace(
            self.imu,
            t_ns=self.imu.t_ns[rows],
            gyro=self.imu.gyro[rows],
            accel=self.imu.accel[rows],
            temp_c=None if self.imu.temp_c is None else self.imu.temp_c[rows],
        )
        fix_t = (self.clock.t_ns(self.fixes.gps_s) - self.imu.t_ns[0]) * 1e-9
        inside = np.flatnonzero((fix_t >= start_s) & (fix_t <= stop_s))
        columns = {k: getattr(self.fixes, k)[inside] for k in self.fixes.__dataclass_fields__}
        wheels = self.odometer
        if wheels is not None:
            wheel_t = (wheels.t_ns - self.imu.t_ns[0]) * 1e-9
            during = (wheel_t >= start_s) & (wheel_t <= stop_s)
            wheels = WheelSpeed(wheels.t_ns[during], wheels.speed[during])
        begin = self.begin_s + (float(t[rows[0]]) if len(rows) else 0.0)
        fixes = Fixes(**columns)
        return replace(self, imu=imu, fixes=fixes, name=name, odometer=wheels, begin_s=begin)


@dataclass(frozen=True)
class OpenDrive:
    """A drive with its fixes modelled and its standstill found, ready for the passes;
    ``n_outliers`` fixes lie off the path of the others."""

    drive: GapDrive
    session: Session
    n_outliers: int = 0


def in_vehicle_axes(drive: GapDrive, options: FusionOptions) -> GapDrive:
    """The drive with its readings turned into the vehicle's axes, found by an ordinary run.

    Does nothing where the axes are known. What the run leaves unsure of the mounting stays a
    nuisance.
    """
    if drive.imu.axes_known:
        return drive
    delay = drive.delay if drive.delay.sd > 0.0 else Prior(0.0, 0.2)
    found = fuse_imu_gnss(
        drive.imu, drive.fixes, drive.clock, options, delay, drive.lever_arm
    ).mounting
    c = found.matrix
    imu = replace(
        drive.imu, gyro=drive.imu.gyro @ c.T, accel=drive.imu.accel @ c.T, axes_known=True
    )
    return replace(drive, imu=imu, mounting_sd=np.maximum(found.sd, [0.005, 0.02, 0.02]))


def open_drive(drive: GapDrive, options: FusionOptions) -> OpenDrive:
    """Model the fixes, screen them, find the standstill.

    Raises:
        InputError: too few samples or fixes to compare anything.
    """
    if len(drive.imu) < MIN_SAMPLES:
        raise InputError(
            f"{drive.name}: only {len(drive.imu)} usable IMU samples; record a longer drive"
        )
    base_ns = int(drive.imu.t_ns[0])
    fix_t = np.asarray((drive.clock.t_ns(drive.fixes.gps_s) - base_ns) * 1e-9)
    screened = screen_fixes(model_fixes(drive.fixes, fix_t, options), options.wander_tau_s)
    fixes = screened.fixes
    t = np.asarray((drive.imu.t_ns - base_ns) * 1e-9)
    span = (0.0, float(t[-1]))
    # a delay that is yet to be found must not decide which fixes take part
    late_t = fixes.t + drive.delay.mean
    fixes = _rows(fixes, (late_t > span[0] + EDGE_S) & (late_t < span[1] - EDGE_S))
    inside = (fixes.flags & HAS_POS_H) > 0
    if int(inside.sum()) < MIN_FIXES:
        raise InputError(
            f"{drive.name}: only {int(inside.sum())} usable fixes within its {span[1]:.0f} s of "
            "IMU data; a gap can only be found where both recordings overlap"
        )
    speed_t, speed, speed_sd = shown_speed(fixes)
    late = drive.delay.mean
    still = find_standstill(t - late, drive.imu.gyro, drive.imu.accel, speed_t, speed, speed_sd)
    still = [(a + late, b + late) for a, b in still]
    means: dict[str, float] = {}
    sds: dict[str, float] = {}
    bias = rest_gyro_bias(t, drive.imu.gyro, still)
    if bias is not None:
        means |= {f"gyro_bias_{a}": float(v) for a, v in zip("xyz", bias, strict=True)}
        sds |= dict.fromkeys(means, REST_BIAS_SD)
    wheels = prepare_wheels(drive.odometer, base_ns, span, fixes, options)
    speeds = None if wheels is None else wheels.odometer
    session = Session(
        *(drive.imu, fixes, options, still, means, sds, span, speeds, drive.begin_s),
        readings=samples_of(drive.imu, options),
        calm=calm_readings(t + drive.begin_s, drive.imu.gyro, drive.imu.accel),
    )
    return OpenDrive(drive, session, screened.n_outliers)


def shocks_of(drive: GapDrive) -> FloatArray:
    """PSD [n, 2] of the noise of shocks that a drive's readings show, of force and rate."""
    step_s = float(np.median(np.diff(drive.imu.t_ns))) * 1e-9
    return shock_noise(drive.imu.gyro, drive.imu.accel, step_s)


def with_shocks(opened: OpenDrive) -> OpenDrive:
    """The drive with the noise of shocks that its readings show."""
    session = opened.session
    options = replace(session.options, shocks=True)
    readings = samples_of(opened.drive.imu, options)
    return replace(opened, session=replace(session, options=options, readings=readings))


def count_outliers(drive: GapDrive, options: FusionOptions, factors: Mapping[str, float]) -> int:
    """How many fixes lie off the path of the others by far more than noise of other levels."""
    t = np.asarray((drive.clock.t_ns(drive.fixes.gps_s) - int(drive.imu.t_ns[0])) * 1e-9)
    fixes = model_fixes(drive.fixes, t, options)
    return screen_fixes(as_shown(fixes, options, factors), options.wander_tau_s).n_outliers


def _rows(fixes: FixModel, keep: BoolArray) -> FixModel:
    return FixModel(
        fixes.t[keep],
        fixes.flags[keep],
        fixes.values[keep],
        fixes.white_var[keep],
        fixes.stated_sd[keep],
        fixes.row[keep],
        fixes.larger[keep],
    )
