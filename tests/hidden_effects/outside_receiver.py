"""Receivers' errors outside every library."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from tests.hidden_effects.extras import Extras
from tests.hidden_effects.geodesy import Array
from tests.hidden_effects.motion import Motion, State
from tests.hidden_effects.outside import (
    POSITION,
    VELOCITY,
    VERTICAL,
    Maker,
    Outside,
    fixes,
    lagged,
    over_drive,
    to_north,
)

Rng = np.random.Generator


def _zero(t: Array) -> Array:
    return np.zeros_like(t)


def _after_tunnel(rng: Rng, seconds: float) -> Outside:
    ends = np.sort(rng.uniform(0.15, 0.9, 4)) * seconds
    bearing = float(rng.uniform(-np.pi, np.pi))

    def position(motion: Motion, t: Array) -> Array:
        size = sum(np.where(t > e, np.exp(-np.maximum(t - e, 0.0) / 15.0), 0.0) for e in ends)
        return np.column_stack([np.cos(bearing) * size, np.sin(bearing) * size, _zero(t)])

    when = ", ".join(f"{e:.0f}" for e in ends)
    return Outside(
        "offset_after_tunnels", "position",
        f"is {{}} off after {when} s and comes back within 15 s, as after tunnels",
        POSITION[:2], ("time",), 0.02, 15.0, "m", fixes(position),
    )  # fmt: skip


def _height_speed(rng: Rng, seconds: float) -> Outside:
    def position(motion: Motion, t: Array) -> Array:
        return np.column_stack([_zero(t), _zero(t), -motion.at(t).speed])

    return Outside(
        "height_with_speed", "height", "rises by {} with the speed (an antenna's pattern)",
        VERTICAL, ("speed",), 2e-3, 0.8, "m per m/s", fixes(position),
    )  # fmt: skip


def _speed_smoothing(rng: Rng, seconds: float) -> Outside:
    def of_size(size: float) -> Extras:
        def velocity(motion: Motion, t: Array) -> tuple[Array, Array]:
            def late(state: State, step_s: float) -> Array:
                # the faster the car, the less the receiver smooths
                keep = np.exp(-step_s * (state.speed + 3.0) / (10.0 * size))
                out, at = np.empty_like(state.vel_ned), state.vel_ned[0]
                for i, share in enumerate(keep.tolist()):
                    at = share * at + (1.0 - share) * state.vel_ned[i]
                    out[i] = at - state.vel_ned[i]
                return out

            return np.zeros((len(t), 3)), over_drive(motion, t, late)

        return Extras(fix=velocity)

    return Outside(
        "velocity_smoothing_by_speed", "velocity",
        "is low-passed by {} times 10 m/s over (speed + 3 m/s)",
        VELOCITY, ("speed", "acceleration", "turn"), 5e-3, 2.0, "s", of_size, signed=False,
    )  # fmt: skip


def _east_swing(rng: Rng, seconds: float) -> Outside:
    period = float(rng.uniform(15.0, 25.0))

    def position(motion: Motion, t: Array) -> Array:
        return np.column_stack([_zero(t), np.sin(2.0 * np.pi * t / period), _zero(t)])

    return Outside(
        "east_swing", "position_e", f"alone swings by {{}} with a period of {period:.0f} s",
        ("position_e",), ("period", "time"), 5e-3, 8.0, "m", fixes(position),
    )  # fmt: skip


def _latches(rng: Rng, seconds: float) -> Outside:
    begins = np.sort(rng.uniform(0.05, 0.95, 6)) * seconds
    toward = rng.normal(size=(6, 2))
    toward /= np.linalg.norm(toward, axis=1)[:, None]

    def position(motion: Motion, t: Array) -> Array:
        out = np.zeros((len(t), 3))
        for begin, side in zip(begins, toward, strict=True):
            out[(t > begin) & (t < begin + 4.0), :2] = side
        return out

    when = ", ".join(f"{b:.0f}" for b in begins)
    return Outside(
        "position_latches", "position", f"is latched {{}} aside for 4 s at {when} s",
        POSITION[:2], ("time", "noise"), 0.02, 15.0, "m", fixes(position), noise=True,
    )  # fmt: skip


def _braking(rng: Rng, seconds: float) -> Outside:
    def velocity(motion: Motion, t: Array) -> Array:
        brake = np.maximum(-motion.at(t).accel, 0.0)
        return to_north(motion, t, brake, _zero(t), _zero(t))

    return Outside(
        "velocity_braking", "velocity", "is {} too long for each m/s^2 of braking, only then",
        VELOCITY[:2], ("acceleration",), 2e-3, 0.8, "s", fixes(velocity=velocity),
    )  # fmt: skip


def _overshoot(rng: Rng, seconds: float) -> Outside:
    def position(motion: Motion, t: Array) -> Array:
        along = over_drive(motion, t, lambda s, h: lagged(s.accel, 2.0, h))
        return to_north(motion, t, -along, _zero(t), _zero(t))

    return Outside(
        "position_overshoot", "position", "runs on by {} for each m/s^2 of braking just before",
        POSITION[:2], ("acceleration",), 5e-3, 8.0, "m", fixes(position),
    )  # fmt: skip


def _height_step(rng: Rng, seconds: float) -> Outside:
    when = float(rng.uniform(0.3, 0.6)) * seconds

    def position(motion: Motion, t: Array) -> Array:
        return np.column_stack([_zero(t), _zero(t), np.where(t > when, -1.0, 0.0)])

    return Outside(
        "height_step", "height", f"is {{}} higher from {when:.0f} s on (other satellites)",
        ("position_d",), ("time",), 0.02, 30.0, "m", fixes(position),
    )  # fmt: skip


def _cornering(rng: Rng, seconds: float) -> Outside:
    def velocity(motion: Motion, t: Array) -> Array:
        state = motion.at(t)
        return to_north(motion, t, -np.abs(state.rate_nav[:, 2]) * state.speed, _zero(t), _zero(t))

    return Outside(
        "velocity_cut_corners", "velocity", "is {} too short for each m/s^2 sideways, in any bend",
        VELOCITY[:2], ("turn", "acceleration"), 1e-3, 0.5, "s", fixes(velocity=velocity),
    )  # fmt: skip


RECEIVER: Mapping[str, Maker] = {
    "velocity_smoothing_by_speed": _speed_smoothing,
    "offset_after_tunnels": _after_tunnel,
    "height_with_speed": _height_speed,
    "velocity_braking": _braking,
    "east_swing": _east_swing,
    "position_overshoot": _overshoot,
    "velocity_cut_corners": _cornering,
    "position_latches": _latches,
    "height_step": _height_step,
}
