"""Searching with several threads gives what one gives, and no frame is lost."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from automap.records import VideoFrame
from automap.vision.detector import FoundSigns
from automap.vision.parallel import Beside, Candidate, detections, prefetched, worker_count


def candidates(coarse: list[bool]) -> Iterator[Candidate[int]]:
    for number, whether in enumerate(coarse):
        image = np.zeros((4, 6, 3), np.uint8)
        yield Candidate(VideoFrame(number, number * 10, image), whether, number)


def searcher(coarse: list[bool], signs: list[bool]):  # type: ignore[no-untyped-def]
    """Stands in for a detector: one box where ``signs`` says so, after an uneven wait."""

    def search(mark: int, frame: VideoFrame, beside: Beside) -> FoundSigns:
        assert mark == frame.frame
        time.sleep(0.0005 * (mark * 7 % 5))
        n = int(signs[mark])
        assert (beside is None) == coarse[mark]
        if beside is not None:
            rows = [i for i, whether in enumerate(coarse) if whether]
            near = [max((r for r in rows if r < mark), default=None)]
            near.append(min((r for r in rows if r > mark), default=None))
            assert [len(found) for found in beside] == [signs[r] for r in near if r is not None]
        return FoundSigns(("spot",) * n, np.full((n, 4), float(mark)), np.ones(n))

    return search


def expected(coarse: list[bool], signs: list[bool]) -> list[int]:
    """The frames that must be searched, by the definition."""
    rows = [i for i, whether in enumerate(coarse) if whether]
    wanted = []
    for i, whether in enumerate(coarse):
        before = max((r for r in rows if r < i), default=None)
        after = min((r for r in rows if r > i), default=None)
        near = any(signs[r] for r in (before, after) if r is not None)
        if whether or near:
            wanted.append(i)
    return wanted


@settings(max_examples=40)
@given(
    frames=st.lists(st.tuples(st.booleans(), st.booleans()), max_size=40),
    workers=st.integers(1, 3),
)
def test_what_lies_beside_a_sign_is_searched(frames: list[tuple[bool, bool]], workers: int) -> None:
    coarse, signs = [c for c, _ in frames], [s for _, s in frames]
    found = list(detections(candidates(coarse), searcher(coarse, signs), workers=workers))
    assert [candidate.mark for candidate, _ in found] == expected(coarse, signs)
    assert all(len(boxes) == signs[candidate.mark] for candidate, boxes in found)


def test_a_failing_search_comes_out() -> None:
    def search(mark: int, frame: VideoFrame, beside: Beside) -> FoundSigns:
        raise ValueError(f"frame {mark}")

    with pytest.raises(ValueError, match="frame 0"):
        list(detections(candidates([True] * 9), search, workers=2))


def test_prefetching_keeps_order_and_stops_with_its_consumer() -> None:
    made: list[int] = []

    def source() -> Iterator[int]:
        for number in range(10_000):
            made.append(number)
            yield number

    items = prefetched(source(), depth=3)
    assert [next(items) for _ in range(5)] == list(range(5))
    items.close()  # type: ignore[attr-defined]
    assert len(made) < 20
    assert not [t for t in threading.enumerate() if t.name == "decode"]


def test_an_error_in_the_source_comes_after_what_was_made() -> None:
    def source() -> Iterator[int]:
        yield 1
        raise OSError("the card was pulled")

    items = prefetched(source())
    assert next(items) == 1
    with pytest.raises(OSError, match="card"):
        next(items)


def test_memory_holds_few_pictures() -> None:
    alive = 0
    most = 0

    class Counted:
        def __init__(self, frame: VideoFrame) -> None:
            nonlocal alive, most
            self.frame = frame
            alive += 1
            most = max(most, alive)

        def __del__(self) -> None:
            nonlocal alive
            alive -= 1

    def source() -> Iterator[Candidate[Counted]]:
        for number in range(300):
            frame = VideoFrame(number, 0, np.zeros((720, 1280, 3), np.uint8))
            yield Candidate(frame, number % 3 == 0, Counted(frame))

    def search(mark: Counted, frame: VideoFrame, beside: Beside) -> FoundSigns:
        return FoundSigns((), np.zeros((0, 4)), np.zeros(0))

    for _ in detections(prefetched(source()), search, workers=2):
        pass
    assert most < 30


def test_workers_are_the_free_processors() -> None:
    assert 1 <= worker_count() <= 8
