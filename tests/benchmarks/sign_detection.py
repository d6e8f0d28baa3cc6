"""Time of finding signs, against decoding alone and against another engine on the same network.

python tests/benchmarks/sign_detection.py VIDEO

Processor time on one thread, the least of several rounds taken in turn, so that whatever else
the machine does falls on all alike.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from importlib.resources import as_file, files
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
    with as_file(files("automap.vision").joinpath("models/sign-detector.onnx")) as path:
        other = cv2.dnn.readNetFromONNX(str(path))
    down, right = -height % 32, -width % 32
    padded = cv2.copyMakeBorder(picture, 0, down, 0, right, cv2.BORDER_REPLICATE)
    blob = cv2.dnn.blobFromImage(padded)

    def by_opencv() -> object:
        other.setInput(blob)
        return other.forward()

    band = (0.0, 0.30 * height, float(width), 0.72 * height)
    works: dict[str, Callable[[], object]] = {
        "decoding one frame": lambda: frames_of(options.video, 24),
        "finding": lambda: detector.propose(picture),
        "finding in a band about the horizon": lambda: detector.propose(picture, band),
        "the same band at 1.5 times its size": lambda: detector.propose(picture, band, 1.5),
        "finding and naming": lambda: detector.detect(picture),
        "the same network by OpenCV's engine": by_opencv,
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
    ratio = best["the same network by OpenCV's engine"] / best["finding"]
    print(f"OpenCV's engine takes {ratio:.2f} times as long")


if __name__ == "__main__":
    main()
