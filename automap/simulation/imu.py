"""What the inertial sensor records: perfect readings, distorted by named effects, and noise."""

from __future__ import annotations

import numpy as np

from automap.effects import CATALOGUE, Signals, distort_imu
from automap.effects.inertial_signals import asks_for_the_drive
from automap.effects.measured import Values
from automap.effects.signals import signals_of
from automap.effects.terms import TEMPERATURE
from automap.effects.user import user_signal
from automap.effects.vehicle import mounting_angles, sensor_to_vehicle
from automap.frames import rpy_to_matrix
from automap.records import FloatArray, ImuData, IntArray
from automap.simulation.scenario import Imu, Scenario, WarmUp
from automap.simulation.trajectory import Motion, body_rate


def temperature(scenario: Scenario, t_s: FloatArray) -> FloatArray | None:
    """The sensor's temperature [n] in deg C as it warms up, None where nothing asks for it."""
    curve = scenario.imu.warm_up
    if curve is None:
        if not any(CATALOGUE[name].follows(TEMPERATURE) for name in scenario.errors):
            return None
        curve = WarmUp()
    rise = curve.rise_k * (1.0 - np.exp(-t_s / curve.time_constant_s))
    return np.asarray(curve.start_c + rise)


def record_imu(
    t_ns: IntArray,
    motion: Motion,
    setup: Imu,
    errors: Values,
    rng: np.random.Generator,
    temp_c: FloatArray | None = None,
) -> ImuData:
    """Readings at ``motion``'s times, stamped ``t_ns`` [n], at ``temp_c`` [n] deg C.

    They are in the sensor's axes, which ``imu_mounting`` turns into the vehicle's. The effects
    of family "imu" come from the one sensor model; bias walks are integrated white noise from
    zero; white noise has the setup's density over the Nyquist band.
    """
    speed = np.linalg.norm(motion.vel_ned, axis=1)
    given = {name: dict(values) for name, values in errors.items()}
    acting = [t.signal for n in given if n in CATALOGUE for t in CATALOGUE[n].terms]
    asked = any(asks_for_the_drive(signal) for signal in acting)
    signals = true_signals(motion, temp_c) if asked else None
    rates, forces = _in_sensor_axes(motion, errors, signals)
    gyro, accel = distort_imu(rates, forces, given, temp_c=temp_c, speed=speed, signals=signals)
    steps = np.diff(motion.t_s, prepend=motion.t_s[:1])
    gyro += _walk(given.get("gyro_bias_walk", {}), steps, rng)
    accel += _walk(given.get("accel_bias_walk", {}), steps, rng)
    root_rate = np.sqrt(setup.rate_hz)
    gyro += rng.standard_normal(gyro.shape) * setup.gyro_noise * root_rate
    accel += rng.standard_normal(accel.shape) * setup.accel_noise * root_rate
    return ImuData(t_ns=t_ns, gyro=gyro, accel=accel, temp_c=temp_c)


def _in_sensor_axes(
    motion: Motion, errors: Values, signals: Signals | None
) -> tuple[FloatArray, FloatArray]:
    """Rates and forces [n, 3] along the axes of a sensor whose mounting may move."""
    angles = np.zeros((1, 3))
    if signals is not None:
        angles = mounting_angles(errors, len(motion.t_s), lambda name: user_signal(name, signals))
    if not np.ptp(angles, axis=0).any():
        C_v_s = sensor_to_vehicle(errors)
        return motion.angular_rate @ C_v_s, motion.specific_force @ C_v_s
    moved = rpy_to_matrix(angles)
    rates, forces = (
        np.einsum("nij,ni->nj", moved, of) for of in (motion.angular_rate, motion.specific_force)
    )
    swing = np.asarray(np.gradient(angles, motion.t_s, axis=0))
    return rates + body_rate(angles, swing), forces


def true_signals(motion: Motion, temp_c: FloatArray | None = None) -> Signals:
    """The quantities [n] that effects are functions of, along a true motion."""
    time = motion.t_s - motion.t_s[0]
    heading = np.unwrap(motion.rpy[:, 2])
    along = np.einsum("ni,ni->n", motion.C_n_b[:, :, 0], motion.accel_ned)
    rate, force = motion.angular_rate, motion.specific_force
    return signals_of(time, motion.vel_ned, heading, along, rate, force, temp_c)


def _walk(intensity: dict[str, float], steps: FloatArray, rng: np.random.Generator) -> FloatArray:
    scale = np.array([intensity.get(axis, 0.0) for axis in "xyz"])
    kicks = rng.standard_normal((len(steps), 3)) * np.sqrt(steps)[:, None] * scale
    return np.asarray(np.cumsum(kicks, axis=0))
