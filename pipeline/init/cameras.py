"""The cameras of a folder: their files, and the optics that a calibration or the user tells."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from automap.io.camera_file import CameraFile
from automap.io.video import image_size
from automap.records import FloatArray
from pipeline.init.draft import Draft
from pipeline.init.found import Found
from pipeline.init.video_start import DATED

Ask = Callable[[str, Sequence[str]], str]
"""Asks for one of some answers; for any where there are none, and "" is none."""

_LEAST_VIEW_DEG, _MOST_VIEW_DEG = 10.0, 170.0
"""No lens that looks at roads sees less, and no pinhole more."""
_SAME_SHAPE = 0.01
"""Sides of two sizes of one picture are in one ratio but for rounding."""
_UNKNOWN = (
    "no calibration: a view of 60 degrees along the longer side is taken, as a phone's video has "
    "about; dash cameras have 70 to 130, and a sign 20 m ahead and 5 m aside is then metres "
    "off. Film a chessboard, calibrate with OpenCV, put its file here and run automap init "
    "--force; or write camera_matrix"
)


def cameras(draft: Draft, found: Found, ask: Ask | None) -> None:
    """A section for each camera, whose files share the beginning of their names."""
    parts: dict[str, dict[str, list[Path]]] = {}
    for what, paths in (
        ("files", found.videos),
        ("frames", found.frames),
        ("detections", found.detections),
    ):
        for path in paths:
            parts.setdefault(_name(path), {}).setdefault(what, []).append(path)
    _only(parts)
    for name, files in parts.items():
        section = f"video.{name}"
        if "files" in files:
            draft.set(section, "files", files["files"], "chapters in the order of their names")
        for key, why in (
            ("frames", "when each frame was taken"),
            ("detections", "boxes of signs"),
        ):
            if key in files:
                draft.set(section, key, files[key][0], why)
        clock = draft.get("imu", "time") or "boot_ns"
        draft.set(section, "time", clock, "taken as the clock of the inertial readings")
        if "frames" not in files and "files" in files:
            draft.note(section, "no frame times: they are start_ns and the stamps in the video")
        size = image_size(tuple(files["files"])) if "files" in files else None
        chosen = _calibration(found, name, size, len(parts))
        if chosen is not None:
            _calibrated(draft, section, *chosen, size)
        else:
            _uncalibrated(draft, section, size, ask)


def _name(path: Path) -> str:
    """What a camera is called: the name of a file without its date, number and kind."""
    stem = re.sub(r"_?(frames|detections)$", "", path.stem)
    bare = DATED.sub("", stem)
    if bare != stem:
        # 2026_0314_202000_001F is the first chapter of F, and what is ahead of a date its series
        bare = re.sub(r"\d+", "", bare)
    bare = re.sub(r"[-_]?\d+$", "", bare).strip("-_. ") or ("front" if bare != stem else stem)
    return re.sub(r"[^\w-]", "_", bare) or "front"


def _only(parts: dict[str, dict[str, list[Path]]]) -> None:
    """Frame times and boxes of no other name are those of an only video."""
    of_video = [name for name, files in parts.items() if "files" in files]
    others = [name for name, files in parts.items() if "files" not in files]
    if len(of_video) == 1:
        for what in ("frames", "detections"):
            listed = [name for name in others if what in parts[name]]
            if len(listed) == 1 and what not in parts[of_video[0]]:
                parts[of_video[0]][what] = parts[listed[0]].pop(what)
        for name in [name for name in others if not parts[name]]:
            del parts[name]


def _calibration(
    found: Found, name: str, size: tuple[int, int] | None, cameras: int
) -> tuple[Path, CameraFile] | None:
    """The calibration that bears a camera's name, else the only one of an only camera, else the one
    of its size."""
    every = list(found.calibrations.items())
    named = [each for each in every if name.lower() in each[0].stem.lower()]
    sized = [each for each in every if size is not None and each[1].size == size]
    for some in (named, every if cameras == 1 else [], sized):
        if len(some) == 1:
            return some[0]
    return None


def _calibrated(
    draft: Draft, section: str, path: Path, camera: CameraFile, size: tuple[int, int] | None
) -> None:
    scale = 1.0
    if size is not None and camera.size is not None and camera.size != size:
        wide, high = size[0] / camera.size[0], size[1] / camera.size[1]
        if abs(wide / high - 1.0) > _SAME_SHAPE:
            draft.doubt(
                section,
                f"{path.name} is of {camera.size[0]}x{camera.size[1]}, the video of "
                f"{size[0]}x{size[1]}, another shape: it is not used; calibrate at the video's own",
            )
            _uncalibrated(draft, section, size, None)
            return
        scale = wide
    _size(draft, section, size or camera.size)
    matrix = camera.matrix.copy()
    # pixel centres are integers, so half a pixel lies between the edges and the first of them
    matrix[:2, 2] += 0.5
    matrix[:2] *= scale
    matrix[:2, 2] -= 0.5
    why = f"of {path.name}" + (f", {scale:.4g} times as large as it was" if scale != 1.0 else "")
    draft.set(section, "camera_matrix", _rounded(matrix), why)
    if camera.distortion:
        draft.set(section, "distortion", list(camera.distortion), f"of {path.name}")
    if camera.doubt is not None:
        draft.doubt(section, camera.doubt)


def _uncalibrated(
    draft: Draft, section: str, size: tuple[int, int] | None, ask: Ask | None
) -> None:
    """What the user says of the view; else nothing, and the run takes a usual one and says so."""
    if size is None and ask is not None:
        told = _numbers(ask(f"[{section}]: width and height of the picture in pixels?", ()))
        size = (round(told[0]), round(told[1])) if len(told) == 2 and min(told) > 0 else None
    _size(draft, section, size)
    if size is None:
        draft.note(section, "add width, height and camera_matrix of a calibration")
        return
    view = ask and ask(f"[{section}]: horizontal field of view in degrees, if it is known?", ())
    degrees = _numbers(view or "")
    if len(degrees) == 1 and _LEAST_VIEW_DEG < degrees[0] < _MOST_VIEW_DEG:
        f = 0.5 * size[0] / np.tan(np.radians(0.5 * degrees[0]))
        rows = [[f, 0.0, 0.5 * (size[0] - 1)], [0.0, f, 0.5 * (size[1] - 1)], [0.0, 0.0, 1.0]]
        why = f"a pinhole of {degrees[0]:g} degrees, as you said; a calibration is better"
        draft.set(section, "camera_matrix", _rounded(np.array(rows)), why)
    else:
        draft.note(section, _UNKNOWN)


def _size(draft: Draft, section: str, size: tuple[int, int] | None) -> None:
    if size is not None:
        draft.set(section, "width", size[0], "")
        draft.set(section, "height", size[1], "")


def _numbers(text: str) -> list[float]:
    try:
        return [float(part) for part in re.split(r"[\s,x]+", text.strip()) if part]
    except ValueError:
        return []


def _rounded(matrix: FloatArray) -> list[list[float]]:
    return [[round(float(v), 4) for v in row] for row in matrix]
