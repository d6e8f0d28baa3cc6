"""The paper's filter, equations (12) to (28), word by word: the oracle of the product's.

State (12): velocity, quaternion, accelerometer bias, gyro bias, accelerometer scale, gyro
scale, 19 numbers. Where the print lacks dt before C((1 + S) o a) and before g, it is put in.
"""

from __future__ import annotations

import numpy as np

from automap.records import FloatArray

V, Q, BA, BG, SA, SG = (slice(0, 3), slice(3, 7), slice(7, 10), slice(10, 13), slice(13, 16),
                        slice(16, 19))  # fmt: skip


class PaperFilter:
    """An extended Kalman filter on 19 states with forward Euler steps (25)."""

    def __init__(self, quat: FloatArray, sd: FloatArray, q: FloatArray, gravity: float) -> None:
        """``sd`` [18] velocity, attitude (navigation side), errors; ``q`` [2] noise densities
        squared of accelerometer and gyro."""
        self.x = np.zeros(19)
        self.x[Q] = quat
        self.P = np.zeros((19, 19))
        self.P[V, V] = np.diag(sd[:3] ** 2)
        # a turn phi of the navigation side moves the quaternion by (0, phi) q / 2
        J = 0.5 * right(quat)[:, 1:]
        self.P[Q, Q] = J @ np.diag(sd[3:6] ** 2) @ J.T
        self.P[7:, 7:] = np.diag(sd[6:] ** 2)
        self.q = q
        self.g = np.array([0.0, 0.0, gravity])

    @property
    def errors(self) -> FloatArray:
        """Biases, then scales, accelerometer first [12]."""
        return self.x[7:]

    @property
    def error_sd(self) -> FloatArray:
        """One sigma of the errors [12]."""
        return np.sqrt(np.diag(self.P)[7:])

    def predict(self, gyro: FloatArray, accel: FloatArray, dt: float) -> None:
        """Equations (13) to (25)."""
        x, quat = self.x, self.x[Q].copy()
        f = (1.0 + x[SA]) * accel + x[BA]
        w = (1.0 + x[SG]) * gyro + x[BG]
        C = matrix(quat)
        F = np.eye(19)
        F[V, Q] = dt * matrix_slope(quat, f)
        F[V, BA] = dt * C
        F[V, SA] = dt * C * accel
        F[Q, Q] += 0.5 * dt * right(np.concatenate([[0.0], w]))
        by_rate = 0.5 * dt * left(quat)[:, 1:]
        F[Q, BG] = by_rate
        F[Q, SG] = by_rate * gyro
        x[V] += dt * (C @ f + self.g)
        x[Q] += 0.5 * dt * left(quat) @ np.concatenate([[0.0], w])
        noise = np.zeros((19, 19))
        noise[V, V] = self.q[0] * dt * np.eye(3)
        noise[Q, Q] = self.q[1] / dt * by_rate @ by_rate.T
        self.P = F @ self.P @ F.T + noise
        self.normalise()

    def update(self, variance: float) -> None:
        """Equations (26) to (28) with z = 0."""
        H = np.eye(3, 19)
        S = H @ self.P @ H.T + variance * np.eye(3)
        K = self.P @ H.T @ np.linalg.inv(S)
        self.x -= K @ self.x[V]
        self.P = (np.eye(19) - K @ H) @ self.P
        self.P = 0.5 * (self.P + self.P.T)
        self.normalise()

    def normalise(self) -> None:
        """Bring the quaternion back to unit length."""
        self.x[Q] /= np.linalg.norm(self.x[Q])


def left(p: FloatArray) -> FloatArray:
    """Matrix of q -> p q."""
    w, x, y, z = p
    return np.array([[w, -x, -y, -z], [x, w, -z, y], [y, z, w, -x], [z, -y, x, w]])


def right(p: FloatArray) -> FloatArray:
    """Matrix of q -> q p."""
    w, x, y, z = p
    return np.array([[w, -x, -y, -z], [x, w, z, -y], [y, -z, w, x], [z, y, -x, w]])


def matrix(q: FloatArray) -> FloatArray:
    """Equation (17)."""
    w, x, y, z = q
    return np.array(
        [
            [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
        ]
    )


def matrix_slope(q: FloatArray, f: FloatArray) -> FloatArray:
    """d(C(q) f) / dq [3, 4], by the quadratic form's exact difference."""
    out = np.empty((3, 4))
    for i in range(4):
        step = np.zeros(4)
        step[i] = 0.5
        out[:, i] = (matrix(q + step) - matrix(q - step)) @ f
    return out
