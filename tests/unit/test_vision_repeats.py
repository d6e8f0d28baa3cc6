"""A picture that stays while the vehicle drives."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from automap.io.manifest import VideoSection
from automap.io.video import VideoInput
from automap.records import Image, IntArray
from automap.vision.camera_path import CameraPath
from automap.vision.detector import FoundSigns
from automap.vision.search import SearchResult, SearchRules
from pipeline.detect.video_search import search_video
from tests.slow_cases import others_slow

RATE, FRAMES = 10, 60


class Nothing:
    """A detector that finds nothing."""

    name = "nothing"

    def detect(self, image: Image) -> FoundSigns:
        return FoundSigns((), np.zeros((0, 4)), np.zeros(0))


def video(path: Path, shown: list[int], grey: float, spread: float) -> VideoInput:
    """A street that moves by 16 px from frame to frame, of which those numbers are ``shown``."""
    import av

    rng = np.random.default_rng(5)
    street = rng.normal(grey, spread, (30, 40 + FRAMES)).repeat(12, 0).repeat(16, 1)
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=RATE)
        stream.width, stream.height, stream.pix_fmt = 640, 360, "yuv420p"
        stream.options = {"crf": "23"}
        for number in shown:
            noise = np.random.default_rng(number).normal(0.0, 2.0, (360, 640))
            part = np.clip(street[:, 16 * number : 16 * number + 640] + noise, 0, 255)
            image = part.astype(np.uint8)[:, :, None].repeat(3, 2)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, "bgr24")))
        container.mux(stream.encode())
    return VideoInput("front", VideoSection(start_ns=0), (path,))


def searched(front: VideoInput, speed: float, every: bool) -> tuple[SearchResult, list[str]]:
    def path_of(t_ns: IntArray) -> CameraPath:
        t_s = (t_ns - t_ns[0]) * 1e-9
        centre = np.outer(speed * t_s, [1.0, 0.0, 0.0])
        attitude = np.broadcast_to(np.eye(3), (len(t_ns), 3, 3))
        return CameraPath(centre, attitude, np.ones(len(t_ns), np.bool_))

    told: list[str] = []
    rules = SearchRules(every=every, workers=1)
    return search_video(front, Nothing(), rules, None, path_of, told.append), told


@pytest.mark.parametrize("every", others_slow([False, True]))
def test_frames_of_a_camera_that_hung_are_told_and_not_searched(
    tmp_path: Path, every: bool
) -> None:
    shown = [*range(20), *[20] * 30, *range(50, FRAMES)]
    result, told = searched(video(tmp_path / "v.mp4", shown, 120.0, 40.0), 12.0, every)
    assert len(told) == 1
    # in steps of two metres the last one may be passed over
    assert re.search("from 2.0 to 4.[89] s .* 3[45] m", told[0])
    looked = result.detections.looked
    assert looked is not None
    assert not np.any((looked.frame > 21) & (looked.frame < 50))
    assert np.any(looked.frame < 20)
    assert np.any(looked.frame >= 50)


@pytest.mark.slow
def test_a_covered_lens_is_told(tmp_path: Path) -> None:
    _, told = searched(video(tmp_path / "v.mp4", list(range(FRAMES)), 4.0, 0.0), 12.0, False)
    assert len(told) == 1
    assert "saw nothing" in told[0]


@pytest.mark.parametrize(
    ("shown", "speed", "grey", "spread"),
    others_slow(
        [
            (list(range(FRAMES)), 12.0, 120.0, 40.0),
            # little light: a texture of two grey levels
            (list(range(FRAMES)), 12.0, 12.0, 4.0),
            # 25 pictures a second told as 30: every sixth is shown twice
            ([i - (i % 6 == 5) for i in range(FRAMES)], 12.0, 120.0, 40.0),
            # a vehicle at rest whose path wanders
            ([7] * FRAMES, 0.8, 120.0, 40.0),
        ],
        fast=1,
    ),
)
def test_other_pictures_are_not_told(
    tmp_path: Path, shown: list[int], speed: float, grey: float, spread: float
) -> None:
    assert not searched(video(tmp_path / "v.mp4", shown, grey, spread), speed, False)[1]
