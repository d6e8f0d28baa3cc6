"""Time of finding signs, against decoding alone.

python tests/benchmarks/sign_detection.py VIDEO

Processor time on one thread, the least of several rounds taken in turn, so that whatever else
the machine does falls on all alike.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from pathlib import Path

import av
import cv2
import numpy as np
import numpy.typing as npt

from automap.vision.network import NetworkDetector, default_detector

Image = npt.NDArray[np.uint8]


def frames_of(path: Path, count: int) -> list[Image]:
    """The first frames of a video as BGR."""
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        stream.thread_count = 1
        frames = []
        for frame in container.decode(stream):
            frames.append(np.asarray(frame.to_ndarray(format="bgr24"), np.uint8))
            if len(frames) == count:
                break
    return frames


def cpu_ms(work: Callable[[], object]) -> float:
    """Processor time of one call in ms."""
    before = time.process_time()
    work()
    return (time.process_time() - before) * 1e3


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("video", type=Path)
    parser.add_argument("--rounds", type=int, default=8)
    options = parser.parse_args()
    cv2.setNumThreads(1)
    frames = frames_of(options.video, 24)
    height, width = frames[0].shape[:2]
    detector: NetworkDetector = default_detector()
    picture = frames[len(frames) // 2]
    detector.detect(picture)
    band = (0.0, 0.30 * height, float(width), 0.72 * height)
    works: dict[str, Callable[[], object]] = {
        "decoding one frame": lambda: frames_of(options.video, 24),
        "finding, every pixel as it is": lambda: detector.propose(picture, zoom=1.0),
        "finding, enlarged": lambda: detector.propose(picture),
        "finding in a band about the horizon": lambda: detector.propose(picture, band),
        "finding and naming": lambda: detector.detect(picture),
    }
    times: dict[str, list[float]] = {name: [] for name in works}
    for _ in range(options.rounds):
        for name, work in works.items():
            times[name].append(cpu_ms(work))
    times["decoding one frame"] = [t / len(frames) for t in times["decoding one frame"]]
    best = {name: min(values) for name, values in times.items()}
    print(f"{width} x {height} px, one thread")
    for name, value in best.items():
        print(f"{name:38s} {value:7.1f} ms")
    total = best["decoding one frame"] + best["finding and naming"]
    print(f"decoding, finding and naming: {1e3 / total:.1f} frames a second, of which decoding "
          f"takes {best['decoding one frame'] / total:.0%}")  # fmt: skip


if __name__ == "__main__":
    main()
