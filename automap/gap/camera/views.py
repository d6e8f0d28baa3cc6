"""Boxes of tracked signs, and the views that geolocation makes of them with a camera's errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from automap.effects import CATALOGUE
from automap.effects.camera import as_stated, true_camera
from automap.effects.camera_kernels import N_COLUMNS
from automap.effects.camera_user import user_columns
from automap.effects.lens import focal_length, normalise, touches_edge
from automap.effects.measured import Values
from automap.effects.path_signals import PathSignals
from automap.gap.limits import MARGIN_SD_PX, MAX_VIEWS, MIN_VIEWS, WINDOW_S
from automap.geolocation.views import MeasurementNoise, Views, build_views
from automap.interpolation import poses_at
from automap.records import (
    BoolArray,
    Camera,
    Detections,
    FloatArray,
    IntArray,
    Trajectory,
    along_course,
)

LEAST_HEIGHT = 1e-4
LATEST_NS = 400_000_000
"""Boxes stay on the path with any time offset that a camera may have."""


def keys() -> tuple[tuple[str, str], ...]:
    """Effects of a camera and their parameters, in the order of the catalogue."""
    effects = [e for e in CATALOGUE.values() if e.family == "camera"]
    return tuple((e.name, p.name) for e in effects for p in e.parameters)


@dataclass(frozen=True)
class Filmed:
    """One drive: its path and the boxes [n] of its tracked signs, in the order of time; ``sign``
    [n] 0.. in the order of their passes; ``path`` quantities for users' effects."""

    trajectory: Trajectory
    camera: Camera
    found: Detections
    sign: IntArray
    path: PathSignals | None = None

    def by_users(self, columns: FloatArray) -> FloatArray:
        """Derivatives [n, 3, u] by the parameters of users' effects, from the kernels'."""
        if self.path is None:
            return np.zeros((len(columns), 3, len(keys()) - N_COLUMNS))
        offset_ns = np.int64(round(self.camera.time_offset_s * 1e9))
        return user_columns(self.path.at(self.found.t_ns + offset_ns), columns)


@dataclass(frozen=True)
class Boxes:
    """Boxes [n] of tracked signs on one or several drives with one camera.

    ``sign`` [n] 0.. and ``t`` [n] s since the drive's first box; of each sign the box that is
    largest, ``anchor`` [s], and the stretch ``window`` [s] 0.. whose attitude error it shares.
    Priors: ``attitude_sd`` [3] rad, ``velocity_sd`` m/s, ``margin_sd`` rad.
    """

    drives: tuple[Filmed, ...]
    sign: IntArray
    t: FloatArray
    anchor: IntArray
    window: IntArray
    attitude_sd: FloatArray
    velocity_sd: float
    margin_sd: float

    @property
    def camera(self) -> Camera:
        """The camera as it is stated."""
        return self.drives[0].camera

    @property
    def n_signs(self) -> int:
        """Number of signs."""
        return len(self.anchor)

    def first_signs(self) -> IntArray:
        """Number of the first sign of each drive."""
        return _first_signs(self.drives)

    @property
    def n_common(self) -> int:
        """Number of parameters that all signs share."""
        return len(self.prior_sd())

    def prior_sd(self) -> FloatArray:
        """One sigma [g] of the shared parameters: infinite for those of effects, then the margin
        of the boxes and the attitude error of the path, over all and over each window."""
        windows = int(self.window.max()) + 1 if len(self.window) else 0
        attitude = np.tile(self.attitude_sd, 1 + windows)
        return np.concatenate([np.full(len(keys()), np.inf), [self.margin_sd], attitude])

    def of_signs(self, first: int, stop: int) -> Boxes:
        """The boxes of the signs from ``first`` to before ``stop``."""
        return _with_priors_of(
            self,
            [
                _rows(d, np.flatnonzero((d.sign >= first - offset) & (d.sign < stop - offset)))
                for d, offset in zip(self.drives, _first_signs(self.drives), strict=True)
            ],
        )

    def by_users(self, columns: FloatArray) -> FloatArray:
        """Derivatives [n, 3, u] by the parameters of users' effects, from the kernels' [n, 3, 11]
        of all boxes."""
        edges = np.cumsum([len(d.sign) for d in self.drives])[:-1]
        parts = zip(self.drives, np.split(columns, edges), strict=True)
        return np.concatenate([drive.by_users(part) for drive, part in parts])

    def views(self, values: Values) -> Views | None:
        """The boxes [n] as the camera with the given errors sees them; None where it does not,
        outside its lens or before the path begins."""
        parts = []
        for number, drive in enumerate(self.drives):
            camera = true_camera(drive.camera, values)
            found = as_stated(drive.found, camera, values, drive.path)
            one = build_views(
                *(drive.trajectory, [found], {found.camera: camera}, MeasurementNoise())
            )
            if len(one) < len(found):
                return None
            order = np.argsort(one.row)
            columns: dict[str, Any] = {n: getattr(one, n)[order] for n in _BY_ROW}
            columns["camera"] = columns["camera"] + number
            parts.append(replace(one, **columns))
        together: dict[str, Any] = {
            n: np.concatenate([getattr(p, n) for p in parts]) for n in (*_BY_ROW, "lens")
        }
        return replace(parts[0], **together)


_BY_ROW = tuple(
    f.name
    for f in fields(Views)
    if f.name not in ("origin", "camera_names", "lens", "without_pose")
)


def boxes_of(
    trajectory: Trajectory,
    camera: Camera,
    found: Detections,
    track: IntArray,
    path: PathSignals | None = None,
) -> Boxes | None:
    """The boxes of signs that were tracked, None where there are none to speak of.

    ``track`` [n] number of the sign's pass of each detection, -1 for none; ``path`` the quantities
    that users' effects are functions of.
    """
    box = np.asarray(found.box, np.float64)
    t_ns = np.asarray(found.t_ns, np.int64) + np.int64(round(camera.time_offset_s * 1e9))
    poses = poses_at(trajectory, t_ns)
    middle = np.column_stack([0.5 * (box[:, 0] + box[:, 2]), 0.5 * (box[:, 1] + box[:, 3])])
    ends = [normalise(camera, np.column_stack([middle[:, 0], box[:, i]])) for i in (1, 3)]
    good = (track >= 0) & np.isfinite(poses.rpy).all(axis=1)
    for side in (-LATEST_NS, LATEST_NS):
        good &= poses_at(trajectory, t_ns + side).covered
    good &= np.isfinite(normalise(camera, middle)).all(axis=1) & ~touches_edge(camera, box)
    good &= ends[1][:, 1] - ends[0][:, 1] > LEAST_HEIGHT
    rows = _chosen(t_ns, track, good)
    if len(rows) == 0:
        return None
    _, first, sign = np.unique(track[rows], return_index=True, return_inverse=True)
    rank = np.empty(len(first), np.int64)
    rank[np.argsort(first)] = np.arange(len(first))
    drive = _rows(Filmed(trajectory, camera, found, np.zeros(len(found), np.int64), path), rows)
    velocity_sd = float(np.median(np.nan_to_num(poses.sd_vel_ned[rows])))
    attitude_sd = along_course(np.nan_to_num(poses.sd_rpy[rows]), poses.slip_sd[rows])
    return _of_drives(
        [replace(drive, sign=rank[sign])],
        attitude_sd=np.maximum(np.median(attitude_sd, axis=0), 1e-4),
        velocity_sd=max(velocity_sd, 1e-3),
        margin_sd=MARGIN_SD_PX / focal_length(camera),
    )


def joined(parts: Sequence[Boxes]) -> Boxes:
    """Boxes of several drives with the same camera as one."""
    return _of_drives(
        [drive for part in parts for drive in part.drives],
        attitude_sd=np.max([p.attitude_sd for p in parts], axis=0),
        velocity_sd=max(p.velocity_sd for p in parts),
        margin_sd=parts[0].margin_sd,
    )


def _with_priors_of(boxes: Boxes, drives: Sequence[Filmed]) -> Boxes:
    return _of_drives(drives, boxes.attitude_sd, boxes.velocity_sd, boxes.margin_sd)


def _of_drives(
    drives: Sequence[Filmed], attitude_sd: FloatArray, velocity_sd: float, margin_sd: float
) -> Boxes:
    drives = tuple(d for d in drives if len(d.sign)) or tuple(drives[:1])
    sign = np.concatenate([d.sign + k for d, k in zip(drives, _first_signs(drives), strict=True)])
    t = np.concatenate([(d.found.t_ns - d.found.t_ns[:1]) * 1e-9 for d in drives])
    height = np.concatenate([d.found.box[:, 3] - d.found.box[:, 1] for d in drives])
    # largest last, so that it is the one that stays
    anchor = np.zeros(int(sign.max(initial=-1)) + 1, np.int64)
    order = np.argsort(height, kind="stable")
    anchor[sign[order]] = order
    number = np.concatenate([np.full(len(d.sign), k) for k, d in enumerate(drives)])
    minute = [
        (number[a], 0.5 * (t[sign == s].min() + t[sign == s].max()) // WINDOW_S)
        for s, a in enumerate(anchor)
    ]
    window = np.unique(np.array(minute).reshape(-1, 2), axis=0, return_inverse=True)[1]
    return Boxes(
        *(drives, sign, t, anchor, window.astype(np.int64).reshape(-1)),
        *(attitude_sd, velocity_sd, margin_sd),
    )


def _first_signs(drives: Sequence[Filmed]) -> IntArray:
    """Number of the first sign of each drive among those of all."""
    counts = [int(d.sign.max(initial=-1)) + 1 for d in drives]
    return np.cumsum([0, *counts[:-1]]).astype(np.int64)


def _rows(drive: Filmed, rows: IntArray) -> Filmed:
    """Some boxes of a drive, their signs numbered anew."""
    found = drive.found
    arrays: dict[str, Any] = {
        f.name: value[rows]
        for f in fields(found)
        if isinstance(value := getattr(found, f.name), np.ndarray)
    }
    sign = np.unique(drive.sign[rows], return_inverse=True)[1].astype(np.int64)
    return replace(drive, found=replace(found, **arrays), sign=sign)


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
