"""Attitude: rotation matrices, quaternions, Euler angles.

All functions take one rotation or a stack along the leading axes. ``C_a_b`` takes
components in b to components in a. Quaternions are scalar-first and unit. Euler angles
are roll, pitch, yaw of the ZYX sequence: ``C_n_b = Rz(yaw) Ry(pitch) Rx(roll)``.
Book: P. D. Groves, Principles of GNSS, Inertial, and Multisensor Integrated Navigation
Systems, 2nd ed., section 2.2.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from automap.records import FloatArray


def rpy_to_matrix(rpy: npt.ArrayLike) -> FloatArray:
    """``C_n_b`` [..., 3, 3] of roll, pitch, yaw [..., 3] in rad."""
    angles = np.asarray(rpy, dtype=np.float64)
    sr, sp, sy = (np.sin(angles[..., i]) for i in range(3))
    cr, cp, cy = (np.cos(angles[..., i]) for i in range(3))
    out = np.empty((*angles.shape[:-1], 3, 3))
    out[..., 0, 0] = cp * cy
    out[..., 0, 1] = sr * sp * cy - cr * sy
    out[..., 0, 2] = cr * sp * cy + sr * sy
    out[..., 1, 0] = cp * sy
    out[..., 1, 1] = sr * sp * sy + cr * cy
    out[..., 1, 2] = cr * sp * sy - sr * cy
    out[..., 2, 0] = -sp
    out[..., 2, 1] = sr * cp
    out[..., 2, 2] = cr * cp
    return out


def matrix_to_rpy(matrix: npt.ArrayLike) -> FloatArray:
    """Roll, pitch, yaw [..., 3] in rad of ``C_n_b`` [..., 3, 3]; pitch in [-pi/2, pi/2]."""
    m = np.asarray(matrix, dtype=np.float64)
    pitch = -np.arcsin(np.clip(m[..., 2, 0], -1.0, 1.0))
    roll = np.arctan2(m[..., 2, 1], m[..., 2, 2])
    yaw = np.arctan2(m[..., 1, 0], m[..., 0, 0])
    return np.stack([roll, pitch, yaw], axis=-1)


def quat_to_matrix(quat: npt.ArrayLike) -> FloatArray:
    """Matrix [..., 3, 3] of a unit quaternion [..., 4], scalar first (paper eq. 17)."""
    q = np.asarray(quat, dtype=np.float64)
    w, x, y, z = (q[..., i] for i in range(4))
    out = np.empty((*q.shape[:-1], 3, 3))
    out[..., 0, 0] = w * w + x * x - y * y - z * z
    out[..., 0, 1] = 2 * (x * y - w * z)
    out[..., 0, 2] = 2 * (x * z + w * y)
    out[..., 1, 0] = 2 * (x * y + w * z)
    out[..., 1, 1] = w * w - x * x + y * y - z * z
    out[..., 1, 2] = 2 * (y * z - w * x)
    out[..., 2, 0] = 2 * (x * z - w * y)
    out[..., 2, 1] = 2 * (y * z + w * x)
    out[..., 2, 2] = w * w - x * x - y * y + z * z
    return out


def quat_to_rpy(quat: npt.ArrayLike) -> FloatArray:
    """Roll, pitch, yaw [..., 3] in rad of a unit quaternion [..., 4], scalar first."""
    q = np.asarray(quat, dtype=np.float64)
    w, x, y, z = (q[..., i] for i in range(4))
    roll = np.arctan2(2 * (y * z + w * x), w * w - x * x - y * y + z * z)
    pitch = -np.arcsin(np.clip(2 * (x * z - w * y), -1.0, 1.0))
    yaw = np.arctan2(2 * (x * y + w * z), w * w + x * x - y * y - z * z)
    return np.stack([roll, pitch, yaw], axis=-1)


def rpy_to_quat(rpy: npt.ArrayLike) -> FloatArray:
    """Unit quaternion [..., 4], scalar first, of roll, pitch, yaw [..., 3] in rad."""
    half = 0.5 * np.asarray(rpy, dtype=np.float64)
    sr, sp, sy = (np.sin(half[..., i]) for i in range(3))
    cr, cp, cy = (np.cos(half[..., i]) for i in range(3))
    return np.stack(
        [
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        ],
        axis=-1,
    )


def quat_multiply(a: npt.ArrayLike, b: npt.ArrayLike) -> FloatArray:
    """Product [..., 4] of quaternions, scalar first: the rotation b, then a."""
    p, q = np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64)
    w0, x0, y0, z0 = (p[..., i] for i in range(4))
    w1, x1, y1, z1 = (q[..., i] for i in range(4))
    return np.stack(
        [
            w0 * w1 - x0 * x1 - y0 * y1 - z0 * z1,
            w0 * x1 + x0 * w1 + y0 * z1 - z0 * y1,
            w0 * y1 - x0 * z1 + y0 * w1 + z0 * x1,
            w0 * z1 + x0 * y1 - y0 * x1 + z0 * w1,
        ],
        axis=-1,
    )


def matrix_to_quat(matrix: npt.ArrayLike) -> FloatArray:
    """Unit quaternion [..., 4], scalar first and non-negative, of a matrix [..., 3, 3]."""
    from scipy.spatial.transform import Rotation

    m = np.asarray(matrix, dtype=np.float64)
    xyzw = Rotation.from_matrix(m.reshape(-1, 3, 3)).as_quat(canonical=True)
    return np.asarray(np.roll(xyzw, 1, axis=-1).reshape(*m.shape[:-2], 4))


def rotation_vector_to_matrix(vector: npt.ArrayLike) -> FloatArray:
    """Matrix exp([v x]) [..., 3, 3] of a rotation vector [..., 3] in rad."""
    from scipy.spatial.transform import Rotation

    v = np.asarray(vector, dtype=np.float64)
    matrices = Rotation.from_rotvec(v.reshape(-1, 3)).as_matrix()
    return np.asarray(matrices.reshape(*v.shape[:-1], 3, 3))


def matrix_to_rotation_vector(matrix: npt.ArrayLike) -> FloatArray:
    """Rotation vector [..., 3] in rad of a matrix [..., 3, 3]."""
    from scipy.spatial.transform import Rotation

    m = np.asarray(matrix, dtype=np.float64)
    vectors = Rotation.from_matrix(m.reshape(-1, 3, 3)).as_rotvec()
    return np.asarray(vectors.reshape(*m.shape[:-2], 3))


def wrap_pi(angle: npt.ArrayLike) -> FloatArray:
    """Angle in rad wrapped to (-pi, pi]."""
    a = np.asarray(angle, dtype=np.float64)
    return np.asarray(-((-a + np.pi) % (2 * np.pi) - np.pi))


def rpy_sd_from_tilt(rpy: FloatArray, cov_phi: FloatArray) -> FloatArray:
    """One-sigma of roll, pitch, yaw [n, 3] from the covariance [n, 3, 3] of a small rotation.

    ``phi`` is expressed in navigation axes: ``C_true = exp([phi x]) C``. The Jacobian is that
    of the ZYX angles; near pitch = 90 deg roll and yaw lose their meaning and the values grow.
    """
    cp = np.cos(rpy[:, 1])
    cp = np.where(np.abs(cp) < 1e-6, 1e-6, cp)
    tp = np.sin(rpy[:, 1]) / cp
    cy, sy = np.cos(rpy[:, 2]), np.sin(rpy[:, 2])
    jac = np.zeros((len(rpy), 3, 3))
    jac[:, 0, 0] = cy / cp
    jac[:, 0, 1] = sy / cp
    jac[:, 1, 0] = -sy
    jac[:, 1, 1] = cy
    jac[:, 2, 0] = cy * tp
    jac[:, 2, 1] = sy * tp
    jac[:, 2, 2] = 1.0
    cov = jac @ cov_phi @ np.swapaxes(jac, 1, 2)
    return np.asarray(np.sqrt(np.maximum(np.einsum("nii->ni", cov), 0.0)))
