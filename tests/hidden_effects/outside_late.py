"""Errors of one side, one direction and one time of many, chosen before any was run."""

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
    nose,
    on,
    over_drive,
    to_north,
)

Rng = np.random.Generator


def _too_fast(rng: Rng, seconds: float) -> Outside:
    beyond = float(rng.uniform(6.0, 10.0))

    def velocity(motion: Motion, t: Array) -> Array:
        zero = np.zeros_like(t)
        return to_north(motion, t, np.maximum(motion.at(t).speed - beyond, 0.0), zero, zero)

    return Outside(
        "speed_scale_above", "velocity", f"is too long by {{}} of what is beyond {beyond:.1f} m/s",
        VELOCITY[:2] + POSITION[:2], ("speed",), 1e-4, 0.2, "of it", fixes(velocity=velocity),
    )  # fmt: skip


def _one_side(rng: Rng, seconds: float) -> Outside:
    axis = any_axis(rng, "accel", "xy")
    return Outside(
        "accel_right_turns", axis, "errs by {} for each rad/s of turn to the right",
        INERTIAL, ("turn",), 5e-3, 5.0, "m/s^2",
        on(axis, lambda s: np.maximum(s.rate[:, 2], 0.0)),
    )  # fmt: skip


def _torque(rng: Rng, seconds: float) -> Outside:
    return Outside(
        "torque_steers", "vehicle", "runs askew by {} for each m/s^2 that it gains",
        INERTIAL, ("acceleration", "speed", "time"), 1e-4, 0.03, "rad",
        nose(2, lambda p: np.maximum(lagged(np.gradient(p.speed, p.t), 0.3, p.t[1] - p.t[0]), 0.0)),
    )  # fmt: skip


def _slow_height(rng: Rng, seconds: float) -> Outside:
    tau = float(rng.uniform(5.0, 15.0))

    def position(motion: Motion, t: Array) -> Array:
        zero = np.zeros_like(t)
        down = over_drive(
            motion, t, lambda state, step_s: lagged(state.vel_ned[:, 2], tau, step_s) * tau
        )
        return np.column_stack([zero, zero, -down])

    return Outside(
        "height_lags", "position", f"its height hangs behind by {{}}, {tau:.0f} s late",
        (POSITION[2], VELOCITY[2]), ("time", "speed", "acceleration"), 1e-2, 1.0, "of the climb",
        fixes(position=position), signed=False,
    )  # fmt: skip


def _heater(rng: Rng, seconds: float) -> Outside:
    axis = any_axis(rng, "gyro", "yz")
    period, share = float(rng.uniform(50.0, 90.0)), float(rng.uniform(0.25, 0.4))
    return Outside(
        "gyro_heater", axis, f"errs by {{}} for {share * period:.0f} s of each {period:.0f} s",
        INERTIAL, ("period", "time"), 5e-6, 1e-2, "rad/s",
        on(axis, lambda s: (s.t % period < share * period).astype(np.float64)),
    )  # fmt: skip


def _leaning_roof(rng: Rng, seconds: float) -> Outside:
    def position(motion: Motion, t: Array) -> Array:
        state = motion.at(t)
        zero = np.zeros_like(t)
        sideways = state.speed * state.rate_nav[:, 2]
        return np.column_stack([zero, zero, -(sideways**2)])

    return Outside(
        "height_leans", "position", "its height rises by {} for each (m/s^2)^2 sideways",
        (POSITION[2], VELOCITY[2]), ("turn", "acceleration", "time"), 1e-3, 1.0, "m",
        fixes(position=position),
    )  # fmt: skip


def _rotor(rng: Rng, seconds: float) -> Outside:
    axis = any_axis(rng, "gyro", "xy")
    return Outside(
        "gyro_anisoinertia", axis, "errs by {} for each rad/s of turn times rad/s of roll or pitch",
        INERTIAL, ("turn", "time"), 1e-3, 20.0, "s",
        on(axis, lambda s: s.rate[:, 2] * s.rate[:, 0 if axis[-1] == "y" else 1]),
    )  # fmt: skip


def _shaken(rng: Rng, seconds: float) -> Outside:
    axis = any_axis(rng, "accel", "xy")

    def jerk(s: Signals) -> Array:
        step = float(s.t[1] - s.t[0])
        slow = lagged(s.state.accel, 0.2, step)
        return np.asarray(np.abs(np.gradient(slow, step)))

    return Outside(
        "accel_feels_jerks", axis, "errs by {} for each m/s^3 of jerk, whichever way",
        INERTIAL, ("acceleration", "time"), 1e-3, 2.0, "s", on(axis, jerk),
    )  # fmt: skip


def _too_slow(rng: Rng, seconds: float) -> Outside:
    below = float(rng.uniform(3.0, 6.0))

    def velocity(motion: Motion, t: Array) -> Array:
        speed, zero = motion.at(t).speed, np.zeros_like(t)
        short = np.where(speed > 0.2, np.maximum(below - speed, 0.0), 0.0)
        return to_north(motion, t, -short, zero, zero)

    return Outside(
        "velocity_short_when_slow", "velocity",
        f"is too short by {{}} of what it is below {below:.1f} m/s",
        VELOCITY[:2] + POSITION[:2], ("speed", "acceleration"), 1e-3, 0.3, "of it",
        fixes(velocity=velocity),
    )  # fmt: skip


def _late_dive(rng: Rng, seconds: float) -> Outside:
    tau = float(rng.uniform(0.8, 2.0))
    return Outside(
        "nose_dives_late", "vehicle", f"nods by {{}} for each m/s^2 gained, {tau:.1f} s late",
        INERTIAL, ("acceleration", "speed", "time"), 1e-4, 0.03, "rad",
        nose(1, lambda p: lagged(np.gradient(p.speed, p.t), tau, p.t[1] - p.t[0])),
    )  # fmt: skip


def _sinking(rng: Rng, seconds: float) -> Outside:
    def velocity(motion: Motion, t: Array) -> Array:
        state = motion.at(t)
        zero = np.zeros_like(t)
        return np.column_stack([zero, zero, state.speed * np.abs(state.rate_nav[:, 2])])

    return Outside(
        "velocity_sinks_in_bends", "velocity", "goes down by {} for each m/s^2 sideways",
        (VELOCITY[2], POSITION[2]), ("turn", "acceleration", "time"), 1e-3, 1.0, "s",
        fixes(velocity=velocity),
    )  # fmt: skip


LATE: Mapping[str, Maker] = {
    "speed_scale_above": _too_fast,
    "accel_right_turns": _one_side,
    "torque_steers": _torque,
    "height_lags": _slow_height,
    "gyro_heater": _heater,
    "height_leans": _leaning_roof,
    "gyro_anisoinertia": _rotor,
    "accel_feels_jerks": _shaken,
    "velocity_short_when_slow": _too_slow,
    "nose_dives_late": _late_dive,
    "velocity_sinks_in_bends": _sinking,
}
