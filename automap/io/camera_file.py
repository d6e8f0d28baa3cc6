"""Calibrations of a camera as other programs write them: OpenCV, ROS, Kalibr, KITTI.

Read are OpenCV's FileStorage (YAML, XML, JSON), ROS's ``camera_info`` YAML, Kalibr's camchain,
KITTI's ``calib*.txt``, and JSON of the names that people give such matrices. Matrix and distortion
are known by their names; no YAML is parsed, for OpenCV's own is none that other readers take.

References: OpenCV, FileStorage; ROS REP 104; Kalibr wiki, "yaml formats"; KITTI, devkit readme.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from automap.records import FloatArray

SUFFIXES = (".yaml", ".yml", ".xml", ".json", ".txt", ".cal")
_MOST_BYTES = 1 << 20
"""A calibration is some kilobytes, with every corner of its pictures some hundred."""
_MATRIX = ("camera_matrix", "cameramatrix", "camera_mat", "intrinsic_matrix", "mtx", "k", "m1")
_INTRINSICS = ("intrinsics",)
_DISTORTION = (
    *("distortion_coefficients", "distortion_coeffs", "dist_coeffs", "distcoeffs", "dist_coeff"),
    *("distortion", "dist", "d", "d1"),
)
_WIDTH, _HEIGHT = ("image_width", "width"), ("image_height", "height")
_SIZE = ("resolution", "image_size", "imagesize")
_KITTI = re.compile(r"^(P_rect_02|P_rect_00|P2|P0)\s*:\s*([-+.\deE \t]+)$", re.MULTILINE)
_KITTI_SIZE = re.compile(r"^S_rect_0[20]\s*:\s*([-+.\deE \t]+)$", re.MULTILINE)
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_OPENCV_MODELS = (
    "plumb_bob",
    "radtan",
    "rational_polynomial",
    "radial-tangential",
    "opencv",
    "none",
)
_HEAD = 250
_LENGTHS = (4, 5, 8, 12, 14)


@dataclass(frozen=True)
class CameraFile:
    """``matrix`` [3, 3] in pixels of an image of ``size`` (width, height), None where the file does
    not say; ``distortion`` as OpenCV orders it. ``doubt`` is a sentence where not all was taken.
    """

    matrix: FloatArray
    size: tuple[int, int] | None
    distortion: tuple[float, ...]
    doubt: str | None = None


def read_camera_file(path: Path) -> CameraFile | None:
    """The calibration in a file, None where there is none in it."""
    try:
        if path.stat().st_size > _MOST_BYTES:
            return None
        text = path.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return None
    matrix = _matrix(text)
    if matrix is None or not _is_pinhole(matrix):
        return None
    size = _size(text)
    distortion = _values(text, _DISTORTION)
    model = re.search(r"distortion_model[\"']?\s*[:>]\s*[\"']?([\w-]+)", text)
    other = model is not None and model[1].lower() not in _OPENCV_MODELS
    doubt = None
    if any(distortion) and (other or len(distortion) not in _LENGTHS):
        named = model[1] if model is not None else f"{len(distortion)} coefficients"
        doubt = (
            f"{path.name}: its distortion ({named}) is not OpenCV's and is left out; calibrate "
            "with the pinhole model for signs at the edge of the picture"
        )
        distortion = []
    return CameraFile(matrix, size, tuple(distortion) if any(distortion) else (), doubt)


def _matrix(text: str) -> FloatArray | None:
    values = _values(text, _MATRIX)
    if len(values) == 9:
        return np.array(values, np.float64).reshape(3, 3)
    intrinsics = _values(text, _INTRINSICS)
    if len(intrinsics) == 4:
        fx, fy, cx, cy = intrinsics
        return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    kitti = {name: [float(v) for v in rest.split()] for name, rest in _KITTI.findall(text)}
    # of a drive's colour camera first
    for name in ("P_rect_02", "P2", "P_rect_00", "P0"):
        if len(kitti.get(name, ())) == 12:
            return np.array(kitti[name], np.float64).reshape(3, 4)[:, :3]
    return None


def _is_pinhole(matrix: FloatArray) -> bool:
    (fx, _, cx), (skew, fy, cy), bottom = matrix.tolist()
    known = min(fx, fy, cx, cy) > 0.0 and skew == 0.0 and bottom == [0.0, 0.0, 1.0]
    return bool(known and np.isfinite(matrix).all())


def _size(text: str) -> tuple[int, int] | None:
    width, height = (_values(text, names)[:1] for names in (_WIDTH, _HEIGHT))
    both = [*width, *height] if width and height else _values(text, _SIZE)
    found = _KITTI_SIZE.search(text)
    if found is not None:
        both = [float(v) for v in found[1].split()]
    if len(both) != 2 or not all(0 < v < 1e5 for v in both):
        return None
    return round(both[0]), round(both[1])


def _values(text: str, names: tuple[str, ...]) -> list[float]:
    """The numbers behind the first of some names: in brackets, in an element, or one alone."""
    for name in names:
        key = rf"(?im)(?:^|[\s\"'{{,<]){re.escape(name)}[\"']?"
        element = re.search(rf"{key}(?:\s[^>]*)?>(.*?)</{re.escape(name)}\s*>", text, re.DOTALL)
        if element is not None:
            inside = element[1]
            data = re.search(r"<data>(.*?)</data>", inside, re.DOTALL)
            return _numbers(data[1] if data is not None else inside)
        found = re.search(rf"{key}\s*[:=]", text)
        if found is not None:
            numbers = _behind(text[found.end() :])
            if numbers:
                return numbers
    return []


def _behind(text: str) -> list[float]:
    """The numbers of a value: to the bracket that closes the first, or of a line."""
    line = text.partition("\n")[0].strip()
    if line and line[0] not in "[{!" and not line.startswith("!!"):
        return _numbers(line) if _NUMBER.match(line) else []
    # what comes before the numbers of a matrix, sizes among it, is shorter
    data = None if line[:1] == "[" else re.search(r"\bdata[\"']?\s*:", text[:_HEAD])
    start = text.find("[", 0 if data is None else data.end())
    if start < 0:
        return []
    depth = 0
    for at, letter in enumerate(text[start:], start):
        depth += (letter == "[") - (letter == "]")
        if depth == 0:
            return _numbers(text[start : at + 1])
    return []


def _numbers(text: str) -> list[float]:
    return [float(number) for number in _NUMBER.findall(text)]
