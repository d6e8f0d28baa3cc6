"""Errors of two quantities at once, or that come late, chosen before any was run."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from tests.hidden_effects.geodesy import Array
from tests.hidden_effects.imu import Signals
from tests.hidden_effects.motion import Motion, Path
from tests.hidden_effects.outside import (
    INERTIAL,
    LEVEL,
    POSITION,
    VELOCITY,
    Maker,
    Outside,
    fixes,
    lagged,
    mount,
    nose,
    on,
    to_north,
)

Rng = np.random.Generator


def _braking_scale(rng: Rng, seconds: float) -> Outside:
    return Outside(
        "gyro_scale_when_braking", "gyro_z",
        "errs by {} of the turn rate for each m/s^2 of braking",
        INERTIAL, ("turn", "acceleration", "time"), 1e-4, 0.3, "of it/(m/s^2)",
        on("gyro_z", lambda s: s.rate[:, 2] * np.minimum(s.state.accel, 0.0)),
    )  # fmt: skip


def _phase_centre(rng: Rng, seconds: float) -> Outside:
    bearing = float(rng.uniform(-np.pi, np.pi))

    def position(motion: Motion, t: Array) -> Array:
        zero = np.zeros_like(t)
        return np.column_stack([zero, zero, -np.cos(motion.at(t).rpy[:, 2] - bearing)])

    return Outside(
        "height_with_heading", "position",
        f"its height rises by {{}} as the car heads for {bearing:.1f} rad",
        (POSITION[2], VELOCITY[2]), ("turn", "time"), 1e-3, 3.0, "m", fixes(position=position),
    )  # fmt: skip


def _dives(rng: Rng, seconds: float) -> Outside:
    beyond = float(rng.uniform(0.5, 1.2))

    def velocity(motion: Motion, t: Array) -> Array:
        zero = np.zeros_like(t)
        return np.column_stack([zero, zero, np.maximum(-motion.at(t).accel - beyond, 0.0)])

    return Outside(
        "velocity_dives_at_brakes", "velocity",
        f"goes down by {{}} of what brakes beyond {beyond:.1f} m/s^2",
        (VELOCITY[2], POSITION[2]), ("acceleration", "speed", "time"), 1e-3, 1.0, "s",
        fixes(velocity=velocity),
    )  # fmt: skip


def _late_slip(rng: Rng, seconds: float) -> Outside:
    tau = float(rng.uniform(0.4, 1.2))

    def slip(path: Path) -> Array:
        return lagged(path.curvature * path.speed**2, tau, float(path.t[1] - path.t[0]))

    return Outside(
        "slip_comes_late", "vehicle",
        f"slips out of bends by {{}} for each m/s^2 sideways, {tau:.1f} s late",
        INERTIAL, ("turn", "acceleration", "time"), 5e-5, 2e-2, "rad/(m/s^2)", nose(2, slip),
    )  # fmt: skip


def _blown(rng: Rng, seconds: float) -> Outside:
    tau = float(rng.uniform(1.0, 4.0))

    def angles(s: Signals) -> Array:
        out = np.zeros_like(s.rate)
        out[:, 1] = lagged(s.state.speed**2, tau, float(s.t[1] - s.t[0]))
        return out

    return Outside(
        "mount_blown_late", "imu", f"pitches by {{}} for each (m/s)^2 of wind, {tau:.1f} s late",
        INERTIAL, ("speed", "acceleration", "time"), 1e-7, 1e-3, "rad/(m/s)^2", mount(angles),
    )  # fmt: skip


def _late_when_slow(rng: Rng, seconds: float) -> Outside:
    below = float(rng.uniform(4.0, 8.0))

    def position(motion: Motion, t: Array) -> Array:
        speed, zero = motion.at(t).speed, np.zeros_like(t)
        return to_north(motion, t, -speed * (speed < below), zero, zero)

    return Outside(
        "position_late_when_slow", "position", f"is {{}} late below {below:.1f} m/s",
        LEVEL, ("speed", "acceleration", "time"), 1e-3, 1.0, "s", fixes(position=position),
    )  # fmt: skip


COUPLED: Mapping[str, Maker] = {
    "gyro_scale_when_braking": _braking_scale,
    "height_with_heading": _phase_centre,
    "velocity_dives_at_brakes": _dives,
    "slip_comes_late": _late_slip,
    "mount_blown_late": _blown,
    "position_late_when_slow": _late_when_slow,
}
