"""Errors of one side, one direction and one time of many, chosen before any was run."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from tests.hidden_effects.geodesy import Array
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


LATE: Mapping[str, Maker] = {
    "speed_scale_above": _too_fast,
    "accel_right_turns": _one_side,
    "torque_steers": _torque,
    "height_lags": _slow_height,
    "gyro_heater": _heater,
}
