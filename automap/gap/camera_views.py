"""Boxes of tracked signs against what the camera and the path foretell of them.

A box is three measurements: direction to the right and down of its centre, and the logarithm of
its height, all as the stated camera has them (focal length one). What the camera's errors, the
sign's place and the path's own errors do to them is taken by differences.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from automap.earth import local_ned
from automap.effects import CATALOGUE
from automap.effects.camera import row_share
from automap.effects.lens import focal_length, normalise, touches_edge
from automap.frames import matrix_to_rotation_vector, rotation_vector_to_matrix, rpy_to_matrix
from automap.interpolation import poses_at
from automap.records import BoolArray, Camera, Detections, FloatArray, IntArray, Trajectory

EFFECTS = (
    "camera_boresight",
    "camera_time_offset",
    "rolling_shutter",
    "camera_focal",
    "camera_distortion",
    "camera_lever_arm",
)
KEYS = tuple((e, p.name) for e in EFFECTS for p in CATALOGUE[e].parameters)
MARGIN = len(KEYS)
"""Boxes taller than their signs, rad: a nuisance after the camera's parameters."""
ATTITUDE = MARGIN + 1
"""The path's attitude error over the whole drive; then those of its minutes."""
N_LOCAL = 7
"""Of a sign: place NED, logarithm of its size, error of the velocity while it passes."""
WINDOW_S = 60.0
MIN_VIEWS = 4
MAX_VIEWS = 24
"""Of a sign; boxes of many neighbouring frames say the same again."""
STEP_NS = 50_000_000
NEAREST_M = 1.0
MARGIN_SD_PX = 1.5
SIZE_LOG_SD = 1.0


@dataclass(frozen=True)
class Boxes:
    """Boxes [n] of tracked signs with the path at their instants.

    ``sign`` [n] 0.. in the order of time, ``t`` [n] s since the first box, ``window`` [n] 0..;
    ``pos`` [n, 3] m NED of the IMU, ``vel`` [n, 3] m/s, ``acc`` [n, 3] m/s^2, ``dcm`` [n, 3, 3]
    body to NED, ``rate`` [n, 3] rad/s and ``rate_change`` [n, 3] rad/s^2 in body axes;
    ``measured`` [n, 3], ``height`` [n] of the boxes, ``share`` [n] of their rows, ``since`` [n] s
    from the middle of the sign's pass. Priors: ``attitude_sd`` [3] rad, ``velocity_sd`` m/s,
    ``margin_sd`` rad.
    """

    camera: Camera
    sign: IntArray
    t: FloatArray
    window: IntArray
    pos: FloatArray
    vel: FloatArray
    acc: FloatArray
    dcm: FloatArray
    rate: FloatArray
    rate_change: FloatArray
    measured: FloatArray
    height: FloatArray
    share: FloatArray
    since: FloatArray
    attitude_sd: FloatArray
    velocity_sd: float
    margin_sd: float

    @property
    def n_signs(self) -> int:
        """Number of signs."""
        return int(self.sign.max()) + 1 if len(self.sign) else 0

    @property
    def n_windows(self) -> int:
        """Number of stretches with an attitude error of their own."""
        return int(self.window.max()) + 1 if len(self.window) else 0

    @property
    def n_common(self) -> int:
        """Number of parameters that all signs share."""
        return ATTITUDE + 3 + 3 * self.n_windows

    def prior_sd(self) -> FloatArray:
        """One sigma [g] of the shared parameters that are no effects; infinite for effects."""
        out = np.full(self.n_common, np.inf)
        out[MARGIN] = self.margin_sd
        out[ATTITUDE : ATTITUDE + 3] = self.attitude_sd
        out[ATTITUDE + 3 :] = np.tile(self.attitude_sd, self.n_windows)
        return out

    def of_signs(self, first: int, stop: int) -> Boxes:
        """The boxes of the signs from ``first`` to before ``stop``."""
        rows = (self.sign >= first) & (self.sign < stop)
        _, window = np.unique(self.window[rows], return_inverse=True)
        arrays = {
            k: v[rows]
            for k, v in vars(self).items()
            if isinstance(v, np.ndarray) and len(v) == len(self.sign) and k != "attitude_sd"
        }
        arrays["sign"] = arrays["sign"] - first
        arrays["window"] = window.astype(np.int64)
        return Boxes(**{**vars(self), **arrays})


def boxes_of(
    trajectory: Trajectory, camera: Camera, found: Detections, track: IntArray
) -> Boxes | None:
    """The boxes of signs that were tracked, None where there are none to speak of.

    ``track`` [n] number of the sign's pass of each detection, -1 for none.
    """
    box = np.asarray(found.box, np.float64)
    t_ns = np.asarray(found.t_ns, np.int64) + np.int64(round(camera.time_offset_s * 1e9))
    poses = poses_at(trajectory, t_ns)
    middle = np.column_stack([0.5 * (box[:, 0] + box[:, 2]), 0.5 * (box[:, 1] + box[:, 3])])
    centre = normalise(camera, middle)
    ends = [normalise(camera, np.column_stack([middle[:, 0], box[:, i]])) for i in (1, 3)]
    height = ends[1][:, 1] - ends[0][:, 1]
    good = (track >= 0) & poses.covered & np.isfinite(poses.rpy).all(axis=1)
    good &= np.isfinite(centre).all(axis=1) & (height > 1e-4) & ~touches_edge(camera, box)
    rows = _chosen(t_ns, track, good)
    if len(rows) == 0:
        return None
    _, first, sign = np.unique(track[rows], return_index=True, return_inverse=True)
    rank = np.empty(len(first), np.int64)
    rank[np.argsort(first)] = np.arange(len(first))
    sign = rank[sign]
    t = np.asarray((t_ns[rows] - t_ns[rows[0]]) * 1e-9)
    spans = [(t[sign == s].min(), t[sign == s].max()) for s in range(len(first))]
    middle_t = np.array([0.5 * (a + b) for a, b in spans])
    window = (middle_t[sign] // WINDOW_S).astype(np.int64)
    _, window = np.unique(window, return_inverse=True)
    origin = (
        float(poses.lat_rad[rows[0]]),
        float(poses.lon_rad[rows[0]]),
        float(poses.height_m[rows[0]]),
    )
    pos = local_ned(poses.lat_rad[rows], poses.lon_rad[rows], poses.height_m[rows], origin)
    dcm = rpy_to_matrix(poses.rpy[rows])
    past, next_ = (poses_at(trajectory, t_ns[rows] + d) for d in (-STEP_NS, STEP_NS))
    came, goes = _turned(rpy_to_matrix(past.rpy), dcm), _turned(dcm, rpy_to_matrix(next_.rpy))
    step = STEP_NS * 1e-9
    sd = np.nan_to_num(poses.sd_rpy[rows])
    return Boxes(
        camera=camera,
        sign=sign.astype(np.int64),
        t=t,
        window=window.astype(np.int64),
        pos=pos,
        vel=poses.vel_ned[rows],
        acc=np.nan_to_num(next_.vel_ned - past.vel_ned) / (2.0 * step),
        dcm=dcm,
        rate=(came + goes) / (2.0 * step),
        rate_change=(goes - came) / step**2,
        measured=np.column_stack([centre, np.log(np.where(good, height, 1.0))])[rows],
        height=height[rows],
        share=row_share(middle[rows, 1], camera.height),
        since=t - middle_t[sign],
        attitude_sd=np.maximum(np.median(sd, axis=0), 1e-4),
        velocity_sd=max(float(np.median(np.nan_to_num(poses.sd_vel_ned[rows]))), 1e-3),
        margin_sd=MARGIN_SD_PX / focal_length(camera),
    )


def _chosen(t_ns: IntArray, track: IntArray, good: BoolArray) -> IntArray:
    """Rows of the boxes to take, in the order of time: evenly some of each sign's."""
    numbers, count = np.unique(track[good], return_counts=True)
    kept = [np.zeros(0, np.int64)]
    for number in numbers[count >= MIN_VIEWS]:
        rows = np.flatnonzero(good & (track == number))
        rows = rows[np.argsort(t_ns[rows], kind="stable")]
        if len(rows) > MAX_VIEWS:
            rows = rows[np.linspace(0, len(rows) - 1, MAX_VIEWS).round().astype(np.int64)]
        kept.append(rows)
    every = np.concatenate(kept)
    return every[np.argsort(t_ns[every], kind="stable")]


def _turned(before: FloatArray, after: FloatArray) -> FloatArray:
    """Rotation vectors [n, 3] in body axes from one attitude to the next, none where unknown."""
    turn = np.swapaxes(before, 1, 2) @ after
    turn[~np.isfinite(turn).all(axis=(1, 2))] = np.eye(3)
    return np.asarray(matrix_to_rotation_vector(turn))


def foretell(boxes: Boxes, common: FloatArray, local: FloatArray) -> FloatArray:
    """Measurements [n, 3] that the shared parameters [g] and the signs' own [s, 7] foretell.

    Infinite where a sign would stand behind the camera.
    """
    own = local[boxes.sign]
    value = {key: common[i] for i, key in enumerate(KEYS)}
    late = value["camera_time_offset", "s"] + value["rolling_shutter", "s"] * boxes.share
    attitude = common[ATTITUDE : ATTITUDE + 3] + common[ATTITUDE + 3 :].reshape(-1, 3)[boxes.window]
    late = late[:, None]
    moved = boxes.vel * late + 0.5 * boxes.acc * late**2
    there = own[:, :3] - boxes.pos - moved - own[:, 4:7] * boxes.since[:, None]
    body = np.einsum("nji,nj->ni", boxes.dcm, there)
    # small turns: of the body while the frame waits, and of the path's own error
    turn = boxes.rate * late + 0.5 * boxes.rate_change * late**2 + attitude
    body = np.einsum("nji,nj->ni", rotation_vector_to_matrix(turn), body)
    shift = np.array([value["camera_lever_arm", a] for a in "xyz"])
    C_body_cam = rpy_to_matrix(boxes.camera.mount_rpy) @ rpy_to_matrix(
        np.array([value["camera_boresight", a] for a in ("roll", "pitch", "yaw")])
    )
    ray = (body - boxes.camera.lever_arm_m - shift) @ C_body_cam
    depth = np.where(ray[:, 0] > NEAREST_M, ray[:, 0], np.nan)
    flat = ray[:, 1:] / depth[:, None]
    r2 = (flat**2).sum(axis=1, keepdims=True)
    bent = 1.0 + value["camera_distortion", "k1"] * r2 + value["camera_distortion", "k2"] * r2**2
    longer = 1.0 + value["camera_focal", "relative"]
    size = own[:, 3] - np.log(depth) + np.log(longer) + common[MARGIN] / boxes.height
    out = np.column_stack([flat * bent * longer, size])
    return np.where(np.isfinite(out), out, np.inf)


STEPS = {
    "camera_boresight": 1e-5,
    "camera_time_offset": 1e-4,
    "rolling_shutter": 1e-4,
    "camera_focal": 1e-5,
    "camera_distortion": 1e-4,
    "camera_lever_arm": 1e-3,
}


def derivatives(
    boxes: Boxes, common: FloatArray, local: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Derivatives [n, 3, g] by the shared and [n, 3, 7] by the signs' own parameters."""
    by_common = np.zeros((len(boxes.sign), 3, boxes.n_common))
    steps = [STEPS[e] for e, _ in KEYS] + [1e-6] + [1e-5] * 3
    for i, step in enumerate(steps):
        by_common[:, :, i] = _slope(boxes, common, local, i, step)
    # an attitude error of a minute acts as that of the drive does
    for axis in range(3):
        for w in range(boxes.n_windows):
            rows = boxes.window == w
            by_common[rows, :, ATTITUDE + 3 + 3 * w + axis] = by_common[rows, :, ATTITUDE + axis]
    by_local = np.zeros((len(boxes.sign), 3, N_LOCAL))
    for i, step in enumerate([1e-3] * 3 + [1e-5] + [1e-3] * 3):
        move = np.zeros(N_LOCAL)
        move[i] = step
        ahead, behind = foretell(boxes, common, local + move), foretell(boxes, common, local - move)
        by_local[:, :, i] = (ahead - behind) / (2.0 * step)
    return by_common, by_local


def _slope(boxes: Boxes, common: FloatArray, local: FloatArray, i: int, step: float) -> FloatArray:
    move = np.zeros(len(common))
    move[i] = step
    ahead, behind = foretell(boxes, common + move, local), foretell(boxes, common - move, local)
    return np.asarray((ahead - behind) / (2.0 * step))
