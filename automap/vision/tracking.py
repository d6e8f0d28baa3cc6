"""Linking the boxes of one sign over the frames of a video.

Each track carries a small extended Kalman filter for a point at rest seen by a moving camera:
direction, logarithm of the inverse depth and logarithm of the sign's size (inverse depth as
in Civera, Davison and Montiel, IEEE Transactions on Robotics 24, 2008). A box gives the
direction and, by its height, size over depth: the depth of a new track is a guess from the
usual size of a sign, and later views correct both. The camera's motion moves the tracks; the
boxes of a frame are assigned to them one to one, so that two boxes in a frame are always two
signs, and a sign that is hidden for a moment is met again where it must be.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from automap.assignment import assign
from automap.effects.camera import direction_by_point, direction_by_turn
from automap.effects.lens import box_variances, focal_length, normalise
from automap.gates import gate
from automap.records import BoolArray, Camera, Detections, FloatArray, IntArray
from automap.vision import limits
from automap.vision.camera_motion import Motion, guessed_motion, motion_on_path
from automap.vision.camera_path import CameraPath
from automap.vision.detector import FoundSigns


@dataclass(frozen=True)
class TrackingRules:
    """``pixel_sd`` px and ``box_fraction`` of its height: error of a box; ``size_m`` and
    ``size_log_sd`` of signs; ``missed`` how rarely a box of a track is not taken for one of it;
    ``alone`` what a new track costs, in squared sigmas, and ``other_class`` another class;
    ``silence_s`` and ``silence_m`` after both of which an unseen track ends; ``beyond`` how far
    outside the picture, in parts of its width, a track is still followed."""

    pixel_sd: float = 1.5
    box_fraction: float = 0.08
    size_m: float = 0.7
    size_log_sd: float = 0.5
    missed: float = 1e-3
    alone: float = 22.0
    other_class: float = 6.0
    silence_s: float = 4.0
    silence_m: float = 15.0
    beyond: float = 0.3


class Tracker:
    """Follows the signs of one camera; memory grows with the signs in view alone."""

    def __init__(self, camera: Camera, rules: TrackingRules | None = None) -> None:
        self._camera = camera
        self._rules = rules or TrackingRules()
        self._focal = focal_length(camera)
        self._x = np.zeros((0, 4))
        self._P = np.zeros((0, 4, 4))
        self._number = np.zeros(0, np.int64)
        self._silent_s = np.zeros(0)
        self._silent_m = np.zeros(0)
        self._votes: list[dict[str, float]] = []
        self._next = 0

    def __len__(self) -> int:
        return len(self._number)

    def step(self, motion: Motion, seconds: float, found: FoundSigns) -> IntArray:
        """Track number [n] of each box of a frame, ``seconds`` and ``motion`` after the last."""
        self._predict(motion, seconds)
        track = np.full(len(found), -1, np.int64)
        z, R = self._measured(found.box)
        usable = np.flatnonzero(np.isfinite(z).all(axis=1))
        links = self._assign(z[usable], R[usable], [found.class_name[i] for i in usable])
        for row, link in zip(usable.tolist(), links.tolist(), strict=True):
            name, score = found.class_name[row], float(found.score[row])
            if link < 0:
                link = self._start(z[row], R[row], motion.scale_log_sd)
            else:
                self._update(link, z[row], R[row])
            self._silent_s[link] = self._silent_m[link] = 0.0
            votes = self._votes[link]
            votes[name] = votes.get(name, 0.0) + max(score, limits.LEAST_SCORE)
            track[row] = self._number[link]
        # a box without a direction (outside the lens model) is a sign all the same
        for untracked in np.flatnonzero(track < 0):
            track[untracked] = self._next
            self._next += 1
        return track

    def _measured(self, box: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Direction and log height [n, 3] of boxes, with their variances [n, 3]."""
        box = np.asarray(box, np.float64).reshape(-1, 4)
        middle = 0.5 * (box[:, :2] + box[:, 2:])
        height = (box[:, 3] - box[:, 1]) / self._focal
        with np.errstate(all="ignore"):
            z = np.column_stack([normalise(self._camera, middle), np.log(height)])
        rules = self._rules
        height = np.maximum(np.nan_to_num(height), rules.pixel_sd / self._focal)
        return z, box_variances(self._camera, box, height, rules.pixel_sd, rules.box_fraction)

    def _predict(self, motion: Motion, seconds: float) -> None:
        if not len(self):
            return
        R, x, P = motion.C_new_old, self._x, self._P
        inverse = np.exp(x[:, 2])
        old = np.column_stack([np.ones(len(x)), x[:, 0], x[:, 1]])
        moved = np.tile(motion.moved, (len(x), 1))
        if motion.scale_log_sd > 0.0:
            # what is only guessed passes no sign; it stays in front until it is not seen there
            part = limits.CLOSER / np.maximum(inverse * motion.moved[0], 1e-9)
            moved *= part.clip(max=1.0)[:, None]
        p = (old - inverse[:, None] * moved) @ R.T
        depth = p[:, 0] / inverse
        ahead = depth > limits.NEAREST_M
        p0 = np.where(ahead, p[:, 0], 1.0)
        direction = p[:, 1:] / p0[:, None]

        # derivatives of (p1, p2) / p0 and -log p0, first by p, then by the state and the motion
        ahead_p = np.column_stack([p0, p[:, 1:]])
        by_p = direction_by_point(ahead_p)
        p_by_x = np.zeros((len(x), 3, 3))
        p_by_x[:, :, 0], p_by_x[:, :, 1] = R[:, 1], R[:, 2]
        p_by_x[:, :, 2] = -inverse[:, None] * (moved @ R.T)
        F = np.zeros((len(x), 4, 4))
        F[:, :3, :3] = by_p @ p_by_x
        F[:, 2, 2] += 1.0
        F[:, 3, 3] = 1.0
        by_move = -inverse[:, None, None] * (by_p @ R)
        by_turn = direction_by_turn(ahead_p)
        Q = np.zeros_like(P)
        Q[:, :3, :3] = np.einsum("nij,j,nkj->nik", by_move, motion.moved_sd**2, by_move)
        Q[:, :3, :3] += motion.turn_sd**2 * by_turn @ np.swapaxes(by_turn, 1, 2)

        self._x = np.column_stack([direction, x[:, 2] - np.log(p0), x[:, 3]])
        self._P = F @ P @ np.swapaxes(F, 1, 2) + Q
        self._silent_s = self._silent_s + seconds
        self._silent_m = self._silent_m + motion.size
        self._keep(np.asarray(ahead & self._followed(), np.bool_))

    def _followed(self) -> BoolArray:
        """Which tracks may still be met."""
        rules, camera = self._rules, self._camera
        half = 0.5 * np.array([camera.width, camera.height]) / self._focal
        middle = (
            camera.matrix[:2, 2] - 0.5 * np.array([camera.width, camera.height])
        ) / self._focal
        outside = np.abs(self._x[:, :2] + middle) - half - rules.beyond * 2.0 * half[0]
        sd = np.sqrt(self._P[:, [0, 1], [0, 1]])
        near = (outside < np.minimum(sd, half[0])).all(axis=1)
        silent = (self._silent_s > rules.silence_s) & (self._silent_m > rules.silence_m)
        return np.asarray(near & ~silent, np.bool_)

    def _keep(self, mask: BoolArray) -> None:
        self._x, self._P, self._number = self._x[mask], self._P[mask], self._number[mask]
        self._silent_s, self._silent_m = self._silent_s[mask], self._silent_m[mask]
        self._votes = [v for v, keep in zip(self._votes, mask.tolist(), strict=True) if keep]

    def _expected(self) -> tuple[FloatArray, FloatArray]:
        """What a box of each track would measure [m, 3], and the covariance [m, 3, 3]."""
        z = np.column_stack([self._x[:, :2], self._x[:, 2] + self._x[:, 3]])
        return z, _H @ self._P @ _H.T

    def _assign(self, z: FloatArray, R: FloatArray, names: list[str]) -> IntArray:
        """Index of the track (-1 for a new one) of each box [n]."""
        n, m = len(z), len(self)
        if n == 0 or m == 0:
            return np.full(n, -1, np.int64)
        expected, spread = self._expected()
        S = spread[None] + R[:, None, :, None] * np.eye(3)
        gap = z[:, None] - expected[None]
        squared = np.einsum("nmi,nmi->nm", gap, np.linalg.solve(S, gap[..., None])[..., 0])
        # of two tracks that both allow the box the one that says it more exactly has the claim
        width = np.linalg.slogdet(S)[1] - np.log(R).sum(axis=1)[:, None]
        cost = squared + width.clip(min=0.0) * 0.5
        for i, name in enumerate(names):
            for j in range(m):
                votes = self._votes[j]
                share = votes.get(name, 0.0) / sum(votes.values())
                cost[i, j] += self._rules.other_class * (1.0 - share)
        cost[(squared > gate(self._rules.missed, 3)) | (cost > self._rules.alone)] = np.inf
        return assign(cost, self._rules.alone)

    def _start(self, z: FloatArray, R: FloatArray, scale_log_sd: float) -> int:
        rules = self._rules
        size = np.log(rules.size_m)
        variance = rules.size_log_sd**2 + scale_log_sd**2
        P = np.diag([R[0], R[1], R[2] + variance, variance])
        P[2, 3] = P[3, 2] = -variance
        self._x = np.vstack([self._x, [z[0], z[1], z[2] - size, size]])
        self._P = np.concatenate([self._P, P[None]])
        self._number = np.append(self._number, self._next)
        self._silent_s = np.append(self._silent_s, 0.0)
        self._silent_m = np.append(self._silent_m, 0.0)
        self._votes.append({})
        self._next += 1
        return len(self._number) - 1

    def _update(self, index: int, z: FloatArray, R: FloatArray) -> None:
        x, P = self._x[index], self._P[index]
        S = _H @ P @ _H.T + np.diag(R)
        K = np.linalg.solve(S, _H @ P).T
        self._x[index] = x + K @ (z - np.array([x[0], x[1], x[2] + x[3]]))
        A = np.eye(4) - K @ _H
        self._P[index] = A @ P @ A.T + K @ np.diag(R) @ K.T


def box_tracks(found: Detections, camera: Camera, path: CameraPath | None) -> IntArray:
    """Track number [n] of each box, -1 of one that stays alone, and of all where frames are so far
    apart (``REJOIN_S``) that nothing that moves can be followed: what stands needs no track.

    ``found`` [n] in the order of frames, as of a detector that looks at each frame by itself;
    ``path`` of the camera at the stamps of the frames that have boxes, in order (None: unknown).
    """
    edges = [*np.flatnonzero(np.diff(found.frame, prepend=-1)).tolist(), len(found)]
    tracker, track = Tracker(camera), np.full(len(found), -1, np.int64)
    stamps = found.t_ns.tolist()
    if (
        np.median(np.diff(found.t_ns[edges[:-1]]) if len(edges) > 2 else 0.0)
        > limits.REJOIN_S * 1e9
    ):
        return track
    for number, (a, b) in enumerate(pairwise(edges)):
        seconds = max(stamps[a] - stamps[edges[max(number - 1, 0)]], 0) * 1e-9
        motion = motion_on_path(path, number - 1, number, seconds) if path and number else None
        signs = FoundSigns(tuple(found.class_name[a:b]), found.box[a:b], found.score[a:b])
        track[a:b] = tracker.step(motion or guessed_motion(seconds), seconds, signs)
    track = _rejoined(track, np.asarray(found.t_ns, np.int64), np.asarray(found.box, np.float64))
    alone = np.bincount(track) == 1
    track[alone[track]] = -1
    return track


def _rejoined(track: IntArray, t_ns: IntArray, box: FloatArray) -> IntArray:
    """Tracks [n] of boxes, those that go on where another has just ended under its number: what
    moves by itself leaves its track now and then, and still covers its place of a moment ago."""
    number, first = np.unique(track, return_index=True)
    last = len(track) - 1 - np.unique(track[::-1], return_index=True)[1]
    joined, reach = number.copy(), round(limits.REJOIN_S * 1e9)
    ends = np.argsort(t_ns[last], kind="stable")
    stamps, open_ = t_ns[last[ends]], np.ones(len(ends), np.bool_)
    for k in np.argsort(first).tolist():
        now = t_ns[first[k]]
        some = slice(*np.searchsorted(stamps, [now - reach, now]).tolist())
        near = ends[some][open_[some]]
        if not len(near):
            continue
        share = _overlap(box[first[k]], box[last[near]])
        best = int(np.argmax(share))
        if share[best] >= limits.SUPPORT_OVERLAP:
            joined[k] = joined[near[best]]
            open_[some.start + np.flatnonzero(open_[some])[best]] = False
    return joined[np.searchsorted(number, track)]


def _overlap(one: FloatArray, others: FloatArray) -> FloatArray:
    """Intersection over union [n] of a box with ``others`` [n, 4]."""
    sides = np.minimum(one[2:], others[:, 2:]) - np.maximum(one[:2], others[:, :2])
    both = sides.clip(min=0.0).prod(axis=1)
    area = (others[:, 2:] - others[:, :2]).prod(axis=1) + (one[2:] - one[:2]).prod()
    return np.asarray(both / (area - both))


_H: FloatArray = np.array([[1.0, 0, 0, 0], [0, 1.0, 0, 0], [0, 0, 1.0, 1.0]])
