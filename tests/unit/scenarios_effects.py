"""Effects one by one: their kernels, and what they do to readings, fixes, wheels and boxes."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np

from automap.records import Camera, Detections
from tests.unit.figure_calls import after
from tests.unit.scenarios import scenario


def _turned(rng: np.random.Generator, n: int) -> np.ndarray:
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.random(n, random_state=int(rng.integers(1000))).as_matrix())


@scenario
def effects_terms() -> Any:
    """Sums and columns of terms of every kind on each axis, with signals and a turned mounting."""
    from automap.effects.measured_kernels import (
        _across,
        antenna_position,
        antenna_velocity,
        course_changes,
        rows_along,
        vehicle_velocity,
    )
    from automap.effects.term_columns import (
        attitude_columns,
        course_columns,
        lengthen,
        plain_columns,
        point_columns,
        turn_columns,
    )
    from automap.effects.term_sums import (
        AXES,
        MOUNTED,
        MeasuredTerms,
        Terms,
        _mount,
        back,
        cross,
        new_room,
        set_signals,
        sum_terms,
        times,
    )

    rng = np.random.default_rng(1)
    kinds = (0, 1, 2, 4, 5, 6, 7)
    pairs = [(kind, axis) for kind in kinds for axis in range(3)]
    order = rng.permutation(len(pairs))
    codes = np.array([(int(k) % 7, *pairs[k], int(k) % 6) for k in order])
    weights = rng.uniform(0.5, 1.5, len(codes)) * np.where(np.arange(len(codes)) % 3, 1.0, -1.0)
    now = np.array([1.0, 0.7, -0.6, 0.8, 1.2, -0.9])
    xi, room = rng.uniform(-0.5, 0.5, 7), rng.normal(size=(24, 3))
    vel, acc, rate = rng.normal(0.0, 3.0, 3), rng.normal(0.0, 2.0, 3), rng.normal(size=3)
    c = _turned(rng, 1)[0]
    h = rng.normal(size=(3, 16))
    still = codes[codes[:, 1] != 1]
    known = room.copy()
    plain_room = np.zeros((24, 3))
    plain_room[7:10] = plain_room[10:13] = np.eye(3)
    slow, rest = np.array([0.4, -0.5, 2.0]), np.array([0.0, 0.0, 1.0])
    found: dict[str, Any] = {
        "room": after(new_room),
        "signals": after(set_signals, np.ones(7), 3.5, np.array([2.0, 4.0, 8.0])),
        "sums": after(sum_terms, codes, weights, now, xi, room),
        "mount": after(_mount, rng.normal(size=3), np.zeros((3, 3)), np.ones((3, 3))),
        "products": [after(f, c, vel, np.zeros(3)) for f in (times, back)],
        "cross": after(cross, vel, acc, np.zeros(3)),
        "attitude": after(attitude_columns, h, vel),
        "points": after(point_columns, h, codes, weights, now, room, c),
        "no arm": after(point_columns, h, still, weights, now, plain_room, c),
        "turns": after(turn_columns, h, codes, weights, now, room[AXES : AXES + 3], vel),
        "plain": after(plain_columns, h, codes, weights, now, acc, vel),
        "course": after(course_columns, h, codes, weights, now, acc),
        "longer": after(lengthen, h, np.array([1.0, 1.3, 0.8])),
        "across": [after(_across, v, acc, np.ones(3)) for v in (vel, slow, rest)],
        "changes": after(
            course_changes, rng.normal(size=(5, 3)), rng.normal(size=(5, 3)), np.zeros((5, 3))
        ),
    }
    for k in range(3):  # a mounting of which one angle is as it was
        known[MOUNTED] = 0.0
        part = codes[codes[:, 1] != 4]
        turns = np.array([[k, 4, k, 0]])
        found[f"turned {k}"] = after(
            sum_terms,
            np.vstack([part, turns]),
            np.append(weights[: len(part)], 1.0),
            now,
            xi,
            known,
        )
    for name, v in (("fast", 4.0 * vel), ("slow", slow)):
        given = (xi, codes, weights, now, plain_room)
        found[f"position {name}"] = after(antenna_position, h, np.zeros(3), v, c, rate, *given)
        found[f"velocity {name}"] = after(antenna_velocity, h, np.zeros(3), v, c, rate, acc, *given)
        for own, few in (("all", codes), ("own", codes[(codes[:, 3] < 2) | (codes[:, 3] > 3)])):
            given = (xi, few, weights, now, plain_room)
            found[f"vehicle {name} {own}"] = after(
                vehicle_velocity, h, np.zeros(3), v, c, rate, acc, *given
            )
    n = 4
    on = Terms(codes, weights)
    found["along"] = after(
        rows_along,
        *(rng.normal(0.0, 3.0, (n, 3)), _turned(rng, n), rng.normal(size=(n, 3))),
        *(rng.normal(size=(n, 3)), np.array([0.5, 1.0, 2.5, 4.0]), rng.normal(size=(n, 2)), xi),
        *(MeasuredTerms(on, on, on), np.zeros((n, 3, 3, 7))),
    )
    return found


def lens() -> np.ndarray:
    """Every coefficient of OpenCV's, and a sensor that is tilted both ways."""
    tilt = np.eye(3) + 0.1 * np.random.default_rng(4).standard_normal((3, 3))
    some = [-0.2, 0.05, 2e-2, -3e-2, 0.03, 0.1, -0.04, 0.02, 4e-2, -2e-2, 3e-2, 1e-2]
    return np.concatenate([some, tilt.ravel()])


@scenario
def effects_camera_kernels() -> Any:
    """Through a lens and back, where it folds too; what errors of a camera do."""
    from automap.effects.camera_kernels import (
        _lens_columns,
        all_columns,
        bend,
        by_point,
        distort,
        effect_columns,
        undistort,
    )

    rng = np.random.default_rng(5)
    points = rng.uniform(-1.0, 1.0, (9, 2))
    folded = np.zeros(21)
    folded[:2] = -0.5, 0.02
    folded[12:] = np.eye(3).ravel()
    q = rng.uniform([3.0, -3.0, -3.0], [20.0, 3.0, 3.0], (4, 3))
    height, share = rng.uniform(0.1, 0.4, 4), rng.uniform(-0.5, 0.5, 4)
    rate, velocity = rng.normal(size=(4, 3)), rng.normal(0.0, 5.0, (4, 3))
    c = _turned(rng, 1)[0]
    h = q[0, 1:] / q[0, 0]
    far = np.concatenate([points, 2.5 * points, np.zeros((1, 2))])
    return {
        "bent": [after(bend, lens(), y, z, np.zeros((2, 5))) for y, z in points[:4]],
        "there": after(distort, lens(), points),
        "back": after(undistort, lens(), points, 1e-9),
        "folded": after(undistort, folded, far, 1e-2),
        "nearly": [after(undistort, folded, 0.62 * points, x) for x in (1e-3, 0.03, 0.3)],
        "move": after(by_point, h, q[0], np.array([1.0, -2.0, 3.0]), np.zeros((3, 4)), 2),
        "lens": after(_lens_columns, h, 0.3, lens(), np.zeros((3, 11))),
        "one": after(
            effect_columns, h, q[0], 0.3, 0.2, rate[0], velocity[0], c, lens(), np.zeros((3, 11))
        ),
        "all": after(all_columns, q, height, share, rate, velocity, c, lens()),
    }


def _camera(**changes: Any) -> Camera:
    matrix = np.array([[900.0, 3.0, 630.0], [0.0, 950.0, 350.0], [0.0, 0.0, 1.0]])
    bent = np.array([-0.2, 0.05, 2e-3, -3e-3, 0.01, 0.1, -0.04, 0.02, 4e-3, -2e-3, 3e-3, 1e-3])
    own = Camera(
        1280, 720, matrix, np.concatenate([bent, [0.05, -0.03]]), np.array([0.5, 0.1, -1.2]),
        np.array([0.02, -0.05, 0.3]), 0.01, 0.5, 0.1,
    )  # fmt: skip
    return replace(own, **changes)


SOFT = "a mount that gives way"


@contextmanager
def users(*effects: Any) -> Iterator[None]:
    """Have users' effects for so long."""
    from automap.effects.user import set_user_effects, user_effects

    before = user_effects()
    set_user_effects(effects)
    try:
        yield
    finally:
        set_user_effects(before)


def _soft() -> Any:
    from automap.effects.user import UserTerm, user_effect

    return user_effect(
        "soft_mount",
        SOFT,
        UserTerm("twist", "camera_yaw", lambda s: 0.7 * s.heading, 0.1),
        UserTerm("late", "camera_time", lambda s: s.speed, 0.1),
        UserTerm("nod", "camera_pitch", lambda s: s.rate_y, 0.1),
        UserTerm("lean", "camera_roll", lambda s: s.force_y, 0.1),
    )


def _signals(rng: np.random.Generator, n: int, step: float = 1.0) -> Any:
    from automap.effects.signals import Signals

    return Signals(step * np.arange(float(n)), *rng.uniform(0.3, 1.8, (18, n)))


ERRORS = {
    "camera_boresight": {"roll": 0.02, "pitch": -0.03, "yaw": 0.05},
    "camera_time_offset": {"s": 0.07},
    "rolling_shutter": {"s": 0.4},
    "camera_focal": {"relative": 0.04},
    "camera_distortion": {"k1": 0.03, "k2": -0.02},
    "camera_lever_arm": {"x": 0.2, "y": -0.1, "z": 0.3},
    "soft_mount": {"twist": 0.06, "late": 0.05, "nod": -0.04, "lean": 0.03},
}


@scenario
def effects_camera() -> Any:
    """A camera with all of its errors, and a user's, that sees points and boxes."""
    from automap.effects import camera, lens
    from automap.effects.camera_user import depends_on_the_drive, drift, user_columns
    from automap.effects.path_signals import PathSignals
    from automap.interpolation import Poses

    rng = np.random.default_rng(6)
    stated = _camera()
    bare = _camera(distortion=np.zeros(5))
    few = _camera(distortion=np.array([-0.2, 0.05, 1e-3, 2e-3]))
    found: dict[str, Any] = {}
    pixels = rng.uniform([50.0, 40.0], [1200.0, 690.0], (7, 2))
    q = rng.uniform([3.0, -2.0, -1.5], [20.0, 2.0, 1.5], (6, 3))
    behind = np.vstack([q, [[-2.0, 1.0, 1.0], [0.0, 1.0, 1.0]]])
    low = rng.uniform([100.0, 100.0], [900.0, 500.0], (6, 2))
    box = np.hstack([low, low + rng.uniform([10.0, 15.0], [60.0, 90.0], (6, 2))])
    edges = np.array(
        [[1.4, 50, 60, 90], [40, 1.4, 60, 90], [40, 50, 1277.6, 90], [40, 50, 60, 717.6],
         [1.6, 1.6, 1277.4, 717.4], [40, 50, 60, 90]]
    )  # fmt: skip
    for name, each in (("all", stated), ("bare", bare), ("few", few)):
        found[name] = {
            "seen": lens.project(each, behind),
            "directions": lens.normalise(each, pixels),
            "lens": lens.lens_of(each),
        }
    found["focal"] = lens.focal_length(stated)
    found["edges"] = [bool(x) for x in lens.touches_edge(stated, edges)]
    found["variances"] = [
        lens.box_variances(stated, edges, rng.uniform(0.01, 0.05, 6), px, 0.1, turned)
        for px, turned in ((2.0, 0.0), (5.0, 0.01))
    ]
    with users(_soft()):
        signals = _signals(rng, 12)
        true = [camera.true_camera(each, ERRORS) for each in (stated, bare, few)]
        turns = _turned(rng, 6)

        def pose(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            return np.column_stack([3.0 * t, 0.5 * t**2, -0.2 * t]), turns

        point = np.array([40.0, 9.0, -2.0])
        t = 1.0 + np.arange(6.0)
        t_ns = np.int64(10**9) + np.arange(6) * np.int64(7 * 10**8)
        boxes = Detections(
            np.arange(6), t_ns, np.full(6, "a", object), box, np.ones(6), np.full(6, -1)
        )
        path = PathSignals(5 * 10**8, signals)
        columns = rng.normal(size=(6, 3, 11))
        rows = np.array([-9.0, 3.0, 200.0, 500.0, 719.0, 900.0])
        wide, none = np.ones((4, 3)), np.ones(4)
        small = Poses(
            0.7 + 1e-5 * rng.normal(size=4), 0.2 + 1e-5 * rng.normal(size=4),
            np.array([300.0, np.nan, 310.0, 280.0]), wide, rng.normal(size=(4, 3)),
            wide, wide, wide, none, none > 0.0, none,
        )  # fmt: skip
        found |= {
            "true": true,
            "share": camera.row_share(rows, 720),
            "delay": camera.row_delay_s(rows, 720, ERRORS),
            "stated": [
                camera.as_stated(boxes, each, values, way)
                for each, values, way in (
                    (stated, ERRORS, path),
                    (stated, ERRORS, None),
                    (bare, {"soft_mount": {"late": 0.05}}, path),
                )
            ],
            "poses": camera.camera_poses(small, stated, (0.7, 0.2, 290.0)),
            "in camera": camera.in_camera(stated, *pose(t), point),
            "exposed": [
                camera.exposed(each, values, pose, t, point, own)
                for each, values, own in (
                    (stated, ERRORS, signals),
                    (bare, ERRORS, None),
                    (bare, {"soft_mount": ERRORS["soft_mount"]}, signals),
                )
            ],
            "columns": camera.error_columns(
                stated, ERRORS, q, rng.uniform(0.1, 0.3, 6), rng.uniform(-0.5, 0.5, 6),
                rng.normal(size=(6, 3)), rng.normal(0.0, 5.0, (6, 3)),
            ),
            "parameters": camera.by_parameters(ERRORS, columns),
            "by point": camera.direction_by_point(q),
            "by turn": camera.direction_by_turn(q),
            "drift": drift(ERRORS, signals),
            "users": user_columns(signals.at(t), columns),
            "depends": [
                depends_on_the_drive(v) for v in (None, ERRORS, {"camera_focal": {"relative": 0.1}})
            ],
        }  # fmt: skip
    found["nobody's"] = [depends_on_the_drive(), user_columns(signals.at(t), columns)]
    return found


def _sizes(seed: int) -> dict[str, dict[str, float]]:
    """A value for every parameter of every effect, of its prior's size."""
    from automap.effects import CATALOGUE

    rng = np.random.default_rng(seed)
    return {
        e.name: {p.name: float(p.prior_sd * rng.uniform(0.5, 2.0)) for p in e.parameters}
        for e in CATALOGUE.values()
    }


@scenario
def effects_readings() -> Any:
    """Every inertial effect by itself and all of them at once, with what they depend on or not."""
    from automap.effects import CATALOGUE, imu
    from automap.effects.inertial_signals import asks_for_the_drive, formula_of, inertial_signal
    from automap.effects.inertial_signals import late as late_by
    from automap.effects.user import UserTerm, user_effect

    rng = np.random.default_rng(8)
    n = 9
    gyro, accel = rng.normal(0.0, 0.4, (n, 3)), rng.normal(0.0, 5.0, (n, 3))
    warm, speed = rng.uniform(10.0, 50.0, n), rng.uniform(0.0, 30.0, n)
    warm[3] = np.nan
    own = user_effect(
        "hum", "a hum", UserTerm("size", "accel_y", lambda s: s.speed * s.rate_z, 0.1),
        UserTerm("swing", "accel_z", lambda s: s.heading, 0.2),
    )  # fmt: skip
    values = _sizes(1) | {"hum": {"size": 0.3, "swing": -0.2}, "accel_bias": {"z": 0.4}}
    found: dict[str, Any] = {}
    with users(own):
        signals = _signals(rng, n, 0.02)
        signals = replace(signals, time=signals.time + 20.0)
        names = [e.name for e in CATALOGUE.values() if e.family == "imu"]
        terms = imu.imu_terms(names)
        found["terms"] = [
            f"{t.name} {t.sensor} {t.axis} {t.basis} {t.extra} {asks_for_the_drive(t.extra or '')}"
            for t in terms
        ]
        found["formulas"] = [formula_of(t.extra) for t in terms if t.extra and "." not in t.extra]
        for k, rest in enumerate(
            ((warm, speed, None, signals), (warm, None, 18.0, signals), (None, speed, None, None))
        ):
            found[f"columns {k}"] = [
                inertial_signal(t.extra, gyro, accel, *rest) for t in terms if t.extra
            ]
            found[f"basis {k}"] = imu.extra_basis(
                terms, gyro, accel, *rest, (0.5 * gyro, 0.3 * accel)
            )
            found[f"read {k}"] = imu.distort_imu(gyro, accel, values, *rest)
            found[f"own basis {k}"] = imu.extra_basis(terms, gyro, accel, *rest)
        found["nothing warm"] = inertial_signal(
            "temperature", gyro, accel, np.full(n, np.nan), None, None, None
        )
        for name in names:
            found[name] = imu.distort_imu(
                gyro, accel, {name: values[name]}, warm, speed, 20.0, signals
            )
        found["late"] = late_by("late_rate_y", 0.013, gyro, accel, signals.time)
    return found


@scenario
def effects_fixes() -> Any:
    """What fixes, wheels and the vehicle have of effects of known size; random errors by seed."""
    from automap.effects import CATALOGUE, gnss, vehicle
    from automap.effects.measured import MEASURED, acting_terms, distortion, measured_terms
    from automap.effects.user import OF_VEHICLE, UserTerm, user_effect

    rng = np.random.default_rng(9)
    values = _sizes(2) | {"not there": {"x": 1.0}, "slides": {"a": 0.3, "b": -0.4, "c": 0.5}}
    n = 7
    columns = rng.uniform(0.5, 2.0, (8, n))
    t = np.cumsum(rng.uniform(0.2, 3.0, n))
    speed = np.array([0.2, 0.9, 1.1, 5.0, 9.0, 20.0, 30.0])

    def signal(name: str) -> np.ndarray:
        return np.asarray(columns[sum(map(ord, name)) % 8])

    places, first = {}, 0
    for effect in CATALOGUE.values():
        if effect.acts_on(*MEASURED):
            places[effect.name] = first
            first += len(effect.states)
    told, names = measured_terms(places)
    slides = user_effect(
        "slides",
        "",
        *(UserTerm(p, on, lambda s: s.speed, 0.1) for p, on in zip("abc", OF_VEHICLE, strict=True)),
    )
    given: dict[str, Any] = {
        "gnss_correlated_noise": {"sigma": 2.0, "tau": 30.0},
        "gnss_multipath": {"sigma": 0.7},
        "gnss_velocity_wander": {"sigma": 0.4, "tau": 3.0},
        "gnss_slow_wander": {"sigma": 1.3, "tau": 50.0},
        "gnss_height_wander": {"sigma": 2.9, "tau": 20.0},
        "gnss_position_steps": {"size": 0.6, "interval": 2.0},
        "gnss_freeze": {"length": 1.5, "interval": 3.0},
        "gnss_speed_threshold": {"speed": 1.0},
        "gnss_outliers": {"fraction": 0.5},
        "gnss_noise_scale": {"factor": 1.7},
    }
    found: dict[str, Any] = {"terms": told, "signals": list(names)}
    for on in ("position", "velocity", "vehicle", "gyro"):
        for families in (("gnss", "vehicle"), ("clock",), ("imu",)):
            found[f"{on} {families}"] = [
                f"{a.parameter} {v:.9g}" for a, v in acting_terms(values, on, families)
            ]
    for on in MEASURED:
        found[f"distorted {on}"] = distortion(values, on, n, signal)
        found[f"clock {on}"] = distortion(values, on, n, signal, ("clock",))
    draws = np.random.default_rng(11)
    long = np.cumsum(draws.uniform(0.2, 3.0, 40)) + 5.0
    sequence = draws.normal(size=(12, 2)) + 3.0
    found |= {
        "low-pass": [gnss.low_pass(sequence, 0.1, tau) for tau in (0.25, 0.0, -1.0)],
        "markov": gnss.gauss_markov(9, np.array([0.5, 2.0]), 0.3, draws),
        "uneven": gnss.gauss_markov(9, np.array([0.5, 2.0]), draws.uniform(0.1, 0.9, 9), draws),
        "short": [gnss.short_error(9, 0.5, v, draws) for v in (given, {})],
        "slow": [gnss.slow_error(9, 0.5, v, draws) for v in (given, {})],
        "steps": [gnss.steps(long, v, draws) for v in (given, {})],
        "frozen": [gnss.frozen(long, v, draws) for v in (given, {})],
        "stands": [gnss.stands(speed, v) for v in (given, {})],
        "outliers": [gnss.outliers(9, v, draws) for v in (given, {})],
        "factor": [gnss.noise_factor(v) for v in (given, {})],
        "wander": [gnss.wander(np.array([1.0, 2.0, 3.0]), 40.0, v) for v in (given, {})],
        "velocity": [gnss.velocity_wander(v) for v in (given, {})],
        "arm": vehicle.lever_arm_motion(
            _turned(rng, n), rng.normal(size=(n, 3)), np.array([1.0, -2.0, 0.5])
        ),
        "mounting": vehicle.sensor_to_vehicle(values),
        "point": vehicle.sliding_point(values),
        "stamps": vehicle.stamp_error_s(t, values),
        "instants": vehicle.wheel_instants(t, values),
    }
    for name, own in (("without", ()), ("with", (slides,))):
        with users(*own):
            found[f"{name} user's"] = [
                vehicle.nose_angles(values, speed, columns[0], columns[1], signal),
                vehicle.wheel_speed(speed, values, signal),
                distortion(values, "vehicle", n, signal),
            ]
    return found
