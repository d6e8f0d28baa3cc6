"""Parts of the fusion beside its kernels: wheels, nodes, bridges, tables."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from automap.errors import AutoMapError
from automap.records import Fixes, FixType, ImuData, Trajectory
from tests.unit.scenarios import scenario


def told(function: Any, *values: Any) -> Any:
    """A result, or the sentence of the error."""
    try:
        return function(*values)
    except AutoMapError as error:
        return str(error)


def words_of(reasons: Any) -> list[Any]:
    return [[str(r.as_dict()), r] for r in reasons]


def wavy_path(n: int, step: float, seed: int = 0, turning: float = 0.05) -> Trajectory:
    """A hilly path that bends one way, then the other, and stops for a while."""
    rng = np.random.default_rng(seed)
    t = step * np.arange(n)
    speed = np.clip(9.0 + 6.0 * np.sin(0.11 * t), 0.0, None)
    speed[(t > 0.6 * t[-1]) & (t < 0.68 * t[-1])] = 0.0
    heading = 0.7 + np.cumsum(turning * np.sin(0.05 * t) * step)
    pitch = 0.05 * np.sin(0.08 * t) + 0.01
    vel = np.column_stack(
        [speed * np.cos(heading), speed * np.sin(heading), -speed * np.tan(pitch)]
    )
    ned = np.cumsum(vel * step, axis=0)
    return Trajectory(
        t_ns=np.int64(5 * 10**9) + np.rint(t * 1e9).astype(np.int64),
        gps_s=1.4e9 + t,
        lat_rad=0.8 + ned[:, 0] / 6.37e6,
        lon_rad=0.2 + ned[:, 1] / (6.38e6 * np.cos(0.8)),
        height_m=400.0 - ned[:, 2],
        vel_ned=vel,
        rpy=np.column_stack([0.03 * np.cos(0.2 * t), pitch, np.angle(np.exp(1j * heading))]),
        sd_pos_ned=rng.uniform(0.5, 2.0, (n, 3)),
        sd_vel_ned=rng.uniform(0.05, 0.2, (n, 3)),
        sd_rpy=rng.uniform(0.01, 0.03, (n, 3)),
    )


def fixes_on(path: Trajectory, every: int, seed: int = 1, **changes: Any) -> Fixes:
    """Fixes on a path, with errors of all sizes and kinds, some without a part."""
    rng = np.random.default_rng(seed)
    rows = np.arange(0, len(path.t_ns), every)
    n = len(rows)
    kinds = np.array([FixType.THREE_D, FixType.DGNSS, FixType.FLOAT, FixType.FIXED])
    vel = path.vel_ned[rows] + rng.normal(0.0, 0.1, (n, 3))
    vel[5::17] = np.nan
    vel[6::19, 2] = np.nan
    height = path.height_m[rows] + rng.normal(0.0, 2.0, n)
    height[7::13] = np.nan
    kind = kinds[(np.arange(n) // 20) % 4].astype(np.int64)
    kind[3::29], kind[4::29] = FixType.NONE, FixType.TWO_D
    kind[9::31] = FixType.DEAD_RECKONING
    sd_pos = rng.uniform(0.4, 2.5, (n, 3)) * np.array([1.0, 1.3, 1.9])
    sd_pos[8::11] = np.nan
    sd_vel = rng.uniform(0.05, 0.4, (n, 3))
    sd_vel[10::12] = np.nan
    hdop = rng.uniform(0.8, 2.5, n)
    hdop[::9] = np.nan
    own = Fixes(
        gps_s=path.gps_s[rows].copy(),
        lat_rad=path.lat_rad[rows] + rng.normal(0.0, 1.5, n) / 6.37e6,
        lon_rad=path.lon_rad[rows] + rng.normal(0.0, 1.2, n) / 4.4e6,
        height_m=height,
        vel_ned=vel,
        sd_pos_ned=sd_pos,
        sd_vel_ned=sd_vel,
        fix_type=kind,
        n_sats=np.full(n, 12, np.int64),
        hdop=hdop,
        geoid_sep_m=np.full(n, np.nan),
        offset=np.full(n, -1, np.int64),
        arrival_ns=np.full(n, -1, np.int64),
    )
    return replace(own, **changes)


@scenario
def fusion_wheels() -> Any:
    """Wheel speeds of many sorts against a receiver's, as readings and at nodes."""
    from automap.fusion import wheel_match, wheels
    from automap.fusion.measurements.wheel_speed import note_wheels
    from automap.fusion.nodes import model_fixes
    from automap.fusion.options import FusionOptions
    from automap.records import WheelSpeed

    rng = np.random.default_rng(1)
    path = wavy_path(700, 0.2)
    t = path.gps_s - path.gps_s[0]
    true = np.hypot(path.vel_ned[:, 0], path.vel_ned[:, 1])
    own_t = np.arange(3.0, 130.0, 0.17) + rng.uniform(0.0, 0.02, len(np.arange(3.0, 130.0, 0.17)))
    speed = 1.03 * np.interp(own_t - 0.24, t, true) + rng.normal(0.0, 0.03, len(own_t))
    seen = wheel_match.Reference(
        t[::4], true[::4] + rng.normal(0.0, 0.1, 175), rng.uniform(0.05, 0.15, 175)
    )
    hung, still, jumped = speed.copy(), speed.copy(), speed.copy()
    hung[200:260], still[300:350] = hung[200], 0.0
    jumped[400:440] = jumped[400] + 3.3
    shapes = {
        "fine": speed,
        "steps": 0.3 * np.rint(speed / 0.3),
        "printed": np.round(0.27777 * np.rint(speed / 0.27777), 2),
        "hung": hung,
        "still": still,
        "jumped": jumped,
        "backwards": -speed,
        "reversing": np.where((own_t > 50.0) & (own_t < 58.0), -2.2, speed),
        "sign": speed * np.where(own_t < 60.0, -1.0, 1.0),
        "km/h": 3.6 * speed,
        "odd": 1.6 * speed,
        "noise": rng.uniform(0.0, 15.0, len(own_t)),
        "late": np.interp(own_t - 4.4, t, true),
        "early": np.interp(own_t + 4.1, t, true),
        "one speed": np.full(len(own_t), 8.0) + 1e-3 * np.sin(own_t),
    }
    options = FusionOptions()
    found: dict[str, Any] = {}
    for name, each in shapes.items():
        made = wheels.judge_wheels(own_t, each, seen, options)
        found[name] = {
            "wheels": made,
            "step": wheel_match.step_of(each),
            "words": list(made.warnings),
        }
        found[name]["unit"] = "" if made.match is None else made.match.unit
        found[name]["wrong"] = str(None if made.match is None else wheels.contradiction(made.match))
        found[name]["stuck"] = wheel_match.stuck(own_t, each, seen)
    units = (1.0, 1.15, 1.25, 3.5, 2.3, 1.9, 3.2, 95.0, 1050.0, 350.0, 0.5)
    plain = found["fine"]["wheels"].match
    found["units"] = [replace(plain, scale=scale).unit for scale in units]
    sizes = {"rest": 5.0, "spread": 30.0, "late_s": -3.2, "late_sd_s": 0.2, "scale": 3.6}
    found["said"] = [str(wheels.contradiction(replace(plain, **{k: v}))) for k, v in sizes.items()]
    bursts = np.sort(np.concatenate([own_t[::6], own_t[::6] + 0.01, own_t[::6] + 0.03]))
    found |= {
        "between": wheel_match.between(own_t, speed, np.linspace(0.0, 135.0, 60)),
        "gaps": wheel_match.between(own_t[::19], speed[::19], np.linspace(0.0, 135.0, 60)),
        "runs": wheel_match.runs(np.array([1.0, 1.0, 2.0, 2.0, 2.0, 3.0, 1.0, 1.0])),
        "bursts": wheels.readings(bursts, 1.0 + np.sin(bursts), 0.2, 0.1, 0.3, options),
        "slow": wheels.readings(own_t[::9], 0.05 * speed[::9], 0.0, 0.4, -0.1, options),
        "signed": wheels.readings(own_t, 0.9 * np.sin(own_t), 0.3, 0.0, 0.0, options),
        "one": wheels.readings(own_t[:1], speed[:1], 0.3, 0.1, 0.0, options),
        "spaced": wheels._spaced(own_t),
        "too few": wheel_match.match_wheels(own_t[:15], speed[:15], seen, 2.0),
        "short reach": wheel_match.match_wheels(own_t, speed, seen, 0.3),
        "none": wheels.judge_wheels(own_t[:2], speed[:2], seen, options),
    }
    fixes = fixes_on(path, 5)
    model = model_fixes(fixes, fixes.gps_s - fixes.gps_s[0], options)
    bare = model_fixes(
        replace(fixes, vel_ned=np.full_like(fixes.vel_ned, np.nan)),
        fixes.gps_s - fixes.gps_s[0],
        options,
    )
    few = model_fixes(fixes_on(path, 60), fixes_on(path, 60).gps_s - fixes.gps_s[0], options)
    found["speeds"] = [wheels.path_speed(each) for each in (model, bare, few)]
    log = WheelSpeed(np.int64(10**9) + np.rint(own_t * 1e9).astype(np.int64), speed)
    found["prepared"] = [
        wheels.prepare_wheels(each, 10**9, (0.0, 1e3), bare, options)
        for each in (log, None, WheelSpeed(log.t_ns[:1], log.speed[:1]))
    ]
    odometer = found["slow"]
    for signed in (False, True):
        flags, values, var = np.arange(6), np.zeros((6, 7)), np.ones((6, 15))
        row = np.array([-1, 3, 0, -1, 5, 2])
        note_wheels(flags, values, var, row, replace(odometer, signed=signed))
        found[f"noted {signed}"] = [flags, values, var]
    return found


@scenario
def fusion_nodes() -> Any:
    """Fixes as the filter takes them, and nodes of them with delays, standstill and wheels."""
    from automap.fusion import nodes
    from automap.fusion.measurements import position, velocity
    from automap.fusion.measurements.position import hold_reported_sd
    from automap.fusion.measurements.wheel_speed import Odometer
    from automap.fusion.options import FusionOptions
    from automap.fusion.wheels import path_speed

    rng = np.random.default_rng(2)
    path = wavy_path(420, 0.2, 3)
    fixes = fixes_on(path, 3)
    t = fixes.gps_s - fixes.gps_s[0]
    t[11] = np.nan
    t[20], t[21] = t[21], t[20]
    # the velocity is all that these tell
    fixes.lat_rad[[40, 71]] = np.nan
    options = FusionOptions(common_horizontal_sd_m=0.9, bias_share=0.4)
    factors = {
        "position_h": 1.3,
        "position_v": 0.7,
        "velocity_h": 1.9,
        "velocity_v": 0.6,
        "wander": 1.4,
        "wander_v": 0.8,
        "multipath": 2.1,
    }
    model = nodes.model_fixes(fixes, t, options)
    shift = nodes.Shift(0.13, 0.21, -0.08, 3e-3, 0.05, 0.3)
    late = replace(shift, vel_latency_s=0.0, vel_lag_s=0.0)
    odometer = Odometer(
        np.arange(2.0, 70.0, 0.7), rng.uniform(0.0, 15.0, 98), rng.uniform(0.01, 0.1, 98)
    )
    seen = path_speed(model)
    lateral = rng.normal(0.0, 2.0, len(seen.t))
    found: dict[str, Any] = {
        "model": model,
        "speed": nodes.fix_speed(model),
        "shown": [nodes.as_shown(model, options, f) for f in (factors, {})],
        "errors": position.position_errors(fixes, rng.uniform(0.5, 2.0, len(t)), options),
        "states": position.states_accuracy(fixes, options),
        "lasting": [position.lasting_share(options, f) for f in (factors, {})],
        "unseen": [position.unseen_errors(model.stated_sd, options, f) for f in (factors, {})],
        "common": position.common_errors(fixes, options),
        "has": [*position.has_position(fixes), *velocity.has_velocity(fixes)],
        "velocity": velocity.velocity_errors(fixes, rng.uniform(0.5, 2.0, len(t)), options),
        "times": [
            shift.host_times(t),
            shift.wheel_times(t),
            shift.position_times(t),
            shift.velocity_delay_s,
        ],
        "split": [nodes._split(model, each) for each in (shift, late)],
    }
    small = replace(fixes, sd_pos_ned=0.2 * fixes.sd_pos_ned, hdop=0.1 * fixes.hdop)
    found["small"] = [
        position.states_accuracy(small, options),
        position.common_errors(small, options),
    ]
    for name, each, way, wheels, held in (
        ("all", model, shift, odometer, True),
        ("late", model, late, odometer, True),
        ("free", model, shift, odometer, False),
        ("no wheels", model, shift, None, True),
    ):
        made = nodes.build_nodes(
            each,
            way,
            (1.3, 77.7),
            [(20.0, 23.0), (50.1, 56.0)],
            seen.t,
            seen.speed,
            lateral,
            wheels,
            options,
            held,
        )
        found[name] = made
        found[f"{name} parts"] = [
            made.first_moving(3.0, 9.0),
            made.first_moving(9.0, 900.0),
            made.first_moving(1e4, 1e4),
            made.first_moving(0.0, 0.0),
            made.between(3, 9),
        ]
    none = nodes.model_fixes(replace(fixes, fix_type=0 * fixes.fix_type), t, options)
    found["none"] = nodes.build_nodes(
        none, shift, (1.3, 7.7), [], seen.t[:0], seen.speed[:0], lateral[:0], None, options, True
    )
    jumpy = np.exp(0.6 * rng.normal(size=(60, 3)))
    steady = np.repeat(np.exp(0.5 * rng.normal(size=(6, 3))), 10, axis=0)
    between = steady * np.exp(0.1 * rng.normal(size=(60, 3)))
    found["held"] = [hold_reported_sd(sd) for sd in (jumpy, steady, between, jumpy[:0], jumpy[:1])]
    return found


def small_problem(seed: int = 0, **options: Any) -> tuple[Any, Any, Any]:
    """A problem of some seconds, its fixes as the filter takes them, and its path."""
    from automap.fusion.model import build_state_model
    from automap.fusion.nodes import model_fixes
    from automap.fusion.options import FusionOptions
    from automap.fusion.problem import make_problem
    from tests.unit.fusion_drive import Sensor, record
    from tests.unit.fusion_motion import city_drive
    from tests.unit.fusion_receiver import Receiver, receive

    motion = city_drive(30.0, 5 + seed)
    imu = record(motion, Sensor(), 2, rate=20.0)
    fixes = receive(motion, Receiver(rate=2.0), 3, begin=1.2)
    chosen = FusionOptions(**options)
    problem = make_problem(imu, build_state_model(chosen), chosen)
    return problem, model_fixes(fixes, fixes.gps_s - 1.4e9, chosen), motion


@scenario
def fusion_bridges() -> Any:
    """Wild and frozen readings at the ends and in the middle, axes that hang, noise of shocks."""
    from automap.fusion import rest_noise, shocks, steady_readings, unusable_readings
    from automap.fusion.options import FusionOptions
    from automap.fusion.stuck_readings import clipped_axes, frozen_axes

    rng = np.random.default_rng(6)
    n = 400
    t = np.cumsum(rng.uniform(0.04, 0.06, n))
    values = rng.normal(size=(n, 6)) * np.repeat([0.1, 1.0], 3)
    found: dict[str, Any] = {}

    def log(readings: np.ndarray) -> ImuData:
        stamps = np.int64(3 * 10**9) + np.rint(t[: len(readings)] * 1e9).astype(np.int64)
        return ImuData(stamps, readings[:, :3].copy(), readings[:, 3:].copy())

    shapes = {}
    for name, rows in (
        ("begin", slice(0, 14)),
        ("middle", slice(100, 112)),
        ("end", slice(385, n)),
    ):
        shapes[f"frozen {name}"] = values.copy()
        shapes[f"frozen {name}"][rows] = values[rows.start]
    for name, row, axis, size in (
        ("first", 0, 1, 9.0),
        ("last", n - 1, 4, -200.0),
        ("two", 50, 0, 7.0),
        ("not", 60, 2, 5.9),
        ("force", 70, 3, 101.0),
        ("near", 80, 5, 99.0),
    ):
        shapes[f"wild {name}"] = values.copy()
        shapes[f"wild {name}"][row : row + (3 if name == "two" else 1), axis] = size
    shapes["units"] = values * np.repeat([57.3, 9.8], 3) * 3.0
    shapes["all frozen"] = np.tile(values[0], (n, 1))
    shapes["short"] = shapes["wild two"][48:54]
    shapes["long burst"] = values.copy()
    shapes["long burst"][200:209, 1] = 50.0
    for name, readings in shapes.items():
        found[name] = unusable_readings.bridge_unusable(log(readings))
    readings = np.concatenate([values, values])[:n]
    found["all wild"] = unusable_readings._wild(t, 1e3 * readings, np.zeros(n, bool))
    found["one wild"] = unusable_readings._wild(t[:1], readings[:1], np.ones(1, bool))
    found["noise"] = unusable_readings.bridge_noise(np.array([0.3, 0.7]), 2.0, 0.6)
    still = values.copy()
    still[20:140, 1], still[200:330, 3] = 0.07, -2.0
    still[250:256, 5] = 4.5
    still[300:307, 5] = -4.5
    still[380:384, 4] = 7.0
    twice = np.repeat(still, 2, axis=0)[:n]
    for name, each in (("still", still), ("twice", twice), ("flat", 0.0 * still)):
        counted = np.arange(n) % 9 != 4
        axes = [
            *frozen_axes(log(each), counted),
            *frozen_axes(log(each), np.ones(n, bool)),
            *clipped_axes(log(each)),
        ]
        found[f"axes {name}"] = [[axis, axis.seconds] for axis in axes]
    shaken = values.copy()
    shaken[150:158] *= 9.0
    found["shocks"] = [
        shocks.shock_noise(shaken[:, :3], shaken[:, 3:], step) for step in (0.05, 0.01, 0.3)
    ] + [shocks.shock_noise(shaken[:2, :3], shaken[:2, 3:], 0.05)]
    rests = ([(1.0, 8.0), (11.0, 18.3)], [(1.0, 3.0)], [], [(30.0, 40.0)], [(1.0, 6.5)])
    found["rest"] = [
        rest_noise.least_levels(log(shaken), t, rest, FusionOptions()) for rest in rests
    ]
    m = 900
    at = 0.02 * np.arange(m) + np.where(np.arange(m) > 600, 0.3, 0.0)
    rate = np.column_stack([0.3 * np.sin(0.8 * at), 0.1 * np.cos(9.0 * at), 0.2 * np.sin(3.0 * at)])
    rate += 0.05 * rng.normal(size=(m, 3)) + 0.1
    found["steady"] = [
        steady_readings.steady(at * scale, rate) for scale in (1.0, 0.4, 3.0, 8.0, 0.0)
    ] + [steady_readings.steady(at[:k], rate[:k]) for k in (1, 2, 799, 801)]
    found["weights"] = [
        steady_readings.wiener_weights(rate[:, 1], 0.02, half) for half in (100, 31, 6)
    ]
    return found


@scenario
def fusion_tables() -> Any:
    """Covariances at stamps, rates of change, what innovations show, sigmas that are widened."""
    from automap.fusion import consistency, stamp_error, widening
    from automap.fusion.doubts.path import Misses
    from automap.fusion.doubts.reason import Reason, verdict_of
    from automap.fusion.model import build_state_model
    from automap.fusion.options import FusionOptions
    from automap.fusion.output import Innovations, vehicle_tilt

    rng = np.random.default_rng(7)
    found: dict[str, Any] = {}
    k = 5
    for name, effects in (
        ("all", ("imu_mounting", "imu_time_offset", "imu_clock_skew")),
        ("mounting", ("imu_mounting",)),
        ("offset", ("imu_time_offset", "gyro_bias")),
        ("none", ()),
    ):
        model = build_state_model(FusionOptions(effects=effects))
        rows = stamp_error.reported_rows(model)
        root = rng.normal(size=(k, len(rows), len(rows)))
        cov = root @ np.swapaxes(root, 1, 2)
        change = rng.normal(size=(k, 9))
        at = np.cumsum(rng.uniform(0.5, 2.0, k))
        found[name] = [
            rows,
            *(stamp_error.covariance_at_stamps(model, cov, at, change, sd) for sd in (0.0, 0.3)),
        ]
        quat = rng.normal(size=(k, 10))
        quat[:, 6:] /= np.linalg.norm(quat[:, 6:], axis=1)[:, None]
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        own = stamp_error.mounting_rows(model).stop
        found[f"{name} tilt"] = vehicle_tilt(quat, cov[:, :own, :own], turn)
    t = 0.02 * np.arange(30)
    states = np.column_stack(
        [
            0.7 + 1e-6 * t,
            0.2 - 2e-6 * t,
            90.0 + t,
            9.0 * np.sin(t),
            4.0 * t,
            t**2,
            np.cos(t),
            0.6 * np.sin(t),
            0.8 * np.sin(t),
            0.0 * t,
        ]
    )
    states[11:, 6:] *= -1.0
    when = np.array([-0.1, 0.0, 0.02, 0.22, 0.3, 0.57, 0.58, 0.7])
    found["rates"] = [
        stamp_error.rates_of_change(t, states, when),
        stamp_error.rates_of_change(t[:1], states[:1], when),
    ]
    names = (
        "position_n",
        "position_e",
        "velocity_n",
        "velocity_e",
        "velocity_d",
        "odometer",
        "nhc_y",
        "position_d",
    )
    sizes = (1.1, 3.0, 0.5, 1.3, 4.0, 2.5, 9.0, 9.0)
    for keep in (0.0, 0.9):
        parts = []
        for channel, size, many in zip(
            names, sizes, (40, 60, 80, 300, 21, 20, 50, 19), strict=True
        ):
            rows = rng.normal(size=many)
            for i in range(1, many):
                rows[i] += keep * rows[i - 1]
            parts.append((np.full(many, channel, object), size * rows, rng.uniform(0.5, 2.0, many)))
        channel, ratio, sd = (np.concatenate(c) for c in zip(*parts, strict=True))
        table = Innovations(
            np.arange(len(sd)), channel, ratio * sd, sd, ratio**2, rng.uniform(size=len(sd)) > 0.3
        )
        each = consistency.channel_consistency(table)
        found[f"channels {keep}"] = [each, {c: each[c].sigma_factor for c in each}]
        for some in (
            names,
            ("position_n", "velocity_n"),
            ("velocity_e", "velocity_d"),
            ("odometer",),
        ):
            found[f"doubts {keep} {some}"] = words_of(
                consistency.innovation_doubts({c: each[c] for c in some})
            )
    way, alone = wavy_path(300, 0.5, 8), wavy_path(250, 0.55, 9, 0.06)
    misses = Misses(
        3.0 * np.arange(40), rng.normal(0.0, 4.0, (40, 3)), np.ones((40, 3)), np.ones((40, 3))
    )
    reasons = [
        Reason("a", "", ((10.0, 40.0), (90.0, 100.0)), error_m=3.0, factor=1.7),
        Reason("b", "", error_m=1.0, height_m=4.0, state="good"),
        Reason("c", "", ((30.0, 60.0),), late_s=0.7, state="unusable", inertial=True),
        Reason("d", "", error_m=90.0, handled=True),
        Reason("e", "", late_s=0.2, factor=1.2, state="good"),
    ]
    none = Misses(*(a[:0] for a in (misses.t, misses.miss, misses.white_var, misses.slow_var)))
    for name, some in {
        "all": reasons,
        "one": reasons[:1],
        "good": reasons[1:2],
        "late": reasons[2:3],
        "handled": reasons[3:4],
        "last": reasons[4:],
    }.items():
        found[f"widened {name}"] = [
            widening.widen(way, some, m, a) for m in (misses, none) for a in (None, alone)
        ]
        verdict = verdict_of(some)
        found[f"verdict {name}"] = [verdict, str(vars(verdict))]
    return found
