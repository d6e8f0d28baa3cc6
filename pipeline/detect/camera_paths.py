"""The paths of a drive's cameras, from what earlier stages wrote."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from automap.errors import AutoMapError, InputError
from automap.io import names

if TYPE_CHECKING:
    from automap.io.drive import Drive
    from automap.io.video import VideoInput
    from automap.records import DriveClocks, IntArray, Trajectory
    from automap.vision.camera_path import CameraPath


def path_finder(
    out: Path, drive: Drive, video: VideoInput
) -> Callable[[IntArray], CameraPath | None]:
    """A function from stamps [n] of the camera's frames to the camera's path.

    It gives None when OUT has no trajectory or nothing ties its clock to the camera's: where
    the signs are placed that is said to the user, here it only makes the search less clever.
    """

    @cache
    def read() -> tuple[Trajectory, DriveClocks | None] | None:
        from automap.io.clock_json import read_clocks
        from automap.io.trajectory_table import read_trajectory

        if not (out / names.TRAJECTORY).is_file():
            return None
        try:
            clocks = read_clocks(out / names.SYNC) if (out / names.SYNC).is_file() else None
            return read_trajectory(out / names.TRAJECTORY), clocks
        except (AutoMapError, InputError):
            return None

    def find(t_ns: IntArray) -> CameraPath | None:
        from automap.sync.stamps import in_trajectory_time
        from automap.vision.camera_path import camera_path

        camera, known = drive.cameras().get(video.name), read()
        if camera is None or known is None or len(known[0]) < 2:
            return None
        trajectory, clocks = known
        try:
            if clocks is not None:
                t_ns = in_trajectory_time(t_ns, video.section.time, clocks)
        except InputError:
            return None
        path = camera_path(trajectory, camera, t_ns)
        return path if path.known.any() else None

    return find
