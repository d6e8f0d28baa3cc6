"""The motion of a car as analytic functions of time, and what ideal sensors feel of it.

The point that follows the road is the one without side-slip, the middle of the rear axle: its
velocity lies along the vehicle's x axis but for the small angles that are drawn on purpose.
Speed over time and curvature over distance are quintic splines, so that all derivatives are
exact; only latitude, longitude and height are integrated numerically.

Reference: P. Groves, Principles of GNSS, Inertial, and Multisensor Integrated Navigation
Systems, 2nd edition, sections 2.3 and 5.4 (kinematics in north, east, down axes).
"""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline, CubicHermiteSpline

from tests.hidden_effects.geodesy import (
    Array,
    earth_rate_ned,
    meridian_radius,
    normal_gravity,
    normal_radius,
    transport_rate_ned,
)
from tests.hidden_effects.route import MARGIN_S, STEP_M, STEP_S, Plan

DEGREE = 5
FINE_S = 0.005


@dataclass(frozen=True)
class State:
    """The motion of one point of the vehicle at instants ``t`` [n], seconds of the recording.

    ``lat``, ``lon`` rad and ``height`` m [n]; ``vel_ned`` [n, 3]; ``C_n_b`` [n, 3, 3] vehicle to
    navigation; ``rpy`` [n, 3] rad; ``force`` [n, 3] specific force and ``rate`` [n, 3] turn rate
    against inertial space, ``rate_nav`` [n, 3] the same against north, east, down, in vehicle
    axes; ``speed`` [n] m/s along the path and ``accel`` [n] its derivative.
    """

    t: Array
    lat: Array
    lon: Array
    height: Array
    vel_ned: Array
    C_n_b: Array
    rpy: Array
    force: Array
    rate: Array
    rate_nav: Array
    speed: Array
    accel: Array


@dataclass(frozen=True)
class Path:
    """What a body's attitude may follow, at instants ``t`` [n] s: ``speed`` m/s, ``accel`` m/s^2,
    ``curvature`` 1/m (to the right positive), ``heading`` rad."""

    t: Array
    speed: Array
    accel: Array
    curvature: Array
    heading: Array


Body = Callable[[Path], Array]
"""Roll, pitch and yaw [n, 3] rad of the body against its path."""


def _spline(coefficients: Array, start: float, step: float) -> BSpline:
    """Quintic spline whose coefficient i has its weight around ``start + i step``."""
    padded = np.pad(coefficients, DEGREE, mode="edge")
    knots = start + step * (np.arange(len(padded) + DEGREE + 1) - DEGREE - (DEGREE + 1) / 2.0)
    return BSpline(knots, padded, DEGREE)


class Motion:
    """A plan as functions of time.

    ``origin`` latitude, longitude (rad) and height (m) of the rear axle at the start; ``axle``
    [3] m from the IMU to the rear axle, vehicle axes; ``sideslip`` rad/(m/s^2) of side-slip
    angle at the axle, outwards, per lateral acceleration.
    """

    def __init__(
        self,
        plan: Plan,
        origin: tuple[float, float, float],
        seconds: float,
        rng: np.random.Generator,
        axle: Array | None = None,
        sideslip: float = 0.0,
    ) -> None:
        self.seconds = seconds
        self.plan = plan
        self.sideslip = sideslip
        self.imu_from_axle = np.zeros(3) if axle is None else -np.asarray(axle, np.float64)
        self._speed = _spline(plan.speed, -MARGIN_S, STEP_S)
        self._accel = self._speed.derivative()
        self._distance = self._speed.antiderivative()
        self._curvature = _spline(plan.curvature, 0.0, STEP_M)
        self._curvature_slope = self._curvature.derivative()
        self._heading = self._curvature.antiderivative()
        self._grade = _spline(plan.grade, 0.0, STEP_M)
        self._grade_slope = self._grade.derivative()
        self._bank = _spline(plan.bank, 0.0, STEP_M)
        self._bank_slope = self._bank.derivative()
        self._s0 = float(self._distance(-MARGIN_S))
        self._psi0 = plan.heading - float(self._heading(0.0))
        self._body = [self._body_angle(axis, rng) for axis in range(3)]
        self._body_rate = [spline.derivative() for spline in self._body]
        self._integrate(origin)

    def _body_angle(self, axis: int, rng: np.random.Generator) -> BSpline:
        """Roll, pitch or yaw of the body against the road over time."""
        style = self.plan.style
        speed = self.plan.speed
        t = -MARGIN_S + STEP_S * np.arange(len(speed))
        white = rng.normal(0.0, 1.0, len(speed))
        wobble = np.convolve(white, np.full(4, 0.5), "same") * style.wobble
        angle = wobble * np.minimum(speed / 3.0, 1.0)
        if axis == 0:
            s = self._distance(t) - self._s0
            angle = angle - style.roll_gradient * self._curvature(s) * speed**2
        elif axis == 1:
            angle = angle + style.pitch_gradient * self._accel(t)
        return _spline(angle, -MARGIN_S, STEP_S)

    def path_at(self, t: Array) -> Path:
        """What the body follows at instants ``t`` [n]."""
        s, v, a = self._along(t)
        return Path(t, v, a, self._curvature(s), self._psi0 + self._heading(s))

    def bent(self, body: Body) -> Motion:
        """The same drive with the body turned further by ``body``."""
        t = np.asarray(-MARGIN_S + STEP_S * np.arange(len(self.plan.speed)), np.float64)
        angles = body(self.path_at(t))
        out = copy(self)
        out._body = [
            BSpline(b.t, b.c + _spline(angle, -MARGIN_S, STEP_S).c, b.k)
            for b, angle in zip(self._body, angles.T, strict=True)
        ]
        out._body_rate = [spline.derivative() for spline in out._body]
        return out

    def _along(self, t: Array) -> tuple[Array, Array, Array]:
        """Distance, speed and its derivative."""
        return self._distance(t) - self._s0, self._speed(t), self._accel(t)

    def _velocity(self, t: Array) -> Array:
        s, v, _ = self._along(t)
        psi, gamma = self._psi0 + self._heading(s), self._grade(s)
        return np.column_stack(
            [v * np.cos(gamma) * np.cos(psi), v * np.cos(gamma) * np.sin(psi), -v * np.sin(gamma)]
        )

    def _integrate(self, origin: tuple[float, float, float]) -> None:
        """Simpson's rule on a fine grid; latitude and longitude by fixed-point iteration."""
        n = round((self.seconds + 2.0 * MARGIN_S) / FINE_S)
        nodes = -MARGIN_S + FINE_S * np.arange(n + 1)
        half = -MARGIN_S + 0.5 * FINE_S * np.arange(2 * n + 1)
        vel = self._velocity(np.asarray(half, np.float64))

        def cumulated(rate: Array) -> Array:
            parts = FINE_S / 6.0 * (rate[:-2:2] + 4.0 * rate[1:-1:2] + rate[2::2])
            return np.concatenate([[0.0], np.cumsum(parts)])

        def between(at_nodes: Array) -> Array:
            # curvature radii change so slowly that the mean of the neighbours is exact
            out = np.empty(2 * n + 1)
            out[::2] = at_nodes
            out[1::2] = 0.5 * (at_nodes[:-1] + at_nodes[1:])
            return out

        lat0, lon0, height0 = origin
        height = height0 + cumulated(-vel[:, 2])
        h_half = between(height)
        lat = np.full(n + 1, lat0)
        for _ in range(4):
            lat_half = between(lat)
            lat_rate = vel[:, 0] / (meridian_radius(lat_half) + h_half)
            lat = lat0 + cumulated(lat_rate)
        lat_half = between(lat)
        lon_rate = vel[:, 1] / ((normal_radius(lat_half) + h_half) * np.cos(lat_half))
        lon = lon0 + cumulated(lon_rate)
        self._lat = CubicHermiteSpline(nodes, lat, lat_rate[::2])
        self._lon = CubicHermiteSpline(nodes, lon, lon_rate[::2])
        self._height = CubicHermiteSpline(nodes, height, -vel[::2, 2])

    def at(self, t: Array) -> State:
        """The motion of the IMU at instants ``t`` [n]."""
        axle = self._axle(t)
        if not np.any(self.imu_from_axle):
            return axle
        return self._at_imu(axle)

    def axle_at(self, t: Array) -> State:
        """The motion of the rear axle at instants ``t`` [n]."""
        return self._axle(t)

    def _axle(self, t: Array) -> State:
        t = np.asarray(t, np.float64)
        s, v, a = self._along(t)
        kappa, gamma = self._curvature(s), self._grade(s)
        psi = self._psi0 + self._heading(s)
        psi_rate, gamma_rate = kappa * v, self._grade_slope(s) * v
        slip = -self.sideslip * kappa * v**2
        slip_rate = -self.sideslip * (self._curvature_slope(s) * v**3 + 2.0 * kappa * v * a)
        # the axle slips out of the bend: the nose points further in than the path
        rpy = np.column_stack(
            [
                self._bank(s) + self._body[0](t),
                gamma + self._body[1](t),
                psi - slip + self._body[2](t),
            ]
        )
        rpy_rate = np.column_stack(
            [
                self._bank_slope(s) * v + self._body_rate[0](t),
                gamma_rate + self._body_rate[1](t),
                psi_rate - slip_rate + self._body_rate[2](t),
            ]
        )
        cg, sg, cp, sp = np.cos(gamma), np.sin(gamma), np.cos(psi), np.sin(psi)
        vel = np.column_stack([v * cg * cp, v * cg * sp, -v * sg])
        change = np.column_stack(
            [
                a * cg * cp - v * gamma_rate * sg * cp - v * psi_rate * cg * sp,
                a * cg * sp - v * gamma_rate * sg * sp + v * psi_rate * cg * cp,
                -a * sg - v * gamma_rate * cg,
            ]
        )
        lat, lon, height = self._lat(t), self._lon(t), self._height(t)
        C = rotation(rpy)
        earth = earth_rate_ned(lat)
        transport = transport_rate_ned(lat, height, vel)
        gravity = np.zeros_like(vel)
        gravity[:, 2] = normal_gravity(lat, height)
        force_ned = change + np.cross(2.0 * earth + transport, vel) - gravity
        rate_nav = euler_rates_to_body(rpy, rpy_rate)
        return State(
            t=t,
            lat=lat,
            lon=lon,
            height=height,
            vel_ned=vel,
            C_n_b=C,
            rpy=rpy,
            force=to_body(C, force_ned),
            rate=rate_nav + to_body(C, earth + transport),
            rate_nav=rate_nav,
            speed=v,
            accel=a,
        )

    def _at_imu(self, axle: State) -> State:
        """The same for the IMU, which sits off the axle on the rigid body."""
        arm = np.broadcast_to(self.imu_from_axle, axle.rate.shape)
        dt = 1e-3
        turn = (self._axle(axle.t + dt).rate - self._axle(axle.t - dt).rate) / (2.0 * dt)
        swing = np.cross(axle.rate, np.cross(axle.rate, arm)) + np.cross(turn, arm)
        lat, lon, height = displaced(axle, arm)
        vel = axle.vel_ned + to_nav(axle.C_n_b, np.cross(axle.rate_nav, arm))
        return State(
            t=axle.t,
            lat=lat,
            lon=lon,
            height=height,
            vel_ned=vel,
            C_n_b=axle.C_n_b,
            rpy=axle.rpy,
            force=axle.force + swing,
            rate=axle.rate,
            rate_nav=axle.rate_nav,
            speed=axle.speed,
            accel=axle.accel,
        )


def displaced(state: State, arm: Array) -> tuple[Array, Array, Array]:
    """Latitude, longitude, height [n] of a point at ``arm`` [n, 3] m in vehicle axes."""
    offset = to_nav(state.C_n_b, np.broadcast_to(arm, state.rate.shape))
    lat = state.lat + offset[:, 0] / (meridian_radius(state.lat) + state.height)
    across = (normal_radius(state.lat) + state.height) * np.cos(state.lat)
    return lat, state.lon + offset[:, 1] / across, state.height - offset[:, 2]


def rotation(rpy: Array) -> Array:
    """Rz(yaw) Ry(pitch) Rx(roll) [n, 3, 3] of ``rpy`` [n, 3], rad."""
    (sr, cr), (sp, cp), (sy, cy) = [(np.sin(a), np.cos(a)) for a in np.asarray(rpy).T]
    out = np.empty((len(sr), 3, 3))
    out[:, 0] = np.column_stack([cp * cy, sr * sp * cy - cr * sy, cr * sp * cy + sr * sy])
    out[:, 1] = np.column_stack([cp * sy, sr * sp * sy + cr * cy, cr * sp * sy - sr * cy])
    out[:, 2] = np.column_stack([-sp, sr * cp, cr * cp])
    return out


def euler_rates_to_body(rpy: Array, rpy_rate: Array) -> Array:
    """Turn rate [n, 3], rad/s, in vehicle axes of changing roll, pitch and yaw."""
    roll, pitch = rpy[:, 0], rpy[:, 1]
    dr, dp, dy = rpy_rate.T
    return np.column_stack(
        [
            dr - dy * np.sin(pitch),
            dp * np.cos(roll) + dy * np.cos(pitch) * np.sin(roll),
            -dp * np.sin(roll) + dy * np.cos(pitch) * np.cos(roll),
        ]
    )


def to_body(C_n_b: Array, vectors: Array) -> Array:
    """Vectors [n, 3] of the navigation frame in vehicle axes."""
    return np.asarray(np.einsum("nji,nj->ni", C_n_b, vectors))


def to_nav(C_n_b: Array, vectors: Array) -> Array:
    """Vectors [n, 3] of the vehicle in navigation axes."""
    return np.asarray(np.einsum("nij,nj->ni", C_n_b, vectors))
