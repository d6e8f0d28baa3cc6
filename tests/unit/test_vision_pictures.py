"""Crops, contact sheets, labels and the class that all views of a sign say."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from automap.io.crops_table import read_crops, write_crops
from automap.vision.annotate import draw, label_for
from automap.vision.contact_sheet import contact_sheet, short_name
from automap.vision.crops import BestCrops, cut_out
from automap.vision.detector import FoundSigns
from automap.vision.voting import View, group_of, view_of, vote


@given(x=st.floats(-20, 310), y=st.floats(-20, 230), w=st.floats(0.5, 250), h=st.floats(0.5, 200))
def test_a_crop_shows_its_box_wherever_it_lies(x: float, y: float, w: float, h: float) -> None:
    image = np.full((240, 320, 3), 90, np.uint8)
    box = np.array([x, y, x + w, y + h])
    shown, inside = cut_out(image, box)
    assert min(shown.shape[:2]) >= 1
    assert max(shown.shape[:2]) <= 160
    wide, high = inside[2] - inside[0], inside[3] - inside[1]
    assert wide / high == pytest.approx(w / h, rel=1e-6)


def test_a_crop_and_its_box_agree() -> None:
    image = np.zeros((200, 300, 3), np.uint8)
    image[80:120, 100:140] = 255
    shown, inside = cut_out(image, np.array([99.5, 79.5, 139.5, 119.5]))
    bright = np.argwhere(shown[:, :, 0] > 127)
    np.testing.assert_allclose(bright.min(axis=0), inside[[1, 0]] + 0.5, atol=1.0)
    np.testing.assert_allclose(bright.max(axis=0), inside[[3, 2]] - 0.5, atol=1.0)


def crops(count: int) -> BestCrops:
    best = BestCrops("front")
    rng = np.random.default_rng(1)
    for track in range(count):
        image = np.kron(rng.integers(0, 2, (18, 24)), np.full((5, 5), 255)).astype(np.uint8)
        image = np.repeat(image[:, :, None], 3, axis=2)
        best.offer(image, 5, 50, track, "far", np.array([40.0, 40, 52, 52]), 0.9)
        best.offer(image, 9, 90, track, "near", np.array([30.0, 20, 70, 60]), 0.9)
        best.offer(image, 12, 120, track, "cut", np.array([80.0, 20, 119, 70]), 0.9)
    return best


def test_the_nearest_whole_view_is_kept(tmp_path: Path) -> None:
    kept = crops(3).crops({0: "warning--curve-left--g1"})
    assert [crop.frame for crop in kept] == [9, 9, 9]
    assert [crop.class_name for crop in kept] == ["warning--curve-left--g1", "near", "near"]
    assert all(len(crop.jpeg) < 30_000 for crop in kept)
    write_crops(tmp_path / "crops.parquet", kept)
    read = read_crops(tmp_path / "crops.parquet")
    for before, after in zip(kept, read, strict=True):
        assert before.jpeg == after.jpeg
        np.testing.assert_array_equal(before.box_in_crop, after.box_in_crop)
        assert (before.track, before.class_name, before.worth) == (
            after.track, after.class_name, after.worth,
        )  # fmt: skip


@pytest.mark.parametrize("count", [0, 1, 9])
def test_a_sheet_has_a_cell_for_every_sign(count: int) -> None:
    sheet = cv2.imdecode(np.frombuffer(contact_sheet(crops(count).crops({})), np.uint8), 1)
    assert sheet is not None
    assert sheet.shape[0] == 34 + 178 * -(-count // 8)
    busy = np.abs(np.diff(sheet[34:].astype(int), axis=1)).max(axis=2) > 40 if count else None
    for number in range(count):
        x, y = number % 8 * 144, number // 8 * 178
        assert busy is not None
        assert busy[y + 10 : y + 130, x + 10 : x + 130].mean() > 0.02


def test_names_are_shortened_for_people() -> None:
    assert short_name("regulatory--stop--g1") == "stop"
    assert short_name("mine") == "mine"
    assert len(short_name("complementary--" + "a" * 50 + "--g1")) == 22


def test_labels_keep_clear_of_the_signs() -> None:
    image = np.full((200, 300, 3), 90, np.uint8)
    upper, lower = np.array([120.0, 40, 160, 80]), np.array([120.0, 84, 160, 124])
    labels = [label_for(box, "stop", 0.9, k, True) for k, box in enumerate((upper, lower))]
    draw(image, labels)
    for box in (upper, lower):
        x0, y0, x1, y1 = box.astype(int)
        assert (image[y0 + 2 : y1 - 1, x0 + 2 : x1 - 1] == 90).all()
    assert (image != 90).any(axis=2).sum() > 500


def test_near_views_outvote_far_ones() -> None:
    far = View((("sixty", 0.5), ("eighty", 0.4)), 14.0)
    near = View((("eighty", 0.97), ("sixty", 0.02)), 60.0)
    assert vote([far] * 8 + [near])[0] == "eighty"
    name, probability = vote([near, near, near])
    assert name == "eighty"
    assert probability > 0.99


def test_many_unsure_views_make_a_sure_one() -> None:
    unsure = View((("a", 0.6), ("b", 0.4)), 40.0)
    assert vote([unsure])[1] == pytest.approx(0.6, abs=0.02)
    # they are not independent, so that certainty grows slowly and ends
    sure = vote([unsure] * 50)[1]
    assert 0.7 < sure < 0.9
    assert vote([unsure] * 4)[1] == pytest.approx(sure)


def test_faces_that_nobody_knows_get_no_wrong_name() -> None:
    a, b = "regulatory--maximum-speed-limit-20--g1", "regulatory--maximum-speed-limit-60--g1"
    group = group_of(a)
    assert group == "regulatory--unknown-red-circle"
    doubtful = [
        View(((group, 0.4), (a, 0.3), (b, 0.2)), 60.0), View(((group, 0.45), (a, 0.25)), 50.0)
    ]  # fmt: skip
    assert vote(doubtful * 6)[0] == group
    torn = [View(((a, 0.9),), 60.0), View(((b, 0.9),), 60.0)]
    assert vote(torn)[0] == group
    assert vote([*torn, torn[0], torn[0]])[0] == a


def test_a_bare_name_is_a_view_too() -> None:
    found = FoundSigns(("a", "b"), np.array([[0, 0, 9, 9], [0, 0, 30, 40.0]]), np.array([0.4, 1.0]))
    assert view_of(found, 0) == View((("a", 0.4),), 9.0)
    assert view_of(found, 1).alternatives[0][1] < 1.0
    assert vote([view_of(found, 0), view_of(found, 1)])[0] == "b"
