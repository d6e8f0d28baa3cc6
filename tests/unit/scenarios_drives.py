"""Drives fused whole, what is doubted of them, and what the gap finder makes of them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from tests.unit import receiver_damage as damage
from tests.unit.receiver_scene import Receiver, simulated_fixes
from tests.unit.scenarios import _fused_drive, _or_error, scenario
from tests.unit.sync_scene import GPS_START


@scenario
def fusion_problem() -> Any:
    """A short problem with every measurement, filtered and smoothed."""
    from tests.unit.dense_problem import solve_both

    both = solve_both()
    return {"forward": both.forward, "smoothed": both.smoothed, "table": both.table}


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
    from automap.fusion.steady_readings import steady, wiener_weights
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
        "steady": steady(t, imu.gyro),
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
    from automap.gap.joint import estimate_nats
    from automap.gap.linear import Given, conditional
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
