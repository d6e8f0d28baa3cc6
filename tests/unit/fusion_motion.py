"""Motions with known truth for the fusion's tests, built apart from the project's simulator.

The motion is given on the tangent plane of the start, in Earth-fixed axes; readings follow
from Newton's law in that plane. No transport rate and no navigation-frame formula enters, so
that a sign shared by simulator and filter cannot hide.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pymap3d
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d

from automap.earth import gravity
from automap.records import FloatArray

EARTH_RATE = 7.292115e-5
GRID_S = 0.02


def _rot_e_ned(lat: FloatArray, lon: FloatArray) -> FloatArray:
    """C_e_n [n, 3, 3] of the local NED at latitude and longitude in rad."""
    s, c, sl, cl = np.sin(lat), np.cos(lat), np.sin(lon), np.cos(lon)
    zero = np.zeros_like(s)
    north = np.stack([-s * cl, -s * sl, c], axis=-1)
    east = np.stack([-sl, cl, zero], axis=-1)
    down = np.stack([-c * cl, -c * sl, -s], axis=-1)
    return np.stack([north, east, down], axis=-1)


def _euler(roll: FloatArray, pitch: FloatArray, yaw: FloatArray) -> FloatArray:
    sr, cr, sp, cp, sy, cy = (f(a) for a in (roll, pitch, yaw) for f in (np.sin, np.cos))
    return np.stack(
        [
            np.stack([cp * cy, sr * sp * cy - cr * sy, cr * sp * cy + sr * sy], axis=-1),
            np.stack([cp * sy, sr * sp * sy + cr * cy, cr * sp * sy - sr * cy], axis=-1),
            np.stack([-sp, sr * cp, cr * cp], axis=-1),
        ],
        axis=-2,
    )


@dataclass(frozen=True)
class Truth:
    """Motion at times ``t`` [n]: geodetic position (rad, m), velocity and attitude in NED,
    perfect readings in vehicle axes, rate against the Earth in vehicle axes."""

    t: FloatArray
    lat: FloatArray
    lon: FloatArray
    height: FloatArray
    vel: FloatArray
    c_n_b: FloatArray
    gyro: FloatArray
    accel: FloatArray
    turn: FloatArray


@dataclass(frozen=True)
class Motion:
    """A drive as splines on the tangent plane of ``origin`` (lat, lon rad, height m)."""

    duration: float
    origin: tuple[float, float, float]
    velocity: CubicSpline
    angles: CubicSpline

    def at(self, t: FloatArray) -> Truth:
        t = np.asarray(t, np.float64)
        vel_t = self.velocity(t)
        acc_t = self.velocity(t, 1)
        pos_t = self._position()(t)
        roll, pitch, yaw = self.angles(t).T
        rates = self.angles(t, 1)
        c_t_b = _euler(roll, pitch, yaw)
        place = pymap3d.ned2geodetic(*pos_t.T, *self.origin, deg=False)
        # a single instant comes back as a scalar
        lat, lon, height = (np.atleast_1d(p) for p in place)
        c_e_t = _rot_e_ned(np.array(self.origin[0]), np.array(self.origin[1]))
        c_n_t = np.swapaxes(_rot_e_ned(lat, lon), 1, 2) @ c_e_t
        g = np.zeros((len(t), 3))
        g[:, 2] = gravity(lat, height)
        g_t = np.einsum("nji,nj->ni", c_n_t, g)
        w_t = c_e_t.T @ np.array([0.0, 0.0, EARTH_RATE])
        force_t = acc_t + 2.0 * np.cross(w_t, vel_t) - g_t
        turn = np.stack(
            [
                rates[:, 0] - np.sin(pitch) * rates[:, 2],
                np.cos(roll) * rates[:, 1] + np.sin(roll) * np.cos(pitch) * rates[:, 2],
                -np.sin(roll) * rates[:, 1] + np.cos(roll) * np.cos(pitch) * rates[:, 2],
            ],
            axis=1,
        )
        return Truth(
            t,
            lat,
            lon,
            height,
            np.einsum("nij,nj->ni", c_n_t, vel_t),
            c_n_t @ c_t_b,
            turn + np.einsum("nji,j->ni", c_t_b, w_t),
            np.einsum("nji,nj->ni", c_t_b, force_t),
            turn,
        )

    def _position(self) -> object:
        return self.velocity.antiderivative()


def make_motion(
    speed: Sequence[tuple[float, float]],
    turns: Sequence[tuple[float, float, float]],
    duration: float,
    origin_deg: tuple[float, float, float] = (-35.28, 149.13, 580.0),
    heading_deg: float = 30.0,
    slope: float = 0.03,
    slip_seed: int | None = None,
) -> Motion:
    """A drive of ``duration`` s. With ``slip_seed`` it slides sideways at random, 0.04 m/s over one
    second and 0.03 m/s more for each m/s^2 of lateral acceleration, and bounces twice as much.

    ``speed`` knots (time s, m/s), negative in reverse; ``turns`` (begin s, length s, angle
    deg). Corners are rounded over half a second; the body leans and the road rises gently.
    """
    pad = 5.0
    t = np.arange(-round(pad / GRID_S), round((duration + pad) / GRID_S) + 1) * GRID_S
    smooth = 0.5 / GRID_S
    knots = np.array(speed, float)
    v = gaussian_filter1d(np.interp(t, knots[:, 0], knots[:, 1]), smooth, mode="nearest")
    yaw = np.full_like(t, np.radians(heading_deg))
    for begin, length, angle in turns:
        yaw += np.radians(angle) * np.clip((t - begin) / length, 0.0, 1.0)
    yaw = gaussian_filter1d(yaw, smooth, mode="nearest")
    way = np.cumsum(v) * GRID_S
    pitch = slope * np.sin(way / 150.0)
    lateral = v * np.gradient(yaw, t)
    roll = -0.006 * gaussian_filter1d(lateral, smooth)
    vel = v[:, None] * np.stack(
        [np.cos(pitch) * np.cos(yaw), np.cos(pitch) * np.sin(yaw), -np.sin(pitch)], axis=1
    )
    if slip_seed is not None:
        rng = np.random.default_rng(slip_seed)
        slide = gaussian_filter1d(rng.standard_normal((2, len(t))), smooth, axis=1)
        # the filtered noise keeps the white noise's density, one over the grid step
        density = np.hypot(0.04, 0.03 * gaussian_filter1d(lateral, smooth))
        slide *= density / np.sqrt(GRID_S) * np.minimum(np.abs(v) / 3.0, 1.0)
        zero = np.zeros_like(roll)
        body = np.stack([zero, slide[0], 2.0 * slide[1]], axis=1)
        vel = vel + np.einsum("nij,nj->ni", _euler(roll, pitch, yaw), body)
    lat, lon, height = origin_deg
    return Motion(
        duration,
        (np.radians(lat), np.radians(lon), height),
        CubicSpline(t, vel),
        CubicSpline(t, np.stack([roll, pitch, yaw], axis=1)),
    )


def city_drive(
    duration: float,
    seed: int,
    rest_s: float = 8.0,
    origin_deg: tuple[float, float, float] = (-35.28, 149.13, 580.0),
    start_speed: float = 0.0,
    slip: bool = False,
) -> Motion:
    """Stops, bends and straights at random; at rest for ``rest_s`` unless it starts moving."""
    rng = np.random.default_rng(seed)
    speed = [(0.0, start_speed), (0.0 if start_speed else rest_s, start_speed)]
    now, v = speed[-1]
    while now < duration:
        want = 0.0 if rng.random() < 0.2 and v > 0 else rng.uniform(6.0, 18.0)
        now += abs(want - v) / rng.uniform(1.0, 2.2) + 0.2
        speed.append((now, want))
        now += rng.uniform(3.0, 8.0) if want == 0.0 else rng.uniform(6.0, 20.0)
        speed.append((now, want))
        v = want
    knots = np.array(speed)
    turns, now = [], rest_s + 6.0
    while now < duration - 10.0:
        length = rng.uniform(4.0, 8.0)
        typical = float(np.interp(now + 0.5 * length, knots[:, 0], knots[:, 1]))
        slowest = float(np.interp(np.linspace(now, now + length, 9), *knots.T).min())
        if slowest > 4.0:
            angle = rng.choice([-90.0, 90.0, -45.0, 45.0, 25.0]) * min(1.0, 12.0 / typical)
            turns.append((now, length, float(angle)))
            now += length
        now += rng.uniform(3.0, 15.0)
    return make_motion(
        speed,
        turns,
        duration,
        origin_deg,
        heading_deg=float(rng.uniform(-180.0, 180.0)),
        slip_seed=seed if slip else None,
    )
