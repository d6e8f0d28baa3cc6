"""Boxes as rays: camera poses and measured directions in one local frame."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from automap.effects.camera import camera_poses, error_columns, row_share, true_camera
from automap.effects.camera_kernels import TIME
from automap.effects.lens import box_variances, focal_length, lens_of, normalise
from automap.frames import matrix_to_rotation_vector, rpy_to_matrix
from automap.geolocation import limits
from automap.interpolation import poses_at
from automap.records import (
    TRACK_PROBABILITIES,
    Camera,
    Detections,
    FloatArray,
    IntArray,
    Trajectory,
    along_course,
)

_RATE_STEP_NS = 20_000_000
"""Velocity and rate are differences over twice this."""
_ROWS = 1 << 15
"""Boxes whose rays are made at once, an hour of a town's."""


@dataclass(frozen=True)
class MeasurementNoise:
    """One-sigma errors of boxes.

    ``pixel_sd`` of a box centre in pixels, ``box_fraction`` the part of the box height that
    its centre and its height are uncertain by, ``attitude_sd`` the vehicle's short-term
    attitude error in rad (what differs from frame to frame), ``margin_sd_px`` what the height of
    all boxes of one sign is off by in common, ``stamp_sd_s`` what stamps err by from frame to
    frame. ``scales`` multiply the sigmas of right, down and height. The last two are what
    ``stamp_scatter`` and ``box_noise`` measured them to be.
    """

    pixel_sd: float = 1.5
    box_fraction: float = 0.05
    attitude_sd: float = 0.002
    margin_sd_px: float = 2.0
    stamp_sd_s: float = 0.0
    scales: tuple[float, float, float] = (1.0, 1.0, 1.0)


@dataclass(frozen=True)
class Views:
    """One row per box that can be used, all cameras together, in the order of time.

    The local frame is the NED tangent plane at ``origin`` (lat rad, lon rad, height m).
    ``row`` [n] index of the box in the joined detections; ``frame`` [n] index of the frame
    among all frames of all cameras in the order of time; ``camera`` [n] index into
    ``camera_names``; ``t_ns`` [n] with the camera's time offset applied. ``centre`` [n, 3]
    camera in the local frame, m; ``C_cam_ref`` [n, 3, 3] local frame to camera axes
    (forward, right, down); ``velocity`` [n, 3] m/s and ``rate`` [n, 3] rad/s of the camera in
    camera axes; ``C_cam_body`` [n, 3, 3] vehicle to camera axes; ``lens`` [c, 21] of each camera
    (``effects.lens``). ``measured`` [n, 3]: right /
    forward, down / forward of the box centre and the logarithm of the box height over the focal
    length; ``sd`` [n, 3] their one-sigma errors; ``share`` [n] of the image height at which they
    are; ``log_aspect`` [n] logarithm of the box's width over its height, both as directions and
    without the camera's margin. ``pose_sd`` [n, 3] m NED,
    ``attitude_sd`` [n, 3] rad (roll, pitch, yaw) and ``velocity_sd`` [n, 3] m/s (forward, right,
    down) of the trajectory, ``speed_sd`` [n] m/s; ``attitude_sd`` is without what the vehicle's
    nose is off its course by for minutes; ``margin_sd`` [n] rad what the height of a sign's boxes
    is off by in common, ``lever_arm_sd`` [n] m of the camera.
    ``class_probability`` and ``group_probability`` [n] that the box's track is what it is called,
    and of its shape and colour (NaN untold). ``without_pose`` [k] indices of the boxes whose
    frames lie outside the trajectory or in a long gap of it.
    """

    origin: tuple[float, float, float]
    camera_names: tuple[str, ...]
    lens: FloatArray
    row: IntArray
    frame: IntArray
    camera: IntArray
    t_ns: IntArray
    centre: FloatArray
    C_cam_ref: FloatArray
    velocity: FloatArray
    rate: FloatArray
    C_cam_body: FloatArray
    measured: FloatArray
    sd: FloatArray
    share: FloatArray
    log_aspect: FloatArray
    pose_sd: FloatArray
    attitude_sd: FloatArray
    velocity_sd: FloatArray
    margin_sd: FloatArray
    lever_arm_sd: FloatArray
    speed_sd: FloatArray
    class_name: npt.NDArray[np.object_]
    score: FloatArray
    track: IntArray
    class_probability: FloatArray
    group_probability: FloatArray
    without_pose: IntArray

    def __len__(self) -> int:
        return len(self.row)


@dataclass(frozen=True)
class CameraCorrection:
    """What was found out about a camera: a turn (roll, pitch, yaw, rad, applied after the
    mounting, in camera axes), a further time offset in s, the logarithm of the true focal
    length over the given one, the margin that boxes leave above and below their signs, in
    sum and over the focal length (rad), and what k1 of the lens is more than stated.
    ``covariance`` [10, 10] of turn, time, focal length, lever arm (m), margin and k1; the lever arm
    is considered, not corrected: on a straight road it is one with the place of all.
    ``time_minima`` time offsets that explain the boxes alike, where the drive does not tell one
    from another."""

    turn: FloatArray
    time_s: float
    covariance: FloatArray
    focal_log: float = 0.0
    margin: float = 0.0
    radial: float = 0.0
    time_minima: tuple[float, ...] = ()

    def applied(self, camera: Camera) -> Camera:
        """The camera with what was found out about it."""
        return true_camera(
            camera,
            {
                "camera_boresight": dict(zip(("roll", "pitch", "yaw"), self.turn, strict=True)),
                "camera_time_offset": {"s": self.time_s},
                "camera_focal": {"relative": float(np.expm1(self.focal_log))},
                "camera_distortion": {"k1": self.radial},
            },
        )

    @property
    def values(self) -> FloatArray:
        """All [10], the lever arm's zeros among them."""
        own = self.time_s, self.focal_log
        return np.array([*self.turn, *own, 0.0, 0.0, 0.0, self.margin, self.radial])


def build_views(
    trajectory: Trajectory,
    detections: Sequence[Detections],
    cameras: Mapping[str, Camera],
    noise: MeasurementNoise,
    corrections: Mapping[str, CameraCorrection] | None = None,
) -> Views:
    """Rays of all boxes whose frame lies within the trajectory.

    Boxes outside it (or in a long gap of it) and boxes without a direction (outside the
    distortion model, no height, NaN) are left out. Rows count through the detections in the order
    given.
    """
    origin = map_origin(trajectory)
    parts: list[dict[str, np.ndarray]] = []
    without_pose = [np.zeros(0, np.int64)]
    first_row = 0
    for index, found in enumerate(detections):
        camera, margin = cameras[found.camera], 0.0
        if (correction := (corrections or {}).get(found.camera)) is not None:
            camera = correction.applied(camera)
            margin = correction.margin * float(np.exp(-correction.focal_log))
        # of the boxes of ten hours the poses alone are as large as their views
        for a in range(0, max(len(found), 1), _ROWS):
            some = found.at(slice(a, a + _ROWS))
            part, lost = _camera_views(trajectory, some, camera, margin, noise, origin)
            part["row"] += first_row + a
            part["camera"] = np.full(len(part["row"]), index, np.int64)
            without_pose.append(lost + first_row + a)
            parts.append(part)
        first_row += len(found)
    order = np.lexsort([np.concatenate([p[k] for p in parts]) for k in ("row", "camera", "t_ns")])
    # column after column, each let go
    joined = {k: np.concatenate([p.pop(k) for p in parts])[order] for k in tuple(parts[0])}
    changes = (np.diff(joined["t_ns"]) != 0) | (np.diff(joined["camera"]) != 0)
    frame = np.concatenate([[0], np.cumsum(changes)]).astype(np.int64)[: len(order)]
    return Views(
        origin=origin,
        camera_names=tuple(d.camera for d in detections),
        lens=np.array([lens_of(cameras[d.camera]) for d in detections]).reshape(-1, 21),
        frame=frame,
        without_pose=np.concatenate(without_pose),
        **joined,
    )


def numbered_tracks(views: Views) -> list[IntArray]:
    """Rows of each track that the detector numbered, in the order of time."""
    rows = np.flatnonzero(views.track >= 0)
    key = np.column_stack([views.camera, views.track])[rows]
    member = np.unique(key, axis=0, return_inverse=True)[1].ravel()
    order = np.argsort(member, kind="stable")
    return np.split(rows[order], np.flatnonzero(np.diff(member[order])) + 1)


def map_origin(trajectory: Trajectory) -> tuple[float, float, float]:
    known = np.isfinite(trajectory.lat_rad) & np.isfinite(trajectory.lon_rad)
    if not known.any():
        return (0.0, 0.0, 0.0)
    middle = np.flatnonzero(known)[int(known.sum()) // 2]
    height = trajectory.height_m[np.isfinite(trajectory.height_m)]
    return (
        float(trajectory.lat_rad[middle]),
        float(trajectory.lon_rad[middle]),
        float(np.median(height)) if len(height) else 0.0,
    )


def _without_margin(extent: FloatArray, margin: float) -> FloatArray:
    """Widths or heights [n] of boxes without what the camera's boxes leave beyond their signs."""
    without = np.maximum(extent - margin, limits.LEAST_WITHOUT_MARGIN * extent)
    return np.where(extent > 0.0, without, extent)


def _camera_views(
    trajectory: Trajectory,
    found: Detections,
    camera: Camera,
    margin: float,
    noise: MeasurementNoise,
    origin: tuple[float, float, float],
) -> tuple[dict[str, np.ndarray], IntArray]:
    """Columns of the views of a camera's boxes, and which of these have no pose."""
    t_ns = np.asarray(found.t_ns, np.int64) + np.int64(round(camera.time_offset_s * 1e9))
    poses = poses_at(trajectory, t_ns)
    centre, C_cam_ref = camera_poses(poses, camera, origin)
    has_pose = poses.covered & np.isfinite(centre).all(axis=1)
    has_pose &= np.isfinite(C_cam_ref).all(axis=(1, 2))

    before, C_before = camera_poses(poses_at(trajectory, t_ns - _RATE_STEP_NS), camera, origin)
    after, C_after = camera_poses(poses_at(trajectory, t_ns + _RATE_STEP_NS), camera, origin)
    span = 2e-9 * _RATE_STEP_NS
    velocity = np.nan_to_num(np.einsum("nij,nj->ni", C_cam_ref, (after - before) / span))
    turned = C_before @ np.swapaxes(C_after, 1, 2)
    moving = np.isfinite(turned).all(axis=(1, 2))
    rate = np.zeros_like(velocity)
    rate[moving] = matrix_to_rotation_vector(turned[moving]) / span
    C_cam_body = rpy_to_matrix(camera.mount_rpy).T

    box = np.asarray(found.box, np.float64).reshape(-1, 4)
    left, top, right, bottom = box.T
    middle_x, middle_y = 0.5 * (left + right), 0.5 * (top + bottom)
    centre_ray = normalise(camera, np.column_stack([middle_x, middle_y]))
    tall, wide = (
        normalise(camera, np.column_stack(end)) - normalise(camera, np.column_stack(begin))
        for begin, end in (
            ((middle_x, top), (middle_x, bottom)),
            ((left, middle_y), (right, middle_y)),
        )
    )
    height, width = _without_margin(tall[:, 1], margin), _without_margin(wide[:, 0], margin)
    has_ray = np.isfinite(centre_ray).all(axis=1) & (height > 0.0)
    # the picture would have cut it off at both ends
    has_ray &= (box[:, 2:] - box[:, :2] <= (camera.width, camera.height)).all(axis=1)
    measured = np.column_stack([centre_ray, np.log(np.where(has_ray, height, 1.0))])

    plausible = np.where(has_ray, height, 1.0)
    with np.errstate(invalid="ignore", divide="ignore"):
        log_aspect = np.where(width > 0.0, np.log(width / plausible), np.nan)
    variance = box_variances(
        *(camera, box, plausible, noise.pixel_sd, noise.box_fraction, noise.attitude_sd)
    )
    ok = has_pose & has_ray
    if noise.stamp_sd_s > 0.0:
        # how far a sign is does not matter much here: of a usual one its box tells it
        q = np.column_stack([np.ones(len(box)), centre_ray]) * (
            limits.USUAL_SIZE_M / plausible[:, None]
        )
        seen = q, plausible, row_share(middle_y, camera.height), rate, velocity
        columns = error_columns(camera, {}, *(values[ok] for values in seen))
        variance[ok] += (noise.stamp_sd_s * columns[:, :, TIME]) ** 2
    sd = np.sqrt(variance) * noise.scales
    sd_ned = poses.sd_vel_ned[ok]
    level = np.sqrt(0.5 * (sd_ned[:, 0] ** 2 + sd_ned[:, 1] ** 2))
    part: dict[str, np.ndarray] = {
        "row": np.flatnonzero(ok),
        "t_ns": t_ns[ok],
        "centre": centre[ok],
        # kernels are compiled once for each order of the memory
        "C_cam_ref": np.ascontiguousarray(C_cam_ref[ok]),
        "velocity": velocity[ok],
        "rate": rate[ok],
        "C_cam_body": np.ascontiguousarray(np.broadcast_to(C_cam_body, C_cam_ref.shape)[ok]),
        "measured": measured[ok],
        "sd": sd[ok],
        "share": row_share(middle_y, camera.height)[ok],
        "log_aspect": log_aspect[ok],
        "pose_sd": np.nan_to_num(poses.sd_pos_ned[ok]),
        "attitude_sd": along_course(np.nan_to_num(poses.sd_rpy[ok]), poses.slip_sd[ok]),
        "margin_sd": np.full(int(ok.sum()), noise.margin_sd_px / focal_length(camera)),
        "lever_arm_sd": np.full(int(ok.sum()), camera.lever_arm_sd),
        "velocity_sd": np.nan_to_num(np.column_stack([level, level, sd_ned[:, 2]])),
        "speed_sd": np.nan_to_num(np.linalg.norm(sd_ned, axis=1)),
        "class_name": np.asarray(found.class_name, np.object_)[ok],
        "score": np.asarray(found.score, np.float64)[ok],
        "track": np.asarray(found.track, np.int64)[ok],
        **{name: found.told(name)[ok] for name in TRACK_PROBABILITIES},
    }
    return part, np.flatnonzero(~has_pose)
