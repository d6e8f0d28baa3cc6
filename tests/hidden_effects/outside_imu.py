"""Sensors' errors outside every library."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from tests.hidden_effects.extras import Extras
from tests.hidden_effects.geodesy import Array
from tests.hidden_effects.imu import Signals
from tests.hidden_effects.outside import INERTIAL, Maker, Outside, any_axis, lagged, on

Rng = np.random.Generator
STEP_S = 0.01
WHEEL_M = 1.95
"""Circumference of a wheel."""
GEARS = (9.0, 17.0, 26.0)
"""m/s at which an automatic shifts up."""
RPM_PER_SPEED = (420.0, 240.0, 150.0, 110.0)


def _swing(rng: Rng, seconds: float) -> Outside:
    axis, period = any_axis(rng, "gyro"), float(rng.uniform(40.0, 50.0))
    phase = float(rng.uniform(0.0, 2.0 * np.pi))
    return Outside(
        "gyro_swing", axis, f"swings by {{}} with a period of {period:.0f} s, all the time",
        INERTIAL, ("period", "time"), 5e-5, 5e-3, "rad/s",
        on(axis, lambda s: np.sin(2.0 * np.pi * s.t / period + phase)),
    )  # fmt: skip


def _fast_swing(rng: Rng, seconds: float) -> Outside:
    axis, period = any_axis(rng, "accel", "xy"), float(rng.uniform(6.0, 14.0))
    return Outside(
        "accel_swing", axis, f"swings by {{}} with a period of {period:.1f} s, all the time",
        INERTIAL, ("period", "time", "band"), 3e-3, 0.6, "m/s^2",
        on(axis, lambda s: np.sin(2.0 * np.pi * s.t / period)),
    )  # fmt: skip


def _settling(rng: Rng, seconds: float) -> Outside:
    axis, tau = any_axis(rng, "accel"), float(rng.uniform(15.0, 30.0))
    return Outside(
        "accel_settling", axis, f"settles by {{}} after power-on, time constant {tau:.0f} s",
        INERTIAL, ("time",), 5e-3, 1.0, "m/s^2",
        on(axis, lambda s: np.exp(-np.maximum(s.t, 0.0) / tau)),
    )  # fmt: skip


def _saturating(rng: Rng, seconds: float) -> Outside:
    return Outside(
        "accel_cross_saturating", "accel_y",
        "follows the forward acceleration and saturates at {}, above 0.8 m/s^2",
        INERTIAL, ("acceleration",), 3e-3, 0.5, "m/s^2",
        on("accel_y", lambda s: np.tanh(s.force[:, 0] / 0.8)),
    )  # fmt: skip


def _play(values: Array, width: float) -> Array:
    """What a joint with play of ``width`` makes of ``values`` [n]: Prandtl's play operator."""
    out = np.empty_like(values)
    at = 0.0
    for i, value in enumerate(values.tolist()):
        at = min(max(at, value - width), value + width)
        out[i] = at
    return out


def _force_hysteresis(rng: Rng, seconds: float) -> Outside:
    width = float(rng.uniform(0.6, 1.2))
    return Outside(
        "accel_hysteresis", "accel_x",
        f"hangs behind its force by a play of {width:.1f} m/s^2, {{}} of the play",
        INERTIAL, ("acceleration", "time"), 3e-3, 0.5, "m/s^2 for each m/s^2",
        on("accel_x", lambda s: s.force[:, 0] - _play(s.force[:, 0], width)),
    )  # fmt: skip


def _thermal_transient(rng: Rng, seconds: float) -> Outside:
    axis, tau = any_axis(rng, "gyro"), float(rng.uniform(40.0, 90.0))
    return Outside(
        "gyro_thermal_gradient", axis,
        f"errs by {{}} per kelvin between case and core, which follows in {tau:.0f} s",
        INERTIAL, ("temperature", "time"), 1e-6, 2e-3, "rad/s/K",
        on(axis, lambda s: s.temp_c - lagged(s.temp_c, tau, STEP_S)),
    )  # fmt: skip


def _dead_zone(rng: Rng, seconds: float) -> Outside:
    def of_size(size: float) -> Extras:
        def readings(gyro: Array, accel: Array, s: Signals) -> None:
            true = s.rate[:, 2]
            gyro[:, 2] -= np.clip(true, -size, size)

        return Extras(readings=readings)

    return Outside(
        "gyro_dead_zone", "gyro_z", "reads no turn below {}", INERTIAL, ("turn",),
        1e-4, 5e-2, "rad/s", of_size, signed=False,
    )  # fmt: skip


def _clipped(rng: Rng, seconds: float) -> Outside:
    def of_size(size: float) -> Extras:
        def readings(gyro: Array, accel: Array, s: Signals) -> None:
            over = np.abs(s.rate[:, 2]) - 0.25
            gyro[:, 2] -= np.sign(s.rate[:, 2]) * np.maximum(over, 0.0) * min(size, 1.0)

        return Extras(readings=readings)

    return Outside(
        "gyro_compressed", "gyro_z", "reads {} too little of what is above 0.25 rad/s",
        INERTIAL, ("turn",), 2e-3, 1.0, "of it", of_size, signed=False,
    )  # fmt: skip


def _speed_switched(rng: Rng, seconds: float) -> Outside:
    axis, speed = any_axis(rng, "accel", "xz"), float(rng.uniform(6.0, 10.0))
    return Outside(
        "accel_speed_switched", axis, f"is {{}} too high above {speed:.0f} m/s (a fan starts)",
        INERTIAL, ("speed",), 3e-3, 0.6, "m/s^2",
        on(axis, lambda s: (s.state.speed > speed).astype(np.float64)),
    )  # fmt: skip


def _along_road(s: Signals) -> Array:
    return np.cumsum(s.state.speed) * float(np.median(np.diff(s.t)))


def _wheel_line(rng: Rng, seconds: float) -> Outside:
    order = int(rng.integers(12, 20))
    return Outside(
        "gyro_wheel_line", "gyro_z",
        f"a magnetised wheel: a line of {{}} at {order} to a turn of the wheel, folded at 100 Hz",
        INERTIAL, ("band", "speed", "noise"), 3e-4, 0.5, "rad/s",
        on("gyro_z", lambda s: np.sin(2.0 * np.pi * order * _along_road(s) / WHEEL_M)),
        noise=True,
    )  # fmt: skip


def _resonance(rng: Rng, seconds: float) -> Outside:
    axis, speed = any_axis(rng, "accel", "xz"), float(rng.uniform(6.0, 12.0))
    return Outside(
        "accel_resonance", axis, f"rectifies vibration by {{}} at {speed:.0f} m/s, 2 m/s wide",
        INERTIAL, ("speed",), 5e-3, 1.0, "m/s^2",
        on(axis, lambda s: np.exp(-(((s.state.speed - speed) / 2.0) ** 2))),
    )  # fmt: skip


def _engine(s: Signals) -> Array:
    """Turns of the engine in thousands a minute."""
    gear = np.searchsorted(np.asarray(GEARS), s.state.speed)
    return np.asarray(np.maximum(0.8, s.state.speed * np.take(RPM_PER_SPEED, gear) / 1000.0))


def _engine_bias(rng: Rng, seconds: float) -> Outside:
    return Outside(
        "accel_engine", "accel_x", "errs by {} per square of the engine's 1000/min, through gears",
        INERTIAL, ("speed",), 1e-3, 0.2, "m/s^2",
        on("accel_x", lambda s: _engine(s) ** 2),
    )  # fmt: skip


def _delayed(channel: str, kind: str, small: float) -> Maker:
    def make(rng: Rng, seconds: float) -> Outside:
        def of_size(size: float) -> Extras:
            def errors(s: Signals) -> tuple[Array, Array]:
                out = np.zeros_like(s.rate), np.zeros_like(s.force)
                true, axis = (s.rate, s.force)[channel[0] == "a"], "xyz".index(channel[-1])
                late = lagged(true[:, axis], size, STEP_S)
                out[channel[0] == "a"][:, axis] = late - true[:, axis]
                return out

            return Extras(imu=errors)

        when = ("turn",) if channel[0] == "g" else ("acceleration",)
        return Outside(
            kind,
            channel,
            "alone is low-passed by {}",
            INERTIAL,
            when,
            small,
            0.6,
            "s",
            of_size,
            signed=False,
        )

    return make


def _stuck(rng: Rng, seconds: float) -> Outside:
    # where it hangs is the same for every size, so that evidence grows with it
    begins = np.sort(rng.uniform(0.0, 1.0, 40))

    def of_size(size: float) -> Extras:
        def readings(gyro: Array, accel: Array, s: Signals) -> None:
            span = float(s.t[-1] - s.t[0])
            for begin in s.t[0] + begins * span:
                i, k = np.searchsorted(s.t, [begin, begin + size])
                gyro[i:k] = gyro[min(i, len(s.t) - 1)]
                accel[i:k] = accel[min(i, len(s.t) - 1)]

        return Extras(readings=readings)

    return Outside(
        "imu_hangs", "imu", "its readings hang for {}, 40 times, at random", INERTIAL,
        ("time", "noise", "band"), 0.02, 1.5, "s", of_size, noise=True, signed=False,
    )  # fmt: skip


def _coarse(rng: Rng, seconds: float) -> Outside:
    def of_size(size: float) -> Extras:
        def readings(gyro: Array, accel: Array, s: Signals) -> None:
            gyro[:] = np.trunc(gyro / size) * size

        return Extras(readings=readings)

    return Outside(
        "gyro_truncated", "gyro", "readings are cut off towards zero in steps of {}",
        INERTIAL, ("turn", "noise"), 2e-4, 4e-2, "rad/s", of_size, noise=True, signed=False,
    )  # fmt: skip


def _spin_up(rng: Rng, seconds: float) -> Outside:
    axis = any_axis(rng, "gyro", "xy")
    return Outside(
        "gyro_spin_up", axis, "reads {} of the vertical turn's change",
        INERTIAL, ("turn",), 1e-4, 0.5, "rad/s per rad/s^2",
        on(axis, lambda s: np.gradient(s.rate[:, 2], s.t)),
    )  # fmt: skip


def _centrifugal(rng: Rng, seconds: float) -> Outside:
    return Outside(
        "accel_size_effect", "accel_x", "its proof mass sits {} off the others, so turns pull",
        INERTIAL, ("turn",), 1e-2, 3.0, "m",
        on("accel_x", lambda s: s.rate[:, 2] ** 2),
    )  # fmt: skip


def _plateau(rng: Rng, seconds: float) -> Outside:
    axis = any_axis(rng, "gyro")
    begin = float(rng.uniform(0.2, 0.5)) * seconds
    length = float(rng.uniform(0.1, 0.2)) * seconds
    return Outside(
        "gyro_plateau", axis,
        f"is {{}} too high from {begin:.0f} s to {begin + length:.0f} s (a heater runs)",
        INERTIAL, ("time",), 2e-5, 1e-2, "rad/s",
        on(axis, lambda s: ((s.t > begin) & (s.t < begin + length)).astype(np.float64)),
    )  # fmt: skip


def _scale_ramp(rng: Rng, seconds: float) -> Outside:
    return Outside(
        "gyro_scale_ramp", "gyro_z", f"its scale grows by {{}} over {seconds:.0f} s",
        INERTIAL, ("time", "turn"), 1e-3, 0.3, "of the turn",
        on("gyro_z", lambda s: s.t / seconds * s.rate[:, 2]),
    )  # fmt: skip


def _magnet(rng: Rng, seconds: float) -> Outside:
    return Outside(
        "gyro_magnet", "gyro_y", "errs by {} with twice the heading (iron in the Earth's field)",
        INERTIAL, ("turn", "time"), 5e-5, 1e-2, "rad/s",
        on("gyro_y", lambda s: np.sin(2.0 * s.state.rpy[:, 2])),
    )  # fmt: skip


def _anisoelastic(rng: Rng, seconds: float) -> Outside:
    return Outside(
        "gyro_anisoelastic", "gyro_z", "reads {} of the product of forward and lateral force",
        INERTIAL, ("acceleration", "turn"), 1e-5, 5e-2, "rad/s per (m/s^2)^2",
        on("gyro_z", lambda s: s.force[:, 0] * s.force[:, 1]),
    )  # fmt: skip


def _clock_step(rng: Rng, seconds: float) -> Outside:
    when = float(rng.uniform(0.35, 0.65)) * seconds

    def of_size(size: float) -> Extras:
        return Extras(clock=lambda t: np.where(t > when, size, 0.0))

    return Outside(
        "clock_step", "imu clock", f"stamps are {{}} late from {when:.0f} s on",
        INERTIAL, ("time", "speed", "acceleration", "turn"), 1e-3, 0.3, "s", of_size, signed=False,
    )  # fmt: skip


def _clock_swing(rng: Rng, seconds: float) -> Outside:
    period = float(rng.uniform(50.0, 90.0))

    def of_size(size: float) -> Extras:
        return Extras(clock=lambda t: np.asarray(size * np.sin(2.0 * np.pi * t / period)))

    return Outside(
        "clock_swing", "imu clock", f"stamps swing by {{}} with a period of {period:.0f} s",
        INERTIAL, ("period", "time", "speed", "acceleration", "turn"), 1e-3, 0.3, "s", of_size,
    )  # fmt: skip


SENSOR: Mapping[str, Maker] = {
    "gyro_swing": _swing,
    "accel_settling": _settling,
    "accel_cross_saturating": _saturating,
    "gyro_dead_zone": _dead_zone,
    "accel_speed_switched": _speed_switched,
    "gyro_thermal_gradient": _thermal_transient,
    "gyro_z_lag": _delayed("gyro_z", "gyro_z_lag", 2e-3),
    "accel_hysteresis": _force_hysteresis,
    "clock_step": _clock_step,
    "accel_resonance": _resonance,
    "gyro_plateau": _plateau,
    "gyro_wheel_line": _wheel_line,
    "accel_engine": _engine_bias,
    "imu_hangs": _stuck,
    "gyro_spin_up": _spin_up,
    "accel_x_lag": _delayed("accel_x", "accel_x_lag", 5e-3),
    "gyro_scale_ramp": _scale_ramp,
    "accel_swing": _fast_swing,
    "gyro_truncated": _coarse,
    "gyro_magnet": _magnet,
    "gyro_anisoelastic": _anisoelastic,
    "accel_size_effect": _centrifugal,
    "gyro_compressed": _clipped,
    "clock_swing": _clock_swing,
}
