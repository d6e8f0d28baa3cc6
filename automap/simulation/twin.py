"""The twin of a recorded drive: the same path, the fitted errors, other noise.

The vehicle follows the smoothed trajectory; what its sensors would record is simulated anew
from the model that the fusion fitted. Laid beside the recording, it shows what that model
lacks: whatever is in the one and not in the other is in no effect of the model.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline
from scipy.ndimage import gaussian_filter1d

from automap import earth
from automap.effects.gnss import gauss_markov
from automap.effects.measured import Values
from automap.effects.vehicle import parameters
from automap.errors import InputError
from automap.records import Fixes, FixType, FloatArray, ImuData, Trajectory, WheelSpeed
from automap.simulation.gnss import ideal_epochs
from automap.simulation.imu import record_imu
from automap.simulation.odometer import reported_speed
from automap.simulation.scenario import Gnss, Imu
from automap.simulation.trajectory import DriveMotion, Motion

_MIN_LENGTH_S, _KNOT_S = 2.0, 0.1
"""The shortest path that splines are laid through, s, and the distance of their knots."""
_SMOOTH_S = 0.12
"""What the path does faster than this is vibration, which the model has as noise."""


@dataclass(frozen=True)
class NoiseModel:
    """Noise of a fitted model.

    ``accel``, ``gyro`` densities; shares [3] NED of a fix's stated accuracy that wander, with
    ``wander_tau_s``, that last for seconds, with ``multipath_tau_s``, that are white, and that stay
    for the whole drive (``bias``). ``velocity`` [3] factors on its stated velocity accuracy, beside
    which velocities err by ``velocity_wander`` m/s for ``velocity_wander_tau_s``; ``odometer`` m/s.
    Where a fix states no accuracy ``position_sd`` [3] m at HDOP 1 and ``common_sd`` [3] m at any,
    ``velocity_sd`` [3].
    """

    accel: float
    gyro: float
    wander_tau_s: float
    wander: FloatArray
    multipath_tau_s: float
    multipath: FloatArray
    white: FloatArray
    bias: FloatArray
    velocity: FloatArray
    velocity_wander_tau_s: float
    velocity_wander: float
    position_sd: FloatArray
    common_sd: FloatArray
    velocity_sd: FloatArray
    odometer: float = 0.05


@dataclass(frozen=True)
class Twin:
    """What the sensors of the twin record; ``truth`` its motion at the IMU's stamps, ``errors``
    what its sensors have, ``lever_arm_m`` [3] to the antenna."""

    truth: Motion
    imu: ImuData
    fixes: Fixes
    odometer: WheelSpeed | None
    lever_arm_m: list[float]
    errors: Values


def motion_along(trajectory: Trajectory) -> DriveMotion:
    """The motion of a vehicle that follows a trajectory, over the seconds since its first row.

    Raises:
        InputError: a trajectory of less than two seconds.
    """
    t_rows = trajectory.gps_s - trajectory.gps_s[0]
    if len(t_rows) < 3 or t_rows[-1] < _MIN_LENGTH_S:
        raise InputError(
            f"the trajectory is only {t_rows[-1] if len(t_rows) else 0.0:.1f} s long; a twin needs "
            f"{_MIN_LENGTH_S:.0f} s or more"
        )
    # whole steps between knots, and the last knot at the last row
    step = round(_KNOT_S / 0.01)
    fine = np.linspace(0.0, float(t_rows[-1]), step * int(t_rows[-1] / _KNOT_S) + 1)
    lat0, lon0 = float(trajectory.lat_rad[0]), float(trajectory.lon_rad[0])
    rows = [
        trajectory.lat_rad - lat0,
        np.unwrap(trajectory.lon_rad) - lon0,
        trajectory.height_m,
        *np.unwrap(trajectory.rpy, axis=0).T,
    ]
    knots = fine[::step]
    lat, lon, height, roll, pitch, yaw = (_smooth(np.interp(fine, t_rows, r))[::step] for r in rows)
    speed = _smooth(np.interp(fine, t_rows, np.linalg.norm(trajectory.vel_ned, axis=1)))[::step]
    return DriveMotion(
        duration_s=float(knots[-1]),
        lat0_rad=lat0,
        lon0_rad=lon0,
        dlat=_spline(knots, lat),
        dlon=_spline(knots, lon),
        height=_spline(knots, height),
        rpy=_spline(knots, np.stack([roll, pitch, yaw], axis=1)),
        distance=_spline(knots, speed).antiderivative(),
        profile=None,
        axle_m=np.zeros(3),
    )


def _smooth(values: FloatArray) -> FloatArray:
    """Low-passed, straight on at the ends."""
    width = 8 * round(_SMOOTH_S / 0.01)
    ends = (2.0 * values[0] - values[width:0:-1], 2.0 * values[-1] - values[-2 : -width - 2 : -1])
    padded = np.concatenate([ends[0], values, ends[1]])
    return np.asarray(gaussian_filter1d(padded, _SMOOTH_S / 0.01)[len(ends[0]) :][: len(values)])


def _spline(t: FloatArray, values: FloatArray) -> BSpline:
    return make_interp_spline(t, values, k=5)


def make_twin(
    trajectory: Trajectory,
    fixes: Fixes,
    errors: Values,
    noise: NoiseModel,
    delay_s: float,
    rng: np.random.Generator,
    temp_c: FloatArray | None = None,
    wheels: WheelSpeed | None = None,
    wheel_gps_s: FloatArray | None = None,
) -> Twin:
    """Record the trajectory's drive anew.

    ``trajectory`` has a row per IMU stamp; the samples were taken ``delay_s`` before their
    stamps. ``fixes`` lend their instants, accuracies and kinds; ``errors`` are in the
    catalogue's terms, ``gnss_lever_arm`` being the whole lever. ``wheels`` lend their stamps,
    whose GPS times are ``wheel_gps_s`` [k].
    """
    motion = motion_along(trajectory)
    begin = float(trajectory.gps_s[0])
    t_rows = trajectory.gps_s - begin
    sampled = motion.at(np.clip(t_rows - delay_s, 0.0, motion.duration_s))
    # the walks want time to run on where the ends are held
    sampled = replace(sampled, t_s=t_rows)
    rate = 1.0 / max(float(np.median(np.diff(trajectory.gps_s))), 1e-4)
    setup = Imu(rate_hz=rate, gyro_noise=noise.gyro, accel_noise=noise.accel)
    imu = record_imu(trajectory.t_ns, sampled, setup, errors, rng, temp_c)
    odometer = None
    if wheels is not None and wheel_gps_s is not None:
        at = np.clip(wheel_gps_s - begin, 0.0, motion.duration_s)
        speed = reported_speed(motion, at, errors)
        speed = speed + rng.standard_normal(len(at)) * noise.odometer * (speed > 0.05)
        odometer = WheelSpeed(wheels.t_ns, speed)
    received = _receive(motion, begin, fixes, errors, noise, rng)
    arm = [round(float(v), 4) for v in parameters(errors, "gnss_lever_arm")]
    return Twin(motion.at(t_rows), imu, received, odometer, arm, errors)


def _receive(
    motion: DriveMotion,
    begin: float,
    fixes: Fixes,
    errors: Values,
    noise: NoiseModel,
    rng: np.random.Generator,
) -> Fixes:
    """Epochs at the instants of ``fixes``, as accurate as those say they are."""
    # receivers' messages carry whole milliseconds
    gps_s = np.round(fixes.gps_s, 3)
    inside = (gps_s >= begin) & (gps_s <= begin + motion.duration_s)
    given = Fixes(**{k: v[inside] for k, v in vars(fixes).items()})
    gps_s = gps_s[inside]
    if len(gps_s) == 0:
        raise InputError("no fix falls into the trajectory; a twin needs a receiver's epochs")
    place, velocity = ideal_epochs(motion, Gnss(), gps_s - begin, errors)
    hdop = np.where(np.isfinite(given.hdop) & (given.hdop > 0.0), given.hdop, 1.0)[:, None]
    sd_pos = _stated(given.sd_pos_ned, np.hypot(noise.position_sd * hdop, noise.common_sd))
    sd_vel = _stated(given.sd_vel_ned, noise.velocity_sd)
    steps = np.diff(gps_s, prepend=gps_s[:1])

    def lasting(size: FloatArray, tau_s: float) -> FloatArray:
        return gauss_markov(len(steps), size, steps / tau_s, rng)

    error = lasting(noise.wander, noise.wander_tau_s)
    error = error + noise.white * rng.standard_normal(sd_pos.shape)
    velocity = velocity + sd_vel * noise.velocity * rng.standard_normal(sd_vel.shape)
    error = error + lasting(noise.multipath, noise.multipath_tau_s)
    error = sd_pos * (error + noise.bias * rng.standard_normal(3))
    velocity = velocity + lasting(np.full(3, noise.velocity_wander), noise.velocity_wander_tau_s)
    north, east = earth.metres_per_radian(place[:, 0], place[:, 2])
    valid = np.isfinite(given.lat_rad)
    return Fixes(
        gps_s=gps_s,
        lat_rad=place[:, 0] + error[:, 0] / north,
        lon_rad=place[:, 1] + error[:, 1] / east,
        height_m=place[:, 2] - error[:, 2],
        vel_ned=velocity,
        sd_pos_ned=sd_pos,
        sd_vel_ned=sd_vel,
        fix_type=np.where(valid, given.fix_type, FixType.NONE).astype(np.int64),
        n_sats=np.where(given.n_sats < 0, 10, given.n_sats).astype(np.int64),
        hdop=np.where(np.isfinite(given.hdop), given.hdop, 1.0),
        geoid_sep_m=np.nan_to_num(given.geoid_sep_m),
        offset=np.full(len(gps_s), -1, np.int64),
        arrival_ns=given.arrival_ns,
    )


def _stated(sd: FloatArray, usual: FloatArray) -> FloatArray:
    return np.where(np.isfinite(sd) & (sd > 0.0), sd, usual)


def estimated_errors(last: Mapping[str, float], names: Mapping[str, list[str]]) -> Values:
    """Effects of a row of estimates ``<effect>_<parameter>``; ``names`` effect -> parameters."""
    return {
        effect: {p: float(last[f"{effect}_{p}"]) for p in known if f"{effect}_{p}" in last}
        for effect, known in names.items()
        if any(f"{effect}_{p}" in last for p in known)
    }
