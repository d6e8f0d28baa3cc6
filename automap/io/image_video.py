"""A sequence of images as a video of JPEG frames; JPEG images go in as they are."""

from __future__ import annotations

from collections.abc import Iterable
from fractions import Fraction
from pathlib import Path

import numpy as np

from automap.errors import InputError
from automap.io.silence import silent_libraries

_QUALITY = 95
_TICK = Fraction(1, 1000)


def write_image_video(path: Path, images: Iterable[tuple[int, bytes]]) -> int:
    """Write ``(t_ns, JPEG)`` in order as an MP4 file; returns the number of frames.

    Times are those of the first frame on, in ms; the exact ones belong into a frames file.
    Raises InputError when there is no image, or one of another size than the first.
    """
    import av

    count = 0
    first_ns = 0
    last = -1
    size: tuple[int, int] | None = None
    with av.open(str(path), "w", format="mp4") as container:
        stream = container.add_stream("mjpeg", rate=30)
        stream.pix_fmt = "yuvj420p"
        stream.time_base = _TICK
        for t_ns, data in images:
            shape = jpeg_size(data)
            if shape is None:
                raise InputError(f"image {count} of the recording is no whole JPEG; leave it out.")
            if size is None:
                size, first_ns = shape, t_ns
                stream.width, stream.height = shape
            elif shape != size:
                raise InputError(
                    f"image {count} has {shape[0]}x{shape[1]} pixels and the ones before "
                    f"{size[0]}x{size[1]}; a video needs one size, import them apart."
                )
            packet = av.Packet(data)
            packet.stream = stream
            packet.time_base = _TICK
            last = max(last + 1, round((t_ns - first_ns) * 1e-6))
            packet.pts = packet.dts = last
            packet.is_keyframe = True
            container.mux(packet)
            count += 1
    if count == 0:
        raise InputError(f"{path.name}: the recording has no images.")
    return count


def jpeg_size(data: bytes) -> tuple[int, int] | None:
    """Width and height of a JPEG from its frame header, None when it is no whole one.

    Reference: ITU-T T.81, B.1.1.3 (markers) and B.2.2 (frame header).
    """
    if not data.startswith(b"\xff\xd8"):
        return None
    at = 2
    while at + 9 < len(data):
        if data[at] != 0xFF:
            return None
        marker = data[at + 1]
        if marker == 0xFF:
            at += 1
            continue
        if 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):
            height = int.from_bytes(data[at + 5 : at + 7], "big")
            width = int.from_bytes(data[at + 7 : at + 9], "big")
            return (width, height) if width and height else None
        at += 2 + int.from_bytes(data[at + 2 : at + 4], "big")
    return None


def as_jpeg(data: bytes, name: str) -> bytes:
    """An encoded image as JPEG: unchanged if it is one, else at high quality.

    Raises InputError for bytes that are no image.
    """
    if jpeg_size(data) is not None:
        return data
    import cv2

    with silent_libraries():
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR) if data else None
    if image is None:
        raise InputError(f"{name} is no image that can be read; leave it out or copy it again.")
    return encode_jpeg(image, name)


def encode_jpeg(image: np.ndarray, name: str) -> bytes:
    """Pixels [h, w] or [h, w, 3] (blue, green, red) as JPEG."""
    import cv2

    good, encoded = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    if not good:
        raise InputError(f"{name} cannot be encoded; leave it out.")
    return bytes(encoded.tobytes())
