"""Short computations of every area whose results are kept as figures."""

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
    from automap.sync.parting import excess, partings
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
        "excess": excess(path, right, use, use),
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


@scenario
def mapping_street() -> Any:
    """A street that three drives passed, merged; which class, which face, what is there."""
    from automap.mapping.merge import merge_drives
    from tests.unit.merge_scene import street_scene

    scene = street_scene(3, 4, 260.0)
    merged = merge_drives(scene.drives)
    return replace(merged, drives=[])


@scenario
def mapping_crowded() -> Any:
    """Signs close to each other, with much clutter and many wrong classes."""
    from automap.mapping.merge import merge_drives
    from automap.mapping.posts import with_supports
    from tests.unit.merge_scene import Errors, street_scene

    errors = Errors(clutter=0.3, wrong_class=0.3, missed=0.3, own_across=0.6)
    merged = merge_drives(street_scene(8, 3, 120.0, 8.0, errors).drives)
    posts = with_supports(merged.signs, np.full((len(merged.signs), 2), 0.3))
    return {"merged": replace(merged, drives=[]), "posts": posts}


@scenario
def mapping_inventory() -> Any:
    """A map against an inventory with faults."""
    from automap.mapping.inventory import compare_inventory
    from tests.unit.inventory_case import faulty, merged_town, town_and_drive
    from tests.unit.merge_scene import USUAL

    found = {}
    for name, case in {
        "one": town_and_drive(1, 500.0, USUAL),
        "three": merged_town(2, 3, 300.0, USUAL),
    }.items():
        rng, town, drives, _, signs = case
        found[name] = compare_inventory(signs, faulty(rng, town).inventory, drives)
    return found


@scenario
def mapping_roads() -> Any:
    """Signs along a path over crossing roads."""
    from automap.mapping.road_matching import road_positions
    from tests.unit.test_roads import driven, layer, sign_at

    rng = np.random.default_rng(3)
    roads = layer(
        [(0.0, 0.0), (0.0, 120.0), (8.0, 160.0)],
        [(-80.0, 118.0), (0.0, 120.0), (140.0, 130.0)],
        [(12.0, 0.0), (12.0, 110.0)],
        [(140.0, 130.0), (150.0, 30.0)],
    )
    corners = [(1.0, 5.0), (2.0, 118.0), (138.0, 129.0), (149.0, 40.0)]
    error = np.cumsum(rng.normal(0.0, 0.5, (len(driven(corners).gps_s), 2)), axis=0)
    path = driven(corners, error)
    signs = [
        sign_at(*rng.uniform([-10.0, 0.0], [160.0, 140.0]), rng.uniform(-3.0, 3.0), "right")
        for _ in range(10)
    ]
    return road_positions(path, roads, signs, [(np.nan, np.nan)] * 4 + [(0.0, 12.0)] * 6)


@scenario
def mapping_cells() -> Any:
    """Cells of the world, who touches them, and tiles."""
    from automap.mapping.cells import around, cell_of, colour_of, quadkey, touched, touches
    from automap.mapping.tiles import cut_tiles

    rng = np.random.default_rng(6)
    lat, lon = rng.uniform(-0.62, -0.61, 60), rng.uniform(2.6, 2.61, 60)
    cell = cell_of(lat, lon)
    return {
        "cell": cell,
        "colour": [colour_of(int(c)) for c in cell],
        "key": [quadkey(int(c)) for c in cell[:5]],
        "touched": touched(lat, lon, 300.0),
        "touches": [touches(lat, lon, 500.0, int(c)) for c in cell[:6]],
        "around": [around(int(c), 400.0, np.unique(cell)) for c in cell[:6]],
        "tiles": list(cut_tiles(lat, lon, 7, 150.0)),
    }


@scenario
def geolocation_street() -> Any:
    """A street with a turned, late camera; signs as a whole drive gives them."""
    from automap.geolocation.locate import locate_signs
    from tests.unit import geolocation_scene as world

    path = world.drive_path(13.0)
    scene = world.roadside(path, every_s=2.0)
    true = world.camera(time_offset_s=0.02, mount_rpy=np.radians([0.7, -0.8, 2.4]))
    found, _ = world.boxes(path, scene, true, np.random.default_rng(3), interval_s=0.4)
    located = locate_signs(path, [found], {"front": world.camera()})
    return vars(replace(located, adjusted=None, corrections=_without_rounding(located)))


def _without_rounding(located: Any) -> Any:
    """Cameras' corrections; a time offset that is no more than what iterations end at is zero."""
    return {
        name: replace(found, time_s=round(found.time_s, 6))
        for name, found in located.corrections.items()
    }


@scenario
def geolocation_control() -> Any:
    """A path that is off, put right by control signs."""
    from automap.geolocation.locate import locate_signs
    from tests.unit import geolocation_scene as world
    from tests.unit.test_geolocation_adjustment import SHIFT, moved, surveyed

    path = world.drive_path(12.0)
    scene = world.roadside(path, every_s=2.0)
    rng = np.random.default_rng(0)
    found, _ = world.boxes(path, scene, world.camera(), rng, 0.5, interval_s=0.5)
    control = surveyed(scene, list(range(0, len(scene.position), 2)))
    off = moved(path, SHIFT, 3.0)
    located = locate_signs(off, [found], {"front": world.camera()}, control=control)
    corrections = _without_rounding(located)
    return {**vars(located), "adjusted": located.trajectory, "corrections": corrections}


@scenario
def geolocation_bearings() -> Any:
    """Lamps from bearings with and without depths, and the scale of depths."""
    from automap.geolocation.bearings import BearingRules, locate_from_bearings
    from automap.geolocation.depth_scale import fit_depth_scale
    from tests.unit.test_geolocation_bearings import sightings

    lamps = np.array([[20.0, 9.0], [45.0, -8.0], [47.0, -4.0], [80.0, 10.0]])
    cameras = np.column_stack([np.arange(0.0, 100.0, 8.0), np.zeros(13)])
    rng = np.random.default_rng(2)
    with_depth, _ = sightings(lamps, cameras, rng)
    without, _ = sightings(lamps, cameras, rng, with_depth=False, bearing_sd_deg=0.5)
    measured, rough = rng.uniform(3.0, 40.0, 50), np.exp(rng.normal(0.0, 0.2, 50))
    return {
        "with": locate_from_bearings(with_depth),
        "without": locate_from_bearings(without, BearingRules(single=True)),
        "scale": fit_depth_scale(
            measured, 2.0 + 1.3 * measured * rough, np.full(50, 0.2), 3.0, 0.5
        ),
    }


@scenario
def geolocation_course() -> Any:
    """The path's relation to places, and a camera's first turn by pairs of boxes."""
    from automap.geolocation.epipolar import first_correction
    from automap.geolocation.path_relation import course_at, make_path, relate, side_of_path
    from tests.unit import geolocation_scene as world

    path = world.drive_path(16.0)
    scene = world.roadside(path, every_s=2.0)
    turned = world.camera(mount_rpy=np.radians([0.5, -1.5, 4.0]), time_offset_s=0.05)
    found, _ = world.boxes(path, scene, turned, np.random.default_rng(1), interval_s=0.5)
    plain = world.camera(mount_sd=np.radians(3.0), time_offset_sd=0.1)
    way = make_path(path, world.ORIGIN)
    first, last = int(path.t_ns[0]), int(path.t_ns[-1])
    places = scene.position
    return {
        "first": first_correction(path, found, plain, world.ORIGIN, 2e-3),
        "relation": [relate(way, p, first, last) for p in places],
        "course": [course_at(way, p, first, last) for p in places],
        "side": [side_of_path(a, b) for a in (-9.0, -0.5, 0.5, 9.0) for b in (1.0, 6.0)],
    }


@scenario
def fusion_problem() -> Any:
    """A short problem with every measurement, filtered and smoothed."""
    from tests.unit.dense_problem import solve_both

    both = solve_both()
    return {"forward": both.forward, "smoothed": both.smoothed, "table": both.table}


def _fused_drive(seconds: float, rate: float = 10.0) -> tuple[ImuData, Fixes]:
    from tests.unit.fusion_drive import Sensor, record
    from tests.unit.fusion_motion import city_drive
    from tests.unit.fusion_receiver import Receiver as Other
    from tests.unit.fusion_receiver import receive

    motion = city_drive(seconds, 1)
    return record(motion, Sensor(), 2, rate=rate), receive(motion, Other(), 3)


@scenario
def fusion_fixes() -> Any:
    """Fixes by themselves: modelled, screened, smoothed."""
    from automap.fusion.gnss_only import smooth_fixes
    from automap.fusion.nodes import fix_speed, model_fixes
    from automap.fusion.options import FusionOptions
    from automap.fusion.screening import screen_fixes
    from automap.fusion.standstill import (
        find_standstill,
        rest_gyro_bias,
        shown_speed,
        unmoved,
    )
    from tests.unit.fusion_drive import BASE_NS, CLOCK

    imu, fixes = _fused_drive(40.0, 25.0)
    t = (imu.t_ns - BASE_NS) * 1e-9
    bare = replace(fixes, sd_pos_ned=np.full_like(fixes.sd_pos_ned, np.nan))
    model = model_fixes(bare, CLOCK.t_ns(fixes.gps_s) * 1e-9 - BASE_NS * 1e-9, FusionOptions())
    rest = find_standstill(t, imu.gyro, imu.accel, *shown_speed(model))
    return {
        "smoothed": smooth_fixes(fixes, CLOCK, FusionOptions()),
        "model": model,
        "speed": fix_speed(model),
        "screened": screen_fixes(model, 20.0),
        "rest": rest,
        "unmoved": unmoved([(0.0, 6.0), (15.0, 25.0)], model),
        "bias": rest_gyro_bias(t, imu.gyro, [(0.0, 6.0)]),
    }


@scenario
def fusion_readings() -> Any:
    """What is found in an IMU's readings by themselves."""
    from automap.fusion.rest_noise import rest_density
    from automap.fusion.shocks import shock_noise
    from automap.fusion.steady_rate import steady_rate, wiener_weights
    from automap.fusion.stuck_readings import clipped_axes, frozen_axes
    from automap.fusion.unusable_readings import bridge_noise, bridge_unusable
    from automap.fusion.wheel_match import runs, step_of

    imu, _ = _fused_drive(40.0, 25.0)
    t = (imu.t_ns - imu.t_ns[0]) * 1e-9
    accel, gyro = imu.accel.copy(), imu.gyro.copy()
    accel[300:303] += 400.0
    gyro[500:560, 1] = gyro[500, 1]
    accel[600:760, 2] = np.clip(accel[600:760, 2], None, np.median(accel[:, 2]))
    hurt = replace(imu, accel=accel, gyro=gyro)
    speed = np.repeat(np.round(np.abs(np.sin(np.arange(60.0))) * 20.0, 1), 3)
    return {
        "shocks": shock_noise(imu.gyro, imu.accel, 0.04),
        "steady": steady_rate(t, imu.gyro),
        "wiener": wiener_weights(imu.gyro[:, 2], 0.04, 40),
        "frozen": frozen_axes(hurt, np.ones(len(imu.t_ns), bool)),
        "clipped": clipped_axes(hurt),
        "bridged": bridge_unusable(hurt),
        "noise": bridge_noise(np.array([0.1, 0.5, 2.0]), 3.0, 0.5),
        "density": rest_density(t, imu.gyro, [(0.0, 6.0)]),
        "step": step_of(speed),
        "runs": runs(speed),
    }


@scenario
def gap_evidence() -> Any:
    """Evidence of single and joint columns, what is left, what was shown."""
    from automap.gap.evidence import evidence, inflation, plain_nats, shown_by, singles
    from automap.gap.linear import Given, conditional
    from automap.gap.screening import estimate_nats
    from tests.unit.gap_linear import columns_named, linear_of

    rng = np.random.default_rng(8)
    names = ("e0.p", "e1.p", "e1.q", "e2.p")
    phi = 0.3 * rng.standard_normal((900, 4))
    phi[:, 1] += 0.5 * phi[:, 0]
    noise = rng.standard_t(4.0, 900)
    w = phi @ np.array([0.8, 0.6, -0.7, 0.0]) + np.where(np.arange(900) < 300, 3.0, 1.0) * noise
    linear = linear_of(phi, w, columns_named(*names))
    found: dict[str, Any] = {}
    for name, given in {"none": Given(), "one": Given((0,), (0.7,))}.items():
        known = conditional(linear, given)
        parts = ((1,), (1, 2), (3,))
        found[name] = {
            "known": known,
            "singles": singles(known, np.array([1, 2, 3])),
            "inflation": inflation(known, np.array([1, 2])),
            "plain": [plain_nats(known, part) for part in parts],
            "evidence": [evidence(known, part) for part in parts],
            "lean": [evidence(known, part, 1.4) for part in parts],
            "shown": [_or_error(shown_by, known, part) for part in parts],
        }
    cov = np.array([[0.04, 0.01], [0.01, 0.09]])
    found["estimate"] = estimate_nats(np.array([0.5, -0.4]), cov, np.array([1.0, 2.0]))
    return found


@scenario
def mapping_changes() -> Any:
    """A map of three drives against one of two, and what its review leaves of it."""
    from automap.mapping.changes import OlderMap
    from automap.mapping.compare import compare_maps
    from automap.mapping.merge import merge_drives
    from tests.unit.merge_scene import street_scene

    scene = street_scene(2, 5, 260.0)
    older = merge_drives(scene.drives[:2])
    newer = merge_drives([*scene.drives[:1], *scene.drives[2:]])
    ids = [f"o{k}" for k in range(len(older.signs))]
    members = {key: name for name, keys in zip(ids, older.keys, strict=True) for key in keys}
    signs = [replace(s, id=name) for s, name in zip(older.signs, ids, strict=True)]
    signs[1] = replace(signs[1], class_name="warning--children--g2")
    signs[2] = replace(signs[2], lat_rad=signs[2].lat_rad + 2e-6)
    return {
        "by sightings": compare_maps(OlderMap(signs, members), newer),
        "by place": compare_maps(OlderMap(signs[:-1]), newer),
    }


@scenario
def fusion_drive() -> Any:
    """A short drive from rest, fused as a whole."""
    from automap.fusion.engine import fuse_imu_gnss
    from automap.fusion.options import FusionOptions
    from automap.fusion.result import Prior
    from tests.unit.fusion_drive import CLOCK

    imu, fixes = _fused_drive(7.0, 6.0)
    arm = np.array([0.3, -0.2, -1.0])
    effects = ("accel_bias", "gyro_bias", "gnss_correlated_noise", "accel_quadratic")
    options = FusionOptions(effects=effects, passes=2, shocks=True)
    result = fuse_imu_gnss(imu, fixes, CLOCK, options, Prior(0.0, 0.1), lever_arm=arm)
    # made when they are asked for
    return vars(result) | {"trajectory": result.trajectory, "filtered": result.filtered}


@scenario
def fusion_doubts() -> Any:
    """What fixes, turns and estimates give reason to doubt."""
    from automap.fusion.doubts.path import Misses, contradicted, local_error, spans_of
    from automap.fusion.doubts.receiver import receiver_doubts
    from automap.sync.velocity_consistency import velocity_consistency

    rng = np.random.default_rng(7)
    t = np.arange(200.0)
    miss = rng.normal(0.0, 2.0, (200, 3)) + 15.0 * ((t > 80.0) & (t < 130.0))[:, None]
    misses = Misses(t, miss, np.full((200, 3), 1.0), np.full((200, 3), 3.0))
    sound = simulated_fixes(1, Receiver(), 120.0)
    shapes = (damage.scaled(sound, 3.6), damage.upside_down(sound), damage.derived(sound, "after"))
    return {
        "misses": [contradicted(misses, 5.0), local_error(misses)],
        "spans": spans_of(t, (t > 80.0) & (t < 130.0) | (t > 190.0)),
        "receiver": [receiver_doubts(velocity_consistency(each), GPS_START) for each in shapes],
    }


@scenario
def fusion_free() -> Any:
    """Readings integrated by themselves beside a receiver that steps, and turns that it sees."""
    from automap.fusion.doubts.turns import slope_of, turn_doubts
    from automap.fusion.doubts.velocity_step import compare, led_away, step_doubts, velocity_steps
    from automap.fusion.free_inertial import free_inertial
    from tests.unit.fusion_drive import BASE_NS, Sensor, record
    from tests.unit.fusion_motion import city_drive
    from tests.unit.fusion_receiver import Receiver as Other
    from tests.unit.fusion_receiver import receive
    from tests.unit.test_fusion_velocity_step import led, path_of

    motion = city_drive(60.0, 3)
    imu = record(motion, Sensor(), 3, rate=20.0)
    t = (imu.t_ns - BASE_NS) * 1e-9
    free = free_inertial(t, imu.gyro, imu.accel, np.where((t > 48.0) & (t < 48.3), 0.3, 0.0))
    fixes = led(receive(motion, Other(), 3), lambda x: 50.0 * np.clip((x - 30.3) / 8.0, 0.0, 1.0))
    path = path_of(motion, imu, (0.02, -0.02, 0.03))
    seen = compare(free, fixes, path, {}, np.array([0.4, -0.2, -1.0]))
    steps = velocity_steps(seen, 0.2)
    true = motion.at(t)
    speed = np.hypot(true.vel[:, 0], true.vel[:, 1])
    return {
        "free": free,
        "point": free.of_point(np.linspace(1.0, 50.0, 40), np.array([0.8, -0.3, -1.2])),
        "lost": free.lost_between(np.array([-1.0, 5.0, 40.0]), np.array([2.0, 9.0, 55.0])),
        "seen": seen,
        "steps": steps,
        "led": led_away(steps, 60.0),
        "reasons": step_doubts(steps, path),
        "slope": slope_of(t, imu.gyro[:, 2], t[::20], 1.1 * true.vel[::20, 0], speed[::20] > 2.0),
        "turns": list(turn_doubts(imu, np.diag([-1.0, -1.0, 1.0]), t[::10], true.vel[::10])),
    }


@scenario
def fusion_climb() -> Any:
    """Levels that climb two hills at once, from flat ground and from steep."""
    from automap.fusion.level_climb import climb
    from automap.fusion.level_likelihood import LevelLikelihood
    from automap.fusion.levels import ALL_LEVELS, LEVELS

    def hills(factors: Any) -> LevelLikelihood:
        score = 0.0
        slope, info = np.zeros(len(ALL_LEVELS)), np.zeros(len(ALL_LEVELS))
        for name, top, flat in (("accel", 1.0, 0.5), ("gyro", 2.5, 0.1)):
            row = ALL_LEVELS.index(name)
            variance = factors[name] ** 2 + flat
            part = (top**2 + flat) / variance
            share = 2.0 * factors[name] ** 2 / variance
            slope[row], info[row] = 50.0 * (part - 1.0) * share, 50.0 * share**2
            score -= 50.0 * (np.log(variance) + part)
        return LevelLikelihood(float(score), slope, info)

    found = {}
    for most in (2.0, 100.0):
        bounds = (0.05, most)
        for start in (0.1, 0.7, 8.0):
            begin = dict.fromkeys(LEVELS, start)
            found[f"{start} to {most}"] = climb(
                hills, begin, ("accel", "gyro"), lambda level, held=bounds: held
            )
    return found


@scenario
def gap_heldout() -> Any:
    """The gap that rows of each colour leave, and the colour itself."""
    from automap.fusion.layout import CH_NHC, CH_POS, CH_VEL
    from automap.gap.scoring import _distance, _lag1

    rng = np.random.default_rng(3)
    found = {}
    for keep in (-0.5, 0.0, 0.6, 0.9):
        rows = rng.normal(size=400)
        for k in range(1, 400):
            rows[k] += keep * rows[k - 1]
        rows[50:55] *= 9.0
        found[str(keep)] = [
            [_distance(size * rows, channel), _lag1(size * rows)]
            for size in (0.4, 1.3)
            for channel in (CH_POS, CH_VEL, CH_NHC)
        ]
    return found


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


@scenario
def geolocation_tracks() -> Any:
    """Tracks with boxes of other signs in them, cleaned; what they leave, linked anew."""
    from automap.geolocation.landmark import SizePrior
    from automap.geolocation.splitting import clean_tracks, join_pieces
    from automap.geolocation.tracking import TrackingRules, link_views
    from automap.geolocation.views import MeasurementNoise, build_views
    from tests.unit import geolocation_scene as world

    path = world.drive_path(14.0)
    scene = world.roadside(path, every_s=2.0)
    found, owner = world.boxes(path, scene, world.camera(), np.random.default_rng(2))
    views = build_views(path, [found], {"front": world.camera()}, MeasurementNoise())
    prior, rules = SizePrior(), TrackingRules()
    of = [np.flatnonzero(owner == k) for k in np.unique(owner)]
    long = [rows for rows in of if len(rows) >= 6][:3]
    mixed = [
        np.sort(np.concatenate([long[0], long[1][:2]])),
        np.sort(np.concatenate([long[2], long[0][:1], long[1][2:3]])),
    ]
    marks, misfits = clean_tracks(views, mixed, prior, rules)
    pieces, _ = clean_tracks(views, [long[1][:4], long[1][4:], long[2]], prior, rules)
    return {
        "linked": link_views(views, prior, rules),
        "cleaned": marks,
        "misfits": misfits,
        "joined": join_pieces(views, pieces, prior, rules),
    }


# what they have besides: scenarios of single kernels and of parts
from tests.unit import (  # noqa: E402, F401
    scenarios_cache,
    scenarios_calibration,
    scenarios_decisions,
    scenarios_doubts,
    scenarios_effects,
    scenarios_fusion,
    scenarios_gap,
    scenarios_geolocation,
    scenarios_geolocation_plane,
    scenarios_geolocation_search,
    scenarios_kernels,
    scenarios_mapping,
    scenarios_mapping_changes,
    scenarios_runs,
    scenarios_sync,
)
