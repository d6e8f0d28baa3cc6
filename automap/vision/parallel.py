"""A detector in several processes, for videos that are long enough to be worth it."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Iterable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.connection import wait

from automap.io.video import VideoFrame
from automap.vision.detector import Detector, FoundSigns, Image

_AHEAD = 2
"""Pictures that wait for each process: enough to keep it busy, few enough for any memory."""
_MOST = 8
_WORTH = 40
"""Frames below which starting processes takes longer than the search."""

_detector: Detector | None = None


def worker_count(frames: int) -> int:
    """Processes that a search of so many frames is worth, by the processors that are free to
    this process; 1 stands for none beside it."""
    if multiprocessing.parent_process() is not None or frames < _WORTH:
        return 1
    return max(1, min(_MOST, len(os.sched_getaffinity(0)), frames // _WORTH + 1))


def detections(
    frames: Iterable[VideoFrame], detector: Detector, workers: int = 1
) -> Iterator[tuple[VideoFrame, FoundSigns]]:
    """Each frame with what the detector finds in it, in the order of the frames.

    With several workers the detector must be picklable. Processes that cannot be started, or
    die, cost nothing but time: this process then searches what is left itself.
    """
    source = iter(frames)
    if workers > 1:
        yield from _with_pool(source, detector, workers)
    for frame in source:
        yield frame, detector.detect(frame.image)


def _with_pool(
    source: Iterator[VideoFrame], detector: Detector, workers: int
) -> Iterator[tuple[VideoFrame, FoundSigns]]:
    """As far as the pool works; ``source`` then stands at the first frame not yet taken."""
    # forked children would inherit locks of threads that they do not have
    try:
        pool = ProcessPoolExecutor(
            workers, multiprocessing.get_context("spawn"), _start, (detector,)
        )
    except (OSError, ImportError, NotImplementedError):
        return  # no semaphores here
    waiting: deque[tuple[VideoFrame, Future[FoundSigns] | None]] = deque()
    works = True
    try:
        while True:
            while works and len(waiting) < _AHEAD * workers:
                frame = next(source, None)
                if frame is None:
                    break
                try:
                    waiting.append((frame, pool.submit(_search, frame.image)))
                except (BrokenProcessPool, OSError):
                    works = False
                    waiting.append((frame, None))
            if not waiting:
                return
            frame, future = waiting.popleft()
            try:
                found = None if future is None else future.result()
            except BrokenProcessPool:
                works, found = False, None
            yield frame, detector.detect(frame.image) if found is None else found
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def _start(detector: Detector) -> None:
    global _detector
    import cv2

    _detector = detector
    cv2.setNumThreads(1)
    # Ctrl-C is for the process that waits, which then ends this one
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)


def _search(image: Image) -> FoundSigns:
    assert _detector is not None
    return _detector.detect(image)
