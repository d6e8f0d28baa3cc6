"""What a fusion starts from and rests on: attitude, heights, standstills."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from automap.records import Fixes
from tests.unit.scenarios import scenario
from tests.unit.scenarios_fusion import fixes_on, small_problem, told, wavy_path


@scenario
def fusion_start() -> Any:
    """Levels and starts, from fixes that have everything or lack a part; mountings."""
    from automap.frames import rpy_to_matrix
    from automap.fusion import alignment, mounting
    from automap.fusion.layout import HAS_POS_H, HAS_POS_V, HAS_VEL_H
    from automap.fusion.nodes import Shift, build_nodes

    rng = np.random.default_rng(3)
    problem, fixes, _ = small_problem()
    bias, shift = np.array([0.01, -0.02, 0.03]), Shift(0.02)
    without = [replace(fixes, flags=fixes.flags & ~bit) for bit in (HAS_POS_V, HAS_VEL_H)]
    late = [fixes.flags.copy() for _ in range(3)]
    late[0][:3] &= ~HAS_POS_H
    late[1][:4] &= ~HAS_VEL_H
    late[2][:12] &= ~HAS_VEL_H
    logs = [fixes, *without, *(replace(fixes, flags=f) for f in late)]
    turn = rpy_to_matrix(np.array([0.3, -0.2, 1.0]))
    sd = np.array([0.1, 0.2, 0.3])
    found: dict[str, Any] = {
        "starts": [
            alignment.start_state(problem, f, t0, turn, sd) for f in logs for t0 in (0.5, 2.0)
        ],
        "levels": [
            alignment.level(problem, f, t0, bias) for f in logs for t0 in (0.0, 3.0, 24.0, 29.96)
        ],
    }
    axes = rng.normal(size=(4, 3))
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    pairs = [(axes[0], axes[1]), (axes[2], axes[2]), (axes[3], -axes[3])]
    pairs += [(np.eye(3)[k], sign * np.eye(3)[k]) for k in range(3) for sign in (-1.0, 1.0)]
    found["shortest"] = [alignment._shortest_rotation(a, b) for a, b in pairs]
    nodes = build_nodes(
        fixes, shift, (0.5, 8.0), [(0.5, 3.0)], *[np.zeros(0)] * 3, None, problem.options, False
    )
    aligned = alignment.align(problem, fixes, nodes, bias, shift)
    unsure = alignment.align(problem, fixes, nodes.first(3), bias, shift)
    found["aligned"] = [aligned, unsure]
    n = 900
    t = 0.1 * np.arange(n)
    heading = np.cumsum(
        np.where((t > 20.0) & (t < 25.0), 0.03, np.where((t > 40.0) & (t < 47.0), -0.025, 0.0))
    )
    speed = np.clip(6.0 + 5.0 * np.sin(0.2 * t), 0.0, None)
    sensor = rpy_to_matrix(np.array([0.4, -0.7, 2.1]))
    lean = np.column_stack([0.02 * np.sin(t), 0.03 * np.cos(0.3 * t), heading])
    body = rpy_to_matrix(lean)
    vel = np.column_stack([speed * np.cos(heading), speed * np.sin(heading), 0.1 * np.sin(t)])
    rate = np.column_stack([0.01 * np.cos(t), 0.008 * np.sin(t), np.gradient(heading, t)])
    backing = np.where(((t > 60.0) & (t < 66.0))[:, None], -vel, vel)
    along = np.gradient(speed, t)
    runs = {
        "both": (t, vel, body @ sensor, rate @ sensor, along),
        "one side": (t[:380], vel[:380], (body @ sensor)[:380], (rate @ sensor)[:380], along[:380]),
        "straight": (t[:190], vel[:190], (body @ sensor)[:190], (rate @ sensor)[:190], along[:190]),
        "backing": (t, backing, body @ sensor, rate @ sensor, along),
        "hasty": (t, vel, body @ sensor, rate @ sensor, 9.0 * along + 2.0),
        "bent": (
            t,
            vel,
            body @ sensor,
            (rate + [0.0, 0.1, 0.0] * np.sign(rate[:, 2:])) @ sensor,
            along,
        ),
        "slow": (t, 0.1 * vel, body @ sensor, rate @ sensor, along),
    }
    for name, values in runs.items():
        found[name] = told(mounting.estimate_mounting, *values)
    found["direction"] = mounting._robust_direction(-axes + [0.0, 0.0, 2.0])
    found["across"] = mounting._across(axes[0], axes[1])
    return found


@scenario
def fusion_levels() -> Any:
    """Noise levels of a short problem: scaled, searched coarsely, refined."""
    from automap.fusion import adapt
    from automap.fusion.kernel_runs import PathStates
    from automap.fusion.levels import ALL_LEVELS, LEVELS, RUN_LEVELS
    from automap.fusion.nodes import Shift, build_nodes
    from automap.fusion.sections import filter_and_smooth
    from tests.unit.fusion_problem import true_start

    effects = ("accel_bias", "gyro_bias", "gnss_correlated_noise", "gnss_multipath")
    problem, fixes, motion = small_problem(1, effects=effects)
    speed = np.hypot(fixes.values[:, 3], fixes.values[:, 4])
    nodes = build_nodes(
        fixes,
        Shift(),
        (0.1, 14.0),
        [(0.1, 1.0)],
        fixes.t,
        speed,
        0.1 * speed,
        None,
        problem.options,
        True,
    )
    start = true_start(motion)
    factors = {level: 0.6 + 0.13 * k for k, level in enumerate(ALL_LEVELS)}
    least = {"accel": 0.9, "gyro": 1.4}
    ones = dict.fromkeys(LEVELS, 1.0)
    _, smooth = filter_and_smooth(problem, nodes, start, Shift())
    path = PathStates(smooth.nominal, smooth.params)
    scaled = adapt.scale_problem(problem, factors)
    quick = adapt.Search(("accel", "position_h", "velocity_h"), 2.0, 4.0, 60.0, 2, 0.5)
    few = adapt.Search(("gyro", "velocity_v"), 1.7, 9.0, 4.0, 1, 0.2, True)
    said: list[str] = []
    rises = {"accel": (1.0, 4.0), "gyro": (3.0, 0.25)}

    def score(trial: dict[str, float]) -> float:
        return -sum(w * np.log(trial[k] / top) ** 2 for k, (w, top) in rises.items())

    found = {
        "scaled": [scaled.model.walk, scaled.model.tau, scaled.model.prior_sd, scaled.arrays.noise],
        "nodes": adapt.scale_nodes(nodes, factors).var,
        "adapted": [
            adapt.adapt_noise(
                problem, nodes, start, Shift(), {**ones, "accel": 3.0}, s, said.append, least
            )
            for s in (quick, few)
        ],
        "said": list(said),
        "refined": [
            adapt.refine_noise(problem, nodes, start, Shift(), path, ones, levels, least)
            for levels in (RUN_LEVELS, ("accel", "velocity_wander"), ("gyro", "velocity_h"))
        ],
        "expected": adapt._expected(factors, RUN_LEVELS, 0.0),
        "below": [
            adapt._below_white(own, problem, {**factors, "velocity_wander": f})
            for own in (nodes, replace(nodes, flags=0 * nodes.flags))
            for f in (0.0, 0.05, 0.2, 9.0)
        ],
        "climbed": [
            adapt._climb(
                *(level, score({**ones, level: 1.0}), {**ones}, score, quick),
                quick.bounds(level, {level: low}, {}),
            )
            for level, low in (("accel", 0.0), ("gyro", 0.0), ("gyro", 0.6))
        ],
        "parabola": [
            adapt._refined(level, value, {**ones, level: value}, score, quick)
            for level, value in (("accel", 3.0), ("accel", 1.0), ("gyro", 0.2), ("velocity_h", 1.0))
        ],
    }
    return found


@scenario
def fusion_standstill() -> Any:
    """Rests by quiet readings and slow fixes, with speeds or positions alone; wild fixes."""
    from automap.fusion import screening, standstill
    from automap.fusion.layout import HAS_POS_H, HAS_POS_V, HAS_VEL_H, HAS_VEL_V
    from automap.fusion.nodes import model_fixes
    from automap.fusion.options import FusionOptions

    rng = np.random.default_rng(11)
    path = wavy_path(600, 0.2, 8)
    fixes = fixes_on(path, 3, 12)
    t = fixes.gps_s - path.gps_s[0]
    model = model_fixes(fixes, t, FusionOptions())
    placed = replace(model, flags=model.flags & ~(HAS_VEL_H | HAS_VEL_V))
    no_place = replace(model, flags=model.flags & ~(HAS_POS_H | HAS_POS_V | HAS_VEL_H))
    sparse = replace(placed, t=1.7 * placed.t)
    found: dict[str, Any] = {
        "shown": [standstill.shown_speed(m) for m in (model, placed, sparse, no_place)]
    }
    at = 0.05 * np.arange(2400)
    speed = np.interp(
        at, path.gps_s - path.gps_s[0], np.hypot(path.vel_ned[:, 0], path.vel_ned[:, 1])
    )
    for lively, size in (("loud", 1.0), ("soft", 0.12)):
        shake = np.where(speed > 0.1, size, 0.05)[:, None]
        gyro = 0.02 + shake * rng.normal(0.0, 0.1, (2400, 3))
        accel = shake * rng.normal(0.0, 1.0, (2400, 3)) - [0.0, 0.0, 9.8]
        accel[1500:1510] += 3.0
        for name, own in (("told", model), ("placed", placed)):
            rest = standstill.find_standstill(at, gyro, accel, *standstill.shown_speed(own))
            found[f"{lively} {name}"] = [
                rest,
                standstill.unmoved(rest, own),
                standstill.rest_gyro_bias(at, gyro, rest),
            ]
        seen = standstill.shown_speed(model)
        found[f"{lively} never"] = standstill.find_standstill(
            at, gyro, accel, seen[0], seen[1] + 9.0, seen[2]
        )
        found[f"{lively} late"] = standstill.find_standstill(
            at, gyro, accel, seen[0] * 3.0, seen[1], seen[2]
        )
        found[f"{lively} short"] = standstill.find_standstill(at[:9], gyro[:9], accel[:9], *seen)
    rests = [(0.0, 4.0), (10.0, 30.0), (72.0, 81.0), (80.0, 80.1), (300.0, 310.0)]
    found["unmoved"] = [standstill.unmoved(rests, m) for m in (model, sparse)]
    found["bias"] = [standstill.rest_gyro_bias(at, gyro, r) for r in (rests, [])]
    found["spread"] = standstill._rolling_sd(accel[:40], 5)
    wild = np.zeros(len(model.t))
    wild[[20, 21, 22, 70]] = 9e-6
    for name, own in (
        ("all", model),
        ("placed", placed),
        (
            "few",
            model_fixes(
                Fixes(**{k: v[:3] for k, v in vars(fixes).items()}), t[:3], FusionOptions()
            ),
        ),
    ):
        for size in (0.0, 1.0, 9.0):
            moved = own.values.copy()
            moved[:, 0] += size * wild[: len(own.t)]
            found[f"{name} {size}"] = screening.screen_fixes(replace(own, values=moved), 30.0)
    found["delay"] = [
        screening._delay_var(model.t, model.values[:, 3:5], model.flags & m > 0)
        for m in (HAS_VEL_H, 1024)
    ]
    return found
