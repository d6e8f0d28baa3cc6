"""Crops, contact sheets, labels and the class that all views of a sign say."""

from __future__ import annotations

import math
from dataclasses import replace
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
from automap.vision.limits import FOREIGN
from automap.vision.network import NetworkDetector
from automap.vision.voting import (
    PoolingRules,
    View,
    group_of,
    pooled,
    pooling,
    rules_of,
    tempered,
    view_of,
    vote,
)


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


TWENTY, SIXTY = "regulatory--maximum-speed-limit-20--g1", "regulatory--maximum-speed-limit-60--g1"


def test_a_detector_that_knows_the_country_is_believed_more() -> None:
    for country in ("AU", "DE", None):
        assert rules_of(NetworkDetector(country)) == pooling(country)
    assert pooling("AU").class_power == pooling("DE").class_power > pooling(None).class_power


def test_near_views_outvote_far_ones() -> None:
    far = View(((TWENTY, 0.5), (SIXTY, 0.4)), 14.0)
    near = View(((SIXTY, 0.99), (TWENTY, 0.005)), 60.0)
    assert vote([far] * 8 + [near]).name == SIXTY
    told = vote([near, near, near], pooling("AU"))
    assert told.name == SIXTY
    assert told.probability > 0.95
    # where the country's set is not known more faces are of no class
    assert 0.9 < vote([near, near, near]).probability < told.probability


def test_the_evidence_of_many_views_ends() -> None:
    unsure = View(((TWENTY, 0.7), (SIXTY, 0.3)), 40.0)
    plain = PoolingRules(correlation=0.25, class_power=1.0, group_power=1.0, named=0.0)
    # as many views as one over their correlation, each with odds of seven to three
    most = 1.0 / (1.0 + (3 / 7) ** 4)
    few, many, more = (vote([unsure] * n, plain).probability for n in (4, 400, 4000))
    assert few < many < more < most
    assert more == pytest.approx(most, abs=1e-3)
    # one alone says no more than it says
    assert vote([unsure], plain).probability < 0.7


def test_what_is_likely_before_anything_is_seen_counts_once() -> None:
    group = group_of(TWENTY)
    assert group is not None
    # faces of no class are taken to be four times as likely, and the face says nothing of it
    rules = PoolingRules(0.25, class_power=1.0, group_power=1.0, named=0.0, unknown=4.0)
    blank = View(((group, 0.8), (TWENTY, 0.2)), 40.0)
    for views in (1, 4, 40):
        names, shares = pooled([blank] * views, rules)
        assert dict(zip(names, shares, strict=True))[TWENTY] == pytest.approx(0.2)
    # the more views, the likelier a face that looks more like the class than was to be expected
    alike = View(((group, 0.6), (TWENTY, 0.4)), 40.0)
    told = [dict(zip(*pooled([alike] * n, rules), strict=True))[TWENTY] for n in (1, 4, 40)]
    assert told[0] < 0.5 < told[1] < told[2]
    # a class of another country likewise: thirty times the evidence, once
    seldom = replace(rules, foreign=frozenset({TWENTY}))
    abroad = View(((SIXTY, 1.0 / (1.0 + FOREIGN)), (TWENTY, FOREIGN / (1.0 + FOREIGN))), 40.0)
    for views in (1, 4, 40):
        names, shares = pooled([abroad] * views, seldom)
        assert dict(zip(names, shares, strict=True))[TWENTY] == pytest.approx(0.03 / 1.03)
    # the country's set makes them as likely as one class, and other detectors say nothing of it
    assert pooling(None).unknown > 4.0 * pooling("AU").unknown
    assert PoolingRules().unknown == 1.0


def test_a_power_of_the_odds_keeps_the_order_and_even_odds() -> None:
    shares = np.linspace(0.0, 1.0, 41)
    found = np.array([tempered(float(s), 0.5) for s in shares])
    assert (np.diff(found) > 0).all()
    assert tempered(0.5, 0.3) == pytest.approx(0.5)
    assert tempered(0.9, 0.5) == pytest.approx(0.75)  # nine to one becomes three to one


def test_what_lapses_is_never_surer_than_that_and_a_shift_is_of_the_odds() -> None:
    assert tempered(0.9, 0.5, math.log(2.0)) == pytest.approx(6.0 / 7.0)
    assert tempered(0.9, 0.5, lapse=0.2) == pytest.approx(0.6)
    clear = View(((TWENTY, 0.9999999),), 60.0)
    # of all countries' signs some look like a class and are none, however many views agree
    far, home = vote([clear] * 50, pooling(None)), vote([clear] * 50, pooling("DE"))
    assert far.group_probability <= 1.0 - pooling(None).group_lapse < home.group_probability
    assert far.probability <= far.group_probability
    # a class must be likelier than at home to be named
    rules = PoolingRules(0.25, class_power=1.0, group_power=1.0, class_shift=-0.5)
    half = View(((TWENTY, 0.75), (SIXTY, 0.25)), 40.0)
    assert vote([half], replace(rules, class_shift=0.0)).name == TWENTY
    assert vote([half], rules).name == group_of(TWENTY)


def test_faces_that_nobody_knows_get_no_wrong_name() -> None:
    group = group_of(TWENTY)
    assert group == "regulatory--unknown-red-circle"
    doubtful = [
        View(((group, 0.4), (TWENTY, 0.3), (SIXTY, 0.2)), 60.0),
        View(((group, 0.45), (TWENTY, 0.25)), 50.0),
    ]
    assert vote(doubtful * 6).name == group
    torn = [View(((TWENTY, 0.9),), 60.0), View(((SIXTY, 0.9),), 60.0)]
    told = vote(torn)
    assert told.name == group
    # what it is remains open, its shape and colour do not
    assert told.probability == told.group_probability > 0.95
    assert vote([*torn, torn[0], torn[0]]).name == TWENTY


def test_a_class_is_never_surer_than_its_group() -> None:
    rng = np.random.default_rng(1)
    names = [TWENTY, SIXTY, "regulatory--unknown-red-circle", "warning--children--g2"]
    for _ in range(200):
        views = [
            View(tuple(zip(names, rng.dirichlet([0.3] * 4).tolist(), strict=True)), 40.0)
            for _ in range(int(rng.integers(1, 6)))
        ]
        told = vote(views)
        assert 0.0 < told.probability <= told.group_probability < 1.0


def test_a_bare_name_is_a_view_too() -> None:
    found = FoundSigns(("a", "b"), np.array([[0, 0, 9, 9], [0, 0, 30, 40.0]]), np.array([0.4, 1.0]))
    assert view_of(found, 0) == View((("a", 0.4),), 9.0)
    assert view_of(found, 1).alternatives[0][1] < 1.0
    assert vote([view_of(found, 0), view_of(found, 1)]).name == "b"
