"""Decoding and searching at the same time, in a bounded amount of memory.

Decoders, OpenCV and onnxruntime let go of the interpreter while they work, so threads do.
"""

from __future__ import annotations

import os
import queue
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Generic, TypeVar

import cv2

from automap.records import VideoFrame
from automap.vision.detector import FoundSigns

T = TypeVar("T")

_MOST, _POLL_S = 8, 0.2
"""Threads at most, and how often a wait looks whether it shall end."""
_HELD_BYTES = 96_000_000
"""Pictures held at once may take so much memory, but a few are held whatever their size."""


def worker_count() -> int:
    """Threads that search, by the processors that are free to this process."""
    return max(1, min(_MOST, len(os.sched_getaffinity(0))))


@dataclass(frozen=True)
class _Raised:
    error: BaseException


def prefetched(source: Iterable[T], depth: int = 2) -> Iterator[T]:
    """The items of ``source``, made by a thread of their own, at most ``depth`` ahead.

    An exception in ``source`` comes out here, after the items before it. A consumer that
    stops early stops the thread too.
    """
    items: queue.Queue[T | _Raised | None] = queue.Queue(maxsize=depth)
    stop = threading.Event()

    def put(item: T | _Raised | None) -> bool:
        while not stop.is_set():
            try:
                items.put(item, timeout=_POLL_S)
            except queue.Full:
                continue
            return True
        return False

    def work() -> None:
        try:
            for item in source:
                if not put(item):
                    return
            put(None)
        except BaseException as error:
            put(_Raised(error))

    thread = threading.Thread(target=work, name="decode", daemon=True)
    thread.start()
    try:
        while (item := items.get()) is not None:
            if isinstance(item, _Raised):
                raise item.error
            yield item
    finally:
        stop.set()
        thread.join()


Beside = tuple[FoundSigns, ...] | None
"""What the coarse frames before and after a frame show; None for a coarse frame itself."""


@dataclass(frozen=True)
class Candidate(Generic[T]):
    """A frame that may be searched: in any case (``coarse``), or beside a coarse one that
    shows something. ``mark`` is the caller's own."""

    frame: VideoFrame
    coarse: bool
    mark: T


@dataclass
class _Group(Generic[T]):
    """Candidates up to and including a coarse one; ``futures`` of those that are searched."""

    candidates: list[Candidate[T]]
    futures: list[Future[FoundSigns] | None]
    decided: bool

    @property
    def coarse(self) -> Future[FoundSigns] | None:
        return self.futures[-1]


def detections(
    candidates: Iterable[Candidate[T]],
    search: Callable[[T, VideoFrame, Beside], FoundSigns],
    shows_sign: Callable[[FoundSigns], bool] = lambda found: len(found) > 0,
    workers: int = 1,
) -> Iterator[tuple[Candidate[T], FoundSigns]]:
    """Each candidate that is searched with what ``search`` finds, in their order.

    A candidate that is not coarse is searched only if the coarse one before or after it shows
    a sign; ``search`` then receives what these two show, and None for a coarse one. The result
    does not depend on the number of workers.
    """
    source = iter(candidates)
    groups: deque[_Group[T]] = deque()
    before: FoundSigns | None = None  # what the last coarse frame that was delivered shows
    exhausted = False
    threads = cv2.getNumThreads()
    # there is a thread for every processor already
    cv2.setNumThreads(1)
    pool = ThreadPoolExecutor(workers, thread_name_prefix="search")

    def submit(candidate: Candidate[T], beside: Beside = None) -> Future[FoundSigns]:
        return pool.submit(search, candidate.mark, candidate.frame, beside)

    def decide(group: _Group[T], beside: tuple[FoundSigns, ...]) -> None:
        group.decided = True
        if any(shows_sign(found) for found in beside):
            group.futures = [
                future or submit(candidate, beside)
                for future, candidate in zip(group.futures, group.candidates, strict=True)
            ]

    try:
        while True:
            while not exhausted and sum(len(g.candidates) for g in groups) < _ahead(
                groups, workers
            ):
                group = _read_group(source)
                exhausted = not group
                if group:
                    alone = len(group) == 1 and group[0].coarse
                    futures = [submit(c) if c.coarse else None for c in group]
                    groups.append(_Group(group, futures, alone))
                _decide_early(groups, before, decide)
            if not groups:
                return
            group_now = groups.popleft()
            after = None if group_now.coarse is None else group_now.coarse.result()
            if not group_now.decided:
                decide(group_now, tuple(f for f in (before, after) if f is not None))
            for candidate, future in zip(group_now.candidates, group_now.futures, strict=True):
                if future is not None:
                    yield candidate, future.result()
            before = after
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
        cv2.setNumThreads(threads)


def _read_group(source: Iterator[Candidate[T]]) -> list[Candidate[T]]:
    group = []
    for candidate in source:
        group.append(candidate)
        if candidate.coarse:
            break
    return group


def _ahead(groups: deque[_Group[T]], workers: int) -> int:
    """How many candidates may be held: enough for all workers, few enough for the memory."""
    if not groups:
        return 1
    size = max(groups[0].candidates[0].frame.image.nbytes, 1)
    return max(2 * workers + 2, min(6 * workers + 4, _HELD_BYTES // size))


def _decide_early(
    groups: deque[_Group[T]],
    before: FoundSigns | None,
    decide: Callable[[_Group[T], tuple[FoundSigns, ...]], None],
) -> None:
    """Decide what can be decided without waiting."""
    first = True
    for group in groups:
        last, after = group.coarse, None
        if last is not None and last.done() and last.exception() is None:
            after = last.result()
        if not group.decided and after is not None and (before is not None or first):
            decide(group, (after,) if before is None else (before, after))
        before, first = after, False
