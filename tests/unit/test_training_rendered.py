"""Figures of drawn faces: every drawing as often as every other, and how sure the shares are."""

from __future__ import annotations

import numpy as np
import pytest

from automap.signs.classes import load_classes
from automap.vision.detector import FoundSigns
from automap.vision.network import NetworkDetector
from pipeline.train.rendered import Scene, in_turn, judge_scenes

UNKNOWN = "warning--unknown-yellow-diamond"
CHILDREN = "warning--children--g2"
BOX = np.array([[10.0, 10.0, 40.0, 40.0]])
PICTURE = np.zeros((8, 8, 3), np.uint8)


class Told(NetworkDetector):
    """Says of each picture in turn what it was told to say, None for nothing."""

    def __init__(self, names: list[str | None]) -> None:
        self._left = list(names)

    def detect(self, image, region=None, zoom=1.0):  # type: ignore[no-untyped-def]
        name = self._left.pop(0)
        if name is None:
            return FoundSigns((), BOX[:0], np.zeros(0))
        return FoundSigns((name,), BOX, np.full(1, 0.9))


def test_every_drawing_comes_up_as_often_as_every_other() -> None:
    faces = [(np.full((4, 4, 4), k, np.uint8), str(k)) for k in range(7)]
    draw = in_turn(faces)
    names = [draw(np.random.default_rng(k))[1] for k in range(21)]
    for start in (0, 7, 14):
        assert sorted(names[start : start + 7]) == [str(k) for k in range(7)]


def test_shares_are_of_what_was_found_and_as_sure_as_drawings_are_many() -> None:
    assert CHILDREN in load_classes()
    # of two drawings one is always taken for a class, and one face is not found
    said = [CHILDREN, UNKNOWN, CHILDREN, UNKNOWN, None]
    made = [Scene(PICTURE, BOX, (UNKNOWN,), (number,)) for number in (1, 2, 1, 2, 2)]
    outcome = judge_scenes(Told(said), made)
    assert outcome.faces == 5
    assert outcome.found.value == pytest.approx(0.8)
    assert outcome.right.value == pytest.approx(0.5)
    assert outcome.wrong.value == pytest.approx(0.5)
    assert (outcome.wrong.low, outcome.wrong.high) == (0.0, 1.0)
    assert outcome.by_name == {UNKNOWN: (4, 2)}
