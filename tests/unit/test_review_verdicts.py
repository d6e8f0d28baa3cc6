"""What the actions of a review come to: signs turned, raised, added, split, merged, disputed."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from export_inputs import sign

from automap.errors import InputError
from automap.io import names
from automap.io.review_json import action_of, append_action, plain_action, read_review
from automap.records import PlacedSign, ReviewAction, SeenIn, Sign
from automap.review import limits
from automap.review.reviewed import apply_review
from automap.review.verdicts import verdicts


def act(number: int, kind: str, of: Sign | None = None, **fields: Any) -> ReviewAction:
    """An action as the page's server keeps it."""
    of = sign(1) if of is None else of
    seen = {
        "seen_class": of.class_name,
        "seen_lon_deg": float(np.degrees(of.lon_rad)),
        "seen_lat_deg": float(np.degrees(of.lat_rad)),
    }
    base = {"id": f"a{number}", "time": f"2026-03-14T09:20:{number:02d}Z", "sign": of.id}
    return action_of({**base, "kind": kind, **seen, **fields})


def where(lon: float, lat: float, **more: float) -> dict[str, Any]:
    return {"lon_deg": lon, "lat_deg": lat, "cov_m2": [0.3, 0.1, 0.2, None], **more}


def test_a_sign_is_turned_and_raised() -> None:
    first = sign(1)
    done = apply_review(
        [first],
        [
            act(1, "correct", facing_deg=0.0),
            act(2, "correct", height_above_road_m=3.1, reviewer="Ben"),
        ],
    ).signs[0]
    assert (done.status, done.reviewer, done.reviewed) == (
        "corrected",
        "Ben",
        "2026-03-14T09:20:02Z",
    )
    assert done.facing_rad == 0.0
    assert np.degrees(done.facing_sd_rad) == pytest.approx(limits.HAND_FACING_SD_DEG)
    assert done.height_above_road_m == 3.1
    # the road stays where it is
    assert done.height_m - first.height_m == pytest.approx(3.1 - first.height_above_road_m)
    assert done.sd_above_road_m == limits.HAND_HEIGHT_SD_M
    assert (done.lat_rad, done.class_name) == (first.lat_rad, first.class_name)


def test_a_sign_is_added_decided_about_and_taken_back() -> None:
    new = Sign(**{**vars(sign(9)), "id": "r1", "class_name": "stop"})
    views = [["demo", "front", 4, 10.5, 20.0], ["demo", "front", 9, 30.0, 21.0]]
    place = where(8.47, 48.98, height_m=160.0, n_views=2)
    add = act(1, "add", new, class_name="stop", place=place, views=views, reviewer="Anna")
    turned = act(2, "correct", new, facing_deg=90.0)
    done = apply_review([sign(1)], [add, turned]).signs
    assert [s.id for s in done] == ["s0001", "r1"]
    added = done[1]
    assert (added.status, added.class_name, added.n_views) == ("added", "stop", 2)
    assert np.degrees([added.lon_rad, added.lat_rad]) == pytest.approx([8.47, 48.98])
    assert added.cov_enu[:2, :2].tolist() == [[0.3, 0.1], [0.1, 0.2]]
    assert np.isnan(added.cov_enu[2, 2])
    assert np.isnan(added.confidence)
    assert np.degrees(added.facing_rad) == pytest.approx(90.0)
    assert added.drives == ("demo",)
    assert [s.id for s in apply_review([], [add]).signs] == ["r1"]
    undone = act(3, "undo", new, undoes="a1")
    gone = apply_review([sign(1)], [add, turned, undone])
    assert [s.id for s in gone.signs] == ["s0001"]
    assert gone.problems == []
    again = apply_review([sign(1)], [add, turned, undone, act(4, "undo", new, undoes="a3")])
    assert [s.id for s in again.signs] == ["s0001", "r1"]
    rejected = apply_review([], [add, act(5, "reject", new)])
    assert [s.id for s in rejected.rejected] == ["r1"]
    # a reset forgets decisions, not that there is a sign
    assert apply_review([], [add, turned, act(6, "reset", new)]).signs[0].status == "added"


def test_a_split_makes_two_and_a_merge_makes_one() -> None:
    one = replace(sign(1), contrast=0.8, contrast_sd=0.1, seen_share=0.9, n_looked=12)
    two = sign(2, drives=("other",))
    split = act(
        *(1, "split", one), other="r2", views=[["demo", "front", 7]], place=where(8.471, 48.971),
        other_place=where(8.472, 48.972, n_views=1), other_seen_class="yield",
        other_seen_lon_deg=8.472, other_seen_lat_deg=48.972,
    )  # fmt: skip
    done = apply_review([one, two], [split])
    assert [(s.id, s.class_name, s.status) for s in done.signs] == [
        ("s0001", one.class_name, "corrected"),
        ("s0002", two.class_name, two.status),
        ("r2", "yield", "corrected"),
    ]
    assert np.degrees(done.signs[0].lon_rad) == pytest.approx(8.471)
    assert done.signs[2].confidence == one.confidence
    # which was measured of the views of both
    for part in done.signs[::2]:
        assert np.isnan([part.contrast, part.contrast_sd, part.seen_share]).all()
        assert part.n_looked == 0
    assert done.renamed.name_of("s0001", "front", 7) == "r2"
    assert done.renamed.name_of("s0001", "front", 8) == "s0001"
    assert done.renamed.name_of("s0001", "front", 7, "tuesday") == "s0001"

    merge = act(
        *(2, "merge", one), other="s0002", place=where(8.4705, 48.9705, n_views=18),
        other_seen_class=two.class_name, other_seen_lon_deg=float(np.degrees(two.lon_rad)),
        other_seen_lat_deg=float(np.degrees(two.lat_rad)),
    )  # fmt: skip
    done = apply_review([one, two], [merge])
    (only,) = done.signs
    assert (only.id, only.n_views, only.drives) == ("s0001", 18, ("demo", "other"))
    assert done.rejected == []
    assert done.renamed.name_of("s0002", "front", 1) == "s0001"
    both = apply_review([one, two], [merge, act(3, "undo", one, undoes="a2")])
    assert both.signs == [one, two]
    # a run that numbered them anew
    swapped = [Sign(**{**vars(one), "id": "x"}), Sign(**{**vars(two), "id": "y"})]
    done = apply_review(swapped, [merge])
    assert [s.id for s in done.signs] == ["x"]
    assert done.renamed.name_of("y", "front", 1) == "x"


def test_reviewers_who_disagree_are_told_until_one_settles_it() -> None:
    anna, ben = act(1, "accept", reviewer="Anna"), act(2, "reject", reviewer="Ben")

    def disputed(*actions: ReviewAction) -> tuple[str, ...]:
        return verdicts(actions)["s0001"].disputed

    assert disputed(anna) == ()
    assert disputed(anna, ben) == ("Anna",)
    assert disputed(anna, ben, act(3, "accept", reviewer="Ben")) == ()
    assert disputed(anna, ben, act(3, "reject", reviewer="Anna")) == ()
    assert disputed(anna, ben, act(3, "reject", reviewer="Cleo", settles=True)) == ()
    assert disputed(anna, act(2, "accept", reviewer="Ben")) == ()
    assert disputed(anna, act(2, "correct", reviewer="Ben", class_name="yield")) == ("Anna",)
    # to turn what somebody accepted is to add to it
    assert disputed(anna, act(2, "correct", reviewer="Ben", facing_deg=3.0)) == ()
    (told,) = apply_review([sign(1)], [anna, ben]).problems
    assert "s0001 (Ben against Anna)" in told
    assert [s.id for s in apply_review([sign(1)], [anna, ben]).rejected] == ["s0001"]


def test_a_file_gives_back_all_of_an_action_and_reads_older_ones(tmp_path: Path) -> None:
    path = tmp_path / names.REVIEW
    older = {"schema": "automap.review/1", "actions": [plain_action(act(1, "accept"))]}
    path.write_text(json.dumps(older))
    place = PlacedSign(0.0, -3.5, (0.1, 0.0, 0.2, float("nan")), facing_deg=0.0, side="left")
    put = [
        act(1, "accept"),
        act(
            2, "correct", facing_deg=0.0, lon_deg=0.0, lat_deg=0.0, sd_m=0.5, settles=True,
            seen_lon_deg=0.0, seen_lat_deg=0.0,
        ),
        ReviewAction(
            *("a3", "2026-03-14T12:00:00Z", "r1", "add", "stop", 0.0, 0.0, "stop"),
            place=place, reviewer="Anna",
            views=(SeenIn("d", "front", 3), SeenIn("d", "front", 0, 0.0, 2.5)),
        ),
    ]  # fmt: skip
    for one in put[1:]:
        append_action(path, one)
    assert repr(read_review(path)) == repr(put)
    assert json.loads(path.read_text())["schema"] == "automap.review/2"
    path.write_text(json.dumps({"schema": "automap.review/9", "actions": []}))
    with pytest.raises(InputError, match="no review"):
        read_review(path)


@pytest.mark.parametrize(
    "fields",
    [
        {"kind": "add", "class_name": "stop"},
        {"kind": "add", "place": where(8, 48)},
        {"kind": "add", "class_name": "stop", "place": {"lon_deg": 8, "lat_deg": 48}},
        {"kind": "add", "class_name": "stop", "place": where(8, 95)},
        {"kind": "add", "class_name": "stop", "place": {**where(8, 48), "extra": 1}},
        {"kind": "split", "place": where(8, 48), "other_place": where(8, 48), "other": "r"},
        {"kind": "merge", "place": where(8, 48)},
        {"kind": "merge", "place": where(8, 48), "other": "s0001"},
        {"kind": "accept", "settles": "yes"},
        {"kind": "accept", "reviewer": "x" * 201},
        {"kind": "correct", "facing_deg": 361},
        {"kind": "correct", "height_above_road_m": 80},
        {"kind": "accept", "views": [["d", "front"]]},
        {"kind": "accept", "views": [["d", "front", True]]},
        {"kind": "accept", "views": [["d", "front", 1, "x", 2]]},
    ],
)
def test_what_is_no_such_action_is_refused(fields: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=r"it|view"):
        act(1, **fields)
