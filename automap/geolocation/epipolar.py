"""First estimate of a camera's turn and time offset, before any box is linked to any other.

Two boxes of one sign and the way between them lie in one plane (epipolar constraint: Hartley
and Zisserman, Multiple View Geometry, 2004, chapter 9); the trajectory knows rotation and way.
All pairs of boxes of frames close in time that could show one sign vote; pairs that do not are
outliers (Cauchy's weights, from a wide scale to a narrow one). A late camera shows in curves,
a turned one on the straight. Several start offsets are tried, since 0.3 s in a sharp corner is
beyond the reach of one.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from automap.effects.camera import camera_poses
from automap.effects.lens import normalise
from automap.frames import rpy_to_matrix
from automap.gates import gate
from automap.geolocation import limits
from automap.geolocation.fixed_in_picture import driven_m
from automap.interpolation import poses_at
from automap.records import BoolArray, Camera, Detections, FloatArray, IntArray, Trajectory

_STEPS = 4
"""Of Gauss-Newton at most, for every scale."""
_TURN_STEP, _TIME_STEP = 1e-4, 1e-3
"""Of numeric derivatives, rad and s."""


def first_correction(
    trajectory: Trajectory,
    found: Detections,
    camera: Camera,
    origin: tuple[float, float, float],
    noise_rad: float,
) -> FloatArray | None:
    """Turn (roll, pitch, yaw, rad) and time offset s as an array [4], None without evidence.

    ``noise_rad`` one-sigma error of a ray. Priors are the camera's own sigmas.
    """
    geometry = pair_geometry(trajectory, found, camera, origin)
    if len(geometry) < limits.LEAST_PAIRS:
        return None
    prior = np.array([max(camera.mount_sd, 1e-6)] * 3 + [max(camera.time_offset_sd, 1e-6)])
    reach = min(limits.REACH_SIGMAS * camera.time_offset_sd, limits.MOST_REACH_S)
    n_starts = 2 * int(np.ceil(reach / limits.START_STEP_S)) + 1
    some = geometry.thinned(limits.START_PAIRS)
    scales = np.hypot(limits.SCALES_RAD, noise_rad).tolist()

    def narrowed(x: FloatArray, by: PairGeometry, scales: list[float]) -> tuple[FloatArray, float]:
        for scale in scales:
            x, cost = descend(x, by, prior, scale)
        return x, cost

    starts = [np.array([0.0, 0.0, 0.0, s]) for s in np.linspace(-reach, reach, n_starts)]
    ends = [narrowed(x, some, scales[:-1]) for x in starts]
    x, cost = narrowed(min(ends, key=lambda end: end[1])[0], geometry, scales[-2:])
    unchanged, plain = descend(np.zeros(4), geometry, prior, scales[-1])
    # a box has many pairs, which repeat its evidence
    gain = (plain - cost) * geometry.n_boxes / len(geometry)
    return x if gain > gate(limits.START_PROBABILITY, len(x)) else unchanged


def pair_geometry(
    trajectory: Trajectory,
    found: Detections,
    camera: Camera,
    origin: tuple[float, float, float],
) -> PairGeometry:
    """All pairs of boxes that may show one sign, seen from where the camera was. Of a car that
    waits boxes now and then do: they tell nothing new, and what stands beside it is no sign."""
    box = np.asarray(found.box, np.float64).reshape(-1, 4)
    middle = normalise(camera, 0.5 * (box[:, :2] + box[:, 2:]))
    height = np.log(np.maximum(box[:, 3] - box[:, 1], 1e-3))
    good = np.flatnonzero(np.isfinite(middle).all(axis=1) & (box[:, 3] > box[:, 1]))
    order = good[np.argsort(found.t_ns[good], kind="stable")]
    order = order[_places_apart(trajectory, np.asarray(found.t_ns, np.int64)[order])]
    t_ns = np.asarray(found.t_ns, np.int64)[order]
    ray = np.column_stack([np.ones(len(order)), middle[order]])
    ray /= np.linalg.norm(ray, axis=1)[:, None]
    pairs = candidate_pairs(t_ns, found.class_name[order], height[order], found.track[order])
    return PairGeometry(trajectory, camera, origin, ray, t_ns, pairs)


def _places_apart(trajectory: Trajectory, t_ns: IntArray) -> BoolArray:
    """Which boxes at ``t_ns`` [n], ascending, are of the first frame from its place, or of the
    first in a while."""
    frame, of_box = np.unique(t_ns, return_inverse=True)
    place = np.floor(driven_m(trajectory, frame) / limits.SAME_PLACE_M)
    while_ = np.floor((frame - trajectory.t_ns[0]) * 1e-9 / limits.PAIR_IDLE_S)
    first = (np.diff(place, prepend=-1.0) != 0.0) | (np.diff(while_, prepend=np.inf) != 0.0)
    return np.asarray(first[of_box])


def candidate_pairs(
    t_ns: IntArray, class_name: np.ndarray, log_height: FloatArray, track: IntArray
) -> IntArray:
    """Pairs [2, p] of boxes [k] that may show one sign: of frames close in time and of one class,
    growing no faster than driving allows."""
    last = np.searchsorted(t_ns, t_ns + int(limits.PAIR_APART_S * 1e9), side="right")
    counts = last - np.arange(len(t_ns)) - 1
    first = np.repeat(np.arange(len(t_ns)), counts)
    second = first + 1 + np.arange(len(first)) - np.repeat(np.cumsum(counts) - counts, counts)
    keep = (t_ns[second] > t_ns[first]) & (class_name[first] == class_name[second])
    keep &= np.abs(log_height[second] - log_height[first]) < limits.PAIR_LOG_GROWTH
    named = (track[first] >= 0) & (track[second] >= 0)
    keep &= ~named | (track[first] == track[second])
    return _some(np.stack([first[keep], second[keep]]).astype(np.int64), limits.MOST_PAIRS)


def _some(pairs: IntArray, n: int) -> IntArray:
    """At most ``n`` of the pairs, evenly."""
    count = pairs.shape[1]
    return pairs[:, np.linspace(0, count - 1, min(n, count)).astype(np.int64)]


@dataclass
class PairGeometry:
    """Pairs [2, p] of boxes with rays [k, 3] and stamps [k], as they are seen at a turn and time
    offset; poses are kept for the last offset."""

    trajectory: Trajectory
    camera: Camera
    origin: tuple[float, float, float]
    ray: FloatArray
    t_ns: IntArray
    pairs: IntArray

    def __post_init__(self) -> None:
        self._times, frame = np.unique(self.t_ns[self.pairs], return_inverse=True)
        self._frames = frame.reshape(self.pairs.shape)
        self._offset_s = np.nan

    def paced(self, rate: float) -> PairGeometry:
        """The same boxes with stamps that run by a part ``rate`` slower from the first one on."""
        since = np.round(rate * (self.t_ns - self.t_ns.min())).astype(np.int64)
        return replace(self, t_ns=self.t_ns + since)

    @property
    def n_boxes(self) -> int:
        """Boxes that have a direction."""
        return len(self.ray)

    def thinned(self, n: int) -> PairGeometry:
        """The same with ``n`` pairs at most."""
        return replace(self, pairs=_some(self.pairs, n))

    def __len__(self) -> int:
        return len(self.pairs[0])

    def _place(self, offset_s: float) -> None:
        t = self._times + np.int64(round((self.camera.time_offset_s + offset_s) * 1e9))
        centre, C_cam_ref = camera_poses(poses_at(self.trajectory, t), self.camera, self.origin)
        first, second = self._frames
        self._way = centre[second] - centre[first]
        self._far = np.linalg.norm(self._way, axis=1)
        self._C_first = np.swapaxes(C_cam_ref[first], 1, 2)
        self._C_second = np.swapaxes(C_cam_ref[second], 1, 2)
        self._offset_s = offset_s

    def rays(self, x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The way between the two cameras of each pair, m, and their rays: each [p, 3]."""
        if x[3] != self._offset_s:
            self._place(float(x[3]))
        first, second = (self.ray @ rpy_to_matrix(x[:3]).T)[self.pairs]
        one = np.einsum("nij,nj->ni", self._C_first, first)
        other = np.einsum("nij,nj->ni", self._C_second, second)
        return self._way, one, other

    def residuals(self, x: FloatArray) -> FloatArray:
        """Angle [p] rad of the second ray out of the plane of way and first ray; NaN unknown."""
        _, one, other = self.rays(x)
        normal = np.cross(self._way, one)
        length = np.linalg.norm(normal, axis=1)
        with np.errstate(invalid="ignore", divide="ignore"):
            angle = np.einsum("ni,ni->n", normal, other) / length
            # near the direction of driving the plane is not determined
            angle[
                ~((self._far > limits.PAIR_WAY_M) & (length > limits.FORWARD_SINE * self._far))
            ] = np.nan
        return np.asarray(angle)


def descend(
    x: FloatArray, geometry: PairGeometry, prior: FloatArray, scale: float
) -> tuple[FloatArray, float]:
    """A few Gauss-Newton steps with Cauchy's weights of one scale; the point and its cost."""
    residuals = geometry.residuals

    def total(r: FloatArray, at: FloatArray) -> float:
        # pairs without a plane count as far off, else leaving the trajectory would pay
        loss = np.log1p(np.nan_to_num((r / scale) ** 2, nan=1e4))
        return float(loss.sum() + np.sum((at / prior) ** 2))

    r = residuals(x)
    cost = total(r, x)
    for _ in range(_STEPS):
        known = np.isfinite(r)
        J = np.zeros((len(r), 4))
        for k, h in enumerate((_TURN_STEP, _TURN_STEP, _TURN_STEP, _TIME_STEP)):
            nudge = np.zeros(4)
            nudge[k] = h
            J[:, k] = (residuals(x + nudge) - r) / h
        known &= np.isfinite(J).all(axis=1)
        weight = np.where(known, 1.0 / (1.0 + np.nan_to_num(r / scale) ** 2), 0.0) / scale**2
        J = np.where(known[:, None], J, 0.0)
        N = (J * weight[:, None]).T @ J + np.diag(prior**-2)
        g = -(J * weight[:, None]).T @ np.nan_to_num(r) - x / prior**2
        step = np.asarray(np.linalg.solve(N, g), np.float64)
        for fraction in (1.0, 0.5, 0.25):
            trial = x + fraction * step
            r_trial = residuals(trial)
            cost_trial = total(r_trial, trial)
            if cost_trial < cost:
                break
        else:
            break
        done = cost - cost_trial < 1e-3
        x, r, cost = np.asarray(trial), r_trial, cost_trial
        if done:
            break
    return x, cost
