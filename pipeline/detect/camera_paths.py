"""The paths of a drive's cameras, from what earlier stages wrote."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from automap.errors import AutoMapError, InputError
from automap.io import names

if TYPE_CHECKING:
    from automap.io.drive import Drive
    from automap.io.video import VideoInput
    from automap.records import IntArray
    from automap.vision.camera_path import CameraPath


def path_finder(
    out: Path, drive: Drive, video: VideoInput
) -> Callable[[IntArray], CameraPath | None]:
    """A function from stamps [n] of the camera's frames to the camera's path.

    It gives None when OUT has no trajectory or nothing ties its clock to the camera's: where
    the signs are placed that is said to the user, here it only makes the search less clever.
    """

    def find(t_ns: IntArray) -> CameraPath | None:
        from automap.io.clock_json import read_clocks
        from automap.io.trajectory_table import read_trajectory
        from automap.sync.stamps import in_trajectory_time
        from automap.vision.camera_path import camera_path

        camera = drive.cameras().get(video.name)
        if camera is None or not (out / names.TRAJECTORY).is_file():
            return None
        try:
            trajectory = read_trajectory(out / names.TRAJECTORY)
            if (out / names.SYNC).is_file():
                clocks = read_clocks(out / names.SYNC)
                t_ns = in_trajectory_time(t_ns, video.section.time, clocks)
        except (AutoMapError, InputError):
            return None
        if len(trajectory) < 2:
            return None
        path = camera_path(trajectory, camera, t_ns)
        return path if path.known.any() else None

    return find
