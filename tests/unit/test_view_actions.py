"""Adding, turning, raising, splitting and merging signs: obeyed by all exports, and undone."""

from __future__ import annotations

import json
import sqlite3
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from export_inputs import sign, trajectory, write_run
from fake_stages import make_drive

from automap.earth import local_ned
from automap.errors import InputError
from automap.frames import rpy_to_matrix
from automap.io import names
from automap.io.review_json import action_of, append_action, plain_action, read_review
from automap.io.signs_table import read_signs, write_signs
from automap.io.tables import write_columns
from automap.records import PlacedSign, ReviewAction, SeenIn, Sign
from automap.review import limits
from automap.review.reviewed import apply_review
from automap.review.verdicts import verdicts
from pipeline.cli.root import run_command
from pipeline.shared.products import load_products
from pipeline.view.opening import open_map
from pipeline.view.reviewing import Reviewing

FOCAL, WIDE, HIGH = 1000.0, 1280, 720
PLACES = {"s0001": (60.0, 5.0, -1.5), "s0002": (75.0, 6.5, -1.5)}
"""Signs ahead of where the path begins, m along the first course, right and down."""


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


# --- what the actions come to


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


# --- a drive with a camera, for what the server computes


def pixel(path: Any, row: int, spot: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """Where a pinhole at the IMU, looking ahead, sees a point [3] (NED of the path's start)."""
    origin = (float(path.lat_rad[0]), float(path.lon_rad[0]), float(path.height_m[0]))
    at = slice(row, row + 1)
    centre = local_ned(path.lat_rad[at], path.lon_rad[at], path.height_m[at], origin)[0]
    forward, right, down = rpy_to_matrix(path.rpy[row]).T @ (spot - centre)
    return np.array([WIDE / 2 + FOCAL * right / forward, HIGH / 2 + FOCAL * down / forward])


def rows_seen() -> np.ndarray[Any, Any]:
    """Rows of the path at which a frame was taken, a tenth of a second apart."""
    return np.arange(10, 210, 5)


@pytest.fixture
def drive(tmp_path: Path) -> Path:
    """OUT of a drive whose one computed sign, s0001, has boxes of two signs, and s0003 others."""
    make_drive(tmp_path / "drive")
    out = write_run(tmp_path / "drive" / "_automap", signs=1)
    path = trajectory()
    (out.parent / names.MANIFEST).write_text(
        'schema = "automap.drive/1"\n[video.front]\nwidth = 1280\nheight = 720\n'
        "camera_matrix = [[1000, 0, 640], [0, 1000, 360], [0, 0, 1]]\n"
        "mount_rpy_sigma_deg = 0.05\ntime_offset_sigma_s = 0.001\nlever_arm_sigma_m = 0.02\n"
    )
    record = json.loads((out / names.RUN).read_text())
    record["drive"] = {"name": "demo", "path": str(out.parent)}
    (out / names.RUN).write_text(json.dumps(record))
    boxes: list[tuple[Any, ...]] = []
    for k, row in enumerate(rows_seen().tolist()):
        # in every second frame the second sign was taken for the first, which was hidden
        for name, taken in (
            (("s0001", "s0001"), ("s0002", "s0003")) if k % 2 == 0 else (("s0002", "s0001"),)
        ):
            u, v = pixel(path, row, np.array(PLACES[name]))
            size = FOCAL * 0.7 / (PLACES[name][0] - 0.24 * row) / 2
            boxes.append((k, int(path.t_ns[row]), u - size, v - size, u + size, v + size, taken))
    columns = list(zip(*boxes, strict=True))
    n = len(boxes)
    write_columns(
        out / names.OBSERVATIONS,
        {
            "camera": np.array(["front"] * n, object),
            "frame": np.array(columns[0]),
            "t_ns": np.array(columns[1]),
            "class": np.array(["stop"] * n, object),
            **{
                c: np.array(columns[2 + k])
                for k, c in enumerate(("x_min", "y_min", "x_max", "y_max"))
            },
            "score": np.full(n, 0.9),
            "sign_id": np.array(columns[6], object),
        },
    )
    lat = path.lat_rad[0]
    signs = [
        sign(1, id=name, class_name="stop", lat_rad=lat + at * 1e-6)
        for at, name in ((9, "s0001"), (12, "s0003"))
    ]
    write_signs(out / names.SIGNS_RAW, signs)
    return out


def off_m(place: dict[str, Any], name: str) -> float:
    """Metres in plan from where a sign stands."""
    path = trajectory()
    origin = (float(path.lat_rad[0]), float(path.lon_rad[0]), float(path.height_m[0]))
    at = np.radians([[place["lat_deg"]], [place["lon_deg"]]])
    found = local_ned(at[0], at[1], np.array([origin[2]]), origin)[0]
    return float(np.hypot(*(found - PLACES[name])[:2]))


def frames_of(shown: Reviewing, row: int) -> list[int]:
    one = shown.sign(row)
    assert one is not None
    return [v["frame"] for v in one["views"]]


def clicks(name: str, wanted: tuple[int, ...]) -> list[list[Any]]:
    path = trajectory()
    spots = [(k, pixel(path, int(rows_seen()[k]), np.array(PLACES[name]))) for k in wanted]
    return [["demo", "front", k, float(u), float(v)] for k, (u, v) in spots]


def test_clicks_in_two_frames_meet_where_the_sign_stands(drive: Path) -> None:
    shown = Reviewing(open_map(drive))
    found = shown.preview({"views": clicks("s0002", (20, 39))})
    assert off_m(found, "s0002") < 0.3
    # the path bends to the right past it
    assert found["side"] == "left"
    # it is nearly ahead in both frames, so that how far is less sure than to which side
    assert 2.0 < found["major"] < 25.0
    assert 1.0 < found["minor"] < 3.0
    sent = {"kind": "add", "class_name": "stop", "views": clicks("s0002", (20, 30, 39))}
    told = shown.add({**sent, "reviewer": "Anna"})
    (made,) = told["made"]
    assert made["row"] == 2
    assert off_m(made, "s0002") < 0.3
    one = shown.sign(2)
    assert one is not None
    assert [v["frame"] for v in one["views"]] == [20, 30, 39]
    assert [h["reviewer"] for h in one["history"]] == ["Anna"]
    products = load_products(drive)
    added = (products.signs or [])[-1]
    assert (added.status, added.n_views, added.drives) == ("added", 3, ("demo",))
    # the prior's size is none of the sign's
    assert np.isnan(added.size_m)
    # the path climbs until it passes the sign
    assert added.height_above_road_m == pytest.approx(2.5 - 2.0 * np.sin(6.2 / 40), abs=0.2)


@pytest.mark.parametrize(
    ("views", "told"),
    [
        (clicks("s0002", (3,)), "two frames"),
        (clicks("s0002", (3,)) + clicks("s0001", (3,)), "two frames"),
        (clicks("s0002", (3, 4)), "too nearly the same place"),
        ([["demo", "front", 3], ["demo", "front", 9]], "where it was clicked"),
        ([["demo", "rear", 0, 5, 5], ["demo", "rear", 9, 5, 5]], "no frame"),
        ([["demo", "front", 0, 5, 5], ["demo", "front", 999, 5, 5]], "no frame 999"),
        ([["other", "front", 0, 5, 5], ["other", "front", 9, 5, 5]], "no views"),
        ("all", "no views"),
    ],
)
def test_clicks_that_tell_no_place_are_refused_in_words(drive: Path, views: Any, told: str) -> None:
    shown = Reviewing(open_map(drive))
    with pytest.raises(ValueError, match=told):
        shown.preview({"views": views})
    with pytest.raises(ValueError, match="no known class"):
        shown.add({"kind": "add", "class_name": "no class at all", "views": views})
    assert not (drive / names.REVIEW).exists()


def test_a_click_on_the_map_takes_side_and_height_of_the_path(drive: Path) -> None:
    shown = Reviewing(open_map(drive))
    path = trajectory()
    lat = float(np.degrees(path.lat_rad[500]))
    lon = float(np.degrees(path.lon_rad[500]))
    shown.add({"kind": "add", "class_name": "stop", "lon_deg": lon - 1e-4, "lat_deg": lat})
    (made,) = [s for s in load_products(drive).signs or [] if s.status == "added"]
    assert made.side == "left"
    assert made.height_m == pytest.approx(path.height_m[500] - 1.0 + 2.2, abs=0.3)
    assert made.cov_enu[0, 0] == limits.HAND_SD_M**2
    # what is assumed of it is stated, so that a height given later raises the sign
    assert (made.height_above_road_m, made.sd_above_road_m) == (2.2, 0.8)
    far = {"kind": "add", "class_name": "stop", "lon_deg": lon + 0.1, "lat_deg": lat}
    shown.add(far)
    assert np.isnan([s.height_m for s in load_products(drive).signs or []][-1])
    for bad in ({}, {"lon_deg": "x", "lat_deg": 1}, {"lon_deg": 500, "lat_deg": 1}):
        with pytest.raises(ValueError, match="it"):
            shown.add({"kind": "add", "class_name": "stop", **bad})


def test_views_of_two_signs_are_split_and_made_one_again(drive: Path) -> None:
    shown = Reviewing(open_map(drive))
    before = load_products(drive)
    assert before.observations is not None
    leaving = [k for k in frames_of(shown, 0) if k % 2]
    assert len(leaving) == 20
    with pytest.raises(ValueError, match="leaves views to both"):
        shown.add({"kind": "split", "row": 0, "views": []})
    told = shown.add({"kind": "split", "row": 0, "views": [["demo", "front", k] for k in leaving]})
    (made,) = told["made"]
    assert frames_of(shown, made["row"]) == leaving
    assert off_m(made, "s0002") < 0.5
    rest = next(v for v in told["verdicts"] if v["sign"] == "s0001")
    assert off_m(rest, "s0001") < 0.5
    assert not set(frames_of(shown, 0)) & set(leaving)
    products = load_products(drive)
    assert products.observations is not None
    ids = products.observations["sign_id"].to_pylist()
    assert made["id"] in ids
    assert [s.id for s in products.signs or []] == ["s0001", "s0003", made["id"]]

    told = shown.add({"kind": "merge", "row": 1, "other": made["row"]})
    merged = next(v for v in told["verdicts"] if v["sign"] == made["id"])
    assert (merged["status"], merged["into"]) == ("merged", "s0003")
    assert set(leaving) <= set(frames_of(shown, 1))
    products = load_products(drive)
    assert [s.id for s in products.signs or []] == ["s0001", "s0003"]
    assert products.observations is not None
    assert made["id"] not in products.observations["sign_id"].to_pylist()
    for _ in range(2):
        last = shown.told()["last"][""]
        shown.add({"kind": "undo", "undoes": last["id"]})
    after = load_products(drive)
    assert after.observations is not None
    assert after.observations.equals(before.observations)
    assert [s.id for s in after.signs or []] == ["s0001", "s0003"]
    assert shown.sign(99) is None


def test_signs_are_merged_without_their_recording(drive: Path) -> None:
    (drive.parent / names.MANIFEST).unlink()
    shown = Reviewing(open_map(drive))
    shown.add({"kind": "merge", "row": 0, "other": 1})
    (only,) = load_products(drive).signs or []
    # by covariance intersection two like places are as sure as one
    assert np.allclose(only.cov_enu[:2, :2], sign(1).cov_enu[:2, :2])
    assert only.lat_rad == pytest.approx(trajectory().lat_rad[0] + 10.5e-6, abs=1e-9)
    assert only.n_views == 18
    with pytest.raises(ValueError, match="itself"):
        shown.add({"kind": "merge", "row": 0, "other": 0})
    with pytest.raises(ValueError, match="recording"):
        shown.preview({"views": clicks("s0002", (20, 39))})


# --- and what people get


def test_every_export_has_what_reviewers_did(drive: Path, tmp_path: Path) -> None:
    shown = Reviewing(replace(open_map(drive), reviewer="Anna"))
    lon, lat = (float(np.degrees(v[0])) for v in (trajectory().lon_rad, trajectory().lat_rad))
    shown.add({"kind": "add", "class_name": "yield", "lon_deg": lon, "lat_deg": lat})
    shown.add({"kind": "correct", "row": 0, "facing_deg": 12.0, "reviewer": "Ben"})
    shown.add({"kind": "merge", "row": 0, "other": 1})
    wanted = ("geojson", "csv", "kml", "osm", "gpkg", "parquet", "xlsx", "shapefile", "flatgeobuf")
    made = {}
    for fmt in wanted:
        made[fmt] = tmp_path / f"map.{fmt}"
        assert run_command(["export", str(drive), "--format", fmt, "-o", str(made[fmt])]) == 0, fmt
    features = json.loads(made["geojson"].read_text())["features"]
    rows = {f["id"]: f["properties"] for f in features}
    assert len(rows) == 2
    assert rows["s0001"]["facing_deg"] == 12.0
    assert {r["reviewer"] for r in rows.values()} == {"Anna"}
    assert all(r["reviewed"].endswith("Z") for r in rows.values())
    assert [r["status"] for r in rows.values()] == ["corrected", "added"]
    for fmt in ("csv", "kml"):
        assert "Anna" in made[fmt].read_text(), fmt
    assert made["osm"].read_text().count("<node") == 2
    assert "fixme" not in made["osm"].read_text()
    with sqlite3.connect(made["gpkg"]) as base:
        found = base.execute("SELECT status, reviewer, reviewed IS NOT NULL FROM signs").fetchall()
    assert sorted(found) == [("added", "Anna", 1), ("corrected", "Anna", 1)]
    import pyarrow.parquet as pq

    assert pq.read_table(made["parquet"])["reviewer"].to_pylist() == ["Anna", "Anna"]


def test_a_sign_that_was_added_has_a_post_a_road_and_a_height_above_the_sea(
    drive: Path, tmp_path: Path
) -> None:
    """As those that drives saw; one beside another stands on that one's post, and one that was
    moved away has left it."""
    path = trajectory()
    signs = [replace(s, support="p1") for s in read_signs(drive / names.SIGNS_RAW)]
    write_signs(drive / names.SIGNS_RAW, signs)
    shown = Reviewing(open_map(drive))
    places = np.degrees([[s.lon_rad, s.lat_rad] for s in signs])
    beside = places[0] + [0.8 / 91_000, 0.0]
    away = places[1] + [9.0 / 91_000, 0.0]
    for lon, lat in (beside, np.degrees([path.lon_rad[500], path.lat_rad[500]])):
        shown.add({"kind": "add", "class_name": "yield", "lon_deg": lon, "lat_deg": lat})
    shown.add({"kind": "correct", "row": 1, "lon_deg": away[0], "lat_deg": away[1]})
    line = np.degrees(np.column_stack([path.lon_rad, path.lat_rad]))[::50].tolist()
    road = {"type": "LineString", "coordinates": line}
    feature = {"type": "Feature", "properties": {"road_id": "A7"}, "geometry": road}
    roads, made = tmp_path / "roads.geojson", tmp_path / "map.geojson"
    roads.write_text(json.dumps({"type": "FeatureCollection", "features": [feature]}))
    asked = ["export", str(drive), "--format", "geojson", "-o", str(made), "--roads", str(roads)]
    assert run_command(asked) == 0
    rows = [f["properties"] for f in json.loads(made.read_text())["features"]]
    first, second = (row for row in rows if row["status"] == "added")
    assert first["support"] == "p1"
    assert second["support"] == f"p{second['id']}"
    assert next(r for r in rows if r["status"] == "corrected")["support"] == f"p{signs[1].id}"
    assert (second["road_id"], second["road_side"] in ("left", "right")) == ("A7", True)
    told = next(r for r in rows if r["status"] == "ok" and r["height_msl_m"] is not None)
    assert second["height_msl_m"] == pytest.approx(told["height_msl_m"], abs=20.0)


def test_the_report_has_what_reviewers_did(drive: Path) -> None:
    from pipeline.report.render import report_html

    shown = Reviewing(open_map(drive))
    lon, lat = (float(np.degrees(v[0])) for v in (trajectory().lon_rad, trajectory().lat_rad))
    told = shown.add(
        {"kind": "add", "class_name": "yield", "lon_deg": lon, "lat_deg": lat, "reviewer": "Anna"}
    )
    shown.add({"kind": "reject", "row": 2, "reviewer": "Anna"})
    shown.add({"kind": "accept", "row": 2, "reviewer": "Ben"})
    shown.add({"kind": "merge", "row": 0, "other": 1})
    products = load_products(drive)
    page = report_html(products, "demo", {})
    assert told["made"][0]["id"] in page
    assert '"Ben"' in page
    assert "s0003" not in page.split('id="map-data"')[1].split("</script>")[0].split('"cards"')[0]
    assert "Reviewers disagree about 1 sign" in page
