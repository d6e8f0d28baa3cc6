"""Errors that no library of effects holds, as formulas of what the car does.

Each kind has a unit size; the case scales it to the evidence it wants.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tests.hidden_effects.extras import Extras
from tests.hidden_effects.geodesy import Array
from tests.hidden_effects.imu import Signals
from tests.hidden_effects.motion import Motion, State

Regressor = Callable[[Signals], Array]


@dataclass(frozen=True)
class Formula:
    """``channel`` is accel_x .. gyro_z, ``position`` along the heading, or ``height``; ``terms``
    are the quantities a right answer names; ``text`` is the formula for people; ``unit`` a
    plausible size. ``imu`` or ``fix`` gives the regressor [n] at unit size."""

    kind: str
    channel: str
    text: str
    terms: tuple[str, ...]
    unit: float
    imu: Regressor | None = None
    fix: Callable[[State], Array] | None = None

    def extras(self, size: float) -> Extras:
        """The error at ``size``."""
        return Extras(imu=self.imu_errors(size), fix=self.fix_errors(size))

    def imu_errors(self, size: float) -> Callable[[Signals], tuple[Array, Array]] | None:
        """Errors (gyro [n, 3], accel [n, 3]) at ``size``, None where the receiver errs."""
        if self.imu is None:
            return None
        regressor, axis = self.imu, "xyz".index(self.channel[-1])

        def errors(signals: Signals) -> tuple[Array, Array]:
            gyro, accel = np.zeros_like(signals.rate), np.zeros_like(signals.force)
            target = gyro if self.channel.startswith("gyro") else accel
            target[:, axis] = size * regressor(signals)
            return gyro, accel

        return errors

    def fix_errors(self, size: float) -> Callable[[Motion, Array], tuple[Array, Array]] | None:
        """Errors (position [n, 3] m, velocity [n, 3]) at ``size``, None where the IMU errs."""
        if self.fix is None:
            return None
        regressor = self.fix

        def errors(motion: Motion, t: Array) -> tuple[Array, Array]:
            state = motion.at(t)
            pos, vel = np.zeros_like(state.vel_ned), np.zeros_like(state.vel_ned)
            value = size * regressor(state)
            if self.channel == "position":
                yaw = state.rpy[:, 2]
                pos[:, 0], pos[:, 1] = value * np.cos(yaw), value * np.sin(yaw)
            elif self.channel == "height":
                pos[:, 2] = -value
            else:
                vel[:, 2] = value
            return pos, vel

        return errors


def draw_formula(kind: str, rng: np.random.Generator, seconds: float) -> Formula:
    """The formula of one of KINDS with its random constants."""
    constant = float(rng.uniform(0.08, 0.25)) * seconds
    when = float(rng.uniform(0.35, 0.65)) * seconds
    makers: dict[str, Callable[[], Formula]] = {
        "heading_sine": lambda: Formula(
            kind,
            "accel_x",
            "accel_x += k sin(heading)",
            ("heading",),
            0.05,
            lambda s: np.sin(s.state.rpy[:, 2]),
        ),
        "rate_squared": lambda: Formula(
            kind,
            "gyro_x",
            "gyro_x += k |omega|^2",
            ("rate", "square"),
            0.02,
            lambda s: (s.rate**2).sum(axis=1),
        ),
        "force_times_rate": lambda: Formula(
            kind,
            "accel_z",
            "accel_z += k f_x omega_z",
            ("force_x", "rate_z"),
            0.05,
            lambda s: s.force[:, 0] * s.rate[:, 2],
        ),
        "speed_cubed": lambda: Formula(
            kind, "accel_x", "accel_x += k speed^3", ("speed",), 2e-5, lambda s: s.state.speed**3
        ),
        "warm_up": lambda: Formula(
            kind,
            "gyro_z",
            f"gyro_z += k exp(-t / {constant:.0f} s)",
            ("time",),
            1e-3,
            lambda s: np.exp(-np.maximum(s.t, 0.0) / constant),
        ),
        "one_sided": lambda: Formula(
            kind,
            "accel_y",
            "accel_y += k max(f_x, 0)",
            ("force_x",),
            0.02,
            lambda s: np.maximum(s.force[:, 0], 0.0),
        ),
        "speed_times_lateral": lambda: Formula(
            kind,
            "accel_x",
            "accel_x += k speed f_y",
            ("speed", "force_y"),
            1e-3,
            lambda s: s.state.speed * s.force[:, 1],
        ),
        "step": lambda: Formula(
            kind,
            "accel_y",
            f"accel_y += k (t > {when:.0f} s)",
            ("time",),
            0.03,
            lambda s: (s.t > when).astype(np.float64),
        ),
        "position_speed_squared": lambda: Formula(
            kind,
            "position",
            "position along heading += k speed^2",
            ("speed",),
            2e-3,
            fix=lambda s: s.speed**2,
        ),
        "hysteresis": lambda: Formula(
            kind,
            "accel_z",
            "accel_z += k sign(d speed / dt)",
            ("force_x",),
            0.03,
            lambda s: np.tanh(s.state.accel / 0.1),
        ),
    }
    return makers[kind]()


KINDS = (
    "heading_sine",
    "rate_squared",
    "force_times_rate",
    "speed_cubed",
    "warm_up",
    "one_sided",
    "speed_times_lateral",
    "step",
    "position_speed_squared",
    "hysteresis",
)
