"""Errors that change with a condition or in the course of a drive, chosen before any was run."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from tests.hidden_effects.extras import Extras
from tests.hidden_effects.geodesy import Array
from tests.hidden_effects.imu import Signals
from tests.hidden_effects.motion import Motion, State
from tests.hidden_effects.outside import (
    INERTIAL,
    POSITION,
    VELOCITY,
    Maker,
    Outside,
    antenna,
    any_axis,
    fixes,
    lagged,
    mount,
    on,
    over_drive,
    to_north,
)

Rng = np.random.Generator
STEP_S = 0.01
DEAD_SPEED = 0.3
"""m/s; a receiver that is slow to say so takes the car for standing below."""


def _antenna_creeps(rng: Rng, seconds: float) -> Outside:
    begin = float(rng.uniform(0.2, 0.5)) * seconds

    def offset(state: State, step_s: float) -> Array:
        out = np.zeros((len(state.t), 3))
        out[:, 0] = -np.clip((state.t - begin) / (seconds - begin), 0.0, 1.0)
        return out

    return Outside(
        "antenna_creeps", "antenna", f"creeps back by {{}} from {begin:.0f} s to the end",
        POSITION + VELOCITY, ("time", "turn"), 0.02, 4.0, "m", antenna(offset),
    )  # fmt: skip


def _pitching(function: Callable[[Signals], Array]) -> Callable[[float], Extras]:
    def angles(s: Signals) -> Array:
        out = np.zeros_like(s.rate)
        out[:, 1] = function(s)
        return out

    return mount(angles)


def _sags_warm(rng: Rng, seconds: float) -> Outside:
    return Outside(
        "mount_sags_warm", "imu mount", "nods by {} for each kelvin since the start",
        INERTIAL, ("time",), 1e-5, 2e-2, "rad/K",
        _pitching(lambda s: lagged(s.temp_c - s.temp_c[0], 5.0, STEP_S)),
    )  # fmt: skip


def _lifts(rng: Rng, seconds: float) -> Outside:
    return Outside(
        "mount_lifts_at_speed", "imu mount", "nods by {} for each (10 m/s)^2",
        INERTIAL, ("speed",), 1e-4, 0.1, "rad", _pitching(lambda s: (s.state.speed / 10.0) ** 2),
    )  # fmt: skip


def _rate_scale(rng: Rng, seconds: float) -> Outside:
    return Outside(
        "gyro_scale_with_rate", "gyro_z", "its scale grows by {} for each rad/s of turn",
        INERTIAL, ("turn",), 1e-3, 1.0, "s/rad",
        on("gyro_z", lambda s: s.rate[:, 2] * np.abs(s.rate[:, 2])),
    )  # fmt: skip


def _relaxes(rng: Rng, seconds: float) -> Outside:
    axis, tau = any_axis(rng, "accel", "xy"), float(rng.uniform(2.0, 6.0))
    column = "xyz".index(axis[-1])
    return Outside(
        "accel_relaxes", axis, f"a share of {{}} of its force fades within {tau:.1f} s",
        INERTIAL, ("acceleration", "turn", "time"), 1e-3, 0.5, "of the force",
        on(axis, lambda s: s.force[:, column] - lagged(s.force[:, column], tau, STEP_S)),
    )  # fmt: skip


def _dead_time(rng: Rng, seconds: float) -> Outside:
    def of_size(size: float) -> Extras:
        def error(motion: Motion, t: Array) -> tuple[Array, Array]:
            def held(state: State, step_s: float) -> Array:
                stands, left = state.speed < DEAD_SPEED, 0.0
                out = np.zeros((len(state.t), 3))
                for i, still in enumerate(stands.tolist()):
                    left = size if still else left - step_s
                    if not still and left > 0.0:
                        out[i] = -state.vel_ned[i]
                return out

            return np.zeros((len(t), 3)), over_drive(motion, t, held)

        return Extras(fix=error)

    return Outside(
        "velocity_starts_late", "velocity", "stays at nothing for {} after each halt",
        VELOCITY, ("speed", "acceleration", "time", "noise"), 0.05, 3.0, "s", of_size,
        noise=True, signed=False,
    )  # fmt: skip


def _saturates(rng: Rng, seconds: float) -> Outside:
    def velocity(motion: Motion, t: Array) -> Array:
        zero = np.zeros_like(t)
        return to_north(motion, t, np.tanh(motion.at(t).speed / 6.0), zero, zero)

    return Outside(
        "speed_saturates", "velocity", "is too long by {} tanh(speed / 6 m/s)",
        VELOCITY[:2], ("speed",), 2e-3, 1.0, "m/s", fixes(velocity=velocity),
    )  # fmt: skip


def _compass(rng: Rng, seconds: float) -> Outside:
    bearing = float(rng.uniform(-np.pi, np.pi))

    def velocity(motion: Motion, t: Array) -> Array:
        state, zero = motion.at(t), np.zeros_like(t)
        aside = state.speed * np.sin(state.rpy[:, 2] - bearing)
        return to_north(motion, t, zero, aside, zero)

    return Outside(
        "course_of_compass", "velocity", f"its course is off by {{}} sin(heading - {bearing:.1f})",
        VELOCITY[:2], ("turn", "speed"), 1e-4, 0.2, "rad", fixes(velocity=velocity),
    )  # fmt: skip


def _engine_orders(rng: Rng, seconds: float) -> Outside:
    axis, period = any_axis(rng, "accel", "xy"), float(rng.uniform(3.0, 7.0))
    return Outside(
        "accel_engine_orders", axis, f"errs by {{}} sin(2 pi speed / {period:.1f} m/s)",
        INERTIAL, ("speed",), 5e-4, 1.0, "m/s^2",
        on(axis, lambda s: np.sin(2.0 * np.pi * s.state.speed / period)),
    )  # fmt: skip


def _speed_bias(rng: Rng, seconds: float) -> Outside:
    axis = any_axis(rng, "gyro", "yz")
    return Outside(
        "gyro_bias_with_speed", axis, "errs by {} sqrt(speed / 10 m/s)",
        INERTIAL, ("speed",), 5e-6, 1e-2, "rad/s",
        on(axis, lambda s: np.sqrt(s.state.speed / 10.0)),
    )  # fmt: skip


def _scale_warm(rng: Rng, seconds: float) -> Outside:
    return Outside(
        "gyro_scale_warm", "gyro_z", "its scale grows by {} for each kelvin since the start",
        INERTIAL, ("turn", "time"), 1e-6, 1e-2, "1/K",
        on("gyro_z", lambda s: s.rate[:, 2] * (s.temp_c - s.temp_c[0])),
    )  # fmt: skip


def _starter(rng: Rng, seconds: float) -> Outside:
    axis, tau = any_axis(rng, "accel", "xy"), float(rng.uniform(4.0, 12.0))

    def since_halt(s: Signals) -> Array:
        stands = s.state.speed < DEAD_SPEED
        last = np.maximum.accumulate(np.where(stands, s.t, s.t[0] - 1e3))
        return np.exp(-(s.t - last) / tau)

    return Outside(
        "accel_sags_at_halts", axis, f"errs by {{}} at halts, which fades within {tau:.0f} s",
        INERTIAL, ("time", "speed", "acceleration"), 5e-4, 0.5, "m/s^2", on(axis, since_halt),
    )  # fmt: skip


def _stretched(rng: Rng, seconds: float) -> Outside:
    def position(motion: Motion, t: Array) -> Array:
        def moved(state: State, step_s: float) -> Array:
            # what the velocity sums up to, near enough to the way from the start
            way = np.cumsum(state.vel_ned, axis=0) * step_s
            way[:, 2] = 0.0
            return np.asarray(way)

        return over_drive(motion, t, moved)

    return Outside(
        "position_stretched", "position", "is off by {} of the way from the start",
        POSITION[:2] + VELOCITY[:2], ("time", "speed"), 1e-5, 0.02, "of it",
        fixes(position=position),
    )  # fmt: skip


def _cross_lagged(rng: Rng, seconds: float) -> Outside:
    axis, tau = any_axis(rng, "accel", "xy"), float(rng.uniform(0.5, 3.0))
    other = 1 - "xyz".index(axis[-1])
    return Outside(
        "accel_cross_lagged", axis, f"takes in {{}} of the force beside it, {tau:.1f} s late",
        INERTIAL, ("acceleration", "turn"), 1e-4, 0.5, "of the force",
        on(axis, lambda s: lagged(s.force[:, other], tau, STEP_S)),
    )  # fmt: skip


def _pressed(rng: Rng, seconds: float) -> Outside:
    return Outside(
        "gyro_pressed_by_brakes", "gyro_z", "errs by {} for each m/s^2 of braking, not of gaining",
        INERTIAL, ("acceleration", "time"), 1e-6, 1e-2, "rad/s per m/s^2",
        on("gyro_z", lambda s: np.maximum(-s.state.accel, 0.0)),
    )  # fmt: skip


def _dips(rng: Rng, seconds: float) -> Outside:
    def velocity(motion: Motion, t: Array) -> Array:
        zero = np.zeros_like(t)
        return np.column_stack([zero, zero, np.maximum(motion.at(t).accel, 0.0)])

    return Outside(
        "velocity_dips", "velocity", "goes down by {} for each m/s^2 that the car gains",
        ("velocity_d", "position_d"), ("acceleration", "time"), 1e-3, 1.0, "s",
        fixes(velocity=velocity),
    )  # fmt: skip


def _overshoots(rng: Rng, seconds: float) -> Outside:
    tau = float(rng.uniform(1.0, 4.0))

    def position(motion: Motion, t: Array) -> Array:
        ahead = over_drive(motion, t, lambda state, step_s: lagged(state.accel, tau, step_s))
        return to_north(motion, t, ahead, np.zeros_like(t), np.zeros_like(t))

    return Outside(
        "position_overshoots", "position",
        f"runs ahead by {{}} for each m/s^2 along of the last {tau:.1f} s",
        POSITION[:2] + VELOCITY[:2], ("acceleration", "time"), 5e-3, 3.0, "s^2",
        fixes(position=position),
    )  # fmt: skip


def _yaws(rng: Rng, seconds: float) -> Outside:
    def angles(s: Signals) -> Array:
        out = np.zeros_like(s.rate)
        out[:, 2] = np.tanh(lagged(s.state.speed * s.state.rate_nav[:, 2], 0.3, STEP_S) / 0.5)
        return out

    return Outside(
        "mount_yaws_in_bends", "imu mount", "turns by {} either way as bends press upon it",
        INERTIAL, ("turn", "acceleration"), 1e-4, 0.1, "rad", mount(angles),
    )  # fmt: skip


SLOW: Mapping[str, Maker] = {
    "antenna_creeps": _antenna_creeps,
    "mount_sags_warm": _sags_warm,
    "mount_lifts_at_speed": _lifts,
    "gyro_scale_with_rate": _rate_scale,
    "accel_relaxes": _relaxes,
    "velocity_starts_late": _dead_time,
    "speed_saturates": _saturates,
    "course_of_compass": _compass,
    "accel_engine_orders": _engine_orders,
    "gyro_bias_with_speed": _speed_bias,
    "gyro_scale_warm": _scale_warm,
    "accel_sags_at_halts": _starter,
    "position_stretched": _stretched,
    "accel_cross_lagged": _cross_lagged,
    "gyro_pressed_by_brakes": _pressed,
    "velocity_dips": _dips,
    "position_overshoots": _overshoots,
    "mount_yaws_in_bends": _yaws,
}
