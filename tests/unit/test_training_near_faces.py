"""What is near to a class: faces of none, words on its outline, things on streets."""

from __future__ import annotations

import numpy as np

from automap.signs.faces import draw_face
from pipeline.train.art import Face
from pipeline.train.look_alikes import LOOK_ALIKES
from pipeline.train.near_faces import beside, families, near_faces, words_in
from pipeline.train.worded import STOP, YIELD, worded

WALKER = "warning--pedestrians-crossing--g4"


def face(name: str) -> Face:
    return Face(name, draw_face(WALKER), "diamond", "yellow", "yellow", held=False)


def test_names_tell_what_pictures_have_in_common() -> None:
    assert words_in("warning--pedestrians-crossing") == {"pedestrians"}
    assert words_in("AU_W5_SA63") == frozenset()
    assert families(frozenset({"children", "bicycles"})) == {"people"}
    assert families(frozenset({"telephone"})) == {"telephone"}


def test_no_class_of_the_group_has_the_subject_of_a_near_face() -> None:
    rng = np.random.default_rng(1)
    ground = {"yellow-diamond": [face(WALKER)]}
    own = near_faces({"regulatory--bicycles-only": [face("regulatory--bicycles-only--g1")]}, ground)
    # bicycles are people's, whom warnings show
    assert all(own.draw("yellow-diamond", rng) is None for _ in range(20))
    foreign = near_faces({"information--telephone": [face("information--telephone--g1")]}, ground)
    drawn = [foreign.draw("yellow-diamond", rng) for _ in range(20)]
    assert sum(one is not None for one in drawn) > 10
    assert foreign.draw("green-square", rng) is None


def test_two_pictures_are_both_whole() -> None:
    rng = np.random.default_rng(2)
    one, other = np.full((40, 20), 255, np.uint8), np.full((20, 60), 255, np.uint8)
    for across in (True, False):
        both = beside(one, other, across, rng) > 127
        filled = both.any(axis=0 if across else 1)
        assert filled[0]
        assert filled[-1]
        # the gap between them
        assert (np.diff(filled.astype(int)) == 1).sum() == 1


def test_words_stand_on_the_outlines_of_stop_and_give_way() -> None:
    rng = np.random.default_rng(3)
    for name in (STOP, YIELD):
        for _ in range(30):
            drawn = worded(name, rng)
            assert drawn is not None
            red = drawn[:, :, 2].astype(int) - drawn[:, :, 0] > 60
            assert red.mean() > 0.1
            pale = (drawn[:, :, 1] > 150) & (drawn[:, :, 3] > 200)
            assert pale.mean() > 0.03
    assert worded("regulatory--no-entry--g1", rng) is None


def test_look_alikes_are_drawn_where_they_are_to_be() -> None:
    for draw in LOOK_ALIKES:
        rng = np.random.default_rng(4)
        street = np.full((200, 200, 3), 128, np.uint8)
        draw(street, (100, 100, 30.0), 200.0, rng)
        changed = (street != 128).any(axis=2)
        assert changed[85:115, 85:115].mean() > 0.3
        assert not changed[:, :30].any()
