"""Faces composed by rule keep what their meaning hangs on."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from automap.signs.classes import load_classes
from automap.signs.faces import draw_face
from pipeline.train.art import Face
from pipeline.train.boards import other_board
from pipeline.train.composed import crossing_face, mandatory, on_board, prohibition
from pipeline.train.drawings import Drawings, group_of_kind
from pipeline.train.layouts import bars, road_layout, words
from pipeline.train.numbers import letter_symbol, on_plate, worded_board
from pipeline.train.people import person
from pipeline.train.pictograms import ground_of, redrawn, regrounded, silhouette_of
from pipeline.train.recipes import other_prohibition, recipes, words_of
from pipeline.train.subjects import mixed_picture
from pipeline.train.symbols import (
    cropped,
    forked_arrow,
    hand_in_hand,
    opposite_arrows,
    pointing_arrow,
    riding,
    ring_of_arrows,
    strange_symbol,
    turn_arrow,
)

Image = npt.NDArray[np.uint8]
PEDESTRIAN = "warning--pedestrians-crossing--g4"
NO_BICYCLES = "regulatory--no-bicycles--g2"


def red_share(face: Image) -> float:
    red = face[:, :, 2].astype(int) - face[:, :, 0] > 60
    return float((red & (face[:, :, 3] > 127)).mean())


def dark(face: Image) -> npt.NDArray[np.bool_]:
    return np.asarray((face[:, :, :3].max(axis=2) < 90) & (face[:, :, 3] > 200))


@pytest.mark.parametrize("way", ["left", "right"])
def test_turning_arrows_point_where_they_are_to(way: str) -> None:
    rng = np.random.default_rng(1)
    for _ in range(40):
        picture = turn_arrow(way, rng) > 127
        high, wide = picture.shape
        # the shaft stands on the one side of the lowest rows, the head lies on the other
        foot = float(np.nonzero(picture[-max(3, high // 12) :])[1].mean()) / wide
        edge = picture[:, : wide // 6] if way == "left" else picture[:, -(wide // 6) :]
        assert (foot > 0.5) == (way == "left")
        assert np.nonzero(edge)[0].mean() < 0.6 * high


def test_u_turns_come_back_and_arrows_ahead_do_not() -> None:
    rng = np.random.default_rng(2)
    for _ in range(40):
        back = turn_arrow("u", rng) > 127
        runs = np.diff(np.pad(back[back.shape[0] * 45 // 100].astype(int), 1))
        # two legs, and the barbs of the head at times
        assert (runs == 1).sum() >= 2
        ahead = turn_arrow("straight", rng) > 127
        assert ahead[:, ahead.shape[1] // 2].mean() > 0.9


def test_a_bar_adds_red_and_keeps_the_symbol() -> None:
    with_bar, without = (
        [prohibition(letter_symbol("P", rng), bar, rng) for _ in range(15)]
        for bar, rng in ((True, np.random.default_rng(3)), (False, np.random.default_rng(3)))
    )
    for face in with_bar + without:
        assert face.shape == (112, 112, 4)
        assert 0.015 < dark(face).mean() < 0.4
        # the ring alone is left free of all that is not its own
        assert face[0, 0, 3] == 0
    share = [np.mean([red_share(face) for face in faces]) for faces in (with_bar, without)]
    assert share[0] > share[1] + 0.03


def test_a_silhouette_has_one_ink_and_moves_to_other_grounds() -> None:
    rng = np.random.default_rng(4)
    walking = silhouette_of(draw_face(PEDESTRIAN))
    assert walking is not None
    assert 0.1 < (walking > 127).mean() < 0.9
    # red, amber and green are no one ink
    assert silhouette_of(draw_face("warning--traffic-signals--g2")) is None
    keep = draw_face("regulatory--keep-left--g1")
    moved = redrawn(keep, walking, rng)
    assert moved is not None
    # white as the arrow was, not black as the walker
    assert (moved[30:80, 30:80, :3].min(axis=2) > 200).mean() > 0.05
    assert dark(moved).mean() < 0.02
    face = crossing_face(walking, rng)
    blue = face[:, :, 0].astype(int) - face[:, :, 2] > 60
    white = face[:, :, :3].min(axis=2) > 180
    assert blue.mean() > 0.2
    assert white.mean() > 0.1


def test_figures_stand_beside_each_other_and_ride() -> None:
    rng = np.random.default_rng(9)
    figure = np.full((60, 24), 255, np.uint8)
    wheels = np.full((40, 80), 128, np.uint8)
    for _ in range(20):
        pair = hand_in_hand(figure, figure, rng)
        # one is as high as the picture, the other a child, close to it or apart
        heights = np.unique((pair > 127).sum(axis=0))
        assert heights[-1] == pair.shape[0]
        assert ((0.4 * pair.shape[0] < heights) & (heights < 0.9 * pair.shape[0])).any()
        rider = riding(figure, wheels, rng)
        assert rider.shape[0] == pair.shape[0]
        assert (rider[-1] == 128).sum() > 1.5 * (rider[2] == 255).sum() > 0
        assert (rider[2] < 128).any()


def test_faces_on_boards_and_plates_are_whole() -> None:
    rng = np.random.default_rng(5)
    stop = draw_face("regulatory--stop--g1")
    for _ in range(10):
        board = on_board(stop, rng)
        assert (board[:, :, 3] == 255).all()
        assert min(board.shape[:2]) > 112
    for text in ("", "NO LEFT TURN", "NO HEAVY GOODS VEHICLES"):
        for _ in range(10):
            plate = on_plate(stop, rng, text)
            assert plate.shape[1] == 112
            assert red_share(plate) > 0.08


def test_classes_are_drawn_by_rule_with_free_pictures_only() -> None:
    image = draw_face(PEDESTRIAN)
    source = Face(PEDESTRIAN, image, "diamond", "yellow", "yellow", held=False)
    rules = recipes([("warning--pedestrians-crossing", source)])
    rng = np.random.default_rng(6)
    assert rules.composed("regulatory--no-pedestrians--g2", rng) is not None
    # nothing shows a bicycle
    assert rules.composed(NO_BICYCLES, rng) is None
    assert rules.composed("regulatory--yield--g1", rng) is None
    assert rules.redrawn("regulatory--stop--g1", image, rng) is None
    for name in ("regulatory--no-u-turn--g1", "regulatory--no-stopping--g5"):
        face = rules.composed(name, rng)
        assert name in load_classes()
        assert face is not None
        assert red_share(face) > 0.1
    assert red_share(other_prohibition(rng)) > 0.1
    assert words_of("regulatory--no-left-turn--g1") == "NO LEFT TURN"


def test_held_pictures_are_not_drawn_by_rule() -> None:
    ring = np.zeros((96, 96, 4), np.uint8)
    cv2.circle(ring, (48, 48), 46, (30, 30, 200, 255), -1)
    cv2.circle(ring, (48, 48), 38, (250, 250, 250, 255), -1)
    free = Face(NO_BICYCLES, ring, "circle", "red", "red", held=False)
    bicycle = draw_face(PEDESTRIAN)
    held = Face("regulatory--bicycles-only--g9", bicycle, "diamond", "yellow", "yellow", held=True)
    drawings = Drawings([free, held])
    rng = np.random.default_rng(7)
    for _ in range(30):
        face, name = drawings.named(rng)
        assert name == NO_BICYCLES
        # the held picture is black, and the free face has no black but that of plates
        if face[0, 0, 3] == 0:
            assert dark(face)[20:-20, 20:-20].mean() < 0.02


def test_strange_pictures_make_unknown_faces() -> None:
    rng = np.random.default_rng(8)
    symbols = [strange_symbol(rng) for _ in range(40)]
    assert len({symbol.tobytes() for symbol in symbols}) > 15
    assert all((symbol > 127).any() for symbol in symbols)
    warning = Face(PEDESTRIAN, draw_face(PEDESTRIAN), "diamond", "yellow", "yellow", held=False)
    camel = Face(
        "warning--camel-crossing--g1", draw_face("warning--roundabout--g2"), "diamond", "yellow",
        "yellow", held=False,
    )  # fmt: skip
    drawings = Drawings([warning, camel])
    kinds = {drawings.other(rng)[1] for _ in range(60)}
    # boards with words come whatever faces there are
    kinds.discard("red-triangle-down/words")
    assert kinds == {"yellow-diamond/warning--camel-crossing", "yellow-diamond/strange"}
    assert kinds <= set(drawings.kinds)
    assert {group_of_kind(kind) for kind in kinds} == {"yellow-diamond"}


def test_people_of_strokes_differ_and_stand_on_their_feet() -> None:
    rng = np.random.default_rng(10)
    people = [person(rng) > 127 for _ in range(40)]
    assert len({figure.tobytes() for figure in people}) == 40
    for figure in people:
        high, wide = figure.shape
        assert 100 < high < 160
        assert 0.15 * high < wide < 1.2 * high
        # the head alone is highest, and nothing lies beside the body as a piece of its own
        assert figure[0].sum() < 0.25 * high
        assert cv2.connectedComponents(figure.astype(np.uint8))[0] <= 3
        assert 0.08 < figure.mean() < 0.75


def test_of_opposite_arrows_one_points_up_and_one_down() -> None:
    rng = np.random.default_rng(11)
    for _ in range(30):
        pair = opposite_arrows(rng) > 127
        above = []
        third = pair.shape[1] // 3
        for outer in (pair[:, :third], pair[:, -third:]):
            # a head makes its end the wider one
            rows = outer.sum(axis=1)[outer.any(axis=1)]
            third = len(rows) // 3
            above.append(rows[:third].sum() > rows[-third:].sum())
        assert sorted(above) == [False, True]


def test_a_warning_comes_on_the_grounds_of_others_with_its_own_picture() -> None:
    face = draw_face("warning--children--g2")
    green = np.array([40.0, 230.0, 190.0])
    other = regrounded(face, green)
    assert np.abs(ground_of(other) - green).max() < 6
    assert np.abs(ground_of(face) - green).max() > 40
    own, kept = silhouette_of(face), silhouette_of(other)
    assert own is not None
    assert kept is not None
    assert own.shape == kept.shape
    assert ((own > 127) == (kept > 127)).mean() > 0.98
    assert (other[:, :, 3] > 127).sum() > 0.9 * 112 * 112 / 2


def test_pictures_of_no_class_keep_away_from_those_of_classes() -> None:
    rng = np.random.default_rng(12)
    for make in (road_layout, words, bars):
        pictures = [make(rng) for _ in range(40)]
        assert len({picture.tobytes() for picture in pictures}) > 25
        assert all(0.08 < (picture > 127).mean() < 0.9 for picture in pictures)
    for _ in range(40):
        road = road_layout(rng) > 127
        # wider than one road: something leaves it, and no crossroads of two straight ones
        assert road.any(axis=0).sum() > 1.5 * np.median(road.sum(axis=1))
        assert not (road == road[:, ::-1]).all()


def foot_of(picture: Image) -> float:
    """Where a picture's lowest rows are drawn on, as a part of its width."""
    low = picture[-max(3, len(picture) // 12) :] > 127
    return float(np.nonzero(low)[1].mean() + 0.5) / picture.shape[1]


@pytest.mark.parametrize("degrees", [0.0, 90.0, -90.0, 135.0, -135.0])
def test_arrows_point_where_they_are_turned(degrees: float) -> None:
    rng = np.random.default_rng(21)
    for _ in range(30):
        picture = cv2.copyMakeBorder(pointing_arrow(degrees, rng), 40, 40, 40, 40, 0)
        size = picture.shape[::-1]
        back = cv2.getRotationMatrix2D((size[0] / 2, size[1] / 2), degrees, 1.0)
        upright = cropped(np.asarray(cv2.warpAffine(picture, back, size), np.uint8))
        wide = (upright > 127).sum(axis=1)
        # turned back it stands upright, and the head is wider than the end of the shaft
        assert wide[: len(wide) * 3 // 4].max() > 1.3 * wide[-len(wide) // 5 :].max()


def test_forked_arrows_leave_the_shaft_to_their_sides() -> None:
    rng = np.random.default_rng(22)
    for _ in range(30):
        assert foot_of(forked_arrow(("straight", "left"), rng)) > 0.5
        assert foot_of(forked_arrow(("straight", "right"), rng)) < 0.5
        assert abs(foot_of(forked_arrow(("left", "right"), rng)) - 0.5) < 0.05


def test_arrows_around_a_circle_leave_its_middle_free_and_are_three() -> None:
    rng = np.random.default_rng(23)
    for _ in range(30):
        picture = ring_of_arrows(rng)
        count, _, stats, _ = cv2.connectedComponentsWithStats((picture > 127).astype(np.uint8))
        large = stats[1:count, cv2.CC_STAT_AREA] > 0.1 * stats[1:count, cv2.CC_STAT_AREA].sum()
        assert large.sum() <= 3
        high, wide = picture.shape
        assert picture[high * 2 // 5 : high * 3 // 5, wide * 2 // 5 : wide * 3 // 5].mean() < 60


def test_orders_are_white_on_a_blue_disc_and_ended_ones_have_a_red_bar() -> None:
    symbol = pointing_arrow(0.0, np.random.default_rng(24))
    plain, ended = (
        [mandatory(symbol, np.random.default_rng(k), barred) for k in range(20)]
        for barred in (False, True)
    )
    for face, other in zip(plain, ended, strict=True):
        blue = face[:, :, 0].astype(int) - face[:, :, 2] > 40
        assert 0.3 < float((blue & (face[:, :, 3] > 127)).mean()) < 0.79
        assert face[0, 0, 3] == 0
        assert red_share(face) < 0.005
        assert red_share(other) > 0.03


@pytest.mark.parametrize("corners", [3, 8])
def test_boards_with_words_are_mostly_red_with_something_white_inside(corners: int) -> None:
    rng = np.random.default_rng(25)
    for _ in range(30):
        face = worded_board(corners, "", rng)
        assert red_share(face) > (0.22 if corners == 3 else 0.4)
        rows = slice(8, 56) if corners == 3 else slice(36, 76)
        assert face[rows, 30:82, 1].max() > 150


def test_boards_are_plates_of_their_group_with_something_on_them() -> None:
    rng = np.random.default_rng(21)
    groups = set()
    for _ in range(60):
        face, group = other_board(rng)
        groups.add(group)
        assert int(face[:, :, 3].min()) == 255
        inner = face[8:-8, 8:-8, :3].reshape(-1, 3).astype(int)
        # no ink is as bright in green
        ground = inner[inner[:, 1].argmax()]
        assert (ground[0] < 90) == (group == "yellow-square")
        drawn = (np.abs(inner - ground).max(axis=1) > 60).mean()
        assert 0.005 < drawn < 0.9
        assert 0.5 < face.shape[0] / face.shape[1] < 2.0
    assert groups == {"white-square", "yellow-square"}


def test_a_mixed_picture_is_none_of_its_two() -> None:
    rng = np.random.default_rng(22)
    upright = np.zeros((96, 96), np.uint8)
    upright[:, 40:56] = 255
    lying = np.asarray(upright.T, np.uint8)
    mixed = [mixed_picture([upright, lying], rng) for _ in range(30)]
    made = [picture for picture in mixed if picture is not None]
    assert len(made) > 5
    for picture in made:
        for one in (upright, lying):
            both, any_ = (picture > 127) & (one > 127), (picture > 127) | (one > 127)
            assert 0.1 < both.sum() / any_.sum() < 0.5
    # of two that are alike there is none
    assert mixed_picture([upright, upright], rng) is None
