"""The exact optimal linear smoother of a simulated drive, as the yardstick of the fusion.

It knows everything that the fusion has to find out: the true trajectory to linearise about,
the true noise levels and correlation time, the clock. What it does not know are the noises
themselves. State: errors of position, velocity and attitude, biases and scale factors of gyro
and accelerometer, and the receiver's wandering errors: three of the position, one of the velocity
that lasts; full matrices, Rauch-Tung-Striebel.
"""

from __future__ import annotations

import numpy as np

from automap.earth import metres_per_radian
from automap.records import Fixes, FloatArray, ImuData
from tests.unit.fusion_drive import BASE_NS, Sensor
from tests.unit.fusion_motion import Motion
from tests.unit.fusion_receiver import GPS0, Receiver

P, V, PHI, BA, BG, SA, SG, W, SLOW, SHORT, LASTING = (slice(3 * i, 3 * i + 3) for i in range(11))
N_INERTIAL, N = 21, 33
PRIOR_SD = np.repeat([10.0, 3.0, 0.2, 0.3, 0.02, 0.01, 0.01, 1.0, 1.0, 1.0, 1.0], 3)
NODE_HZ = 5.0
"""Steps of the smoother: as often as this the vehicle constraint is observed."""


def _cross(v: FloatArray) -> FloatArray:
    out = np.zeros((*v.shape[:-1], 3, 3))
    out[..., 0, 1], out[..., 0, 2] = -v[..., 2], v[..., 1]
    out[..., 1, 0], out[..., 1, 2] = v[..., 2], -v[..., 0]
    out[..., 2, 0], out[..., 2, 1] = -v[..., 1], v[..., 0]
    return out


def optimal_errors(
    motion: Motion,
    imu: ImuData,
    fixes: Fixes,
    sensor: Sensor,
    receiver: Receiver,
    use: FloatArray | None = None,
    use_velocity: bool = True,
    smooth: bool = True,
    nhc_sd: float | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Errors [k, 9] and sd [k, 9] (NED) of the optimal estimate at the fixes' epochs.

    The IMU must have no delay and vehicle axes, the antenna no lever arm, the receiver no delay;
    what it does not say (NaN) is left out. ``use`` [k] masks fixes. With ``nhc_sd`` (m/s over one
    second) the vehicle constraint is observed as well.
    """
    t_imu = (imu.t_ns - BASE_NS) * 1e-9
    rate = round(1.0 / float(np.median(np.diff(t_imu))))
    node_hz = max(NODE_HZ, receiver.rate)
    per = round(rate / node_hz)
    begin = float(fixes.gps_s[0]) - GPS0
    fix_at = np.rint((fixes.gps_s - GPS0 - begin) * node_hz).astype(int)
    k = int(fix_at[-1]) + 1
    t_node = begin + np.arange(k) / node_hz
    phi, q, u = _steps(motion, imu, sensor, k, per, rate)
    for part, tau in _markov(receiver):
        d = np.exp(-1.0 / node_hz / np.asarray(tau))
        phi[:, part, part] = d * np.eye(3)
        q[:, part, part] = (1.0 - d * d) * np.eye(3)

    true = motion.at(t_node)
    at_fix = motion.at(fixes.gps_s - GPS0)
    north, east = metres_per_radian(at_fix.lat, at_fix.height)
    dlon = (fixes.lon_rad - at_fix.lon + np.pi) % (2 * np.pi) - np.pi
    z = np.column_stack(
        [
            (fixes.lat_rad - at_fix.lat) * north,
            dlon * east,
            at_fix.height - fixes.height_m,
            fixes.vel_ned - at_fix.vel,
        ]
    )
    h = np.zeros((6, N))
    h[:3, P], h[:3, W], h[3:, V] = np.eye(3), np.diag(receiver.wander), np.eye(3)
    h[:3, SLOW], h[:3, SHORT] = np.diag(receiver.slow), receiver.short * np.eye(3)
    h[3:, LASTING] = receiver.lasting * np.eye(3)
    r = np.concatenate([np.square(receiver.white), np.full(3, receiver.velocity**2)])
    said = np.isfinite(z)
    said[:, 3:] &= use_velocity
    if use is not None:
        said &= np.asarray(use, bool)[:, None]
    speed = np.linalg.norm(true.vel, axis=1)
    fix_of = np.full(k, -1)
    fix_of[fix_at] = np.arange(len(fix_at))

    x, p = np.zeros(N), np.diag(PRIOR_SD**2)
    xs, ps = np.zeros((k, N)), np.zeros((k, N, N))
    xp, pp = np.zeros((k, N)), np.zeros((k, N, N))
    for i in range(k):
        if i:
            x, p = phi[i - 1] @ x + u[i - 1], phi[i - 1] @ p @ phi[i - 1].T + q[i - 1]
        xp[i], pp[i] = x, p
        # estimate minus truth is x: measured minus predicted is z - h x
        rows = said[fix_of[i]] if fix_of[i] >= 0 else np.zeros(6, bool)
        if rows.any():
            x, p = _update(x, p, h[rows], z[fix_of[i]][rows], np.diag(r[rows]))
        if nhc_sd is not None and speed[i] > 3.0:
            ct = true.c_n_b[i].T
            g = np.zeros((2, N))
            g[:, V] = ct[1:]
            g[:, PHI] = (ct @ _cross(true.vel[i]))[1:]
            sd = nhc_sd * (1.0 + 0.05 * speed[i]) * np.array([1.0, 2.0])
            slide = -(ct @ true.vel[i])[1:]
            x, p = _update(x, p, g, slide, np.diag(sd**2 * node_hz))
        xs[i], ps[i] = x, p
    if smooth:
        for i in range(k - 2, -1, -1):
            gain = np.linalg.solve(pp[i + 1], phi[i] @ ps[i]).T
            xs[i] += gain @ (xs[i + 1] - xp[i + 1])
            ps[i] += gain @ (ps[i + 1] - pp[i + 1]) @ gain.T
    return xs[fix_at, :9], np.sqrt(np.einsum("kii->ki", ps[fix_at])[:, :9])


def _markov(receiver: Receiver) -> list[tuple[slice, float | tuple[float, ...]]]:
    """The receiver's Gauss-Markov errors and their time constants; the states have unit size."""
    position = [(W, receiver.tau), (SLOW, receiver.slow_tau), (SHORT, receiver.short_tau)]
    return [*position, (LASTING, receiver.lasting_tau)]


def _steps(
    motion: Motion, imu: ImuData, sensor: Sensor, k: int, per: int, rate: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Transition [k - 1, N, N], noise and drive [k - 1, N] of the inertial states, a node to the
    next; ``per`` samples lie between two.

    The estimate's deviation is driven by the errors that the readings really had; biases and scales
    start at zero error of knowledge, so the true ones stand in the state.
    """
    steps = (k - 1) * per
    dt = 1.0 / rate
    t_imu = (imu.t_ns - BASE_NS) * 1e-9
    mid = motion.at((np.arange(steps) + 0.5) * dt)
    true = motion.at(t_imu[: steps + 1])
    # the errors of the readings in the middle of each step, beyond bias and scale at zero
    noise = np.concatenate(
        [imu.gyro[: steps + 1] - true.gyro, imu.accel[: steps + 1] - true.accel], axis=1
    )
    noise = 0.5 * (noise[1:] + noise[:-1])
    c, f_b, w_b = mid.c_n_b, mid.accel, mid.gyro
    f_n = np.einsum("nij,nj->ni", c, f_b)
    n, shape = N_INERTIAL, (k - 1, per, 3, 3)
    a = np.zeros((k - 1, per, n, n))
    a[..., P, V] = np.eye(3)
    a[..., V, PHI] = -_cross(f_n).reshape(shape)
    a[..., V, BA] = -c.reshape(shape)
    a[..., V, SA] = -(c * f_b[:, None, :]).reshape(shape)
    a[..., PHI, BG] = -c.reshape(shape)
    a[..., PHI, SG] = -(c * w_b[:, None, :]).reshape(shape)
    drive = np.zeros((k - 1, per, n))
    drive[..., PHI] = np.einsum("nij,nj->ni", c, noise[:, :3]).reshape(k - 1, per, 3)
    drive[..., V] = np.einsum("nij,nj->ni", c, noise[:, 3:]).reshape(k - 1, per, 3)
    phi = np.zeros((k - 1, N, N))
    q = np.zeros((k - 1, N, N))
    u = np.zeros((k - 1, N))
    density = np.zeros(n)
    density[V] = sensor.accel_noise**2 + sensor.vibration**2 * dt
    density[PHI] = sensor.gyro_noise**2
    density[BA], density[BG] = sensor.accel_walk**2, sensor.gyro_walk**2
    phi[:, :n, :n] = np.eye(n)
    for s in range(per):
        step = a[:, s] * dt
        step = np.eye(n) + step + 0.5 * step @ step
        phi[:, :n, :n] = step @ phi[:, :n, :n]
        spread = q[:, :n, :n] + 0.5 * np.diag(density) * dt
        q[:, :n, :n] = step @ spread @ np.swapaxes(step, 1, 2) + 0.5 * np.diag(density) * dt
        half = 0.5 * drive[:, s] * dt
        u[:, :n] = np.einsum("nij,nj->ni", step, u[:, :n] + half) + half
    return phi, q, u


def _update(
    x: FloatArray, p: FloatArray, h: FloatArray, z: FloatArray, r: FloatArray
) -> tuple[FloatArray, FloatArray]:
    s = h @ p @ h.T + r
    gain = np.linalg.solve(s, h @ p).T
    p = p - gain @ s @ gain.T
    return x + gain @ (z - h @ x), 0.5 * (p + p.T)
