"""More errors outside every library, chosen after the first forty had been looked at."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from tests.hidden_effects.extras import Extras
from tests.hidden_effects.geodesy import Array
from tests.hidden_effects.motion import Motion, State
from tests.hidden_effects.outside import (
    INERTIAL,
    POSITION,
    VELOCITY,
    VERTICAL,
    Maker,
    Outside,
    any_axis,
    fixes,
    lagged,
    mount,
    nose,
    on,
    over_drive,
    to_north,
)

Rng = np.random.Generator
STEP_S = 0.01


def _held(values: Array, least: float) -> Array:
    """``values`` [n] told anew only where they differ by ``least`` from what was told last."""
    out = np.empty_like(values)
    at = float(values[0])
    for i, value in enumerate(values.tolist()):
        if abs(value - at) > least:
            at = value
        out[i] = at
    return out


def _sticks(rng: Rng, seconds: float) -> Outside:
    def of_size(size: float) -> Extras:
        def readings(gyro: Array, accel: Array, s: object) -> None:
            gyro[:, 2] = _held(gyro[:, 2], size)

        return Extras(readings=readings)

    return Outside(
        "gyro_sticks", "gyro_z", "is told anew only where it has changed by {}",
        INERTIAL, ("turn", "noise"), 2e-4, 0.1, "rad/s", of_size, noise=True, signed=False,
    )  # fmt: skip


def _speed_steps(rng: Rng, seconds: float) -> Outside:
    def of_size(size: float) -> Extras:
        def error(motion: Motion, t: Array) -> tuple[Array, Array]:
            speed = motion.at(t).speed
            cut = np.floor(speed / size) * size - speed
            zero = np.zeros_like(t)
            return np.zeros((len(t), 3)), to_north(motion, t, cut, zero, zero)

        return Extras(fix=error)

    return Outside(
        "speed_quantised", "velocity", "is told in steps of {}, cut off",
        VELOCITY[:2], ("speed", "noise"), 0.01, 3.0, "m/s", of_size, noise=True, signed=False,
    )  # fmt: skip


def _cross_clipped(rng: Rng, seconds: float) -> Outside:
    return Outside(
        "accel_cross_clipped", "accel_x", "takes in {} of what it feels sideways, up to 1 m/s^2",
        INERTIAL, ("turn", "acceleration"), 3e-3, 0.5, "m/s^2 for each m/s^2",
        on("accel_x", lambda s: np.clip(s.force[:, 1], -1.0, 1.0)),
    )  # fmt: skip


def _sun(rng: Rng, seconds: float) -> Outside:
    axis, tau = any_axis(rng, "accel", "xz"), float(rng.uniform(20.0, 60.0))
    return Outside(
        "accel_sun", axis, f"drifts by {{}} as the sun warms what stands, within {tau:.0f} s",
        INERTIAL, ("time", "speed"), 5e-3, 2.0, "m/s^2",
        on(axis, lambda s: lagged((s.state.speed < 3.0).astype(np.float64), tau, STEP_S)),
    )  # fmt: skip


def _ringing(values: Array, step_s: float, hertz: float, damping: float) -> Array:
    """What a filter of second order makes of ``values`` [n] more than they are."""
    turn = 2.0 * np.pi * hertz
    out, place, speed = np.empty_like(values), float(values[0]), 0.0
    for i, value in enumerate(values.tolist()):
        speed += step_s * (turn**2 * (value - place) - 2.0 * damping * turn * speed)
        place += step_s * speed
        out[i] = place - value
    return out


def _rings(rng: Rng, seconds: float) -> Outside:
    hertz = float(rng.uniform(0.1, 0.25))

    def position(motion: Motion, t: Array) -> Array:
        def across(state: State, step_s: float) -> Array:
            return _ringing(state.speed * state.rate_nav[:, 2], step_s, hertz, 0.4)

        aside = over_drive(motion, t, across)
        return to_north(motion, t, np.zeros_like(t), aside, np.zeros_like(t))

    return Outside(
        "position_rings_in_bends", "position",
        f"swings aside at {hertz:.2f} Hz by {{}} for each m/s^2 as bends begin and end",
        POSITION[:2], ("turn", "acceleration"), 5e-3, 8.0, "m", fixes(position),
    )  # fmt: skip


def _slip_above(rng: Rng, seconds: float) -> Outside:
    limit = float(rng.uniform(7.0, 11.0))
    return Outside(
        "slip_above_speed", "vehicle",
        f"slips out of bends by {{}} for each m/s^2 sideways and m/s above {limit:.0f} m/s",
        INERTIAL, ("speed", "turn", "acceleration"), 1e-5, 1e-2, "rad",
        nose(2, lambda p: p.curvature * p.speed**2 * np.maximum(p.speed - limit, 0.0)),
        signed=False,
    )  # fmt: skip


def _breathes(rng: Rng, seconds: float) -> Outside:
    period = float(rng.uniform(60.0, 100.0))
    return Outside(
        "gyro_scale_breathes", "gyro_z", f"its scale swings by {{}} in {period:.0f} s",
        INERTIAL, ("period", "time", "turn"), 1e-3, 0.3, "of the turn",
        on("gyro_z", lambda s: np.sin(2.0 * np.pi * s.t / period) * s.rate[:, 2]),
    )  # fmt: skip


def _current(rng: Rng, seconds: float) -> Outside:
    axis = any_axis(rng, "gyro", "xy")
    return Outside(
        "gyro_current", axis, "errs by {} for each m/s^2 of pull: the motor's current",
        INERTIAL, ("acceleration",), 1e-5, 5e-2, "rad/s",
        on(axis, lambda s: np.maximum(s.state.accel, 0.0) * s.state.speed / 10.0),
    )  # fmt: skip


def _height_at_rest(rng: Rng, seconds: float) -> Outside:
    def position(motion: Motion, t: Array) -> Array:
        def up(state: State, step_s: float) -> Array:
            return lagged((state.speed < 1.0).astype(np.float64), 10.0, step_s)

        return np.column_stack([np.zeros_like(t), np.zeros_like(t), -over_drive(motion, t, up)])

    return Outside(
        "height_after_halts", "height", "rises by up to {} at rest and comes back within 10 s",
        VERTICAL, ("speed", "time"), 0.02, 20.0, "m", fixes(position),
    )  # fmt: skip


def _course_hangs(rng: Rng, seconds: float) -> Outside:
    def of_size(size: float) -> Extras:
        def error(motion: Motion, t: Array) -> tuple[Array, Array]:
            def turned(state: State, step_s: float) -> Array:
                course = np.unwrap(np.arctan2(state.vel_ned[:, 1], state.vel_ned[:, 0]))
                at, off = float(course[0]), np.empty_like(course)
                for i, value in enumerate(course.tolist()):
                    at = min(max(at, value - size), value + size)
                    off[i] = at - value
                return state.speed * off

            zero = np.zeros_like(t)
            return np.zeros((len(t), 3)), to_north(
                motion, t, zero, over_drive(motion, t, turned), zero
            )

        return Extras(fix=error)

    return Outside(
        "course_hangs", "velocity", "its course hangs behind by a play of {}",
        VELOCITY[:2], ("turn", "time", "speed"), 5e-4, 0.3, "rad", of_size, signed=False,
    )  # fmt: skip


def _rectified(rng: Rng, seconds: float) -> Outside:
    axis, middle = any_axis(rng, "gyro", "yz"), float(rng.uniform(5.0, 12.0))
    return Outside(
        "gyro_shaken_at_speed", axis, f"errs by {{}} about {middle:.0f} m/s, where the car hums",
        INERTIAL, ("speed",), 5e-5, 2e-2, "rad/s",
        on(axis, lambda s: np.exp(-(((s.state.speed - middle) / 2.0) ** 2))),
    )  # fmt: skip


def _creeps(rng: Rng, seconds: float) -> Outside:
    tau = float(rng.uniform(20.0, 60.0))
    return Outside(
        "mount_creeps", "imu mount", f"creeps in yaw by {{}} times log(1 + t / {tau:.0f} s)",
        INERTIAL, ("time",), 5e-4, 0.1, "rad",
        mount(
            lambda s: np.column_stack(
                [0.0 * s.t, 0.0 * s.t, np.log1p(np.maximum(s.t, 0.0) / tau)]
            )
        ),
    )  # fmt: skip


MORE: Mapping[str, Maker] = {
    "gyro_sticks": _sticks,
    "speed_quantised": _speed_steps,
    "accel_cross_clipped": _cross_clipped,
    "accel_sun": _sun,
    "position_rings_in_bends": _rings,
    "slip_above_speed": _slip_above,
    "gyro_scale_breathes": _breathes,
    "gyro_current": _current,
    "height_after_halts": _height_at_rest,
    "course_hangs": _course_hangs,
    "gyro_shaken_at_speed": _rectified,
    "mount_creeps": _creeps,
}
