"""Kept figures of what the fusion doubts of a path: where it contradicts, steps of velocities."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from automap.frames import rpy_to_matrix
from automap.records import Fixes, ImuData
from tests.unit.scenarios import scenario
from tests.unit.scenarios_fusion import fixes_on, wavy_path, words_of


def _slope_of(path: Any, t: Any, height: Any) -> Any:
    from automap.fusion.doubts import heights

    changes = heights._changes(path, t, height)
    return None if changes is None else heights._slope(changes)


@scenario
def fusion_path_doubts() -> Any:
    """A path against fixes, another path, itself later, hills and roads."""
    from automap.fusion.doubts import constancy, difference, heights, outcome, path
    from automap.fusion.nodes import model_fixes
    from automap.fusion.options import FusionOptions
    from automap.fusion.output import Innovations, ParameterHistory

    rng = np.random.default_rng(4)
    way = wavy_path(900, 0.4, 6)
    other = wavy_path(600, 0.6, 7, 0.051)
    other = replace(other, gps_s=other.gps_s + 40.1)
    options = FusionOptions()
    fixes = fixes_on(way, 3, 8)
    off = (np.arange(len(fixes)) > 120) & (np.arange(len(fixes)) < 190)
    wrong = replace(fixes, lat_rad=fixes.lat_rad + 16.0 * off / 6.37e6, gps_s=fixes.gps_s + 0.1)
    found: dict[str, Any] = {}
    arm = np.array([1.0, -0.5, 0.7])
    for name, log in (("sound", fixes), ("wrong", wrong)):
        model = model_fixes(log, log.gps_s, options)
        misses = path.fix_misses(way, model, arm, 0.3)
        bad = path.contradicted(misses, 7.0)
        found[name] = {
            "misses": misses,
            "bad": bad,
            "spans": path.spans_of(misses.t, bad),
            "local": path.local_error(misses),
            "without": path.fix_misses(way, model),
            "apart": path.fix_misses(replace(way, gps_s=way.gps_s - 9e3), model),
        }
    few = path.Misses(*(a[:1] for a in (misses.t, misses.miss, misses.white_var, misses.slow_var)))
    found["few"] = [path.contradicted(few, 7.0), path.local_error(few)]
    found["left"] = [path._left_of_slow(x) for x in (1e-4, 2e-3, 0.5, 30.0)]
    rows = np.linspace(way.gps_s[0] - 5.0, way.gps_s[-1] + 5.0, 50)
    lost = replace(other, gps_s=other.gps_s + 1e5)
    late = 0.5 + 0.3 * np.sin(np.arange(200.0))
    found |= {
        "between": [difference.between(way, each)(rows) for each in (other, lost)],
        "course": [difference.off_course(way, each) for each in (other, lost)],
        "within": difference.within(way, late, slice(300, 500)),
        "at once": difference.within(way, 0.0 * late, slice(300, 500)),
    }
    bumps = wavy_path(900, 1.1, 6)
    hole = np.where(np.arange(300) % 17 == 5, np.nan, 0.0)
    logs = {
        scale: fixes_on(
            bumps,
            3,
            9,
            height_m=scale * bumps.height_m[::3] + rng.normal(0.0, 0.3, 300) + hole,
            gps_s=bumps.gps_s[::3] + np.roll(hole, 3),
        )
        for scale in (1.0, 3.28, 0.3048, 1.5, 1.25, 0.8, -0.4, 3.5)
    }
    logs[0.8].lat_rad[9:30:4] = np.nan
    logs[1.5].gps_s[40:50] = logs[1.5].gps_s[40]
    mixed = np.random.default_rng(1).permutation(300)
    logs[1.25] = Fixes(**{k: v[mixed] for k, v in vars(logs[1.25]).items()})
    found["hills"] = {
        str(scale): [
            words_of(heights.height_doubts(bumps, log)),
            _slope_of(bumps, bumps.gps_s[:200] - 1.4e9 + 0.2, scale * bumps.height_m[:200]),
        ]
        for scale, log in logs.items()
    }
    level = replace(bumps, rpy=bumps.rpy * [1.0, 0.0, 1.0] + [0.0, 0.01, 0.0])
    found["level"] = words_of(heights.height_doubts(level, logs[1.5]))
    tilted = replace(way, rpy=way.rpy + [0.23, 0.0, 0.0] * (np.arange(900) > 500)[:, None])
    steep = replace(way, rpy=way.rpy + [0.0, -0.4, 0.0] * (np.arange(900) < 300)[:, None])
    sd = 0.01 + 0.005 * np.sin(np.arange(900.0))
    ways = (way, tilted, steep, replace(way, vel_ned=0.1 * way.vel_ned))
    found["leans"] = [words_of(outcome.leaning(w)) for w in ways]
    found["askew"] = [
        [words_of(outcome.mounted_askew(w, s)[0]), outcome.mounted_askew(w, s)[1]]
        for w in (*ways, replace(tilted, rpy=-tilted.rpy))
        for s in (sd, sd + 0.06)
    ]
    found["heading"] = [
        words_of(outcome.weak_heading(m, c)) for m in (4.9, 5.1) for c in (0.25, 0.28, np.inf)
    ]
    found["unsure"] = [words_of(outcome.unsure_path(s)) for s in (29.0, 31.0, np.nan)]
    channels = np.array(["position_n", "velocity_e", "nhc_y", "odometer", "zupt_n"], object)
    m = 5 * 24
    table = Innovations(
        *(
            np.arange(m)
            if f == "t_ns"
            else np.resize(channels, m)
            if f == "channel"
            else np.arange(m) % 24 > np.arange(m) % 5 * 2 + 1
            if f == "accepted"
            else np.ones(m)
            for f in Innovations.__dataclass_fields__
        )
    )
    found["refused"] = [
        words_of(outcome.refused(t))
        for t in (
            table,
            replace(table, **{f: getattr(table, f)[:95] for f in Innovations.__dataclass_fields__}),
        )
    ]
    k = 40
    names = (
        "imu_time_offset_s",
        "gnss_latency_s",
        "gnss_lever_arm_x",
        "gnss_lever_arm_y",
        "imu_mounting_pitch",
        "imu_mounting_yaw",
        "odometer_scale_relative",
    )
    shrink = np.linspace(1.0, 0.05, k)[:, None] ** np.linspace(0.7, 1.3, 7)
    for size in (0.0, 0.6, 3.0):
        jump = size * (np.arange(k) > 22)[:, None] * np.array([0.6, -0.5, 2.0, -3.0, 0.4, 0.6, 1.0])
        history = ParameterHistory(
            (7 + np.arange(k)) * np.int64(3 * 10**9),
            names,
            0.01 * rng.normal(size=(k, 7)) + jump,
            0.3 * shrink,
        )
        found[f"moves {size}"] = [
            [constancy.move_of(history, name) for name in (*names, "other")],
            words_of(constancy.constancy_doubts(history)),
        ]
    for size in (0.5, 0.9, 1.4, 2.5, 5.0):
        for moved in range(6):
            jump = size * (np.arange(k) > 22)[:, None] * (np.arange(7) == moved) * 0.5
            jump += 0.8 * (np.arange(k) > 25)[:, None] * (np.arange(7) == (1, 9, 3, 9, 5, 9)[moved])
            one = replace(history, values=0.01 * rng.normal(size=(k, 7)) + jump)
            found[f"move {size} {moved}"] = words_of(constancy.constancy_doubts(one))
    two = replace(
        history, t_ns=history.t_ns[:2], values=history.values[[0, -1]], sd=history.sd[[0, -1]]
    )
    found["two"] = constancy.move_of(two, names[0])
    short = ParameterHistory(history.t_ns[:1], names, history.values[:1], history.sd[:1])
    found["no move"] = [
        constancy.move_of(short, names[0]),
        constancy.move_of(replace(history, sd=0.0 * history.sd + 0.3), names[0]),
    ]
    return found


@scenario
def fusion_velocity_steps() -> Any:
    """Jumps of a receiver's velocity that an IMU does not feel: found, followed, told."""
    from automap.fusion import free_inertial
    from automap.fusion.doubts import turns, velocity_step
    from tests.unit.figure_calls import after

    rng = np.random.default_rng(9)
    m = 160
    t = 0.5 * np.arange(m) + rng.uniform(0.0, 0.05, m)
    t[100:] += 4.0
    q = np.linalg.qr(rng.normal(size=(m, 3, 3)))[0]
    turn = np.broadcast_to(q[0], (m, 3, 3)) + 0.01 * rng.normal(size=(m, 3, 3))
    felt = np.cumsum(rng.normal(0.0, 0.3, (m, 3)), axis=0)
    felt_position = np.cumsum(0.5 * felt, axis=0)
    found: dict[str, Any] = {}
    for name, jumps in {
        "none": [],
        "one": [(60, 3.0, -2.0)],
        "back": [(40, 3.0, -2.0), (70, -3.0, 2.0)],
        "two": [(30, 1.5, 2.0), (80, 0.3, 3.0), (140, -2.0, -2.0)],
        "first": [(6, 3.0, -2.0)],
    }.items():
        velocity = (turn[:, :2] @ felt[..., None])[..., 0] + rng.normal(0.0, 0.1, (m, 2))
        place = (turn[:, :2] @ felt_position[..., None])[..., 0] + rng.normal(0.0, 0.3, (m, 2))
        for row, north, east in jumps:
            velocity[row:] += [north, east]
            place += np.maximum(t - t[row], 0.0)[:, None] * [north, east]
        velocity[20] += 9.0
        for lost in (0.0, 0.7):
            seen = velocity_step.Compared(
                t, velocity, place, felt, felt_position, turn, lost * (np.arange(m) > 120)
            )
            steps = velocity_step.velocity_steps(seen, 0.2)
            rows = np.array([10, 35, 59, 90, 130])
            found[f"{name} {lost}"] = [
                steps,
                velocity_step._velocity_jumps(seen, rows, 6),
                velocity_step.filled(t, seen.lost_s, np.arange(5, m - 6), 6, 0.5),
                [velocity_step._goes_along(seen, k, np.array([3.0, -2.0]), 0.5) for k in rows],
                [velocity_step._lasts(seen, int(k), np.array([2.0, -1.0])) for k in rows],
                [
                    [str(r.as_dict()), r]
                    for r in velocity_step.step_doubts(steps, wavy_path(300, 0.5))
                ],
            ]
    few = velocity_step.Compared(
        *(a[:9] for a in (t, velocity, place, felt, felt_position, turn, t))
    )
    found["few"] = [
        velocity_step.velocity_steps(few, 0.2),
        velocity_step.velocity_steps(
            velocity_step.Compared(
                *(a[:1] for a in (t, velocity, place, felt, felt_position, turn, t))
            ),
            0.2,
        ),
    ]
    kinds = [
        (5.0, 2.0, 1.0, 9.0),
        (20.0, -2.1, -0.8, 50.0),
        (40.0, 1.0, 1.0, 4.0),
        (44.0, -0.4, 1.0, 30.0),
        (70.0, 3.0, 0.0, 70.0),
        (75.0, -1.0, 0.5, 5.0),
        (150.0, 0.2, 2.0, 61.0),
    ]
    each = [velocity_step.Step(when, np.array([n, e]), lasts) for when, n, e, lasts in kinds]
    for first in range(7):
        for last in range(first + 1, 8):
            led = velocity_step.led_away(each[first:last], 200.0)
            found[f"led {first} {last}"] = [led, [s.size for s in each[first:last]]]
    found["doubts"] = [
        [str(r.as_dict()) for r in velocity_step.step_doubts(some, wavy_path(300, 0.5))]
        for some in (each, each[:1], each[:2], [])
    ]
    path = wavy_path(500, 0.2, 4)
    at = path.gps_s - path.gps_s[0]
    gyro = np.column_stack(
        [0.05 * np.sin(at), 0.04 * np.cos(at), np.gradient(np.unwrap(path.rpy[:, 2]), at)]
    )
    accel = np.column_stack(
        [np.gradient(np.hypot(*path.vel_ned[:, :2].T), at), 0.3 * np.sin(at), -9.8 + 0.0 * at]
    )
    bridged = np.where((at > 30.0) & (at < 31.0), 0.9, 0.0) + np.where(at > 90.0, 0.2, 0.0)
    wanted = np.array([-1.0, 0.0, 3.05, 30.3, 77.7, 99.8, 200.0])
    stamps = at + np.where(at > 50.0, 0.4, 0.0)
    for name, want in (("all", None), ("some", wanted)):
        free = free_inertial.free_inertial(stamps, gyro, accel, bridged, want)
        when = np.array([0.02, 1.13, 30.4, 60.31, 90.09])
        found[f"free {name}"] = [
            free,
            free.nearest(np.append(when, [-3.0, 300.0])),
            free.of_point(when, np.array([1.0, -2.0, 0.5])),
            free.lost_between(
                np.array([-1.0, 0.0, 29.0, 49.0, 60.0]), np.array([5.0, 29.0, 52.0, 51.0, 101.0])
            ),
        ]
    size = 30
    found["integrated"] = after(
        free_inertial._integrate,
        stamps[:size],
        9.0 * gyro[:size],
        accel[:size],
        rpy_to_matrix([0.1, -0.2, 0.7]),
        np.linspace(-0.2, 0.3, 6),
        np.array([0, 4, 5, 20, 29]),
        np.eye(5, 4),
        np.zeros((5, 3)),
        np.zeros((5, 3)),
    )
    fixes = fixes_on(path, 4, 6)
    ages = {
        "gnss_velocity_latency_s": (0.1, 0.1),
        "gnss_velocity_lag_tau": (0.05, 0.1),
        "gnss_latency_s": (-0.2, 0.1),
    }
    fixes.lat_rad[[30, 61]], fixes.gps_s[[44, 70]] = np.nan, np.nan
    shuffled = Fixes(**{k: np.concatenate([v, v[:9]])[::-1] for k, v in vars(fixes).items()})
    for name, log, known in (("aged", fixes, ages), ("plain", shuffled, {})):
        found[f"compared {name}"] = [
            velocity_step.compare(free, log, path, known, np.array([1.0, -2.0, 0.5])),
            velocity_step.told_times(log, path, known),
        ]
    far = replace(fixes, gps_s=fixes.gps_s + 1e4)
    found["apart"] = velocity_step.compare(free, far, path, {}, np.zeros(3))
    log = ImuData(np.int64(4 * 10**9) + np.rint(stamps * 1e9).astype(np.int64), gyro, accel)
    seen_at, shown = stamps[::3] + 0.03, path.vel_ned[::3] + rng.normal(0.0, 0.05, (167, 3))
    for name, matrix, v in (
        ("right", np.eye(3), shown),
        ("mirrored", np.diag([1.0, -1.0, -1.0]), shown),
        ("back", np.diag([-1.0, -1.0, 1.0]), shown),
        ("scaled", np.diag([1.0, 1.0, 0.7]), shown),
        ("slow", np.eye(3), 0.2 * shown),
    ):
        found[f"turns {name}"] = [
            [str(r.as_dict()), r] for r in turns.turn_doubts(log, matrix, seen_at, v)
        ]
        speed = np.hypot(v[:, 0], v[:, 1])
        course = np.unwrap(np.arctan2(v[:, 1], v[:, 0]))
        found[f"slopes {name}"] = [
            turns.slope_of(
                stamps, (gyro @ matrix.T)[:, 2] + 0.02, seen_at + late, course, speed > 3.0
            )
            for late in (0.0, 0.4)
        ] + [
            turns.slope_of(
                stamps,
                (accel @ matrix.T)[:, 0],
                seen_at[::step],
                speed[::step],
                speed[::step] >= 0.0,
            )
            for step in (1, 5)
        ]
    x, span = rng.normal(size=50), rng.uniform(1.0, 3.0, 50)
    found["fit"] = [
        turns._fit(x, y, span, 0.3, 0.1)
        for y in (2.0 * x + 0.3 * span + 0.1 * rng.normal(size=50), 0.0 * x)
    ]
    return found
