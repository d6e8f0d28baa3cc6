"""Small recordings in other programs' formats: a vehicle driving north-east at 10 m/s."""

from __future__ import annotations

import cv2
import numpy as np

LAT, LON, HEIGHT = -33.9, 151.2, 40.0
START_NS = 1_700_000_000_000_000_000
SPEED = 10.0
N_IMU, N_FIX, N_IMAGE = 300, 16, 5
IMU_NS = START_NS + np.arange(N_IMU, dtype=np.int64) * 10_000_000
FIX_NS = START_NS + np.arange(N_FIX, dtype=np.int64) * 200_000_000
IMAGE_NS = START_NS + np.arange(N_IMAGE, dtype=np.int64) * 500_000_000
GYRO = np.array([0.01, -0.02, 0.03])
FORCE_FLU = np.array([0.1, 0.2, 9.8])


def gyro(i: int) -> np.ndarray:
    """Turn rates of reading ``i``, which flicker as a sensor's do."""
    return GYRO * (1.0 + 1e-3 * (-1) ** i)


def force(i: int) -> np.ndarray:
    """Specific force of reading ``i``, forward, left, up."""
    return FORCE_FLU * (1.0 + 1e-4 * (-1) ** i)


def place(i: int) -> tuple[float, float, float]:
    """Degrees and height of fix ``i``."""
    way = SPEED * np.sqrt(0.5) * i * 0.2
    lat = LAT + np.degrees(way / 6_371_000.0)
    return lat, LON + np.degrees(way / 6_371_000.0 / np.cos(np.radians(LAT))), HEIGHT


def jpeg(i: int) -> bytes:
    """A small picture of its own grey."""
    return cv2.imencode(".jpg", np.full((48, 64, 3), 40 + 20 * i, np.uint8))[1].tobytes()


def png(i: int) -> bytes:
    """The same as PNG."""
    return cv2.imencode(".png", np.full((48, 64, 3), 40 + 20 * i, np.uint8))[1].tobytes()
