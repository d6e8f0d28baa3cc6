"""One drive of a map: its path, its cameras' frames, and the boxes in them."""

from __future__ import annotations

import threading
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from automap.errors import AutoMapError
from automap.io import names
from automap.records import ClockModel, IntArray, Trajectory
from pipeline.view.boxes import Boxes, read_boxes

if TYPE_CHECKING:
    from automap.io.drive import Drive
    from pipeline.view.frames import FrameReader


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

        clock = None if self.trajectory is None else clock_from_trajectory(self.trajectory)
        if clock is not None:
            return clock
        try:
            if self.out is not None and (self.out / names.SYNC).is_file():
                return read_clock(self.out / names.SYNC)
        except (AutoMapError, OSError, ValueError, KeyError, TypeError) as error:
            self.problems.append(f"Times of {self.name} are host stamps: {error}")
        return None

    @cached_property
    def boxes(self) -> Boxes | None:
        """The detections with their signs."""
        if self.out is None:
            return None
        for name in (names.OBSERVATIONS, names.DETECTIONS):
            if (self.out / name).is_file():
                try:
                    return read_boxes(self.out / name)
                except (AutoMapError, KeyError, ValueError, TypeError) as error:
                    self.problems.append(f"The boxes of {self.name} are not shown: {error}")
        return None

    @cached_property
    def metrics(self) -> dict[str, Any]:
        """Figures of the run, as its record has them."""
        from pipeline.shared.run_record import read_record

        return {} if self.out is None else dict(read_record(self.out).get("metrics", {}))

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

    def stamp_of(self, camera: str, frame: int) -> int | None:
        """A frame's stamp in the trajectory's clock, without the camera's offset; None for a frame
        that is not there. Raises InputError where nothing ties the two clocks."""
        from automap.io.clock_json import read_clocks
        from automap.sync.stamps import in_trajectory_time

        boxes = self.boxes
        if boxes is not None:
            rows = np.flatnonzero((boxes.frame == frame) & (boxes.camera == camera))
            if len(rows):
                return int(boxes.t_ns[rows[0]])
        if camera not in self.readers or self.drive is None:
            return None
        section = self.drive.videos[camera].section
        frames, t_ns = self.readers[camera].times()
        at = int(np.searchsorted(frames, frame))
        if at >= len(frames) or frames[at] != frame:
            return None
        own = t_ns[at : at + 1] - np.int64(round(section.time_offset_s * 1e9))
        if self.out is not None and (self.out / names.SYNC).is_file():
            own = in_trajectory_time(own, section.time, read_clocks(self.out / names.SYNC))
        return int(own[0])

    def rows_of(self, rows: IntArray, sign_id: str) -> IntArray:
        """Boxes of a sign, by rows of the observations or else by its id, in time order."""
        self.load()
        boxes = self.boxes
        if boxes is None:
            return np.zeros(0, np.int64)
        chosen = np.isin(boxes.row, rows) if len(rows) else boxes.sign_id == sign_id
        found = np.flatnonzero(chosen)
        return found[np.argsort(boxes.t_ns[found], kind="stable")]

    def camera_frame(self, row: int) -> tuple[str, int]:
        """The camera and the frame of a box."""
        assert self.boxes is not None
        return self.boxes.camera[row], int(self.boxes.frame[row])

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
                "row": k,
                "used": bool(boxes.used[k]),
            }
            for k in range(int(low), int(high))
            if boxes.camera[k] == camera
        ]

    def view(self, k: int) -> dict[str, Any]:
        """One box as the page lists it."""
        from automap.effects.lens import cut_off

        boxes = self.boxes
        assert boxes is not None
        size = np.array(self._sizes[boxes.camera[k]], np.float64)
        return {
            "row": k,
            "cut": bool(cut_off(boxes.box[k : k + 1], size)[0]),
            "camera": boxes.camera[k],
            "frame": int(boxes.frame[k]),
            "t": round((int(boxes.t_ns[k]) - self.start_ns) * 1e-9, 3),
            "height_px": round(float(boxes.box[k, 3] - boxes.box[k, 1]), 1),
            "score": round(float(boxes.score[k]), 3),
            "residual_px": _known(boxes.residual_px[k], 1),
            "used": bool(boxes.used[k]),
        }

    def clicked(self, camera: str, frame: int, at: tuple[float, float]) -> dict[str, Any] | None:
        """A frame that a reviewer clicked in, likewise."""
        self.load()
        t_ns = self.stamp_of(camera, frame)
        if t_ns is None:
            return None
        seconds = round((t_ns - self.start_ns) * 1e-9, 3)
        return {"camera": camera, "frame": frame, "t": seconds, "at": at, "used": True}

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
        width, height = self._sizes[name]
        return {
            "name": name,
            "video": name in self.readers,
            "width": width,
            "height": height,
            "frame": frame.tolist(),
            "t": np.round((t_ns - start_ns) * 1e-9, 3).tolist(),
        }

    @cached_property
    def _sizes(self) -> dict[str, tuple[int, int]]:
        """Width and height of the cameras' frames; where unknown, what holds all their boxes."""
        known = self.drive.cameras() if self.drive is not None else {}
        return {
            name: (known[name].width, known[name].height) if name in known else self._extent(name)
            for name in self.cameras()
        }

    def _extent(self, camera: str) -> tuple[int, int]:
        assert self.boxes is not None
        box = self.boxes.box[self.boxes.camera == camera]
        return tuple(int(v) + 1 for v in np.nan_to_num(box[:, 2:]).max(axis=0))  # type: ignore[return-value]


def _known(value: float, decimals: int) -> float | None:
    return round(float(value), decimals) if np.isfinite(value) else None
