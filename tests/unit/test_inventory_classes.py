"""Classes of a list against what single views of a sign look like."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pyarrow as pa
import pytest

from automap.inventory.classes import listed_wrong, of_another_class, same_face
from automap.inventory.comparison import compare_inventory
from automap.inventory.findings import Finding, Inventory, class_belief
from automap.io.detections_table import read_detections, write_detections
from automap.records import Detections, Sign
from automap.signs.class_shares import mean_of, shares_of, shares_text
from automap.vision.voting import View, mean_shares
from pipeline.compare.command import _class_shares
from pipeline.shared.products import RunProducts

BUMP, CHILDREN, STOP_AHEAD = (
    "warning--road-bump--g2",
    "warning--children--g2",
    "warning--stop-ahead--g1",
)
UNKNOWN = "warning--unknown-yellow-diamond"
NAMES = ["regulatory--stop--g1", "regulatory--yield--g1", "regulatory--no-entry--g1"] * 7


def compared(
    name: str,
    probability: float,
    shares: dict[str, float],
    listed: str,
    reviewed: str = "",
    moved_m: float = 0.0,
) -> Finding:
    """What is said of one sign of 22, of which the others are as listed."""
    names = [*NAMES, name]
    lat = np.radians(48.0) + np.arange(len(names)) * 40.0 / 6.37e6
    signs = [
        Sign(
            f"s{k}", name, float(lat[k]), 0.1, 0.0, 0.25 * np.eye(3), 0.99, 9, 0, 0, 2.0, 0.0, 0.6,
            "", existence=0.999, class_probability=0.999,
        )
        for k, name in enumerate(names)
    ]  # fmt: skip
    signs[-1] = replace(signs[-1], class_probability=probability, reviewed=reviewed)
    nothing = np.full(len(names), np.nan)
    lat[-1] += moved_m / 6.37e6
    inventory = Inventory(
        [str(k) for k in range(len(names))], [*NAMES, listed], lat, np.full(len(names), 0.1),
        np.zeros(len(names)), nothing,
    )  # fmt: skip
    told: list[dict[str, float]] = [{}] * len(NAMES)
    result = compare_inventory(signs, inventory, [], [*told, shares])
    return next(f for f in result.findings if f.listed == len(NAMES))


def test_a_class_that_no_view_looks_like_is_the_lists_mistake() -> None:
    """However little sure the detector is of the class that it names."""
    plain = compared(BUMP, 0.75, {}, STOP_AHEAD)
    assert (plain.kind, plain.sure) == ("class", False)
    looked = compared(BUMP, 0.75, {BUMP: 0.6, CHILDREN: 0.2}, STOP_AHEAD)
    assert (looked.kind, looked.sure) == ("class", True)


def test_a_class_that_many_views_look_like_may_be_right() -> None:
    assert not compared(BUMP, 0.95, {BUMP: 0.6, CHILDREN: 0.2}, CHILDREN).sure


def test_a_misread_sign_that_was_moved_is_told_as_moved() -> None:
    shares = {BUMP: 0.6, CHILDREN: 0.2}
    assert compared(BUMP, 0.75, shares, CHILDREN, moved_m=8.0).kind == "moved"
    assert compared(BUMP, 0.75, shares, STOP_AHEAD, moved_m=8.0).kind != "moved"


def test_a_face_without_a_name_can_contradict_a_list() -> None:
    """If next to no view looked like what is listed; else it is taken as listed."""
    shares = {CHILDREN: 0.5, UNKNOWN: 0.3, BUMP: 0.1}
    assert compared(UNKNOWN, 0.9, {}, STOP_AHEAD).kind == "matched"
    assert compared(UNKNOWN, 0.9, shares, STOP_AHEAD).kind == "class"
    assert compared(UNKNOWN, 0.9, shares, BUMP).kind == "matched"


def test_a_person_has_the_last_word() -> None:
    shares = {BUMP: 0.3, CHILDREN: 0.6}
    assert not compared(BUMP, 0.7, shares, CHILDREN).sure
    reviewed = compared(BUMP, 0.7, shares, CHILDREN, reviewed="2026-01-01T00:00:00Z")
    assert reviewed.sure
    alone = Sign("s", BUMP, 0.0, 0.0, 0.0, np.eye(3), 0.9, 9, 0, 0, 2.0, 0.0, 0.6, "",
                 class_probability=0.2, reviewed="2026-01-01T00:00:00Z")  # fmt: skip
    assert class_belief(alone) > 0.99


def test_what_views_give_to_classes_is_their_mean_by_how_clear_they_are() -> None:
    views = [View(((BUMP, 0.9), (CHILDREN, 0.1)), 32.0), View(((CHILDREN, 1.0),), 16.0)]
    assert dict(mean_shares(views)) == pytest.approx({BUMP: 0.72, CHILDREN: 0.28})
    faint = mean_shares([View(((BUMP, 0.9999), (CHILDREN, 0.0001)), 32.0)])
    assert [name for name, _ in faint] == [BUMP]


def test_the_more_views_give_to_a_class_the_less_it_is_wrong() -> None:
    told = [of_another_class({BUMP: 1.0 - s, CHILDREN: s}, CHILDREN) for s in (0.0, 0.05, 0.3, 0.9)]
    assert told == sorted(told, reverse=True)
    assert told[0] > 0.99
    assert told[-1] < 0.01
    # one face under two names is one
    assert of_another_class({"regulatory--stop--g1": 1.0}, "regulatory--stop--g2") < 0.01
    # what was read among all classes tells less
    shares = {BUMP: 0.4, CHILDREN: 0.01}
    assert 0.9 < of_another_class(shares, CHILDREN, False) < of_another_class(shares, CHILDREN)


def test_shares_come_back_from_their_text_and_from_the_table(tmp_path: Path) -> None:
    text = shares_text([(BUMP, 0.75), (CHILDREN, 0.2)])
    assert shares_of(text) == {BUMP: 0.75, CHILDREN: 0.2}
    assert shares_of("nonsense; a b; x 2; y nan; ;" + text) == shares_of(text)
    assert mean_of(["", text, f"{CHILDREN} 1.000"]) == {BUMP: 0.375, CHILDREN: 0.6}
    assert mean_of(["", ""]) == {}
    n = 2
    found = Detections(
        np.arange(n), np.arange(n), np.full(n, BUMP, object), np.tile([1.0, 1.0, 9.0, 9.0], (n, 1)),
        np.ones(n), np.zeros(n, np.int64), class_shares=np.array([text, ""], object),
    )  # fmt: skip
    write_detections(tmp_path / "detections.parquet", [found, replace(found, class_shares=None)])
    again = read_detections(tmp_path / "detections.parquet")[found.camera].class_shares
    assert again is not None
    assert again.tolist() == [text, "", "", ""]
    assert mean_of({text: 3, "": 9}) == pytest.approx(shares_of(text))
    assert mean_of({f"{BUMP} 1.000": 3, f"{CHILDREN} 1.000": 1}) == {BUMP: 0.75, CHILDREN: 0.25}


def test_a_merged_map_still_has_what_the_views_look_like() -> None:
    """Of signs that one drive saw, and of such as no drive could name."""
    seen = pa.table({
        "sign_id": ["a", "a", "b", "c", None],
        "class_shares": [f"{BUMP} 1.0", f"{CHILDREN} 1.0", f"{BUMP} 0.8", f"{BUMP} 0.5", None],
    })  # fmt: skip
    one = Sign("a", BUMP, 0.0, 0.0, 0.0, np.eye(3), 0.9, 9, 0, 0, 2.0, 0.0, 0.6, "", drives=("x",))
    signs = [one, replace(one, id="b", drives=("x", "y")),
             replace(one, id="c", drives=("x", "y"), class_name=UNKNOWN)]  # fmt: skip
    products = cast(RunProducts, SimpleNamespace(observations=seen))
    assert _class_shares(products, signs) == [{BUMP: 0.5, CHILDREN: 0.5}, {}, {BUMP: 0.5}]
    assert _class_shares(cast(RunProducts, SimpleNamespace(observations=None)), signs) == []


def test_views_of_another_shape_contradict_a_list_though_no_class_is_seen() -> None:
    circle = {"regulatory--unknown-red-circle": 0.6, "regulatory--no-stopping--g5": 0.05}
    # of lists that are right in 19 of 20
    assert listed_wrong(circle, STOP_AHEAD) > 0.5
    assert listed_wrong({UNKNOWN: 0.6, CHILDREN: 0.05}, STOP_AHEAD) < 0.5
    # nothing is known of how a class looks that is in no catalogue
    assert listed_wrong(circle, "other--thing--g1") < 0.5


def test_no_shape_contradicts_a_face_that_has_none() -> None:
    """A cross at a railway looks like a square of any colour."""
    cross = "regulatory--railroad-crossing--au"
    squares = {"regulatory--unknown-white-square": 0.3, "warning--unknown-yellow-square": 0.3}
    assert of_another_class(squares, cross, at_home=False) < 0.5
    assert same_face("warning--unknown-yellow-square", cross) is None
    assert of_another_class({**squares, CHILDREN: 0.3}, cross, at_home=False) > 0.9


def test_a_face_has_the_shape_of_each_country_that_draws_it() -> None:
    """Words in a list are the first drawing of a class, whichever stands there."""
    assert same_face(UNKNOWN, "warning--children--g1") is None
    assert same_face(UNKNOWN, "regulatory--yield--g1") is False
    assert compared(UNKNOWN, 0.9, {}, "warning--children--g1").kind == "matched"
    assert of_another_class({UNKNOWN: 0.9}, "warning--children--g1") < 0.5


def test_a_match_is_no_surer_than_that_the_class_is_as_listed() -> None:
    told = compared(UNKNOWN, 0.9, {UNKNOWN: 0.3, CHILDREN: 0.16, BUMP: 0.01}, BUMP)
    assert told.kind == "matched"
    assert 0.5 < told.probability < 0.9
    assert compared(UNKNOWN, 0.9, {UNKNOWN: 0.5, BUMP: 0.3}, BUMP).probability > 0.95
