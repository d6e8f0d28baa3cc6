"""The classical detector on drawn pictures."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from automap.vision.classical import ClassicalDetector
from automap.vision.faces import Image, draw_face, outline_points, usual_size
from automap.vision.shapes import match_shapes
from automap.vision.vocabulary import SHAPES, load_vocabulary

CLASSES = sorted(load_vocabulary().classes)
DETECTOR = ClassicalDetector()


def paste(image: Image, face: Image, x: float, y: float, size: float) -> np.ndarray:
    """Blend a face centred at (x, y) px; returns the true box of its unit square."""
    k, n = 4, face.shape[0]
    scale = size * k / n
    offset = (np.array([x, y]) + 0.5) * k - 0.5 - scale * (n - 1) / 2
    matrix = np.array([[scale, 0, offset[0]], [0, scale, offset[1]]])
    picture = face.astype(np.float32)
    picture[:, :, :3] *= picture[:, :, 3:] / 255.0
    h, w = image.shape[:2]
    fine = cv2.warpAffine(picture, matrix, (w * k, h * k), flags=cv2.INTER_LINEAR)
    small = cv2.resize(fine, (w, h), interpolation=cv2.INTER_AREA)
    mixed = image * (1 - small[:, :, 3:] / 255.0) + small[:, :, :3]
    image[:] = np.clip(np.rint(mixed), 0, 255).astype(np.uint8)
    return np.array([x - size / 2, y - size / 2, x + size / 2, y + size / 2])


def street(seed: int = 0, noise: float = 2.0) -> Image:
    """A grey and green picture 160 x 200 with noise, nothing in a sign's colours."""
    rng = np.random.default_rng(seed)
    image = np.full((160, 200, 3), 150, np.uint8)
    image[90:] = (80, 120, 95)
    image[:, 150:] = (120, 125, 130)
    return np.clip(image + rng.normal(0, noise, image.shape), 0, 255).astype(np.uint8)


def true_centre(name: str, box: np.ndarray) -> np.ndarray:
    points = outline_points(load_vocabulary().classes[name].outline)
    return box[:2] + (points.min(axis=0) + points.max(axis=0)) / 2 * (box[2:] - box[:2])


@pytest.mark.parametrize("name", CLASSES)
def test_every_known_face_gets_its_name_and_place(name: str) -> None:
    image = street()
    box = paste(image, draw_face(name), 80.3, 70.6, 40.0)
    found = DETECTOR.detect(cv2.GaussianBlur(image, (0, 0), 0.7))
    assert found.class_name == (name,)
    centre = (found.box[0, :2] + found.box[0, 2:]) / 2
    np.testing.assert_allclose(centre, true_centre(name, box), atol=0.15)
    width = found.box[0, 2] - found.box[0, 0]
    assert width == pytest.approx(40.0, abs=1.5)
    assert 0.8 < found.score[0] <= 1.0


@settings(max_examples=40, deadline=None)
@given(
    name=st.sampled_from(CLASSES),
    x=st.floats(40, 120),
    y=st.floats(40, 110),
    size=st.floats(18, 60),
    gain=st.floats(0.45, 1.05),
)
def test_place_holds_to_a_third_of_a_pixel(
    name: str, x: float, y: float, size: float, gain: float
) -> None:
    image = street(seed=int(size * 10))
    box = paste(image, draw_face(name), x, y, size)
    image = cv2.GaussianBlur(image, (0, 0), 0.6)
    image = np.clip(image * gain, 0, 255).astype(np.uint8)
    found = DETECTOR.detect(image)
    assert len(found) == 1
    vocabulary = load_vocabulary()
    group = vocabulary.groups[vocabulary.classes[name].group]
    assert found.class_name[0] in (name, group)
    centre = (found.box[0, :2] + found.box[0, 2:]) / 2
    assert np.abs(centre - true_centre(name, box)).max() < 0.34


@pytest.mark.parametrize("shape", ["circle", "triangle-up", "triangle-down"])
def test_an_unknown_red_face_is_named_after_colour_and_shape(shape: str) -> None:
    n = 256
    face = np.zeros((n, n, 4), np.uint8)
    outline = outline_points(shape)
    centre = outline.mean(axis=0)
    inner = centre + (outline - centre) * 0.72
    for points, colour in ((outline, (28, 18, 193, 255)), (inner, (240, 240, 240, 255))):
        cv2.fillPoly(face, [np.rint(points * n).astype(np.int32)], colour)
    cv2.drawMarker(face, (n // 2, int(centre[1] * n)), (20, 20, 20, 255), cv2.MARKER_STAR, 60, 18)
    image = street()
    paste(image, face, 80.0, 70.0, 44.0)
    found = DETECTOR.detect(image)
    kind = "warning" if shape == "triangle-up" else "regulatory"
    assert found.class_name == (f"{kind}--unknown-red-{shape}",)
    assert found.score[0] < 0.65


def test_an_unknown_blue_plate_is_no_known_sign() -> None:
    image = street()
    cv2.rectangle(image, (60, 50), (99, 89), (161, 92, 3), -1)
    cv2.line(image, (66, 84), (94, 56), (245, 245, 245), 5)
    cv2.line(image, (66, 56), (94, 84), (245, 245, 245), 5)
    assert DETECTOR.detect(image).class_name == ("information--unknown-blue-square",)


def test_plain_coloured_things_are_no_signs() -> None:
    image = street()
    cv2.rectangle(image, (20, 100), (60, 118), (40, 30, 190), -1)
    cv2.rectangle(image, (80, 40), (110, 70), (161, 92, 3), -1)
    cv2.circle(image, (140, 60), 12, (30, 20, 200), -1)
    cv2.fillConvexPoly(image, np.array([[40, 30], [55, 45], [40, 60], [25, 45]]), (0, 209, 255))
    assert len(DETECTOR.detect(image)) == 0


@pytest.mark.parametrize("seed", range(4))
def test_noise_and_gradients_hold_no_signs(seed: int) -> None:
    rng = np.random.default_rng(seed)
    assert len(DETECTOR.detect(rng.integers(0, 256, (200, 300, 3), dtype=np.uint8))) == 0
    ramp = np.linspace(0, 255, 300)[None, :, None] * rng.random(3)
    assert len(DETECTOR.detect(np.broadcast_to(ramp, (200, 300, 3)).astype(np.uint8))) == 0


def test_a_sign_cut_by_the_edge_has_no_centre_and_is_left_out() -> None:
    image = street()
    paste(image, draw_face("information--parking--g1"), 5.0, 70.0, 40.0)
    assert len(DETECTOR.detect(image)) == 0


def test_two_signs_side_by_side_are_two() -> None:
    image = street()
    paste(image, draw_face("regulatory--keep-left--g1"), 60.0, 70.0, 32.0)
    paste(image, draw_face("regulatory--maximum-speed-limit-60--g1"), 100.0, 70.0, 36.0)
    found = DETECTOR.detect(image)
    assert sorted(found.class_name) == [
        "regulatory--keep-left--g1",
        "regulatory--maximum-speed-limit-60--g1",
    ]


@pytest.mark.parametrize(
    "image",
    [np.zeros((20, 20), np.uint8), np.zeros((20, 20, 3)), np.zeros((20, 20, 4), np.uint8)],
)
def test_only_pictures_of_three_bytes_are_taken(image: np.ndarray) -> None:
    with pytest.raises(ValueError, match="three channels"):
        DETECTOR.detect(image)


def test_tiny_pictures_are_searched_without_harm() -> None:
    for size in ((1, 1), (3, 40), (11, 11)):
        assert len(DETECTOR.detect(np.full((*size, 3), 200, np.uint8))) == 0


@pytest.mark.parametrize("shape", SHAPES)
def test_an_outline_matches_itself_best(shape: str) -> None:
    points = outline_points(shape) * [38.0, 52.0] + [7.3, 11.9]
    overlaps = match_shapes(points)
    assert max(overlaps, key=overlaps.__getitem__) == shape
    assert overlaps[shape] > 0.95


def test_the_vocabulary_is_whole() -> None:
    vocabulary = load_vocabulary()
    assert {c.group for c in vocabulary.classes.values()} <= set(vocabulary.groups)
    assert {c.outline for c in vocabulary.classes.values()} <= set(SHAPES)
    for name in CLASSES:
        assert name.split("--")[0] in {"regulatory", "warning", "information"}
        assert vocabulary.group_of(vocabulary.groups[vocabulary.classes[name].group]) is not None
        assert usual_size(name) == vocabulary.classes[name].size_m
    assert usual_size("warning--unknown-yellow-diamond") == pytest.approx(0.75)
    assert usual_size("nonsense") is None
    assert vocabulary.group_of("nonsense") is None
