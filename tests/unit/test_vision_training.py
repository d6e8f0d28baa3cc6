"""What the networks are trained on: drawings in many hands, numbers in many types."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from automap.vision.classes import load_classes
from automap.vision.faces import draw_face
from automap.vision.training.art import Face
from automap.vision.training.drawings import Drawings, group_of_face
from automap.vision.training.numbers import (
    LIMITS,
    letter_face,
    limit_face,
    limit_name,
    other_number,
)
from automap.vision.training.pictograms import picture_of, transplanted
from automap.vision.training.variants import varied

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
    assert training.other(rng)[1] == group_of_face(strange)
