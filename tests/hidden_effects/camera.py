"""Signs beside the road and the boxes that a camera behind the windscreen has of them.

Camera axes forward, right, down; a pixel is (cx + f right/forward, cy + f down/forward) after
OpenCV's radial distortion. Errors are of what the manifest says: ``camera_boresight`` turns the
camera further (Rz Ry Rx), ``camera_focal`` lengthens it by that share, ``camera_distortion`` and
``camera_lever_arm`` add to the stated ones, ``camera_time_offset`` is what must be added to the
stamps, and with ``rolling_shutter`` the last row is read that much after the first, the middle
one at the stamp.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tests.hidden_effects.extras import Flex
from tests.hidden_effects.geodesy import Array, meridian_radius, normal_radius
from tests.hidden_effects.imu import Effects
from tests.hidden_effects.motion import Motion, rotation, to_nav
from tests.hidden_effects.sizes import Scale

Integers = npt.NDArray[np.int64]

WIDTH, HEIGHT, FOCAL = 1280, 720, 1000.0
LEVER_ARM = np.array([1.3, 0.0, -0.6])
RATE_HZ = 10.0
IMU_ABOVE_ROAD_M = 1.0
NEAR_M, FAR_M = 5.0, 60.0
SPACING_M = (15.0, 60.0)

CAMERA_SCALES: Mapping[str, Scale] = {
    "camera_boresight": Scale(("roll", "pitch", "yaw"), 3e-3, 4e-2, every=True),
    "camera_time_offset": Scale(("s",), 0.01, 0.15),
    "rolling_shutter": Scale(("s",), 0.01, 0.05, positive=True),
    "camera_focal": Scale(("relative",), 5e-3, 5e-2),
    "camera_distortion": Scale(("k1", "k2"), 0.02, 0.2, every=True),
    "camera_lever_arm": Scale(("x", "y", "z"), 0.1, 1.0, every=True),
}


@dataclass(frozen=True)
class Boxes:
    """``frame`` [n] of each box, ``box`` [n, 4] x_min, y_min, x_max, y_max in pixels, ``sign``
    [n] its number; ``stamp`` [m] s of all frames; ``signs`` [k, 3] latitude and longitude in
    rad, height in m of the plates' centres."""

    frame: Integers
    box: Array
    sign: Integers
    stamp: Array
    signs: Array


@dataclass(frozen=True)
class Plates:
    """``centre`` [k, 3] rad, rad, m; ``size`` [k] m high; ``facing`` [k] rad, the heading of the
    cars that they are made for."""

    centre: Array
    size: Array
    facing: Array


def plant_signs(motion: Motion, rng: np.random.Generator) -> Plates:
    """Plates on both sides of the road, for those who come along it."""
    fine = np.arange(0.0, motion.seconds, 0.05)
    state = motion.at(fine)
    driven = np.concatenate([[0.0], np.cumsum(state.speed[1:] * 0.05)])
    along = np.cumsum(rng.uniform(*SPACING_M, 10_000))
    along = along[along < driven[-1]]
    at = motion.at(np.interp(along, driven, fine))
    n = len(along)
    aside = rng.choice([-1.0, 1.0], n) * rng.uniform(2.5, 7.0, n)
    yaw = at.rpy[:, 2]
    north, east = -np.sin(yaw) * aside, np.cos(yaw) * aside
    lat = at.lat + north / (meridian_radius(at.lat) + at.height)
    lon = at.lon + east / ((normal_radius(at.lat) + at.height) * np.cos(at.lat))
    above = rng.uniform(1.8, 3.5, n) - IMU_ABOVE_ROAD_M
    centre = np.column_stack([lat, lon, at.height + above])
    return Plates(centre, rng.uniform(0.5, 0.9, n), yaw)


def film(
    motion: Motion,
    effects: Effects,
    rng: np.random.Generator,
    pixel_sd: float,
    plates: Plates,
    flex: Flex | None = None,
) -> Boxes:
    """Boxes of all signs in all frames; ``pixel_sd`` of a box's edges; a ``flex`` of the mount."""
    stamp = np.arange(5, int((motion.seconds - 0.5) * RATE_HZ)) / RATE_HZ
    shutter = sum(effects.get("rolling_shutter", {}).values())
    frames, boxes, numbers = [], [], []
    for number, (place, metres) in enumerate(zip(plates.centre, plates.size, strict=True)):
        near = _near_frames(motion, stamp, place, float(plates.facing[number]))
        if len(near) == 0:
            continue
        late = np.zeros(len(near))
        for _ in range(3 if shutter else 1):
            ray = rays(motion, effects, stamp[near] + late, place, flex)
            pixel, good = pixels(effects, ray)
            late = row_delay(shutter, pixel)
        # the edges of a plate that faces the camera
        aside, down = 0.5 * metres * np.eye(3)[1:]
        left, right = pixels(effects, ray - aside)[0], pixels(effects, ray + aside)[0]
        top, bottom = pixels(effects, ray - down)[0], pixels(effects, ray + down)[0]
        box = np.column_stack([left[:, 0], top[:, 1], right[:, 0], bottom[:, 1]])
        box += rng.normal(0.0, pixel_sd, box.shape)
        inside = (box[:, 0] > 1) & (box[:, 1] > 1) & (box[:, 2] < WIDTH - 1)
        inside &= (
            (box[:, 3] < HEIGHT - 1) & (box[:, 2] > box[:, 0] + 3) & (box[:, 3] > box[:, 1] + 3)
        )
        keep = good & inside & (rng.random(len(near)) > 0.08)
        frames.append(near[keep])
        boxes.append(box[keep])
        numbers.append(np.full(int(keep.sum()), number))
    return Boxes(
        np.concatenate(frames), np.concatenate(boxes), np.concatenate(numbers), stamp, plates.centre
    )


def row_delay(shutter: float, pixel: Array) -> Array:
    """When the rows [n] of ``pixel`` are read, s against the middle row."""
    return np.asarray(shutter * np.clip((pixel[:, 1] + 0.5) / HEIGHT - 0.5, -0.5, 0.5))


def _near_frames(motion: Motion, stamp: Array, place: Array, facing: float) -> Integers:
    """Frames in which the front of a sign may be seen at all."""
    state = motion.at(stamp)
    north = (place[0] - state.lat) * 6.37e6
    east = (place[1] - state.lon) * 6.37e6 * np.cos(state.lat)
    yaw = state.rpy[:, 2]
    ahead = north * np.cos(yaw) + east * np.sin(yaw)
    towards = north * np.cos(facing) + east * np.sin(facing)
    away = np.hypot(north, east)
    return np.flatnonzero((away < FAR_M + 10.0) & (ahead > 0.0) & (towards > 0.3 * away))


def rays(
    motion: Motion, effects: Effects, stamp: Array, place: Array, flex: Flex | None = None
) -> Array:
    """One place [n, 3] m in camera axes at the frames' stamps [n]."""
    offset = sum(effects.get("camera_time_offset", {}).values())
    state = motion.at(stamp + offset)
    shift = effects.get("camera_lever_arm", {})
    arm = LEVER_ARM + np.array([shift.get(axis, 0.0) for axis in "xyz"])
    turn = effects.get("camera_boresight", {})
    angles = np.tile([turn.get(a, 0.0) for a in ("roll", "pitch", "yaw")], (len(stamp), 1))
    if flex is not None:
        angles = angles + flex(state)
    C_body_cam = rotation(angles)
    there = np.column_stack(
        [
            (place[0] - state.lat) * (meridian_radius(state.lat) + state.height),
            (place[1] - state.lon) * (normal_radius(state.lat) + state.height) * np.cos(state.lat),
            state.height - place[2],
        ]
    )
    # the Earth falls away from the tangent plane: 0.3 mm at 60 m, as little as it is
    there[:, 2] += 0.5 * (there[:, 0] ** 2 + there[:, 1] ** 2) / 6.37e6
    ray = np.einsum(
        "nji,nj->ni", state.C_n_b, there - to_nav(state.C_n_b, np.tile(arm, (len(stamp), 1)))
    )
    return np.asarray(np.einsum("ni,nij->nj", ray, C_body_cam))


def pixels(effects: Effects, ray: Array) -> tuple[Array, npt.NDArray[np.bool_]]:
    """Pixels [n, 2] of points [n, 3] m in camera axes, and which of them lie at a depth that a
    detector sees."""
    depth = ray[:, 0]
    forward = np.where(depth > 0.1, depth, np.nan)
    flat = ray[:, 1:] / forward[:, None]
    bend = effects.get("camera_distortion", {})
    r2 = (flat**2).sum(axis=1, keepdims=True)
    flat = flat * (1.0 + bend.get("k1", 0.0) * r2 + bend.get("k2", 0.0) * r2**2)
    focal = FOCAL * (1.0 + sum(effects.get("camera_focal", {}).values()))
    pixel = np.array([WIDTH / 2.0, HEIGHT / 2.0]) + focal * flat
    # beyond the field of view the polynomial of the distortion folds back into the image
    good = (depth > NEAR_M) & (depth < FAR_M) & (r2[:, 0] < 0.7)
    return np.where(np.isfinite(pixel), pixel, 0.0), good


def camera_nats(
    motion: Motion, effects: Effects, boxes: Boxes, pixel_sd: float, flex: Flex | None = None
) -> float:
    """Nats that the boxes carry for the camera's errors, the path known, the signs unknown."""
    total = 0.0
    centre_sd = pixel_sd / np.sqrt(2.0)
    for number in np.unique(boxes.sign):
        stamp = boxes.stamp[boxes.frame[boxes.sign == number]]
        place = boxes.signs[number]
        clean = pixels({}, rays(motion, {}, stamp, place))[0]
        shutter = sum(effects.get("rolling_shutter", {}).values())
        late = row_delay(shutter, clean)
        shifted = pixels(effects, rays(motion, effects, stamp + late, place, flex))[0]
        steps = np.diag([1e-8, 1e-8, 0.05])
        slopes = [pixels({}, rays(motion, {}, stamp, place + step))[0] - clean for step in steps]
        A = np.stack([s.ravel() for s in slopes], axis=1) / centre_sd
        A = A / np.maximum(np.linalg.norm(A, axis=0), 1e-12)
        y = (shifted - clean).ravel() / centre_sd
        rest = y - A @ np.linalg.lstsq(A, y, rcond=None)[0]
        total += 0.5 * float(rest @ rest)
    return total


def detections_csv(boxes: Boxes) -> str:
    """The boxes as ``front_detections.csv``."""
    order = np.argsort(boxes.frame, kind="stable")
    lines = [
        "%d,regulatory--maximum-speed-limit-50--g1,%.2f,%.2f,%.2f,%.2f,0.90" % (f, *b)  # noqa: UP031
        for f, b in zip(boxes.frame[order], boxes.box[order], strict=True)
    ]
    return "\n".join(["frame,class,x_min,y_min,x_max,y_max,score", *lines]) + "\n"


def frames_csv(boxes: Boxes, gps0: int) -> str:
    """The stamps as ``front_frames.csv``."""
    t_ns = gps0 * 10**9 + np.rint(boxes.stamp * 1e9).astype(np.int64)
    lines = [f"{i},{t}" for i, t in enumerate(t_ns.tolist())]
    return "\n".join(["frame,t_ns", *lines]) + "\n"


def manifest_section() -> str:
    """``[video.front]`` of the manifest; turn and time offset are stated as exact."""
    arm = ", ".join(f"{value:.3f}" for value in LEVER_ARM)
    return (
        '[video.front]\nframes = "video/front_frames.csv"\ntime = "gps_ns"\n'
        'detections = "video/front_detections.csv"\n'
        "mount_rpy_sigma_deg = 0.05\ntime_offset_sigma_s = 0.001\n"
        f"width = {WIDTH}\nheight = {HEIGHT}\n"
        f"camera_matrix = [[{FOCAL}, 0.0, {WIDTH / 2}], [0.0, {FOCAL}, {HEIGHT / 2}], "
        "[0.0, 0.0, 1.0]]\n"
        f"lever_arm_m = [{arm}]\n"
    )
