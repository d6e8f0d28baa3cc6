"""Pictures of a scene as a pinhole camera on the moving vehicle takes them."""

from __future__ import annotations

import cv2
import numpy as np

from automap import earth, frames
from automap.effects.lens import normalise, project
from automap.records import FloatArray, Image
from automap.signs.faces import draw_face
from automap.signs.outlines import outline_points
from automap.signs.vocabulary import load_vocabulary
from automap.simulation.boxes import stated_camera
from automap.simulation.scenario import CameraSetup
from automap.simulation.scene import Ball, Colour, Patch, Scene, SceneSign
from automap.simulation.trajectory import DriveMotion

_NEAR_M, _FAR_M = 0.4, 130.0
"""What is drawn, m ahead: nearer is the car, further no more than a pixel or two."""
_OVERSAMPLING, _SHIFT = 4, 4
"""Pixels of a sign's picture to one drawn, and binary places of a pixel that OpenCV draws with."""
_POLE_M = 0.06
"""Width of a sign's pole."""


class View:
    """One camera pose: projects NED points into the picture.

    ``centre`` [3] NED of the camera, ``C_cam_n`` [3, 3] to camera axes forward, right, down.
    """

    def __init__(self, setup: CameraSetup, centre: FloatArray, C_cam_n: FloatArray) -> None:
        self.setup = setup
        self.camera = stated_camera(setup)
        self.centre = centre
        self.C_cam_n = C_cam_n

    def to_camera(self, points: FloatArray) -> FloatArray:
        """Points [k, 3] NED in camera axes."""
        return (points - self.centre) @ self.C_cam_n.T

    def to_pixels(self, points_cam: FloatArray) -> FloatArray:
        """Pixels [k, 2] of points [k, 3] in camera axes, in front of the camera."""
        return project(self.camera, points_cam)


def camera_views(
    drive: DriveMotion, setup: CameraSetup, t_s: FloatArray, ref: tuple[float, float, float]
) -> list[View]:
    """The camera's poses at the given seconds of the drive."""
    motion = drive.at(t_s)
    ned = earth.local_ned(motion.lat_rad, motion.lon_rad, motion.height_m, ref)
    C_b_cam = frames.rpy_to_matrix(np.deg2rad(setup.mount_rpy_deg))
    centres = ned + motion.C_n_b @ np.asarray(setup.lever_arm_m)
    return [
        View(setup, centre, (C_n_b @ C_b_cam).T)
        for centre, C_n_b in zip(centres, motion.C_n_b, strict=True)
    ]


class Painter:
    """Draws views of one scene; holds what does not change from picture to picture."""

    def __init__(
        self, scene: Scene, setup: CameraSetup, brightness: float, rng: np.random.Generator
    ) -> None:
        self.scene = scene
        self.setup = setup
        self.brightness = brightness
        self.rng = rng
        self.ground_centres = np.array([patch.corners.mean(axis=0) for patch in scene.ground])
        self.thing_centres = np.array([t.centre for t in scene.things]).reshape(-1, 3)
        shape = (setup.height, setup.width, 3)
        self.noise = (rng.standard_normal((4, *shape)) * setup.image_noise).astype(np.int16)

    def paint(self, view: View) -> Image:
        """The picture [h, w, 3] BGR."""
        image = self._sky_and_land(view)
        for i in self._in_sight(view, self.ground_centres, ordered=False):
            _fill(image, view, self.scene.ground[i])
        for i in self._in_sight(view, self.thing_centres, ordered=True):
            for part in self.scene.things[i].parts:
                if isinstance(part, Patch):
                    _fill(image, view, part)
                elif isinstance(part, Ball):
                    _blob(image, view, part)
                else:
                    _sign(image, view, part)
        return self._expose(image)

    def _in_sight(self, view: View, centres: FloatArray, ordered: bool) -> list[int]:
        if len(centres) == 0:
            return []
        cam = view.to_camera(centres)
        distance = np.hypot(cam[:, 0], cam[:, 1])
        seen = np.flatnonzero((cam[:, 0] > -30.0) & (distance < _FAR_M))
        if ordered:
            seen = seen[np.argsort(-distance[seen])]
        return [int(i) for i in seen]

    def _sky_and_land(self, view: View) -> Image:
        h, w = self.setup.height, self.setup.width
        # sine of the elevation of each pixel's ray, from the down axis seen by the camera
        down = view.C_cam_n[:, 2]
        x = normalise(view.camera, np.stack([np.arange(w), np.zeros(w)], axis=1))[:, 0]
        y = normalise(view.camera, np.stack([np.zeros(h), np.arange(h)], axis=1))[:, 1]
        elevation = -(down[0] + x[None, :] * down[1] + y[:, None] * down[2])
        haze = np.clip(elevation * 3.0, 0.0, 1.0)[:, :, None].astype(np.float32)
        near = np.array([228, 222, 212], np.float32)
        top = np.array([215, 165, 115], np.float32)
        image: Image = (near + haze * (top - near)).astype(np.uint8)
        image[elevation < 0.0] = (88, 120, 108)
        return image

    def _expose(self, image: Image) -> Image:
        if self.setup.blur_px > 0.0:
            image = np.asarray(cv2.GaussianBlur(image, (0, 0), self.setup.blur_px), np.uint8)
        gain = self.brightness * (1.0 + 0.01 * self.rng.standard_normal())
        noise = self.noise[self.rng.integers(len(self.noise))]
        noise = np.roll(noise, tuple(self.rng.integers(0, noise.shape[:2])), axis=(0, 1))
        exposed = np.rint(image * np.float32(gain))
        return np.asarray(np.clip(exposed + noise, 0, 255).astype(np.uint8))


def _clipped(cam: FloatArray) -> FloatArray:
    """The part [k, 3] of a polygon in camera axes that lies beyond the near plane."""
    ahead = cam[:, 0] - _NEAR_M
    if (ahead > 0).all():
        return cam
    out = []
    for i in range(len(cam)):
        j = (i + 1) % len(cam)
        if ahead[i] > 0:
            out.append(cam[i])
        if (ahead[i] > 0) != (ahead[j] > 0):
            out.append(cam[i] + (cam[j] - cam[i]) * (ahead[i] / (ahead[i] - ahead[j])))
    return np.array(out).reshape(-1, 3)


def _fixed(pixels: FloatArray) -> np.ndarray:
    return np.rint(np.clip(pixels, -2e4, 2e4) * (1 << _SHIFT)).astype(np.int32)


def _fill(image: Image, view: View, patch: Patch) -> None:
    if patch.outward is not None and patch.outward @ (view.centre - patch.corners[0]) <= 0.0:
        return
    cam = _clipped(view.to_camera(patch.corners))
    if len(cam) >= 3:
        points = _fixed(view.to_pixels(cam))
        cv2.fillConvexPoly(image, points, patch.colour, cv2.LINE_AA, _SHIFT)


def _blob(image: Image, view: View, ball: Ball) -> None:
    cam = view.to_camera(ball.centre[None])
    if cam[0, 0] < 2.0 * ball.radius_m:
        return
    centre = _fixed(view.to_pixels(cam))[0]
    radius = int(view.setup.focal_px * ball.radius_m / cam[0, 0] * (1 << _SHIFT))
    at = (int(centre[0]), int(centre[1]))
    cv2.circle(image, at, radius, ball.colour, -1, cv2.LINE_AA, _SHIFT)


def sign_corners(sign: SceneSign) -> FloatArray:
    """Corners [4, 3] NED of the square that a face fills: as its reader sees them, from the
    top left clockwise."""
    look = sign.facing_rad + np.pi
    right = np.array([-np.sin(look), np.cos(look), 0.0]) * sign.size_m / 2
    up = np.array([0.0, 0.0, -sign.size_m / 2])
    c = sign.centre
    return np.array([c - right + up, c + right + up, c + right - up, c - right - up])


def _sign(image: Image, view: View, sign: SceneSign) -> None:
    corners = sign_corners(sign)
    cam = view.to_camera(corners)
    if (cam[:, 0] < _NEAR_M).any():
        return
    _pole(image, view, sign)
    facing = np.array([np.cos(sign.facing_rad), np.sin(sign.facing_rad), 0.0])
    quad = view.to_pixels(cam)
    if float(facing @ (view.centre - sign.centre)) > 0.0:
        _face(image, quad, sign)
    else:
        shape = outline_points(load_vocabulary().classes[sign.name].outline)
        edge_x, edge_y = corners[1] - corners[0], corners[3] - corners[0]
        outline = corners[0] + shape[:, :1] * edge_x + shape[:, 1:] * edge_y
        _fill(image, view, Patch(outline, (135, 135, 135)))


def _pole(image: Image, view: View, sign: SceneSign) -> None:
    side = np.array([-np.sin(sign.facing_rad), np.cos(sign.facing_rad), 0.0]) * _POLE_M / 2
    # the pole stands behind the face
    back = -0.04 * np.array([np.cos(sign.facing_rad), np.sin(sign.facing_rad), 0.0])
    foot, top = sign.foot + back, sign.centre + back
    colour: Colour = (140, 140, 138)
    _fill(image, view, Patch(np.array([foot - side, foot + side, top + side, top - side]), colour))


def _face(image: Image, quad: FloatArray, sign: SceneSign) -> None:
    """Blend a face into the quadrilateral [4, 2] px by supersampled projective warping."""
    h, w = image.shape[:2]
    low = np.maximum(np.floor(quad.min(axis=0)).astype(int) - 1, 0)
    high = np.minimum(np.ceil(quad.max(axis=0)).astype(int) + 2, [w, h])
    if (high <= low).any():
        return
    k = _OVERSAMPLING
    extent = float((quad.max(axis=0) - quad.min(axis=0)).max()) * k
    # a source about as fine as the target: coarser blurs, finer aliases
    size = int(np.clip(2 ** np.ceil(np.log2(max(extent, 1.0))), 16, 512))
    face = draw_face(sign.name, size)
    source = np.array([[0, 0], [size, 0], [size, size], [0, size]], np.float64) - 0.5
    # the fine grid has k samples per pixel, centred on it
    target = (quad - low + 0.5) * k - 0.5
    matrix = cv2.getPerspectiveTransform(source.astype(np.float32), target.astype(np.float32))
    shape = (int(high[0] - low[0]), int(high[1] - low[1]))
    premultiplied = face.astype(np.float32)
    premultiplied[:, :, :3] *= premultiplied[:, :, 3:] / 255.0
    fine = cv2.warpPerspective(
        premultiplied, matrix, (shape[0] * k, shape[1] * k), flags=cv2.INTER_LINEAR
    )
    small = cv2.resize(fine, shape, interpolation=cv2.INTER_AREA)
    region = image[low[1] : high[1], low[0] : high[0]]
    cover = small[:, :, 3:] / 255.0
    mixed = region * (1.0 - cover) + small[:, :, :3] * sign.shade
    region[:] = np.clip(np.rint(mixed), 0, 255).astype(np.uint8)


def visible_box(view: View, sign: SceneSign) -> FloatArray | None:
    """The true box x_min, y_min, x_max, y_max of a sign's outline in pixels.

    None when the face looks away, lies behind the camera or is not wholly in the picture.
    """
    corners = sign_corners(sign)
    shape = outline_points(load_vocabulary().classes[sign.name].outline)
    outline = (
        corners[0]
        + shape[:, :1] * (corners[1] - corners[0])
        + shape[:, 1:] * (corners[3] - corners[0])
    )
    facing = np.array([np.cos(sign.facing_rad), np.sin(sign.facing_rad), 0.0])
    cam = view.to_camera(outline)
    if (cam[:, 0] < _NEAR_M).any() or float(facing @ (view.centre - sign.centre)) <= 0.0:
        return None
    pixels = view.to_pixels(cam)
    low, high = pixels.min(axis=0), pixels.max(axis=0)
    if (low < 0).any() or (high > [view.setup.width - 1, view.setup.height - 1]).any():
        return None
    return np.concatenate([low, high])
