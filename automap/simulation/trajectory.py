"""A smooth drive on the ellipsoid, from which ideal sensors are derived without differencing.

Velocity over time is a spline; latitude and longitude are its exact integrals, so that
position, velocity and acceleration agree to rounding. Attitude is a quintic spline.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline, CubicSpline, PPoly, make_interp_spline
from scipy.ndimage import gaussian_filter1d

from automap import earth, frames
from automap.effects.measured import Values
from automap.effects.signals import Signals, signals_of
from automap.effects.user import user_signal
from automap.effects.vehicle import lever_arm_motion, nose_angles, sliding_point
from automap.records import FloatArray
from automap.simulation.errors import earth_rotates, error_values
from automap.simulation.route import RouteProfile, distance_over_time, profile_route
from automap.simulation.scenario import Scenario

_KNOT_S = 0.02
"""Distance of the splines' knots in time: faster is vibration, which the sensors have as noise."""
_JERK_WIDTH_S, _SUSPENSION_WIDTH_S = 0.4, 0.35
"""Pedals and springs take so long, one sigma of a Gaussian: no jumps of acceleration or lean."""
_ROUGHNESS_WIDTH_S, _ROUGHNESS_SPEED = 0.12, 8.0
"""Springs pass a road's roughness below some 1.3 Hz, most of it from twice this speed, m/s."""


@dataclass(frozen=True)
class Motion:
    """The vehicle's motion at given times: arrays [n] or [n, 3].

    Position of the IMU origin (rad, rad, m), velocity and its rate in NED components, roll,
    pitch, yaw (rad), and what perfect inertial sensors read in body axes: ``specific_force``
    m/s^2 and ``angular_rate`` rad/s against inertial space; ``turn_rate`` is against the
    navigation frame.
    """

    t_s: FloatArray
    lat_rad: FloatArray
    lon_rad: FloatArray
    height_m: FloatArray
    vel_ned: FloatArray
    accel_ned: FloatArray
    rpy: FloatArray
    C_n_b: FloatArray
    specific_force: FloatArray
    angular_rate: FloatArray
    turn_rate: FloatArray


@dataclass(frozen=True)
class DriveMotion:
    """Splines of a whole drive over the seconds since its begin.

    ``profile`` is the route driven, None for a recorded path. ``axle_m`` [3] from the IMU to
    the point that follows the road without sliding, in body axes; ``earth_rate`` rad/s.
    """

    duration_s: float
    lat0_rad: float
    lon0_rad: float
    dlat: PPoly | BSpline
    dlon: PPoly | BSpline
    height: PPoly | BSpline
    rpy: BSpline
    distance: PPoly | BSpline
    profile: RouteProfile | None
    axle_m: FloatArray
    earth_rate: float = earth.RATE

    def at(self, t_s: FloatArray) -> Motion:
        """The motion at times ``t_s`` [n] in 0..duration_s."""
        t = np.asarray(t_s, np.float64)
        lat = self.lat0_rad + self.dlat(t)
        lat1, lat2 = self.dlat(t, 1), self.dlat(t, 2)
        lon1, lon2 = self.dlon(t, 1), self.dlon(t, 2)
        h, h1, h2 = self.height(t), self.height(t, 1), self.height(t, 2)
        sin, cos = np.sin(lat), np.cos(lat)
        rm, rn = _radii(lat)
        shrink = 1.0 - earth.E2 * sin**2
        rm1 = 3.0 * earth.E2 * rm * sin * cos / shrink * lat1
        rn1 = earth.E2 * rn * sin * cos / shrink * lat1
        vel = np.stack([(rm + h) * lat1, (rn + h) * cos * lon1, -h1], axis=-1)
        accel = np.stack(
            [
                (rm1 + h1) * lat1 + (rm + h) * lat2,
                ((rn1 + h1) * cos - (rn + h) * sin * lat1) * lon1 + (rn + h) * cos * lon2,
                -h2,
            ],
            axis=-1,
        )
        rpy = self.rpy(t)
        C_n_b = frames.rpy_to_matrix(rpy)
        turn = body_rate(rpy, self.rpy(t, 1))
        w_ie = self.earth_rate * np.stack([cos, np.zeros_like(lat), -sin], axis=-1)
        w_en = np.stack([cos * lon1, -lat1, -sin * lon1], axis=-1)
        gravity = np.zeros_like(vel)
        gravity[:, 2] = np.vectorize(earth.gravity)(lat, h)
        force_n = accel + np.cross(2.0 * w_ie + w_en, vel) - gravity
        return Motion(
            t_s=t,
            lat_rad=lat,
            lon_rad=self.lon0_rad + self.dlon(t),
            height_m=h,
            vel_ned=vel,
            accel_ned=accel,
            rpy=rpy,
            C_n_b=C_n_b,
            specific_force=np.einsum("nji,nj->ni", C_n_b, force_n),
            angular_rate=turn + np.einsum("nji,nj->ni", C_n_b, w_ie + w_en),
            turn_rate=turn,
        )


def drive_motion(scenario: Scenario, rng: np.random.Generator) -> DriveMotion:
    """Drive the scenario's route; ``rng`` gives the road's roughness.

    Of the scenario's errors those of the vehicle act here: what turns its nose against the path,
    and where the point that follows the path stands from the IMU.
    """
    vehicle, start = scenario.vehicle, scenario.start
    profile = profile_route(scenario.route, vehicle)
    knots_t, knots_v = distance_over_time(profile, scenario.route, start.standstill_s)
    duration = float(np.floor(knots_t[-1] / _KNOT_S) * _KNOT_S)
    t: FloatArray = np.arange(round(duration / _KNOT_S) + 1) * np.float64(_KNOT_S)
    speed = gaussian_filter1d(
        np.interp(t, knots_t, knots_v), _JERK_WIDTH_S / _KNOT_S, mode="constant"
    )
    distance = CubicSpline(t, speed).antiderivative()
    s = np.clip(distance(t), 0.0, profile.s[-1])

    heading = np.deg2rad(start.heading_deg) + _integral(profile.s, profile.curvature, s)
    slope = np.interp(s, profile.s, profile.slope)
    errors = error_values(scenario.errors)
    rpy = _attitude(scenario, profile, t, s, speed, heading, slope, errors, rng)
    axle = sliding_point(errors)
    level, climb = speed * np.cos(slope), speed * np.sin(slope)
    north, east = level * np.cos(heading), level * np.sin(heading)
    start_ned = np.zeros(3)
    if axle.any():
        angles = rpy(t)
        offset, swing = lever_arm_motion(
            frames.rpy_to_matrix(angles), body_rate(angles, rpy(t, 1)), axle
        )
        north, east, climb = north - swing[:, 0], east - swing[:, 1], climb + swing[:, 2]
        start_ned = -offset[0]
    height = CubicSpline(t, climb).antiderivative()
    height.c[-1] += start.height_m - start_ned[2]
    lat0, lon0 = np.deg2rad(start.lat_deg), np.deg2rad(start.lon_deg)
    if axle.any():
        lat0, lon0, _ = earth.from_local_ned(start_ned, (lat0, lon0, start.height_m))
    # the radii depend so weakly on latitude that two rounds settle them to rounding
    lat = np.full_like(t, lat0)
    for _ in range(3):
        rm, rn = _radii(lat)
        dlat = CubicSpline(t, north / (rm + height(t))).antiderivative()
        lat = lat0 + dlat(t)
    rate_lon = east / ((rn + height(t)) * np.cos(lat))
    return DriveMotion(
        duration_s=duration,
        lat0_rad=float(lat0),
        lon0_rad=float(lon0),
        dlat=dlat,
        dlon=CubicSpline(t, rate_lon).antiderivative(),
        height=height,
        rpy=rpy,
        distance=distance,
        profile=profile,
        axle_m=axle,
        earth_rate=earth.RATE if earth_rotates(scenario.errors) else 0.0,
    )


def _attitude(
    scenario: Scenario,
    profile: RouteProfile,
    t: FloatArray,
    s: FloatArray,
    speed: FloatArray,
    heading: FloatArray,
    slope: FloatArray,
    errors: Values,
    rng: np.random.Generator,
) -> BSpline:
    vehicle = scenario.vehicle
    forward = np.gradient(speed, t)
    sideways = speed**2 * np.interp(s, profile.s, profile.curvature)
    roughness = np.zeros((2, len(t)))
    if vehicle.road_roughness_deg > 0:
        noise = gaussian_filter1d(
            rng.standard_normal((2, len(t))), _ROUGHNESS_WIDTH_S / _KNOT_S, axis=1
        )
        noise *= np.deg2rad(vehicle.road_roughness_deg) / noise.std(axis=1, keepdims=True)
        roughness = noise * (1.0 - np.exp(-speed / _ROUGHNESS_SPEED))
    # the body leans outwards in bends and lifts its nose when it gathers speed
    roll = np.interp(s, profile.s, profile.bank) - np.deg2rad(
        vehicle.roll_per_accel_deg
    ) * gaussian_filter1d(sideways, _SUSPENSION_WIDTH_S / _KNOT_S, mode="nearest")
    lifting = gaussian_filter1d(forward, _SUSPENSION_WIDTH_S / _KNOT_S, mode="nearest")
    pitch = slope + np.deg2rad(vehicle.pitch_per_accel_deg) * lifting

    def signal(name: str) -> FloatArray:
        return user_signal(name, _signals_on_path(t, speed, heading, forward, sideways))

    nose = nose_angles(errors, speed, forward, sideways, signal)
    pitch, yaw = pitch + nose[:, 1], heading + nose[:, 2]
    rpy = np.stack([roll + roughness[0], pitch + roughness[1], yaw], axis=1)
    return make_interp_spline(t, rpy, k=5)


def _signals_on_path(
    t: FloatArray,
    speed: FloatArray,
    heading: FloatArray,
    forward: FloatArray,
    sideways: FloatArray,
) -> Signals:
    """What users' effects are functions of, for a vehicle that is level on its path."""
    none = np.zeros(len(t))
    velocity = np.stack([speed * np.cos(heading), speed * np.sin(heading), none], axis=1)
    rate = np.stack([none, none, np.gradient(heading, t)], axis=1)
    force = np.stack([forward, sideways, none - earth.STANDARD_GRAVITY], axis=1)
    return signals_of(t, velocity, heading, forward, rate, force, None)


def _integral(grid: FloatArray, values: FloatArray, at: FloatArray) -> FloatArray:
    return np.asarray(CubicSpline(grid, values).antiderivative()(at), np.float64)


def body_rate(rpy: FloatArray, rate: FloatArray) -> FloatArray:
    """Angular rate in body axes of ZYX angles ``rpy`` [n, 3] changing at ``rate`` [n, 3]."""
    roll, pitch = rpy[:, 0], rpy[:, 1]
    return np.stack(
        [
            rate[:, 0] - np.sin(pitch) * rate[:, 2],
            np.cos(roll) * rate[:, 1] + np.sin(roll) * np.cos(pitch) * rate[:, 2],
            -np.sin(roll) * rate[:, 1] + np.cos(roll) * np.cos(pitch) * rate[:, 2],
        ],
        axis=1,
    )


def _radii(lat: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Meridian and transverse radius of curvature [n] in m."""
    north, east = earth.metres_per_radian(lat, 0.0)
    return north, east / np.cos(lat)
