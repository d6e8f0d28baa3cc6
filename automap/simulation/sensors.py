"""All sensors but the camera on one simulated drive, with the vehicle's true motion."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from automap import timebase
from automap.effects.user import user_signal
from automap.effects.vehicle import stamp_error_s
from automap.errors import ConfigError
from automap.records import ClockModel, FixErrors, Fixes, FloatArray, ImuData, IntArray, WheelSpeed
from automap.simulation.errors import check_errors, error_values
from automap.simulation.gnss import receive
from automap.simulation.imu import record_imu, temperature, true_signals
from automap.simulation.odometer import count_wheels
from automap.simulation.replay import Replayed
from automap.simulation.scenario import Scenario
from automap.simulation.trajectory import DriveMotion, drive_motion

N_STREAMS = 6
"""Random streams, one a sensor: another sensor's settings change no draws of this one."""


@dataclass(frozen=True)
class Streams:
    """One random stream a sensor: changing one sensor leaves the others as they were."""

    road: np.random.Generator
    imu: np.random.Generator
    gnss: np.random.Generator
    scene: np.random.Generator
    camera: np.random.Generator
    odometer: np.random.Generator


@dataclass(frozen=True)
class SimulatedSensors:
    """What the sensors of a drive record, without noise in ``clock``, host to GPS time."""

    drive: DriveMotion
    begin_gps_s: float
    clock: ClockModel
    imu: ImuData
    fixes: Fixes | None
    odometer: WheelSpeed | None
    replayed: Replayed | None = None

    def seconds(self, t_ns: IntArray) -> FloatArray:
        """True seconds [n] of the drive at host instants [n], held at its ends."""
        rate = 1.0 + self.clock.drift
        t = np.asarray((t_ns - self.clock.ref_ns) * 1e-9 * rate)
        return np.clip(t, 0.0, self.drive.duration_s)


def random_streams(seed: int) -> Streams:
    """The streams of a drive's seed."""
    seeds = np.random.SeedSequence(seed).spawn(N_STREAMS)
    return Streams(*(np.random.default_rng(s) for s in seeds))


def simulate_sensors(
    scenario: Scenario,
    streams: Streams,
    progress: Callable[[float, str], None] = lambda fraction, text: None,
    recorded: FixErrors | None = None,
) -> SimulatedSensors:
    """Drive the scenario and record it.

    IMU stamps carry ``imu_time_offset`` and ``imu_clock_skew``; fixes and wheel speeds stand on
    the right clock. ``recorded`` are the receiver's errors where the scenario replays some. Raises
    ConfigError for errors that cannot be simulated.
    """
    check_errors(
        scenario.errors,
        scenario.gnss is not None,
        scenario.odometer is not None,
        scenario.camera is not None and scenario.camera.box_sd_px is not None,
    )
    errors = error_values(scenario.errors)
    progress(0.0, "trajectory")
    drive = drive_motion(scenario, streams.road)
    begin = float(timebase.unix_to_gps(scenario.start.utc.timestamp()))
    clock = ClockModel(
        ref_ns=scenario.clock.start_ns,
        ref_gps_s=begin,
        drift=scenario.clock.drift_ppm * 1e-6,
        sd_offset_s=0.0,
        sd_drift=0.0,
        method="simulated",
    )

    def host_ns(t_s: FloatArray) -> IntArray:
        rate = 1.0 + clock.drift
        return np.asarray(clock.ref_ns + np.rint(t_s / rate * 1e9).astype(np.int64))

    imu = _record_imu(scenario, drive, errors, streams.imu)
    fixes = odometer = replayed = None
    if scenario.gnss is not None:
        if scenario.gnss.replay is not None and recorded is None:
            raise ConfigError("the scenario replays a receiver's errors; give them")
        fixes, replayed = receive(drive, scenario.gnss, begin, streams.gnss, errors, recorded)
    if scenario.odometer is not None:
        odometer = count_wheels(drive, scenario.odometer, errors, host_ns, streams.odometer)
    return SimulatedSensors(drive, begin, clock, imu, fixes, odometer, replayed)


def _record_imu(
    scenario: Scenario,
    drive: DriveMotion,
    errors: dict[str, dict[str, float]],
    rng: np.random.Generator,
) -> ImuData:
    setup = scenario.imu
    count = int(np.floor(drive.duration_s * setup.rate_hz))
    jitter = rng.standard_normal(count) * setup.stamp_jitter_s
    limit = 0.4 / setup.rate_hz
    grid = np.arange(count) / setup.rate_hz + np.abs(np.clip(jitter, -limit, limit))
    true_ns = scenario.clock.start_ns + np.rint(grid * 1e9).astype(np.int64)
    rate = 1.0 + scenario.clock.drift_ppm * 1e-6
    t_s = np.asarray((true_ns - scenario.clock.start_ns) * 1e-9 * rate)
    motion = drive.at(np.minimum(t_s, drive.duration_s))
    late = stamp_error_s(
        grid - grid[0], errors, lambda name: user_signal(name, true_signals(motion))
    )
    stamps = true_ns + np.rint(late * 1e9).astype(np.int64)
    return record_imu(stamps, motion, setup, errors, rng, temperature(scenario, motion.t_s))
