"""Searching with several processes gives what one process gives."""

from __future__ import annotations

import os
from dataclasses import dataclass

import numpy as np

from automap.io.video import VideoFrame
from automap.vision.detector import FoundSigns, Image
from automap.vision.parallel import detections, worker_count


@dataclass(frozen=True)
class BrightestPixel:
    """Stands in for a detector: one box at the brightest pixel."""

    name: str = "brightest"

    def detect(self, image: Image) -> FoundSigns:
        y, x = np.unravel_index(int(image[:, :, 0].argmax()), image.shape[:2])
        box = np.array([[x, y, x + 1.0, y + 1.0]], np.float64)
        return FoundSigns(("spot",), box, np.ones(1))


@dataclass(frozen=True)
class DiesElsewhere:
    """Ends every process but the one that made it."""

    home: int
    name: str = "fragile"

    def detect(self, image: Image) -> FoundSigns:
        if os.getpid() != self.home:
            os._exit(1)
        return BrightestPixel().detect(image)


def pictures(count: int) -> list[VideoFrame]:
    frames = []
    for number in range(count):
        image = np.zeros((20, 30, 3), np.uint8)
        image[number % 20, number % 30] = 255
        frames.append(VideoFrame(number, number * 10, image))
    return frames


def places(found: list[tuple[VideoFrame, FoundSigns]]) -> list[tuple[int, float, float]]:
    return [(f.frame, float(s.box[0, 0]), float(s.box[0, 1])) for f, s in found]


def test_several_processes_keep_order_and_content() -> None:
    alone = places(list(detections(pictures(30), BrightestPixel())))
    shared = places(list(detections(iter(pictures(30)), BrightestPixel(), workers=2)))
    assert shared == alone
    assert shared[7] == (7, 7.0, 7.0)


def test_processes_that_die_lose_no_frame() -> None:
    found = list(detections(iter(pictures(12)), DiesElsewhere(os.getpid()), workers=2))
    assert [frame.frame for frame, _ in found] == list(range(12))


def test_short_videos_start_no_process() -> None:
    assert worker_count(5) == 1
    assert 1 <= worker_count(10_000) <= len(os.sched_getaffinity(0))
