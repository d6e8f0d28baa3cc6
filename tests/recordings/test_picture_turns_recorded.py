"""Turns of a recorded hand-held video beside its own gyro: it accuses no picture falsely."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from automap.frames import matrix_to_rpy, rotation_vector_to_matrix
from automap.io.gopro import read_gopro
from automap.records import IntArray, PictureTurns, Trajectory, VideoFrame
from automap.vision import picture_turns
from automap.vision.camera_path import CameraPath, camera_path
from automap.vision.search import default_camera

CAMERA = replace(default_camera(848, 480), time_offset_sd=0.1)
S = 1_000_000_000


def by_gyro(path: Path) -> Trajectory:
    """The attitude that the gyro tells, and four seconds of rest before and after it."""
    recorded = read_gopro([path])
    rows = recorded.imu_t_ns > 0
    t, gyro = recorded.imu_t_ns[rows], recorded.gyro[rows]
    turn, attitudes = np.eye(3), [np.eye(3)]
    for rate, step in zip(0.5 * (gyro[1:] + gyro[:-1]), np.diff(t) * 1e-9, strict=True):
        turn = turn @ rotation_vector_to_matrix(rate * step)
        attitudes.append(turn)
    rpy = matrix_to_rpy(np.array(attitudes))
    rest = np.arange(1, 800) * S // 200
    t = np.concatenate([t[0] - rest[::-1], t, t[-1] + rest])
    rpy = np.concatenate([np.tile(rpy[0], (len(rest), 1)), rpy, np.tile(rpy[-1], (len(rest), 1))])
    one, three = np.zeros(len(t)), np.full((len(t), 3), 0.1)
    return Trajectory(t, t * 1e-9, one, one, one, np.zeros((len(t), 3)), rpy, three, three, three)


@pytest.mark.slow
def test_a_hand_held_video_is_not_accused(shared_data: Path) -> None:
    import av

    path = shared_data / "video" / "gopro-max.mp4"
    turned = by_gyro(path)

    def path_of(t_ns: IntArray) -> CameraPath:
        return camera_path(turned, CAMERA, t_ns)

    def pictures() -> Iterator[VideoFrame]:
        with av.open(str(path)) as container:
            for k, frame in enumerate(container.decode(video=0)):
                if k % 3 == 0:
                    yield VideoFrame(k, round(k * S / 29.97), frame.to_ndarray(format="bgr24"))

    steps = picture_turns._follow(CAMERA, np.zeros(2), pictures())
    assert len(steps.turn) > 90
    assert picture_turns.judged(CAMERA, path_of, [steps, steps]) == PictureTurns(0)
    offsets = np.arange(-3.0, 3.01, 0.05)
    on_path, known = picture_turns._on_path(path_of, steps, offsets)
    fits = [
        picture_turns._fit(steps, on_path @ looks.T, known, offsets)
        for _, looks in picture_turns._PICTURES
    ]
    right, *others = (0.0 if fit is None else fit.correlation for fit in fits)
    assert right > 0.5
    assert max(others) < 0.3
