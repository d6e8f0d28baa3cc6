"""Simulated sensors turned by hand, with errors that are known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from automap.calibration.accelerometer import misalignment_matrix
from automap.frames import matrix_to_rotation_vector, rotation_vector_to_matrix
from automap.records import FloatArray, RawImu

GRAVITY = 9.80665
RATE = 100.0


@dataclass(frozen=True)
class Errors:
    """A sensor's errors in correction form: true = T (scale reading + bias) and so on."""

    accel_scale: FloatArray
    accel_bias: FloatArray
    misalignment: FloatArray
    gyro_scale: FloatArray
    gyro_bias: FloatArray
    gyro_matrix: FloatArray
    g_sensitivity: FloatArray

    def readings(self, rate: FloatArray, force: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Gyro and accelerometer readings [n, 3] of true rates and forces [n, 3]."""
        T = misalignment_matrix(self.misalignment)
        accel = (np.linalg.solve(T, force.T).T - self.accel_bias) / self.accel_scale
        turned = rate + force @ self.g_sensitivity.T
        gyro = (np.linalg.solve(self.gyro_matrix, turned.T).T - self.gyro_bias) / self.gyro_scale
        return gyro, accel


def random_errors(rng: np.random.Generator, size: float = 1.0) -> Errors:
    """Errors of a consumer MEMS unit, in units: some per cent, some tenths."""
    matrix = np.eye(3)
    matrix[~np.eye(3, dtype=bool)] = size * rng.normal(0, 0.01, 6)
    return Errors(
        accel_scale=1.0 + size * rng.normal(0, 0.01, 3),
        accel_bias=size * rng.normal(0, 0.2, 3),
        misalignment=size * rng.normal(0, 0.005, 3),
        gyro_scale=1.0 + size * rng.normal(0, 0.01, 3),
        gyro_bias=size * rng.normal(0, 0.01, 3),
        gyro_matrix=matrix,
        g_sensitivity=np.zeros((3, 3)),
    )


@dataclass(frozen=True)
class Motion:
    """True motion: ``t_s`` [n], ``C`` [n, 3, 3] body to navigation (z down), ``rate`` [n, 3]
    and ``force`` [n, 3] in body axes."""

    t_s: FloatArray
    C: FloatArray
    rate: FloatArray
    force: FloatArray


def turned_by_hand(
    rng: np.random.Generator,
    poses: FloatArray,
    rest_s: float = 4.0,
    turn_s: float = 2.0,
    first_s: float = 10.0,
    amplitude_m: float = 0.05,
    sway_hz: float = 1.0,
) -> Motion:
    """A sensor held still in each of ``poses`` [k, 3, 3] in turn, swayed by the hand between.

    Turns have a constant axis and a smooth rate; the hand's translation has an amplitude
    (one sigma) and a frequency band.
    """
    rates, attitudes = [], []
    moving = []
    for i, C in enumerate(poses):
        n = round((first_s if i == 0 else rest_s) * RATE)
        if n:
            rates.append(np.zeros((n, 3)))
            attitudes.append(np.broadcast_to(C, (n, 3, 3)))
            moving.append(np.zeros(n))
        if i + 1 < len(poses):
            angle = matrix_to_rotation_vector(C.T @ poses[i + 1])
            n = round(turn_s * RATE)
            x = np.arange(n) / n
            part = x - np.sin(2 * np.pi * x) / (2 * np.pi)
            speed = (1.0 - np.cos(2 * np.pi * x)) / (n / RATE)
            rates.append(speed[:, None] * angle)
            attitudes.append(C @ rotation_vector_to_matrix(part[:, None] * angle))
            # without rests between, the hand sets out gently and goes on
            gently = np.sin(0.5 * np.pi * x) ** 2 if i == 0 else np.ones(n)
            moving.append(np.sin(np.pi * x) ** 2 if rest_s else gently)
    rate, C = np.concatenate(rates), np.concatenate(attitudes)
    t_s = np.arange(len(rate)) / RATE
    place = _sway(rng, t_s, amplitude_m, sway_hz) * np.concatenate(moving)[:, None]
    velocity = np.gradient(place, 1.0 / RATE, axis=0)
    acceleration = np.gradient(velocity, 1.0 / RATE, axis=0)
    force_n = acceleration - np.array([0.0, 0.0, GRAVITY])
    return Motion(t_s, C, rate, np.einsum("nji,nj->ni", C, force_n))


def _sway(rng: np.random.Generator, t_s: FloatArray, amplitude_m: float, hz: float) -> FloatArray:
    """A bounded random translation [n, 3] in metres, as a sum of sines."""
    out = np.zeros((len(t_s), 3))
    for _ in range(12):
        w = 2 * np.pi * rng.uniform(0.3, 1.5) * hz
        phase = rng.uniform(0, 2 * np.pi, 3)
        size = amplitude_m * np.sqrt(2.0 / 12.0) * rng.normal(0, 1, 3)
        out += size * np.sin(w * t_s[:, None] + phase)
    return out


def random_walk(rng: np.random.Generator, n: int, density: FloatArray) -> FloatArray:
    """Random walks [n, k] from zero, ``density`` [k] per square root of a second."""
    return np.cumsum(rng.normal(0, density / np.sqrt(RATE), (n, len(density))), axis=0)


def random_poses(rng: np.random.Generator, count: int) -> FloatArray:
    """Attitudes [k, 3, 3]: the six faces first, then random ones."""
    from scipy.spatial.transform import Rotation

    faces = Rotation.from_euler(
        "xyz", [[0, 0, 0], [90, 0, 20], [180, 0, 40], [-90, 0, 0], [0, 88, 10], [0, -88, 0]],
        degrees=True,
    ).as_matrix()  # fmt: skip
    others = Rotation.random(max(count - 6, 0), rng=rng).as_matrix()
    return np.asarray(np.concatenate([faces, others])[:count])


def recorded(
    rng: np.random.Generator,
    motion: Motion,
    errors: Errors,
    gyro_noise: float = 1e-4,
    accel_noise: float = 1e-3,
    temp_c: FloatArray | None = None,
    drift: FloatArray | None = None,
) -> RawImu:
    """The log of a sensor with these errors and white noise (rad/s/sqrt(Hz) and so on).

    ``drift`` [n, 6] is added to the readings, accelerometer first.
    """
    gyro, accel = errors.readings(motion.rate, motion.force)
    if drift is not None:
        accel, gyro = accel + drift[:, :3], gyro + drift[:, 3:]
    root = np.sqrt(RATE)
    return RawImu(
        t_ns=np.rint(motion.t_s * 1e9).astype(np.int64),
        gyro=gyro + rng.normal(0, gyro_noise * root, gyro.shape),
        accel=accel + rng.normal(0, accel_noise * root, accel.shape),
        gyro_scale=np.ones(3),
        accel_scale=np.ones(3),
        temp_c=temp_c,
        name="simulated",
    )
