"""What the networks are trained on: drawings in many hands, numbers in many types."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from automap.signs.classes import load_classes
from automap.signs.faces import draw_face
from pipeline.train.art import Face
from pipeline.train.classifier_data import CropMaker, jittered
from pipeline.train.degrade import against_light
from pipeline.train.digits import road_digits
from pipeline.train.drawings import Drawings, group_of_face, group_of_kind
from pipeline.train.mirror import mirrored_name
from pipeline.train.numbers import (
    END_OF,
    LIMITS,
    end_face,
    letter_face,
    limit_face,
    limit_name,
    on_plate,
    other_end,
    other_number,
)
from pipeline.train.pictograms import picture_of, transplanted
from pipeline.train.subjects import foreign_pictures
from pipeline.train.variants import varied

Image = npt.NDArray[np.uint8]
CHILDREN, ROUNDABOUT = "warning--children--g2", "warning--roundabout--g2"


def alike(a: Image, b: Image) -> float:
    """Mean difference of two faces brought to one size, where both are solid."""
    size = (64, 64)
    one, other = (cv2.resize(x, size, interpolation=cv2.INTER_AREA).astype(float) for x in (a, b))
    solid = np.minimum(one[:, :, 3], other[:, :, 3]) > 200
    return float(np.abs(one - other)[solid, :3].mean())


@pytest.mark.parametrize("name", [CHILDREN, "regulatory--stop--g1", "information--parking--g1"])
def test_other_drawings_keep_the_outline_and_the_sense(name: str) -> None:
    face = draw_face(name)
    rng = np.random.default_rng(1)
    drawings = [varied(face, rng) for _ in range(12)]
    for other in drawings:
        assert other.shape[2] == 4
        assert max(other.shape[:2]) <= 112
        whole = cv2.resize(face, other.shape[1::-1], interpolation=cv2.INTER_AREA)
        assert np.abs(whole[:, :, 3].astype(int) - other[:, :, 3]).max() <= 1
        assert alike(face, other) < 70
    assert len({d.tobytes() for d in drawings}) > 9


@pytest.mark.parametrize("number", [5, 60, 110])
def test_limits_are_dark_numbers_in_red_rings(number: int) -> None:
    rng = np.random.default_rng(2)
    for _ in range(8):
        face = limit_face(number, rng)
        blue, _, red, cover = (face[:, :, k].astype(int) for k in range(4))
        solid = cover > 200
        assert 0.05 < ((red - blue > 60) & solid).mean() < 0.5
        dark = (face[:, :, :3].max(axis=2) < 90) & solid
        assert 0.01 < dark.mean() < 0.4
    assert limit_name(number) in load_classes()


def test_other_numbers_are_no_classes() -> None:
    rng = np.random.default_rng(3)
    assert not {other_number(rng) for _ in range(300)} & set(LIMITS)
    assert letter_face("P", rng).shape[2] == 4


def test_a_picture_moves_to_the_ground_of_another_sign() -> None:
    rng = np.random.default_rng(4)
    children, roundabout = draw_face(CHILDREN), draw_face(ROUNDABOUT)
    picture = picture_of(children)
    assert picture is not None
    mixed = transplanted(roundabout, picture, rng)
    assert mixed is not None
    small = cv2.resize(children, mixed.shape[1::-1], interpolation=cv2.INTER_AREA)
    assert alike(mixed, small) < 0.8 * alike(mixed, roundabout)
    plain = np.full((80, 80, 4), 255, np.uint8)
    assert picture_of(plain) is None
    assert transplanted(plain, picture, rng) is None


def face(name: str, shape: str, colour: str, held: bool = False) -> Face:
    image = draw_face(ROUNDABOUT)
    return Face(name, image, shape, colour, colour, held)


def test_held_drawings_are_never_trained_on() -> None:
    free = face("warning--roundabout--g2", "diamond", "yellow")
    held = face("AU_W2_7", "diamond", "yellow", held=True)
    variant = face("warning--roundabout--g6", "diamond", "yellow")
    strange = face("warning--camel-crossing--g1", "diamond", "yellow")
    kept = face("warning--kiwi-crossing--g1", "diamond", "yellow", held=True)
    faces = [free, held, variant, strange, kept]
    training, testing = Drawings(faces), Drawings(faces, held=True)
    assert training.art == {ROUNDABOUT: [free]}
    assert training.unknown == {"yellow-diamond": [strange]}
    assert testing.art == {ROUNDABOUT: [held]}
    assert testing.unknown == {"yellow-diamond": [kept]}
    rng = np.random.default_rng(5)
    image, name = testing.named(rng)
    assert name == ROUNDABOUT
    np.testing.assert_array_equal(image, held.image)
    assert training.named(rng)[1] == ROUNDABOUT
    kinds = {training.other(rng)[1] for _ in range(30)}
    kind = "yellow-diamond/warning--camel-crossing"
    # what is drawn by rule has no held picture in it
    assert kinds - {"red-triangle-down/words"} == {kind, "yellow-diamond/strange"}
    assert kinds <= set(training.kinds)
    assert group_of_kind(kind) == group_of_face(strange)


def holes(picture: Image) -> int:
    """Areas of black that white encloses."""
    framed = cv2.copyMakeBorder(picture, 4, 4, 4, 4, cv2.BORDER_CONSTANT, value=0)
    black = (framed < 128).astype(np.uint8)
    count, _, stats, _ = cv2.connectedComponentsWithStats(black, connectivity=4)
    return int((stats[1:, cv2.CC_STAT_AREA] > 12).sum()) - 1 if count > 1 else 0


@pytest.mark.parametrize(
    ("digit", "enclosed"), [("0", 1), ("2", 0), ("3", 0), ("5", 0), ("6", 1), ("8", 2), ("9", 1)]
)
def test_constructed_digits_keep_what_tells_them_apart(digit: str, enclosed: int) -> None:
    rng = np.random.default_rng(6)
    for _ in range(60):
        picture = road_digits(digit, rng)
        assert picture.shape[0] == 96
        assert holes(picture) == enclosed


def test_a_face_stands_on_a_plate() -> None:
    rng = np.random.default_rng(7)
    for _ in range(12):
        plate = on_plate(draw_face("regulatory--no-entry--g1"), rng)
        assert plate.shape[0] >= plate.shape[1]
        assert (plate[:, :, 3] == 255).all()
        red = plate[:, :, 2].astype(int) - plate[:, :, 0] > 60
        assert 0.1 < red.mean() < 0.7


def test_mirrors_exchange_left_and_right() -> None:
    assert mirrored_name("warning--curve-left--g1") == "warning--curve-right--g1"
    assert mirrored_name("warning--curve-left--g2") == "warning--curve-right--g2"
    assert mirrored_name("regulatory--no-entry--g1") == "regulatory--no-entry--g1"
    for unreadable in (limit_name(50), "regulatory--stop--g1", "regulatory--one-way-left--g2"):
        assert mirrored_name(unreadable) is None
    for name, entry in load_classes().items():
        other = mirrored_name(name)
        if other is not None:
            assert mirrored_name(other) == name
            assert load_classes()[other].group == entry.group


def test_pictures_against_the_light_lose_contrast_and_black() -> None:
    rng = np.random.default_rng(8)
    picture = np.zeros((40, 40, 3), np.uint8)
    picture[:, 20:] = 240
    for _ in range(10):
        spoilt = against_light(picture, rng).astype(float)
        assert spoilt[:, :20].mean() > 3
        assert spoilt[:, 20:].mean() - spoilt[:, :20].mean() < 190


def test_jittered_boxes_stay_about_the_sign() -> None:
    rng = np.random.default_rng(9)
    box = np.array([10.0, 20.0, 49.0, 59.0])
    moved = np.array([jittered(box, rng) for _ in range(2000)])
    np.testing.assert_allclose(moved.mean(axis=0), box, atol=0.3)
    wide = moved[:, 2] - moved[:, 0]
    assert 2.0 < wide.std() < 6.0


def test_the_end_of_a_limit_is_a_crossed_number_on_a_white_disc() -> None:
    rng = np.random.default_rng(4)
    for _ in range(6):
        face = end_face(END_OF, rng)
        assert face[0, 0, 3] == 0
        shown = face[face[:, :, 3] > 200][:, :3]
        assert np.percentile(shown, 75) > 200
        # the bar goes from the lower left to the upper right, through the middle or beside it
        middle = face[46:66, 46:66, :3].min(axis=2)
        assert middle.min() < 120
    assert END_OF not in {other_end(rng) for _ in range(200)}


def test_pictures_are_foreign_to_a_group_by_what_they_show() -> None:
    picture = draw_face("warning--children--g2")
    faces = [
        Face(name, picture, "diamond", "yellow", "yellow", False)
        for name in ("warning--children", "warning--ufo", "warning--double-turn", "AU_W2_7")
    ]
    by_base = {face.name: [face] for face in faces}
    pictures = foreign_pictures(by_base, ("yellow-diamond", "red-circle"))
    # children are a class of yellow diamonds; ways look alike whatever they are called, and a code
    # does not tell what is shown
    assert {group: len(of) for group, of in pictures.items()} == {
        "yellow-diamond": 1, "red-circle": 2,
    }  # fmt: skip


@pytest.mark.slow
def test_a_training_without_a_picture_of_a_class_is_refused() -> None:
    circle = np.zeros((96, 96, 4), np.uint8)
    cv2.circle(circle, (48, 48), 46, (30, 30, 200, 255), -1)
    faces = [
        Face(name, circle, "circle", "red", "red", held=False)
        for entry in load_classes().values()
        for name in entry.art
    ]
    CropMaker([], [], faces).require_every_class()
    kept = [face for face in faces if face.name not in load_classes()[CHILDREN].art]
    with pytest.raises(ValueError, match=f"no drawing and no crop of {CHILDREN};"):
        CropMaker([], [], kept).require_every_class()
