"""Errors of a trajectory against truth at the truth's epochs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from automap.interpolation import Poses, poses_at, poses_at_gps
from automap.records import NO_TIME, Fixes, FixType, FloatArray, Trajectory

COMPONENTS = ("n", "e", "d", "vn", "ve", "vd", "roll", "pitch", "yaw")


@dataclass(frozen=True)
class TrajectoryErrors:
    """Estimate minus truth at the truth's epochs.

    ``error`` and ``sd`` [n, 9] in the order of COMPONENTS (m, m/s, rad), NaN where either
    side has no value. ``span_s`` is the time from the first to the last compared epoch,
    ``distance_m`` the truth's path over all its epochs, ``n_not_covered`` the number of
    truth epochs outside the estimate.
    """

    error: FloatArray
    sd: FloatArray
    span_s: float
    distance_m: float
    n_not_covered: int


def position_difference_ned(
    lat_rad: FloatArray,
    lon_rad: FloatArray,
    height_m: FloatArray,
    ref_lat_rad: FloatArray,
    ref_lon_rad: FloatArray,
    ref_height_m: FloatArray,
) -> FloatArray:
    """Position minus reference in the reference's NED [n, 3], metres.

    Where a height is unknown the horizontal part is still given (both points are then taken
    at height zero) and the vertical one is NaN.
    """
    import pymap3d

    unknown = ~(np.isfinite(height_m) & np.isfinite(ref_height_m))
    n, e, d = pymap3d.geodetic2ned(
        lat_rad,
        lon_rad,
        np.where(unknown, 0.0, height_m),
        ref_lat_rad,
        ref_lon_rad,
        np.where(unknown, 0.0, ref_height_m),
        deg=False,
    )
    return np.column_stack([n, e, np.where(unknown, np.nan, d)])


def trajectory_errors(
    estimate: Trajectory, truth: Trajectory, max_gap_s: float = 3.0
) -> TrajectoryErrors:
    """Compare at the truth's epochs, interpolating the estimate.

    Epochs are matched by ``t_ns`` where the truth has it and the two overlap, otherwise by
    ``gps_s``. Truth values may be NaN (a truth without attitude, say).
    """
    poses = _estimate_at(estimate, truth, max_gap_s)
    position = position_difference_ned(
        poses.lat_rad,
        poses.lon_rad,
        poses.height_m,
        truth.lat_rad,
        truth.lon_rad,
        truth.height_m,
    )
    attitude = poses.rpy - truth.rpy
    attitude = (attitude + np.pi) % (2.0 * np.pi) - np.pi
    error = np.column_stack([position, poses.vel_ned - truth.vel_ned, attitude])
    sd = np.column_stack([poses.sd_pos_ned, poses.sd_vel_ned, poses.sd_rpy])
    compared = poses.covered & np.isfinite(position[:, 0])
    error[~compared] = np.nan
    times = _seconds(truth)[compared]
    return TrajectoryErrors(
        error=error,
        sd=sd,
        span_s=float(times.max() - times.min()) if len(times) else 0.0,
        distance_m=path_length(truth),
        n_not_covered=int((~compared).sum()),
    )


def _seconds(trajectory: Trajectory) -> FloatArray:
    if len(trajectory) and trajectory.t_ns[0] != NO_TIME:
        return np.asarray((trajectory.t_ns - trajectory.t_ns[0]) * 1e-9)
    return trajectory.gps_s


def _estimate_at(estimate: Trajectory, truth: Trajectory, max_gap_s: float) -> Poses:
    if len(truth) and truth.t_ns[0] != NO_TIME:
        poses = poses_at(estimate, truth.t_ns, max_gap_s)
        if poses.covered.any() or not np.isfinite(truth.gps_s).any():
            return poses
    return poses_at_gps(estimate, truth.gps_s, max_gap_s)


def path_length(trajectory: Trajectory) -> float:
    """Horizontal length of the path in metres, over steps longer than a standstill's noise."""
    known = np.isfinite(trajectory.lat_rad) & np.isfinite(trajectory.lon_rad)
    lat, lon = trajectory.lat_rad[known], trajectory.lon_rad[known]
    if len(lat) < 2:
        return 0.0
    zero = np.zeros(len(lat) - 1)
    step = position_difference_ned(lat[1:], lon[1:], zero, lat[:-1], lon[:-1], zero)
    return float(np.hypot(step[:, 0], step[:, 1]).sum())


def raw_fix_errors(fixes: Fixes, truth: Trajectory, lever_arm_m: FloatArray) -> FloatArray:
    """Receiver fixes minus truth, NED metres [m, 3], at the usable fixes inside the truth.

    ``lever_arm_m`` [3] IMU to antenna in body axes; it is applied where the truth has an
    attitude. The truth needs ``gps_s``.
    """
    usable = (fixes.fix_type >= FixType.TWO_D) & np.isfinite(fixes.lat_rad)
    poses = poses_at_gps(truth, fixes.gps_s[usable])
    error = position_difference_ned(
        fixes.lat_rad[usable],
        fixes.lon_rad[usable],
        fixes.height_m[usable],
        poses.lat_rad,
        poses.lon_rad,
        poses.height_m,
    )
    known = poses.covered & np.isfinite(poses.rpy).all(axis=1)
    if np.any(lever_arm_m) and known.any():
        from scipy.spatial.transform import Rotation

        to_nav = Rotation.from_euler("ZYX", poses.rpy[known][:, ::-1])
        error[known] -= to_nav.apply(lever_arm_m)
    return error[poses.covered]


def rms(values: FloatArray) -> float | None:
    """Root mean square of the finite values, None when there are none."""
    finite = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(finite**2))) if len(finite) else None


def _mean(values: FloatArray) -> float | None:
    """Mean of the finite values, None when there are none."""
    finite = values[np.isfinite(values)]
    return float(finite.mean()) if len(finite) else None


def position_rms(error_ned: FloatArray) -> dict[str, float | None]:
    """RMS of position errors [n, 3] as n, e, d and horizontal (both components together)."""
    result = {name: rms(error_ned[:, k]) for k, name in enumerate("ned")}
    result["horizontal"] = rms(np.hypot(error_ned[:, 0], error_ned[:, 1]))
    return result


def summarise_trajectory(errors: TrajectoryErrors) -> dict[str, Any]:
    """The figures of ``evaluation.json`` that concern the trajectory.

    ``nees_mean`` (Bar-Shalom, Li, Kirubarajan, section 5.4) is the mean of the sum of squared
    error-over-sd over the components that both sides have; its expectation is ``nees_dof`` where
    the errors of the components are independent. ``attitude_mean_deg`` is what a truth of a unit
    that sits another way in the vehicle shows throughout.
    """
    degrees = np.degrees(errors.error[:, 6:9])
    with np.errstate(divide="ignore", invalid="ignore"):
        normalised = np.where(errors.sd > 0.0, errors.error / errors.sd, np.nan)
    present = np.isfinite(normalised).any(axis=0)
    complete = np.isfinite(normalised[:, present]).all(axis=1)
    squares = np.sum(normalised[complete][:, present] ** 2, axis=1)
    return {
        "position_rms_m": position_rms(errors.error[:, 0:3]),
        "velocity_rms": {name: rms(errors.error[:, 3 + k]) for k, name in enumerate("ned")},
        "attitude_rms_deg": {name: rms(degrees[:, k]) for k, name in enumerate(COMPONENTS[6:])},
        "attitude_mean_deg": {name: _mean(degrees[:, k]) for k, name in enumerate(COMPONENTS[6:])},
        "sigma_ratio": {name: rms(normalised[:, k]) for k, name in enumerate(COMPONENTS)},
        "nees_mean": float(squares.mean()) if len(squares) and present.any() else None,
        "nees_dof": int(present.sum()),
        "n_compared": int(np.isfinite(errors.error[:, 0]).sum()),
        "n_not_covered": errors.n_not_covered,
        "span_s": errors.span_s,
        "distance_m": errors.distance_m,
    }
