"""Errors that begin, saturate or are remembered, chosen before any was run."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from tests.hidden_effects.geodesy import Array
from tests.hidden_effects.imu import Signals
from tests.hidden_effects.motion import Motion
from tests.hidden_effects.outside import (
    INERTIAL,
    POSITION,
    VELOCITY,
    Maker,
    Outside,
    any_axis,
    fixes,
    lagged,
    mount,
    on,
    over_drive,
    to_north,
)

Rng = np.random.Generator


def _slow_scale(rng: Rng, seconds: float) -> Outside:
    below = float(rng.uniform(4.0, 8.0))
    return Outside(
        "gyro_scale_when_slow", "gyro_z", f"errs by {{}} of the turn rate below {below:.1f} m/s",
        INERTIAL, ("turn", "speed", "time"), 1e-4, 0.5, "of it",
        on("gyro_z", lambda s: s.rate[:, 2] * (s.state.speed < below)),
    )  # fmt: skip


def _outwards(rng: Rng, seconds: float) -> Outside:
    side = float(rng.choice([-1.0, 1.0]))
    word = "right" if side > 0.0 else "left"

    def velocity(motion: Motion, t: Array) -> Array:
        state, zero = motion.at(t), np.zeros_like(t)
        force = np.maximum(side * state.speed * state.rate_nav[:, 2], 0.0)
        return to_north(motion, t, zero, force, zero)

    return Outside(
        "velocity_aside_in_bends", "velocity",
        f"goes aside by {{}} for each m/s^2 in bends to the {word}",
        VELOCITY[:2] + POSITION[:2], ("turn", "acceleration", "time"), 1e-3, 1.0, "s",
        fixes(velocity=velocity),
    )  # fmt: skip


def _after_halts(rng: Rng, seconds: float) -> Outside:
    axis, tau = any_axis(rng, "accel", "xy"), float(rng.uniform(5.0, 15.0))

    def halted(s: Signals) -> Array:
        step = float(s.t[1] - s.t[0])
        return lagged((s.state.speed < 0.5).astype(np.float64), tau, step)

    return Outside(
        "accel_settles_after_halts", axis, f"errs by {{}} at halts, which takes {tau:.0f} s",
        INERTIAL, ("acceleration", "speed", "time"), 1e-4, 1.0, "m/s^2", on(axis, halted),
    )  # fmt: skip


def _soft_mount(rng: Rng, seconds: float) -> Outside:
    at = float(rng.uniform(0.5, 1.5))

    def angles(s: Signals) -> Array:
        step = float(s.t[1] - s.t[0])
        out = np.zeros_like(s.rate)
        out[:, 1] = np.maximum(np.abs(lagged(s.state.accel, 0.5, step)) - at, 0.0)
        return out

    return Outside(
        "mount_gives_beyond", "imu", f"pitches by {{}} of what pulls beyond {at:.1f} m/s^2",
        INERTIAL, ("acceleration", "speed", "time"), 1e-4, 0.1, "rad/(m/s^2)", mount(angles),
    )  # fmt: skip


def _sinks(rng: Rng, seconds: float) -> Outside:
    tau = float(rng.uniform(4.0, 12.0))

    def position(motion: Motion, t: Array) -> Array:
        zero = np.zeros_like(t)
        fast = over_drive(motion, t, lambda state, step_s: lagged(state.speed, tau, step_s))
        return np.column_stack([zero, zero, -fast])

    return Outside(
        "height_follows_speed", "position",
        f"its height rises by {{}} for each m/s, {tau:.0f} s late",
        (POSITION[2], VELOCITY[2]), ("speed", "acceleration", "time"), 1e-3, 1.0, "s",
        fixes(position=position),
    )  # fmt: skip


def _pressed(rng: Rng, seconds: float) -> Outside:
    axis = any_axis(rng, "gyro", "xyz")
    return Outside(
        "gyro_pressed_sideways", axis, "errs by {} for each (m/s^2)^2 sideways, to either side",
        INERTIAL, ("turn", "acceleration", "time"), 1e-6, 0.05, "rad/s",
        on(axis, lambda s: s.force[:, 1] * np.abs(s.force[:, 1])),
    )  # fmt: skip


THRESHOLDS: Mapping[str, Maker] = {
    "gyro_scale_when_slow": _slow_scale,
    "velocity_aside_in_bends": _outwards,
    "accel_settles_after_halts": _after_halts,
    "mount_gives_beyond": _soft_mount,
    "height_follows_speed": _sinks,
    "gyro_pressed_sideways": _pressed,
}
