"""The trained detector and classifier: decoding, naming, and what they make of plain scenes."""

from __future__ import annotations

import pickle
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

from automap.errors import InputError
from automap.signs.classes import country_set, load_classes, national_code
from automap.signs.faces import draw_face, usual_size
from automap.signs.vocabulary import SHAPES, load_vocabulary
from automap.vision import limits
from automap.vision.boxes import decode_maps, distinct
from automap.vision.classifier import CROP_PX, Named, SignClassifier, crop_faces
from automap.vision.fine import fine_windows
from automap.vision.limits import FACE_MARGIN
from automap.vision.network import NetworkDetector, NetworkRules, blocks_of, default_detector
from automap.vision.scoring import doubted, joint_score, least_found, sign_score, supported

Image = npt.NDArray[np.uint8]
NOTHING = np.zeros((6, 40, 60), np.float32) - 9.0


def maps_with(cells: list[tuple[int, int, float, tuple[float, float, float, float]]]) -> np.ndarray:
    """Maps with a peak at each (row, column, logit, distances in px)."""
    maps = NOTHING.copy()
    for row, column, logit, distances in cells:
        maps[0, row, column] = logit
        maps[2:, row, column] = np.log(np.array(distances) / 4.0)
    return maps


def test_a_peak_becomes_a_box_around_the_middle_of_its_cell() -> None:
    boxes, scores = decode_maps(maps_with([(10, 20, 2.0, (8, 6, 12, 10))]), 0.1, 50)
    assert scores == pytest.approx([1.0 / (1.0 + np.exp(-2.0))])
    np.testing.assert_allclose(boxes, [[81.5 - 8, 41.5 - 6, 81.5 + 12, 41.5 + 10]], rtol=1e-6)


def test_only_the_highest_of_neighbours_counts() -> None:
    maps = maps_with([(10, 20, 2.0, (9, 9, 9, 9)), (10, 21, 3.0, (9, 9, 9, 9)),
                      (30, 40, -1.0, (9, 9, 9, 9)), (5, 5, -8.0, (9, 9, 9, 9))])  # fmt: skip
    boxes, scores = decode_maps(maps, 0.1, 50)
    assert len(boxes) == 2
    assert scores[0] > scores[1]
    assert (boxes[0, :2] + boxes[0, 2:]).tolist() == pytest.approx([2 * 85.5, 2 * 41.5])


@given(st.lists(st.tuples(st.floats(0, 90), st.floats(0, 90), st.floats(5, 40)), max_size=12))
def test_distinct_boxes_do_not_overlap(places: list[tuple[float, float, float]]) -> None:
    boxes = np.array([[x, y, x + s, y + s] for x, y, s in places]).reshape(-1, 4)
    scores = np.linspace(1.0, 0.5, len(boxes))
    kept = distinct(boxes, scores, 0.4)
    assert len(boxes) == 0 or kept[0] == 0
    for k, i in enumerate(kept):
        for j in kept[:k]:
            sides = np.minimum(boxes[i, 2:], boxes[j, 2:]) - np.maximum(boxes[i, :2], boxes[j, :2])
            common = float(np.prod(np.maximum(sides, 0.0)))
            areas = [float(np.prod(boxes[n, 2:] - boxes[n, :2])) for n in (i, j)]
            assert common <= 0.4 * (sum(areas) - common) + 1e-9


def test_a_small_better_box_takes_no_large_sign_away() -> None:
    # a letter, or another sign in front, within a large sign; a plate and its sign
    boxes = np.array([[100.0, 100.0, 400.0, 400.0], [110.0, 300.0, 160.0, 350.0]])
    assert distinct(boxes, np.array([0.7, 0.9]), 0.4, 0.8, 0.2).tolist() == [1, 0]
    assert distinct(boxes, np.array([0.9, 0.7]), 0.4, 0.8, 0.2).tolist() == [0]
    framed = np.array([[100.0, 100.0, 200.0, 300.0], [105.0, 105.0, 195.0, 195.0]])
    assert distinct(framed, np.array([0.7, 0.9]), 0.4, 0.8, 0.2).tolist() == [1]


def test_what_two_copies_show_is_surer_than_what_one_does() -> None:
    boxes = np.array(
        [[10.0, 10, 210, 210], [14, 12, 208, 214], [10, 10, 210, 210], [500, 0, 550, 50]]
    )
    scores = np.array([0.6, 0.5, 0.55, 0.6])
    copies = np.array([[1.0, 70], [2, 35], [1, 70], [1, 70]])
    sure = supported(boxes, scores, copies)
    assert (sure >= scores - 1e-12).all()
    # two boxes of one copy are one look, what is small in a copy is none, and the first copy
    # is judged by itself
    assert (sure[:3] > scores[:3]).all()
    assert sure[3] == pytest.approx(scores[3])
    alone = supported(boxes[[0, 2]], scores[[0, 2]], copies[[0, 2]])
    np.testing.assert_allclose(alone, scores[[0, 2]])
    faint = supported(boxes[:2], scores[:2], np.array([[1.0, 70], [2, 12]]))
    assert faint[0] == pytest.approx(scores[0])
    first = supported(boxes[:2], scores[:2], np.array([[0.0, 280], [1, 70]]))
    assert first[0] == pytest.approx(scores[0])
    assert first[1] > scores[1]


@given(st.floats(0.01, 0.99))
def test_what_is_not_read_could_not_be_reported(score: float) -> None:
    weights = (-2.7, 2.7, 0.45)
    least = least_found(score, weights)
    assert joint_score(least, 1.0, weights) == pytest.approx(score, rel=1e-6)
    assert joint_score(0.99 * least, 1.0, weights) < score


@given(st.floats(0.0, 1.0), st.floats(0.0, 1.0), st.floats(0.0, 1.0))
def test_a_little_of_a_board_costs_a_little(found: float, sign: float, board: float) -> None:
    face, weights = Named("x", (), sign, board, 1.0), (-2.7, 2.7, 0.45)
    plain = sign_score(found, face, False, 6.7, weights)
    assert sign_score(found, face, True, 6.7, weights) == pytest.approx(
        plain * (1.0 - board), abs=limits.SURE
    )


class FixedModel:
    """A network whose logits are given."""

    def __init__(self, logits: np.ndarray) -> None:
        labels = [*load_classes(), *load_vocabulary().groups, "no-sign"]
        self.notes = {"labels": labels, "temperature": 1.0}
        self.logits = logits

    def run(self, crops: Image) -> np.ndarray:
        return np.tile(self.logits, (len(crops), 1))


def classifier_saying(country: str | None = None, **probabilities: float) -> SignClassifier:
    classifier = SignClassifier(country)
    labels = [*load_classes(), *load_vocabulary().groups, "no-sign"]
    p = np.full(len(labels), 1e-6)
    for name, value in probabilities.items():
        p[labels.index(name)] = value
    classifier._model = FixedModel(np.log(p).astype(np.float32))  # type: ignore[assignment]
    return classifier


FIFTY = "regulatory--maximum-speed-limit-50--g1"
SIXTY = "regulatory--maximum-speed-limit-60--g1"
GREY = np.full((90, 90, 3), 128, np.uint8)
BOX = np.array([[20.0, 20.0, 60.0, 60.0]])


def test_a_certain_face_is_named_with_its_alternatives() -> None:
    named = classifier_saying(**{FIFTY: 0.8, SIXTY: 0.15, "no-sign": 0.05}).name(GREY, BOX)[0]
    assert named.name == FIFTY
    assert named.sign == pytest.approx(0.95, abs=0.01)
    assert named.alternatives[0] == (FIFTY, pytest.approx(0.8 / 0.95, abs=0.01))
    assert named.alternatives[1][0] == SIXTY


def test_a_doubtful_face_is_named_after_its_colour_and_shape() -> None:
    named = classifier_saying(**{FIFTY: 0.45, SIXTY: 0.45, "yellow-diamond": 0.1}).name(GREY, BOX)
    assert named[0].name == "regulatory--unknown-red-circle"
    named = classifier_saying(**{FIFTY: 0.1, "yellow-diamond": 0.9}).name(GREY, BOX)
    assert named[0].name == "warning--unknown-yellow-diamond"


def test_a_country_prefers_its_own_signs_but_forbids_none() -> None:
    foreign, own = "warning--children--g1", "warning--children--g2"
    even = {foreign: 0.7, own: 0.3}
    assert classifier_saying(**even).name(GREY, BOX)[0].name == foreign
    assert classifier_saying("AU", **even).name(GREY, BOX)[0].name == own
    assert classifier_saying("AU", **{foreign: 0.999}).name(GREY, BOX)[0].name == foreign


def test_where_the_signs_are_known_fewer_are_taken_for_strange_ones() -> None:
    even = {FIFTY: 0.6, "red-circle": 0.4}
    share = {}
    for country in ("AU", "DE", "US", None):
        named = classifier_saying(country, **even).name(GREY, BOX)[0]
        share[country] = dict(named.alternatives)[FIFTY]
        assert (named.name == FIFTY) == (country in ("AU", "DE"))
    assert share["AU"] == pytest.approx(share["DE"], abs=0.01)
    assert share["DE"] == pytest.approx(0.788, abs=0.01)
    assert share["US"] == share[None] == pytest.approx(0.357, abs=0.01)


@pytest.mark.parametrize("country", ["AU", "US"])
def test_the_country_does_not_say_whether_there_is_a_sign(country: str) -> None:
    foreign = "warning--children--g1"
    for face in (foreign, FIFTY, "red-circle"):
        named = classifier_saying(country, **{face: 0.7, "no-sign": 0.3}).name(GREY, BOX)[0]
        assert named.sign == pytest.approx(0.7, abs=0.01)


@pytest.mark.parametrize("size", [9.0, 24.0, 48.0, 200.0])
def test_crops_hold_the_box_in_their_middle(size: float) -> None:
    image = np.zeros((300, 300, 3), np.uint8)
    box = np.array([40.0, 50.0, 40.0 + size - 1.0, 50.0 + size - 1.0])
    cv2.rectangle(image, (40, 50), (round(39 + size), round(49 + size)), (255, 255, 255), -1)
    crop = crop_faces(image, box[None])[0]
    assert crop.shape == (CROP_PX, CROP_PX, 3)
    weight = crop[:, :, 0].astype(float)
    rows, columns = np.mgrid[0:CROP_PX, 0:CROP_PX]
    middle = (CROP_PX - 1) / 2.0
    assert (weight * rows).sum() / weight.sum() == pytest.approx(middle, abs=0.15)
    assert (weight * columns).sum() / weight.sum() == pytest.approx(middle, abs=0.15)
    assert weight.mean() / 255.0 == pytest.approx((1.0 + 2.0 * FACE_MARGIN) ** -2, rel=0.06)


def test_a_crop_beyond_the_picture_is_filled_up() -> None:
    crops = crop_faces(
        GREY, np.array([[-400.0, -400.0, -300.0, -300.0], [80.0, 80.0, 130.0, 99.0]])
    )
    assert crops.shape == (2, CROP_PX, CROP_PX, 3)
    assert (crops[0] == 128).all()


def street(names: list[str], size: int) -> tuple[Image, np.ndarray]:
    """A road, houses, sky and faces on poles; their boxes."""
    rng = np.random.default_rng(2)
    image = np.empty((512, 768, 3), np.uint8)
    image[:230], image[230:] = (225, 205, 180), (95, 95, 92)
    for x in range(0, 768, 96):
        colour = tuple(int(v) for v in rng.integers(80, 190, 3))
        cv2.rectangle(image, (x, 120 + int(rng.integers(0, 60))), (x + 80, 260), colour, -1)
    boxes = []
    for k, name in enumerate(names):
        x, y = 60 + k * (660 // len(names)), 150 + 40 * (k % 3)
        cv2.line(image, (x + size // 2, y), (x + size // 2, y + 5 * size), (120, 120, 120), 3)
        face = cv2.resize(draw_face(name), (size, size), interpolation=cv2.INTER_AREA)
        cover = face[:, :, 3:] / 255.0
        part = image[y : y + size, x : x + size]
        part[:] = (0.85 * face[:, :, :3] * cover + part * (1 - cover)).astype(np.uint8)
        boxes.append([x, y, x + size - 1, y + size - 1])
    image = cv2.GaussianBlur(image, (0, 0), 0.7)
    noisy = image + rng.normal(0, 3, image.shape)
    return np.clip(noisy, 0, 255).astype(np.uint8), np.array(boxes, float)


@pytest.fixture(scope="module")
def detector() -> NetworkDetector:
    return default_detector("AU")


FACES = [SIXTY, "regulatory--stop--g1", "regulatory--yield--g1", "warning--roundabout--g2",
         "regulatory--no-entry--g1"]  # fmt: skip


def test_faces_along_a_street_are_found_and_named(detector: NetworkDetector) -> None:
    image, boxes = street(FACES, 44)
    found = detector.detect(image)
    best = {}
    for i in range(len(found)):
        middle = (found.box[i, :2] + found.box[i, 2:]) / 2
        for name, box in zip(FACES, boxes, strict=True):
            if (np.abs(middle - (box[:2] + box[2:]) / 2) < 5).all() and found.score[i] > 0.3:
                best[name] = found.class_name[i]
    assert len(best) >= 4
    assert sum(name == given for name, given in best.items()) >= len(best) - 1
    assert found.alternatives is not None
    assert all(a[0][1] >= a[-1][1] for a in found.alternatives if a)


@pytest.mark.parametrize("name", ["regulatory--stop--g1", SIXTY])
@pytest.mark.parametrize("size", [60, 130, 240, 440])
def test_a_sign_of_any_size_is_found_once(detector: NetworkDetector, name: str, size: int) -> None:
    image = cv2.resize(street([], 0)[0], (1024, 683))
    face = cv2.resize(draw_face(name), (size, size), interpolation=cv2.INTER_AREA)
    cover = face[:, :, 3:] / 255.0
    x, y = 300, 120
    part = image[y : y + size, x : x + size]
    part[:] = (0.85 * face[:, :, :3] * cover + part * (1 - cover)).astype(np.uint8)
    found = detector.detect(np.asarray(image, np.uint8))
    middle = (found.box[:, :2] + found.box[:, 2:]) / 2
    here = np.abs(middle - [x + size / 2, y + size / 2]).max(axis=1) < 0.5 * size
    here &= found.score > 0.5
    assert here.sum() == 1
    assert found.class_name[int(np.argmax(here))] == name
    sides = found.box[here][0, 2:] - found.box[here][0, :2]
    np.testing.assert_allclose(sides, size, rtol=0.12)


def test_a_region_of_another_zoom_is_searched_at_that_alone(detector: NetworkDetector) -> None:
    image = street(FACES, 44)[0]
    assert detector.zooms_of(image, (0, 0, 768, 512)) == [2.0, 0.5, 0.25, 0.125]
    # no sign is as large as a copy of a few pixels shows
    assert detector.zooms_of(image, (0, 0, 100, 100)) == [2.0]
    scored = detector.detect(image, zoom=0.25)
    assert all((scored.box[:, 2:] - scored.box[:, :2]).max(axis=1) > 20.0)


def test_a_region_is_looked_at_alone(detector: NetworkDetector) -> None:
    image, boxes = street(FACES, 44)
    region = (boxes[1, 0] - 60.0, 90.0, boxes[1, 2] + 60.0, 330.0)
    found = detector.detect(image, region)
    assert len(found) > 0
    assert (found.box[:, 0] > region[0] - 30).all()
    assert (found.box[:, 2] < region[2] + 30).all()
    assert detector.detect_in(image, region).class_name == found.class_name
    whole = detector.detect(image)
    near = np.abs(whole.box - found.box[0]).max(axis=1)
    assert near.min() < 3.0


def test_blocks_hold_every_pixel_and_the_edge_is_repeated() -> None:
    image = np.random.default_rng(4).integers(0, 256, (50, 70, 3), dtype=np.uint8)
    blocks = blocks_of(image)
    assert blocks.shape == (1, 32, 48, 12)
    assert blocks.dtype == np.uint8
    full = blocks[0].reshape(32, 48, 2, 2, 3).transpose(0, 2, 1, 3, 4).reshape(64, 96, 3)
    np.testing.assert_array_equal(full[:50, :70], image)
    assert (full[50:, :70] == image[-1]).all()
    assert (full[:50, 70:] == image[:, -1:]).all()
    # a view of a larger picture is as good as a copy
    np.testing.assert_array_equal(blocks_of(np.tile(image, (1, 2, 1))[:, :70]), blocks)


def test_small_pictures_are_enlarged_within_limits() -> None:
    detector = NetworkDetector(rules=NetworkRules(width=1920))
    for size, zoom in (((720, 1280), 1.5), ((360, 640), 2.0), ((1080, 1920), 1.0),
                       ((1440, 2560), 1.0), ((2160, 3840), 0.5), ((1280, 720), 1.5)):  # fmt: skip
        assert detector.zoom_of(np.empty((*size, 3), np.uint8)) == zoom


def test_a_picture_of_4k_is_searched_in_a_copy_and_where_far_signs_stand(
    detector: NetworkDetector,
) -> None:
    image = cv2.resize(street([], 0)[0], (3840, 2560))
    places = {"regulatory--stop--g1": (1000, 300, 300), SIXTY: (2000, 1200, 18),
              "regulatory--yield--g1": (3000, 1500, 60)}  # fmt: skip
    for name, (x, y, size) in places.items():
        face = cv2.resize(draw_face(name), (size, size), interpolation=cv2.INTER_AREA)
        cover = face[:, :, 3:] / 255.0
        part = image[y : y + size, x : x + size]
        part[:] = (0.85 * face[:, :, :3] * cover + part * (1 - cover)).astype(np.uint8)
    searched: list[int] = []
    model = detector._model
    run = model.run
    model.run = lambda blocks: (searched.append(blocks.size), run(blocks))[1]  # type: ignore
    try:
        found = detector.detect(np.asarray(image, np.uint8))
    finally:
        del model.run  # type: ignore[method-assign]
    for name, (x, y, size) in places.items():
        middle = (found.box[:, :2] + found.box[:, 2:]) / 2
        here = np.abs(middle - [x + size / 2, y + size / 2]).max(axis=1) < 0.3 * size
        here &= found.score > 0.3
        assert here.sum() == 1, name
    assert sum(searched) < 0.75 * image.size


def test_windows_of_a_large_picture_hold_the_band_and_what_is_asked_for() -> None:
    hints = np.array([[500.0, 100, 520, 120], [510, 110, 530, 130], [3000, 1500, 3040, 1540],
                      [100, 1800, 400, 2100], [3830, 2150, 3840, 2160]])  # fmt: skip
    windows = fine_windows(2160, (0, 0, 3840, 2160), hints)
    for k in (0, 1, 4):
        x, y = hints[k, :2] + 5.0
        assert sum(a <= x < c and b <= y < d for a, b, c, d in windows) == 1
    inside = [(a, b, c, d) for a, b, c, d in windows if b <= 1080 < d]
    assert inside == [(0, 768, 3840, 1408)]
    # what is large is seen in the copy
    assert sum((c - a) * (d - b) for a, b, c, d in windows) < 0.35 * 3840 * 2160
    assert all(c <= 3840 and d <= 2160 for _, _, c, d in windows)
    # a part of the picture below the band
    assert fine_windows(2160, (0, 1600, 3840, 2160), np.zeros((0, 4))) == []


def test_what_is_reported_does_not_depend_on_what_is_named(detector: NetworkDetector) -> None:
    image, _ = street(FACES, 40)
    every = detector.detect(image)
    strict = NetworkDetector("AU", rules=NetworkRules(min_score=0.5)).detect(image)
    good = every.score >= 0.5
    assert good.any()
    np.testing.assert_allclose(strict.score, every.score[good])
    np.testing.assert_allclose(strict.box, every.box[good])


def test_zoom_gives_boxes_of_the_picture_itself(detector: NetworkDetector) -> None:
    image, _ = street(FACES, 30)
    plain, zoomed = detector.detect(image), detector.detect(image, zoom=1.5)
    assert len(plain) > 0
    assert len(zoomed) > 0
    assert np.abs(zoomed.box - plain.box[0]).max(axis=1).min() < 3.0


def test_pictures_of_any_size_are_taken(detector: NetworkDetector) -> None:
    for shape in ((1, 1, 3), (33, 700, 3), (8, 8, 3), (257, 31, 3)):
        found = detector.detect(np.full(shape, 90, np.uint8))
        assert found.box.shape == (len(found), 4)
    assert len(detector.detect(GREY, (500.0, 500.0, 600.0, 600.0))) == 0


def test_other_pictures_are_refused(detector: NetworkDetector) -> None:
    with pytest.raises(ValueError, match="three channels"):
        detector.detect(np.zeros((40, 40), np.uint8))
    with pytest.raises(ValueError, match="8 bits"):
        detector.detect(np.zeros((40, 40, 3), np.float32))  # type: ignore[arg-type]


def test_a_detector_travels_to_another_process(detector: NetworkDetector) -> None:
    image, _ = street(FACES, 44)
    other = pickle.loads(pickle.dumps(detector))
    np.testing.assert_array_equal(other.detect(image).box, detector.detect(image).box)


def test_a_broken_model_file_is_named(tmp_path: Path) -> None:
    broken = tmp_path / "broken.onnx"
    broken.write_bytes(b"no network")
    with pytest.raises(InputError, match=r"broken\.onnx"):
        NetworkDetector(model=broken).detect(GREY)
    with pytest.raises(InputError, match="missing"):
        NetworkDetector(model=tmp_path / "absent.onnx").detect(GREY)


def test_the_table_of_classes_holds_together() -> None:
    classes, vocabulary = load_classes(), load_vocabulary()
    assert {entry.group for entry in classes.values()} <= vocabulary.groups.keys()
    assert sorted(e.gtsdb for e in classes.values() if e.gtsdb is not None) == list(range(43))
    assert len(country_set("AU")) >= 60
    assert len(country_set("DE")) >= 43
    assert country_set("at") == country_set("DE")
    assert country_set(None) == frozenset(classes)
    assert country_set("US") == frozenset(classes)
    assert vocabulary.classes.keys() <= classes.keys()
    for name, drawn in vocabulary.classes.items():
        assert classes[name].group == drawn.group
    assert national_code("regulatory--stop--g1", "au") == "R1-1"
    assert national_code("regulatory--stop--g1", "FR") is None
    assert national_code("nonsense", "AU") is None


def test_the_models_speak_of_the_same_classes(detector: NetworkDetector) -> None:
    labels = SignClassifier().labels
    assert labels == [*load_classes(), *load_vocabulary().groups, "no-sign"]
    sizes = [
        p.stat().st_size for p in (Path(__file__).parents[2] / "automap/vision/models").iterdir()
    ]
    assert sum(sizes) < 15e6


def test_the_vocabulary_is_whole() -> None:
    vocabulary = load_vocabulary()
    assert {c.group for c in vocabulary.classes.values()} <= set(vocabulary.groups)
    assert {c.outline for c in vocabulary.classes.values()} <= set(SHAPES)
    for name in sorted(vocabulary.classes):
        assert name.split("--")[0] in {"regulatory", "warning", "information"}
        assert vocabulary.group_of(vocabulary.groups[vocabulary.classes[name].group]) is not None
        assert usual_size(name) == vocabulary.classes[name].size_m
    assert usual_size("warning--unknown-yellow-diamond") == pytest.approx(0.75)
    assert usual_size("nonsense") is None
    assert vocabulary.group_of("nonsense") is None


def test_faces_of_no_class_are_doubted_and_named_ones_are_not() -> None:
    assert doubted(0.98, 1.0, 6.7) == pytest.approx(0.98)
    assert 0.94 < doubted(0.98, 0.0, 6.7) < 0.96
    # where other faces are as frequent as the classes they are as often signs
    assert doubted(0.98, 0.0, 6.7) < doubted(0.98, 0.0, 1.0) <= 0.98
    assert doubted(0.4, 0.0, 6.7) == pytest.approx(0.4)


@given(st.floats(0.0, 1.0), st.floats(0.0, 1.0), st.floats(0.0, 1.0))
def test_doubt_keeps_the_order_of_like_faces_and_never_adds(a: float, b: float, k: float) -> None:
    low, high = sorted((doubted(a, k, 6.7), doubted(b, k, 6.7)))
    assert low == pytest.approx(doubted(min(a, b), k, 6.7))
    assert high <= max(a, b, 1.01e-4) + 1e-12
