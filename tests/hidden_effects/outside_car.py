"""Errors of the installation and of the car outside every library."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from tests.hidden_effects.extras import Extras
from tests.hidden_effects.geodesy import Array
from tests.hidden_effects.imu import Signals
from tests.hidden_effects.motion import State
from tests.hidden_effects.outside import (
    IMAGE,
    INERTIAL,
    LEVEL,
    POSITION,
    VELOCITY,
    Maker,
    Outside,
    antenna,
    lagged,
    mount,
    nose,
)

Rng = np.random.Generator


def _angles(axis: int, function: Callable[[Signals], Array]) -> Callable[[Signals], Array]:
    def angles(s: Signals) -> Array:
        out = np.zeros_like(s.rate)
        out[:, axis] = function(s)
        return out

    return angles


def _braking_twist(rng: Rng, seconds: float) -> Outside:
    return Outside(
        "mount_twists_braking", "imu mount", "twists sideways by {} for each m/s^2 of braking",
        INERTIAL, ("acceleration",), 2e-4, 8e-2, "rad",
        mount(_angles(2, lambda s: np.maximum(-lagged(s.state.accel, 0.2, 0.01), 0.0))),
    )  # fmt: skip


def _bend_roll(rng: Rng, seconds: float) -> Outside:
    def lateral(s: Signals) -> Array:
        return lagged(s.state.speed * s.state.rate_nav[:, 2], 0.2, 0.01)

    return Outside(
        "mount_yields_in_bends", "imu mount", "turns in yaw by {} for each m/s^2 sideways",
        INERTIAL, ("turn", "acceleration"), 1e-4, 5e-2, "rad", mount(_angles(2, lateral)),
    )  # fmt: skip


def _bracket_slips(rng: Rng, seconds: float) -> Outside:
    when, axis = float(rng.uniform(0.35, 0.65)) * seconds, int(rng.integers(1, 3))
    about = ("pitch", "yaw")[axis - 1]
    return Outside(
        "bracket_slips", "imu mount", f"turns in {about} by {{}} at {when:.0f} s and stays",
        INERTIAL, ("time",), 1e-3, 0.2, "rad",
        mount(_angles(axis, lambda s: 0.5 * (1.0 + np.tanh((s.t - when) / 0.2)))),
    )  # fmt: skip


def _mast(rng: Rng, seconds: float) -> Outside:
    def offset(state: State, step_s: float) -> Array:
        level = np.column_stack([state.force[:, 0], state.force[:, 1], np.zeros_like(state.t)])
        return -lagged(level, 0.15, step_s)

    return Outside(
        "antenna_mast", "antenna", "a mast: gives way by {} for each m/s^2, against the force",
        LEVEL, ("acceleration", "turn"), 2e-3, 0.6, "m", antenna(offset),
    )  # fmt: skip


def _antenna_slides(rng: Rng, seconds: float) -> Outside:
    when = float(rng.uniform(0.35, 0.65)) * seconds

    def offset(state: State, step_s: float) -> Array:
        out = np.zeros((len(state.t), 3))
        out[:, 0] = -0.5 * (1.0 + np.tanh((state.t - when) / 0.3))
        return out

    return Outside(
        "antenna_slides", "antenna", f"slides back by {{}} at {when:.0f} s and stays",
        POSITION + VELOCITY, ("time", "turn"), 0.02, 4.0, "m", antenna(offset),
    )  # fmt: skip


def _slip_cubed(rng: Rng, seconds: float) -> Outside:
    return Outside(
        "sideslip_cubed", "vehicle", "slips out of bends by {} for each (m/s^2)^3 sideways",
        INERTIAL, ("turn", "acceleration"), 1e-4, 1.5e-2, "rad",
        nose(2, lambda p: (p.curvature * p.speed**2) ** 3), signed=False,
    )  # fmt: skip


def _load_shifts(rng: Rng, seconds: float) -> Outside:
    when = float(rng.uniform(0.35, 0.65)) * seconds
    return Outside(
        "load_shifts", "vehicle", f"its nose rises by {{}} at {when:.0f} s: the load shifts",
        INERTIAL, ("time",), 5e-4, 0.06, "rad",
        nose(1, lambda p: 0.5 * (1.0 + np.tanh((p.t - when) / 0.6))),
    )  # fmt: skip


def _trailer(rng: Rng, seconds: float) -> Outside:
    hertz, speed = float(rng.uniform(0.5, 0.9)), float(rng.uniform(6.0, 9.0))
    return Outside(
        "trailer_sways", "vehicle",
        f"a trailer sways its tail by {{}} at {hertz:.2f} Hz for each m/s above {speed:.0f} m/s",
        INERTIAL, ("speed", "band", "period"), 1e-4, 1e-2, "rad",
        nose(2, lambda p: np.sin(2 * np.pi * hertz * p.t) * np.maximum(p.speed - speed, 0.0)),
    )  # fmt: skip


def _kerb(rng: Rng, seconds: float) -> Outside:
    when = float(rng.uniform(0.35, 0.65)) * seconds
    return Outside(
        "kerb_bends_axle", "vehicle", f"runs askew by {{}} from {when:.0f} s on",
        INERTIAL, ("time",), 5e-4, 0.06, "rad",
        nose(2, lambda p: 0.5 * (1.0 + np.tanh((p.t - when) / 0.6))),
    )  # fmt: skip


def _wind(rng: Rng, seconds: float) -> Outside:
    bearing = float(rng.uniform(-np.pi, np.pi))
    return Outside(
        "crosswind", "vehicle", f"runs askew by up to {{}} in a wind from {bearing:.1f} rad",
        INERTIAL, ("turn", "speed", "time"), 5e-4, 0.06, "rad",
        nose(2, lambda p: np.sin(bearing - p.heading) * np.minimum(p.speed / 5.0, 1.0)),
    )  # fmt: skip


# the path's own attitude is known to a few hundredths of a degree: mounts that move less are its
# errors, and a camera's nats, which take the path as known, say more than a drive can show
def _camera(axis: int, function: Callable[[State], Array]) -> Callable[[float], Extras]:
    """A camera that turns by a size times ``function`` about one of its axes, rad."""

    def of_size(size: float) -> Extras:
        def flex(state: State) -> Array:
            out = np.zeros((len(state.t), 3))
            out[:, axis] = size * function(state)
            return out

        return Extras(flex=flex)

    return of_size


def _camera_nods(rng: Rng, seconds: float) -> Outside:
    return Outside(
        "camera_nods", "camera", "its mount nods by {} for each m/s^2 along the road",
        IMAGE, ("acceleration",), 2e-3, 3e-2, "rad", _camera(1, lambda s: s.accel),
    )  # fmt: skip


def _camera_warps(rng: Rng, seconds: float) -> Outside:
    tau = float(rng.uniform(0.15, 0.3)) * seconds
    return Outside(
        "camera_warps", "camera", f"yaws on its mount by {{}} as the sun warms it, {tau:.0f} s",
        IMAGE, ("time",), 8e-3, 8e-2, "rad",
        _camera(2, lambda s: 1.0 - np.exp(-np.maximum(s.t, 0.0) / tau)),
    )  # fmt: skip


CAR: Mapping[str, Maker] = {
    "sideslip_cubed": _slip_cubed,
    "mount_twists_braking": _braking_twist,
    "antenna_mast": _mast,
    "load_shifts": _load_shifts,
    "bracket_slips": _bracket_slips,
    "trailer_sways": _trailer,
    "mount_yields_in_bends": _bend_roll,
    "kerb_bends_axle": _kerb,
    "antenna_slides": _antenna_slides,
    "crosswind": _wind,
    "camera_nods": _camera_nods,
    "camera_warps": _camera_warps,
}
