"""One drive of a map: its path, its cameras' frames, and the boxes in them."""

from __future__ import annotations

import threading
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from automap.errors import AutoMapError
from automap.io import names
from automap.records import ClockModel, FloatArray, IntArray, Trajectory

if TYPE_CHECKING:
    from automap.io.drive import Drive
    from pipeline.view.frames import FrameReader


@dataclass(frozen=True)
class Boxes:
    """Detections [n] of one drive in the order of camera, frame.

    ``row`` is the row of ``observations.parquet``, ``box`` [n, 4] x_min, y_min, x_max, y_max in
    pixels, ``sign_id`` text or None, ``residual_px`` NaN where the file has none.
    """

    camera: npt.NDArray[np.object_]
    frame: IntArray
    t_ns: IntArray
    class_name: npt.NDArray[np.object_]
    box: FloatArray
    score: FloatArray
    sign_id: npt.NDArray[np.object_]
    used: npt.NDArray[np.bool_]
    residual_px: FloatArray
    row: IntArray

    def __len__(self) -> int:
        return len(self.frame)


@dataclass
class MapDrive:
    """A drive of a map; ``out`` holds its results, ``folder`` the recording, None if unknown.

    What cannot be read is left out, with a sentence in ``problems``.
    """

    name: str
    out: Path | None
    folder: Path | None
    problems: list[str] = field(default_factory=list)
    _lock: threading.RLock = field(default_factory=threading.RLock, repr=False)

    @cached_property
    def drive(self) -> Drive | None:
        """The recording's manifest and files."""
        from automap.io.drive import load_drive

        if self.folder is None:
            return None
        try:
            return load_drive(self.folder)
        except AutoMapError as error:
            self.problems.append(f"The recording of {self.name} is not shown: {error}")
            return None

    @cached_property
    def trajectory(self) -> Trajectory | None:
        """The trajectory that the signs rest on."""
        from automap.io.trajectory_table import read_trajectory

        for name in (names.TRAJECTORY_ADJUSTED, names.TRAJECTORY):
            if self.out is None or not (self.out / name).is_file():
                continue
            try:
                trajectory = read_trajectory(self.out / name)
            except AutoMapError as error:
                self.problems.append(f"The path of {self.name} is not shown: {error}")
                continue
            if len(trajectory):
                return trajectory
        return None

    @cached_property
    def clock(self) -> ClockModel | None:
        """The recording's clock against GPS time."""
        from automap.export.clock import clock_from_trajectory
        from automap.io.clock_json import read_clock

        try:
            if self.out is not None and (self.out / names.SYNC).is_file():
                return read_clock(self.out / names.SYNC)
        except (AutoMapError, OSError, ValueError, KeyError, TypeError) as error:
            self.problems.append(f"Times of {self.name} are host stamps: {error}")
        return None if self.trajectory is None else clock_from_trajectory(self.trajectory)

    @cached_property
    def boxes(self) -> Boxes | None:
        """The detections with their signs."""
        if self.out is None:
            return None
        for name in (names.OBSERVATIONS, names.DETECTIONS):
            if (self.out / name).is_file():
                try:
                    return _read_boxes(self.out / name)
                except (AutoMapError, KeyError, ValueError, TypeError) as error:
                    self.problems.append(f"The boxes of {self.name} are not shown: {error}")
        return None

    @cached_property
    def readers(self) -> dict[str, FrameReader]:
        """What decodes the frames, for the cameras that have a video."""
        from pipeline.view.frames import FrameReader

        videos = self.drive.videos if self.drive is not None else {}
        return {name: FrameReader(video) for name, video in videos.items() if video.chapters}

    def load(self) -> MapDrive:
        """Read everything now, once, whichever thread asks first."""
        with self._lock:
            _ = self.trajectory, self.clock, self.boxes, self.readers
        return self

    def overview(self) -> dict[str, Any]:
        """Path and cameras as the page needs them; times are seconds since ``start_ns``."""
        self.load()
        start = self.start_ns
        return {
            "name": self.name,
            "start_ns": str(start),
            "start_utc": self._utc(start),
            "path": self._path(start),
            "cameras": [self._camera(name, start) for name in self.cameras()],
            "problems": list(self.problems),
        }

    @property
    def start_ns(self) -> int:
        """The first stamp of the trajectory, or else of the boxes."""
        if self.trajectory is not None:
            return int(self.trajectory.t_ns[0])
        return int(self.boxes.t_ns.min()) if self.boxes is not None and len(self.boxes) else 0

    def cameras(self) -> list[str]:
        """Cameras with a video or with boxes."""
        seen = [] if self.boxes is None else self.boxes.camera.tolist()
        return list(dict.fromkeys([*self.readers, *seen]))

    def boxes_in(self, camera: str, frame: int) -> list[dict[str, Any]]:
        """The boxes of one frame."""
        self.load()
        if self.boxes is None:
            return []
        low, high = np.searchsorted(self.boxes.frame, [frame, frame + 1])
        boxes = self.boxes
        return [
            {
                "box": np.round(boxes.box[k], 1).tolist(),
                "class": boxes.class_name[k],
                "score": round(float(boxes.score[k]), 3),
                "sign": boxes.sign_id[k],
                "used": bool(boxes.used[k]),
            }
            for k in range(int(low), int(high))
            if boxes.camera[k] == camera
        ]

    def views(self, rows: IntArray, sign_id: str) -> list[dict[str, Any]]:
        """Where a sign is seen, by rows of the observations or else by its id, in time order."""
        self.load()
        boxes = self.boxes
        if boxes is None:
            return []
        chosen = np.isin(boxes.row, rows) if len(rows) else boxes.sign_id == sign_id
        found = np.flatnonzero(chosen)
        found = found[np.argsort(boxes.t_ns[found], kind="stable")]
        size = np.diff(boxes.box[:, [1, 3]], axis=1)[:, 0]
        return [
            {
                "camera": boxes.camera[k],
                "frame": int(boxes.frame[k]),
                "t": round((int(boxes.t_ns[k]) - self.start_ns) * 1e-9, 3),
                "height_px": round(float(size[k]), 1),
                "score": round(float(boxes.score[k]), 3),
                "residual_px": _known(boxes.residual_px[k], 1),
                "used": bool(boxes.used[k]),
            }
            for k in found.tolist()
        ]

    def _utc(self, t_ns: int) -> str | None:
        from automap.export.clock import iso_texts, utc_of_stamps

        return iso_texts(utc_of_stamps(np.array([t_ns]), self.clock))[0]

    def _path(self, start_ns: int) -> dict[str, Any] | None:
        from automap.export.path import simplified_path
        from automap.io.web_tiles import to_world

        if self.trajectory is None:
            return None
        path = simplified_path(self.trajectory, tolerance_m=0.15)
        if len(path) < 2:
            return None
        x, y = to_world(path.lon_deg, path.lat_deg)
        return {
            "t": np.round((path.t_ns - start_ns) * 1e-9, 3).tolist(),
            "x": np.round(x, 12).tolist(),
            "y": np.round(y, 12).tolist(),
            "yaw_deg": [_known(v, 1) for v in path.rpy_deg[:, 2].tolist()],
            "sd_m": [_known(v, 3) for v in path.sd_h_m.tolist()],
            "speed": [_known(v, 1) for v in path.speed_m_s.tolist()],
        }

    def _camera(self, name: str, start_ns: int) -> dict[str, Any]:
        if name in self.readers:
            frame, t_ns = self.readers[name].times()
        else:
            assert self.boxes is not None
            rows = np.flatnonzero(self.boxes.camera == name)
            frame, first = np.unique(self.boxes.frame[rows], return_index=True)
            t_ns = self.boxes.t_ns[rows[first]]
        camera = self.drive.cameras().get(name) if self.drive is not None else None
        width, height = (camera.width, camera.height) if camera else self._extent(name)
        return {
            "name": name,
            "video": name in self.readers,
            "width": width,
            "height": height,
            "frame": frame.tolist(),
            "t": np.round((t_ns - start_ns) * 1e-9, 3).tolist(),
        }

    def _extent(self, camera: str) -> tuple[int, int]:
        """A size that holds all boxes of a camera of unknown size."""
        assert self.boxes is not None
        box = self.boxes.box[self.boxes.camera == camera]
        return tuple(int(v) + 1 for v in np.nan_to_num(box[:, 2:]).max(axis=0))  # type: ignore[return-value]


def _known(value: float, decimals: int) -> float | None:
    return round(float(value), decimals) if np.isfinite(value) else None


def _read_boxes(path: Path) -> Boxes:
    from automap.io.detections_table import COLUMNS
    from automap.io.tables import floats, ints, read_table

    table = read_table(path, COLUMNS[:9])
    n = table.num_rows
    have = set(table.column_names)
    camera = np.array(table.column("camera").to_pylist(), object)
    frame = ints(table, "frame")
    order = np.argsort(frame, kind="stable")

    def texts(name: str) -> npt.NDArray[np.object_]:
        values = table.column(name).to_pylist() if name in have else [None] * n
        array = np.empty(n, object)
        array[:] = values
        return array[order]

    residual = np.full(n, np.nan)
    if {"residual_x_px", "residual_y_px"} <= have:
        residual = np.hypot(floats(table, "residual_x_px"), floats(table, "residual_y_px"))
    used = np.ones(n, bool)
    if "used" in have:
        used = np.asarray(table.column("used").fill_null(False).to_numpy(), bool)
    return Boxes(
        camera=camera[order],
        frame=frame[order],
        t_ns=ints(table, "t_ns")[order],
        class_name=texts("class"),
        box=np.column_stack([floats(table, c) for c in COLUMNS[4:8]])[order],
        score=floats(table, "score")[order],
        sign_id=texts("sign_id"),
        used=used[order],
        residual_px=residual[order],
        row=order.astype(np.int64),
    )
