"""Pictures of ROS recordings and the cameras they were taken with: sensor_msgs CompressedImage,
Image and CameraInfo."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from automap.errors import InputError
from automap.records import FloatArray

if TYPE_CHECKING:
    from automap.io.rosbag import Bag


def read_images(bag: Bag, topic: str) -> Iterator[tuple[int, bytes]]:
    """Stamps and JPEGs of an image topic; raises InputError for an encoding not known."""
    from automap.io.image_video import as_jpeg, encode_jpeg

    for stamp, message in bag.messages(topic):
        name = f"{bag.path}: an image of {topic}"
        if hasattr(message, "format"):
            yield stamp, as_jpeg(bytes(message.data), name)
        else:
            yield stamp, encode_jpeg(_pixels(message, name), name)


def _pixels(message: Any, name: str) -> np.ndarray:
    """Pixels, blue first, of a sensor_msgs/Image."""
    import cv2

    encoding = str(message.encoding).lower()
    codes = {
        "bgr8": (3, None),
        "8uc3": (3, None),
        "rgb8": (3, cv2.COLOR_RGB2BGR),
        "mono8": (1, None),
        "8uc1": (1, None),
        "bgra8": (4, cv2.COLOR_BGRA2BGR),
        "rgba8": (4, cv2.COLOR_RGBA2BGR),
        "bayer_rggb8": (1, cv2.COLOR_BayerBG2BGR),
        "bayer_bggr8": (1, cv2.COLOR_BayerRG2BGR),
        "bayer_gbrg8": (1, cv2.COLOR_BayerGR2BGR),
        "bayer_grbg8": (1, cv2.COLOR_BayerGB2BGR),
        "yuv422": (2, cv2.COLOR_YUV2BGR_UYVY),
        "yuv422_yuy2": (2, cv2.COLOR_YUV2BGR_YUYV),
    }
    if encoding not in codes:
        raise InputError(
            f"{name} has the encoding {message.encoding}, which is not read; republish it as bgr8."
        )
    channels, code = codes[encoding]
    height, width, step = int(message.height), int(message.width), int(message.step)
    data = np.frombuffer(bytes(message.data), np.uint8)
    if step < width * channels or len(data) < step * height:
        raise InputError(f"{name} is shorter than its size says; leave it out.")
    rows = data[: step * height].reshape(height, step)[:, : width * channels]
    pixels = rows.reshape(height, width, channels)
    pixels = pixels[:, :, 0] if channels == 1 else pixels
    return pixels if code is None else np.asarray(cv2.cvtColor(pixels, code))


def read_camera(bag: Bag, topic: str) -> tuple[tuple[int, int], FloatArray, list[float]] | None:
    """Size, matrix [3, 3] and distortion of a CameraInfo topic; None for an empty one."""
    for _, message in bag.messages(topic):
        matrix = np.asarray(message.K if hasattr(message, "K") else message.k, np.float64)
        distortion = np.asarray(message.D if hasattr(message, "D") else message.d, np.float64)
        matrix = matrix.reshape(3, 3)
        model = str(message.distortion_model)
        if matrix[0, 0] > 0.0 and matrix[1, 1] > 0.0:
            known = model in ("plumb_bob", "rational_polynomial", "")
            coefficients = distortion.tolist() if known and len(distortion) in (4, 5, 8) else []
            return (int(message.width), int(message.height)), matrix, coefficients
        return None
    return None
