"""Short computations whose results are kept as figures: the time and the calibration of sensors."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

from automap.errors import AutoMapError
from automap.records import ClockModel, Fixes, ImuData, RawImu
from tests.unit import receiver_damage as damage
from tests.unit.receiver_scene import Receiver, simulated_fixes
from tests.unit.sync_scene import GPS_START, drive, fixes_of, imu_of

SCENARIOS: dict[str, Callable[[], Any]] = {}


def scenario(function: Callable[[], Any]) -> Callable[[], Any]:
    """Make a function one of the scenarios."""
    SCENARIOS[function.__name__] = function
    return function


def _or_error(function: Callable[..., Any], *values: Any) -> Any:
    try:
        return function(*values)
    except AutoMapError as error:
        return str(error)


def _sync_drive(seconds: float, seed: int = 3) -> tuple[ImuData, Fixes]:
    from scipy.spatial.transform import Rotation

    mounting = Rotation.from_euler("ZYX", [150.0, 12.0, 178.0], degrees=True)
    t, gyro, accel, motion = drive(seconds, 50.0, mounting, seed)
    t = np.delete(t, np.s_[500:560])
    gyro, accel = (np.delete(a, np.s_[500:560], axis=0) for a in (gyro, accel))
    fixes = fixes_of(np.arange(0.0, seconds, 0.02), motion, rate=2.0)
    return imu_of(t + 0.07, gyro, accel, 5_000_000_000), fixes


@scenario
def sync_motion() -> Any:
    """Offset, lag and axes by the motions of a drive with a gap."""
    from automap.sync.axes import correlation, judge_stated, judge_unknown, slope
    from automap.sync.axes_evidence import axes_evidence
    from automap.sync.coarse import find_offset
    from automap.sync.correlation import refine_lag
    from automap.sync.motion import imu_motion, position_motion, velocity_motion

    imu, fixes = _sync_drive(90.0)
    motion = imu_motion(imu)
    told = {"velocity": velocity_motion(fixes), "position": position_motion(fixes)}
    near = {name: each.shifted(-GPS_START - 5.0) for name, each in told.items()}
    clock = ClockModel(5_000_000_000, GPS_START, 0.0, 1e-3, 1e-6, "arrival", 0.0)
    seen = axes_evidence(imu, fixes, clock)
    rng = np.random.default_rng(1)
    axis = rng.normal(size=3)
    return {
        "imu": motion,
        "rate": motion.rate(np.linspace(1.0, 80.0, 40)),
        "between": motion.between(np.linspace(-1.0, 88.0, 60), np.linspace(0.5, 90.0, 60)),
        "told": told,
        "offset": {n: find_offset(motion, g) for n, g in near.items()},
        "close": {n: find_offset(motion, g, 9.0) for n, g in near.items()},
        "lag": {n: refine_lag(motion, g, 5.0, 0.6) for n, g in near.items()},
        "axes": seen,
        "stated": judge_stated(seen),
        "unknown": judge_unknown(seen),
        "follow": [(correlation(f, axis), *slope(f, axis)) for f in (seen.turn, seen.surge) if f],
    }


@scenario
def sync_correlation_clock() -> Any:
    """The clock without arrival times, of a log with a rate of its own."""
    from automap.sync.motion_clock import correlation_clock
    from automap.sync.steadiness import clock_change, lags_by_piece

    t, gyro, accel, motion = drive(300.0, 25.0)
    fixes = fixes_of(t, motion, rate=2.0)
    imu = imu_of(t * (1.0 + 3e-4), gyro, accel, 0)
    bent = imu_of(t + 0.01 * np.maximum(t - 150.0, 0.0), gyro, accel, 0)
    clock = ClockModel(0, GPS_START, 0.0, 1e-3, 1e-6, "arrival", 0.0)
    pieces = lags_by_piece(bent, fixes, clock)
    return {
        "clock": correlation_clock(imu, fixes, drift_sd=3e-4),
        "pieces": pieces,
        "change": clock_change(pieces),
    }


@scenario
def sync_arrival() -> Any:
    """The clock from arrival times of several shapes, with bends, steps and lost tags."""
    from automap.sync.arrival import fit_arrival_clock
    from automap.sync.clock import check_overlap, gps_clock, rough_clock, stated_clock
    from automap.sync.envelope import lower_envelope
    from automap.sync.finished import trajectory_clock
    from automap.sync.logger_clock import on_logger_clock
    from automap.sync.steps import find_step

    rng = np.random.default_rng(5)
    epochs = GPS_START + np.arange(400.0)
    found: dict[str, Any] = {}
    shapes = {
        "exponential": rng.exponential(0.01, 400),
        "soft": rng.gamma(3.0, 0.01, 400),
        "coarse": np.round(rng.exponential(0.02, 400), 3),
        "late": rng.exponential(0.4, 400),
        "early": rng.exponential(0.01, 400) - 0.3 * (np.arange(400) % 130 == 7),
        "bent": rng.exponential(0.01, 400) + 3e-6 * (np.arange(400.0) - 200.0) ** 2,
        "raised": rng.exponential(0.01, 400) + 0.3 * (np.arange(400) > 370),
        "step": rng.exponential(0.01, 400) - 0.3 * (np.arange(400) > 250),
        "far": 40.0 * (np.arange(400) % 90 > 44),
    }
    for name, waiting in shapes.items():
        host = 77.0 + (epochs - GPS_START) * (1.0 + 2e-5) + 0.06 + waiting
        arrival = np.rint(host * 1e9).astype(np.int64)
        found[name] = _or_error(fit_arrival_clock, arrival, epochs, 0.05, 5e-5)
        found[name + " step"] = find_step(host, waiting + 1e-5 * host)
    few = np.rint((77.0 + epochs[:5] - GPS_START + waiting[:5]) * 1e9).astype(np.int64)
    found["edge"] = lower_envelope(np.arange(400.0), shapes["soft"], 5e-5)
    found["few"] = fit_arrival_clock(few, epochs[:5])
    found["ppm"] = _or_error(
        fit_arrival_clock, np.rint(1.02 * (epochs - GPS_START) * 1e9).astype(np.int64), epochs
    )
    stamp = np.rint(np.arange(0.0, 60.0, 0.05) * (1.0 + 4e-5) * 1e9).astype(np.int64) + 3
    heard = stamp + np.rint(rng.exponential(0.004, len(stamp)) * 1e9).astype(np.int64) + 10**9
    found["logger"] = (on_logger_clock(stamp, heard) - stamp) * 1e-9
    found["apart"] = _or_error(on_logger_clock, stamp, 2 * stamp)
    found["finished"] = trajectory_clock(stamp, epochs[0] + stamp * 1e-9 * (1.0 + 1e-5))
    found["gps"] = gps_clock(stamp + 10**18)
    found["stated"] = [_or_error(stated_clock, stamp + 17 * 10**17, b) for b in ("gps", "unix")]
    clock = gps_clock(np.int64(10**9) * np.arange(1_400_000_000, 1_400_000_100))
    found["overlap"] = _or_error(check_overlap, clock, clock.t_ns(epochs[:9] + 900.0), epochs)
    found["rough"] = _or_error(rough_clock, *_sync_drive(40.0))
    return found


@scenario
def sync_receiver() -> Any:
    """What a receiver's velocities say against its positions, sound and damaged."""
    from automap.sync.velocity_consistency import velocity_consistency

    sound = simulated_fixes(1, Receiver(speed_lag_s=0.4, course_lag_s=0.2), 150.0)
    stretch = damage.driving(sound, 30.0)
    shapes = {
        "sound": sound,
        "scaled": damage.scaled(sound, 3.6),
        "mirrored": damage.redirected(sound, [[1.0, 0.0], [0.0, -1.0]]),
        "turned": damage.redirected(sound, [[0.0, 1.0], [-1.0, 0.0]]),
        "upside down": damage.upside_down(sound),
        "frozen": damage.held(sound, stretch, "lat_rad", "lon_rad"),
        "stuck": damage.held(sound, stretch, "vel_ned"),
        "rows": damage.held(sound, stretch, "lat_rad", "lon_rad", "vel_ned"),
        "zeroed": damage.zeroed(sound, stretch),
        "shifted": damage.shifted(sound, stretch, 80.0),
        "led away": damage.shifted(sound, np.cumsum(stretch) * 1.0, 3.0),
        "before": damage.derived(sound, "before"),
        "around": damage.derived(sound, "around"),
        "without": replace(sound, vel_ned=np.full_like(sound.vel_ned, np.nan)),
    }
    return {name: velocity_consistency(fixes) for name, fixes in shapes.items()}


@scenario
def sync_receiver_path() -> Any:
    """The two paths, their windows and what they may part by."""
    from automap.sync.climb_match import match_climbs
    from automap.sync.held_values import _moving_part, _too_hard
    from automap.sync.parting import excesses, partings
    from automap.sync.path_match import match_paths
    from automap.sync.receiver_path import (
        integrated,
        plausible_sd,
        receiver_path,
        velocity_sd,
        windows,
    )

    fixes = simulated_fixes(4, Receiver(rate_hz=4.0, speed_lag_s=0.3), 100.0)
    gone = np.arange(len(fixes)) % 90 > 70
    fixes = replace(fixes, vel_ned=np.where(gone[:, None], np.nan, fixes.vel_ned))
    path = receiver_path(damage.shifted(fixes, np.arange(len(fixes)) > 250, 30.0))
    use = np.arange(len(path)) % 11 != 3
    match = match_paths(path, use, use)
    right = match.path(path, use)
    over = windows(path, use, 8.0, use)
    return {
        "path": path,
        "match": match,
        "right": right,
        "velocity": match.velocity(path),
        "late": integrated(path, use, 0.3, -0.2),
        "windows": over,
        "apart": windows(path, use, 8.0, use, apart=True),
        "sd": plausible_sd(path, over),
        "velocity sd": velocity_sd(path, over),
        "climbs": match_climbs(path, use, 1.3),
        "excess": max([1.0, *excesses(path, right, use, use)]),
        "partings": partings(path, right, use, use, 1.2),
        "hard": [
            _too_hard(path.t, np.where(path.t > 50.0, v + 0j, 0j), row)
            for v in (2.0, 8.0, 12.0, 40.0)
            for row in (-1, int(np.flatnonzero(path.t > 50.0)[0]) - 1, len(path) - 1)
        ],
        "moving": _moving_part(
            np.arange(10, 19),
            np.array([0.0, 0.1, 0.0, 2.0, 1.0, 3.0j, 0.0, 0.1]) + 0j,
            np.full(8, 0.5),
        ),
    }


def _turned(seed: int, poses: int, rest_s: float, turn_s: float, **changes: Any) -> RawImu:
    from tests.unit import calibration_scene as hand

    rng = np.random.default_rng(seed)
    motion = hand.turned_by_hand(rng, hand.random_poses(rng, poses), rest_s, turn_s, 6.0)
    errors = replace(hand.random_errors(rng), **changes)
    log = hand.recorded(rng, motion, errors)
    keep = np.s_[:: max(1, round(hand.RATE / 50.0))]
    return replace(log, t_ns=log.t_ns[keep], gyro=log.gyro[keep], accel=log.accel[keep])


@scenario
def calibration_static() -> Any:
    """A static calibration, whole and by its parts."""
    from automap.calibration.poses import determination, helpful_poses
    from automap.calibration.rest import movement, noise_density
    from automap.calibration.static import calibrate_static
    from tests.unit.calibration_scene import GRAVITY

    log = _turned(3, 10, 2.0, 1.0)
    found = calibrate_static([log], GRAVITY)
    rng = np.random.default_rng(2)
    axes = rng.normal(size=(8, 3))
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    return {
        "found": found,
        "movement": movement(log),
        "noise": noise_density(log, 1.0),
        "determination": [determination(axes, n) for n in (6, 9, 12)],
        "helpful": helpful_poses(axes[:5], 9),
    }


@scenario
def calibration_dynamic() -> Any:
    """The filter of the errors of a sensor in the hand."""
    from automap.calibration.dynamic import calibrate_dynamic
    from tests.unit.calibration_scene import GRAVITY

    log = _turned(1, 4, 0.0, 1.5, misalignment=np.zeros(3), gyro_matrix=np.eye(3))
    return calibrate_dynamic(log, log.gyro, log.accel, GRAVITY)


@scenario
def calibration_rest() -> Any:
    """Rests of a log, and what the bias of one does to the others."""
    from automap.calibration.rest_sequences import log_sequences

    log = replace(_turned(4, 3, 6.0, 2.0), gyro_scale=np.ones(3), accel_scale=np.ones(3))
    return log_sequences(log, 10.0)


@scenario
def calibration_allan() -> Any:
    """Allan's deviation of a log at rest, and the noise that it says."""
    from automap.calibration.allan import allan_fit, averaging_factors, overlapping_deviation

    rng = np.random.default_rng(4)
    rate = rng.normal(0.0, 0.01, 3000) + np.cumsum(rng.normal(0.0, 1e-4, 3000))
    factors = averaging_factors(len(rate))
    return {"fit": allan_fit(rate, 20.0), "deviation": overlapping_deviation(rate, 20.0, factors)}


def _fused_drive(seconds: float, rate: float = 10.0) -> tuple[ImuData, Fixes]:
    from tests.unit.fusion_drive import Sensor, record
    from tests.unit.fusion_motion import city_drive
    from tests.unit.fusion_receiver import Receiver as Other
    from tests.unit.fusion_receiver import receive

    motion = city_drive(seconds, 1)
    return record(motion, Sensor(), 2, rate=rate), receive(motion, Other(), 3)


@scenario
def effects_signals() -> Any:
    """What effects may depend on, from a known motion and from readings."""
    from automap.effects.signals import signals_of, signals_of_readings
    from tests.unit.fusion_drive import BASE_NS
    from tests.unit.fusion_receiver import GPS0

    imu, fixes = _fused_drive(20.0, 25.0)
    t = (imu.t_ns - BASE_NS) * 1e-9
    warm = 20.0 + 3.0 * np.sin(0.3 * t)
    velocity = np.column_stack([np.sin(t), np.cos(0.7 * t), 0.1 * t])
    told = signals_of_readings(t, imu.gyro, imu.accel, warm, fixes.gps_s - GPS0, fixes.vel_ned)
    known = signals_of(t, velocity, 0.3 * t, np.cos(t), imu.gyro, imu.accel, None)
    return {
        "known": known,
        "told": told,
        "later": told.at(t[::7] + 0.013),
        "still": signals_of_readings(t, imu.gyro, imu.accel, None, t[:1], velocity[:1]),
    }


# what they have besides: scenarios of single kernels and of parts
from tests.unit import (  # noqa: E402, F401
    scenarios_cache,
    scenarios_calibration,
    scenarios_decisions,
    scenarios_doubts,
    scenarios_drives,
    scenarios_effects,
    scenarios_effects_users,
    scenarios_fusion,
    scenarios_fusion_start,
    scenarios_gap,
    scenarios_geolocation,
    scenarios_geolocation_plane,
    scenarios_geolocation_search,
    scenarios_ingest,
    scenarios_kernels,
    scenarios_mapping,
    scenarios_mapping_changes,
    scenarios_maps,
    scenarios_path_doubts,
    scenarios_runs,
    scenarios_sync,
)
