"""Cameras, their frames, and the signs seen in them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from automap.records.arrays import BoolArray, FloatArray, Image, IntArray

TRACK_PROBABILITIES = ("class_probability", "group_probability")
"""Columns of detections that tell how sure a track's class is, and its shape and colour."""
FARTHEST_ARM_M = 100.0
"""Of a point of the vehicle from the IMU; the longest road trains have some sixty metres."""
LEVER_ARM_SD_M = 0.3
"""Of a camera's place on the vehicle of which nobody says how well it is known: by eye."""
DISTORTION_SD, UNKNOWN_DISTORTION_SD = 0.01, 0.2
"""Of k1 as a calibration states it, those of one of KITTI's cameras on several days differ by half
of that; and of a lens of which nobody says anything, from a phone's -0.05 to a wide one's -0.4."""
UNKNOWN_FOCAL_SD = 0.3
"""Of ``usual_matrix``, part of it: views of dash cameras and phones are 45 to 100 degrees wide."""


@dataclass(frozen=True)
class Camera:
    """Pinhole camera with OpenCV distortion, mounted on the vehicle.

    ``matrix`` [3, 3], ``distortion`` [k] OpenCV order, ``lever_arm_m`` [3] IMU to camera in
    body axes, ``mount_rpy`` [3] rad (C_body_cam = Rz(yaw) Ry(pitch) Rx(roll), camera axes
    forward, right, down), ``mount_sd`` rad, ``time_offset_s`` added to frame stamps,
    ``lever_arm_sd`` one sigma of the lever arm in m, each axis, ``distortion_sd`` of k1,
    ``focal_sd`` of the focal length, part of it, beyond what a calibration errs by.
    """

    width: int
    height: int
    matrix: FloatArray
    distortion: FloatArray
    lever_arm_m: FloatArray
    mount_rpy: FloatArray
    mount_sd: float
    time_offset_s: float
    time_offset_sd: float
    lever_arm_sd: float = LEVER_ARM_SD_M
    distortion_sd: float = DISTORTION_SD
    focal_sd: float = 0.0


def usual_matrix(width: int, height: int) -> FloatArray:
    """Camera matrix [3, 3] of a pinhole with a view of 60 degrees along the longer side of the
    picture, which that of an action camera in its linear mode and that of a phone are near; a phone
    held upright has the same lens."""
    f = 0.5 * max(width, height) / np.tan(np.radians(30.0))
    cx, cy = 0.5 * (width - 1), 0.5 * (height - 1)
    return np.array([[f, 0.0, cx], [0.0, f, cy], [0.0, 0.0, 1.0]])


@dataclass(frozen=True)
class FrameTimes:
    """Stamps of the frames of one camera.

    ``frame`` [n] increasing numbers, ``t_ns`` [n] in the clock that the manifest names for
    this video.
    """

    frame: IntArray
    t_ns: IntArray
    warnings: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.frame)

    def at(self, frame: npt.ArrayLike) -> tuple[IntArray, npt.NDArray[np.bool_]]:
        """Stamps [k] of frame numbers [k], and which of them are known."""
        wanted = np.asarray(frame, dtype=np.int64)
        if not len(self.frame):
            return np.zeros(len(wanted), np.int64), np.zeros(len(wanted), bool)
        index = np.searchsorted(self.frame, wanted).clip(max=len(self.frame) - 1)
        return self.t_ns[index], self.frame[index] == wanted


@dataclass(frozen=True)
class VideoFrame:
    """A decoded picture: number over all chapters, stamp, BGR image [height, width, 3]."""

    frame: int
    t_ns: int
    image: Image


@dataclass(frozen=True)
class PictureTurns:
    """How the pictures of a camera turn against its path, as far as that says more than the
    manifest.

    ``offset_s`` and ``offset_sd_s`` are to be added to the stamps at ``at_ns`` beyond the camera's
    own offset, and ``rate`` of the time since; zeros where the manifest knows as well.
    ``pictures`` names what the picture then is, one of them. ``bends`` told it. A sigma without an
    offset is of a picture that follows the vehicle slowly. So many as ``unlike`` bend otherwise
    than the path does at any offset. ``allowed`` where the manifest's sigma of the offset holds it:
    then it is that of both, and nothing is wrong.
    """

    bends: int
    at_ns: int = 0
    offset_s: float = 0.0
    offset_sd_s: float = 0.0
    rate: float = 0.0
    pictures: tuple[str, ...] = ()
    unlike: int = 0
    allowed: bool = False

    @property
    def as_stated(self) -> bool:
        """Whether nothing is to be corrected."""
        return self.offset_sd_s == 0.0 and not self.pictures

    @property
    def elsewhere(self) -> bool:
        """Whether the video seems to be of another drive: one bend may be a lorry's."""
        return self.unlike >= 2

    def corrected(self, t_ns: IntArray) -> IntArray:
        """Stamps [n] as they are by the bends."""
        since = (t_ns - self.at_ns) * 1e-9
        late_s = self.offset_s + self.rate * since
        return np.asarray(t_ns + np.round(late_s * 1e9).astype(np.int64), np.int64)

    def told(self, camera: str) -> str:
        """What is wrong, in a sentence; empty where nothing is."""
        if self.elsewhere:
            return (
                f"camera {camera}: in none of {self.unlike} bends that the picture shows does it "
                "turn as the path does, nor within seconds of it: check that the video is of this "
                "drive and its frames' stamps. Places of its signs may be wrong by more than they "
                "say."
            )
        if self.as_stated or self.allowed:
            return ""
        said = []
        if self.offset_s:
            said.append(
                f"its frames are {self.offset_s:+.2f} s from their stamps (one sigma "
                f"{self.offset_sd_s:.2f} s)"
            )
        if self.rate:
            said.append(f"they take {1.0 + self.rate:.4f} of the time that their stamps say")
        if self.offset_sd_s and not self.offset_s:
            said.append(
                f"it follows the vehicle slowly, by up to {self.offset_sd_s:.2f} s, as a gimbal or "
                "steadied pictures do"
            )
        if self.pictures:
            said.append(f"its picture is {' or '.join(self.pictures)}")
        return (
            f"camera {camera}: in {self.bends} bends the picture turns as the path does if "
            f"{' and '.join(said)}. That was assumed; check the video and its frames' stamps."
        )


@dataclass(frozen=True)
class Looked:
    """Frames [k] of a camera that a detector searched, also those without a box, ascending;
    ``region`` [k, 4] x_min, y_min, x_max, y_max of the part that it saw, in pixels."""

    frame: IntArray
    region: FloatArray

    def __len__(self) -> int:
        return len(self.frame)


@dataclass(frozen=True)
class Detections:
    """Boxes of signs in frames, one row each.

    ``frame`` [n] counts from 0 over all chapters; ``t_ns`` [n] the frame's stamp; ``class_name``
    [n] str; ``box`` [n, 4] x_min, y_min, x_max, y_max in pixels; ``score`` [n] in 0..1;
    ``track`` [n] (-1 untracked); ``camera`` the name of the video section. ``view_class`` [n] is
    what the single view looks like where ``class_name`` is that of the whole track, None where
    there is no such difference. ``class_probability`` and ``group_probability`` [n]: that the track
    is what ``class_name`` says, and of its shape and colour; None where the detector tells neither.
    ``class_shares`` [n] str what the track's views give to each class on average, as
    ``automap.signs.class_shares`` writes it; None likewise.
    ``contrast`` [n] of the face in this view, 0 to 1 (NaN: ``contrast_note`` [n] says why), and the
    frames that were ``looked`` at; None where the boxes come from elsewhere.
    """

    frame: IntArray
    t_ns: IntArray
    class_name: npt.NDArray[np.object_]
    box: FloatArray
    score: FloatArray
    track: IntArray
    camera: str = "front"
    view_class: npt.NDArray[np.object_] | None = None
    class_probability: FloatArray | None = None
    group_probability: FloatArray | None = None
    class_shares: npt.NDArray[np.object_] | None = None
    contrast: FloatArray | None = None
    contrast_note: npt.NDArray[np.object_] | None = None
    looked: Looked | None = None

    def __len__(self) -> int:
        return len(self.frame)

    def at(self, rows: IntArray | BoolArray | slice) -> Detections:
        """Some of the boxes."""
        columns = {k: v[rows] for k, v in vars(self).items() if isinstance(v, np.ndarray)}
        return replace(self, **columns)  # type: ignore[arg-type]

    def told(self, name: str) -> FloatArray:
        """One of ``TRACK_PROBABILITIES``, or ``contrast`` [n], NaN where nothing tells it."""
        values: FloatArray | None = getattr(self, name)
        return np.full(len(self), np.nan) if values is None else np.asarray(values, np.float64)


@dataclass(frozen=True)
class Crop:
    """A sign as it was seen best.

    ``box`` [4] in the pixels of the frame, ``box_in_crop`` [4] in those of the picture;
    ``jpeg`` the picture, at most 160 px wide and high; ``worth`` how good a view it is.
    """

    camera: str
    track: int
    frame: int
    t_ns: int
    class_name: str
    score: float
    box: FloatArray
    box_in_crop: FloatArray
    jpeg: bytes
    worth: float
