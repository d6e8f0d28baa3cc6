"""Adding, turning, raising, splitting, merging: computed from frames, obeyed by all exports."""

from __future__ import annotations

import json
import sqlite3
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from export_inputs import sign, trajectory, write_run
from fake_stages import make_drive

from automap.earth import local_ned
from automap.frames import rpy_to_matrix
from automap.io import names
from automap.io.signs_table import read_signs, write_signs
from automap.io.tables import write_columns
from automap.review import limits
from pipeline.cli.root import run_command
from pipeline.shared.products import load_products
from pipeline.view.opening import open_map
from pipeline.view.reviewing import Reviewing

FOCAL, WIDE, HIGH = 1000.0, 1280, 720
PLACES = {"s0001": (60.0, 5.0, -1.5), "s0002": (75.0, 6.5, -1.5)}
"""Signs ahead of where the path begins, m along the first course, right and down."""


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


def test_what_is_zero_is_told_too(drive: Path) -> None:
    shown = Reviewing(open_map(drive))
    zero = {"facing_deg": 0.0, "height_above_road_m": 0.0}
    (verdict,) = shown.add({"row": 0, "kind": "correct", **zero})["verdicts"]
    assert {name: verdict.get(name) for name in zero} == zero
    place = {name: shown.sign(0)[name] for name in ("lon_deg", "lat_deg")}  # type: ignore[index]
    told = shown.add({"kind": "add", "class_name": "stop", **place})
    # a circle's axes point anywhere, but somewhere
    assert told["verdicts"][-1]["azimuth"] == told["made"][0]["azimuth"] == 0.0


def test_a_view_that_the_edge_of_the_frame_cuts_off_says_so(drive: Path) -> None:
    path = drive / names.OBSERVATIONS
    table = pq.read_table(path)
    right = table["x_max"].to_numpy().copy()
    right[-2] = WIDE - 1.0
    at = table.column_names.index("x_max")
    pq.write_table(table.set_column(at, "x_max", pa.array(right)), path)
    shown = Reviewing(open_map(drive))
    cut = {v["row"]: v["cut"] for row in (0, 1) for v in shown.sign(row)["views"]}  # type: ignore[index]
    assert [row for row, own in cut.items() if own] == [len(right) - 2]


def test_the_card_names_the_code_of_the_class_that_the_review_gave(drive: Path) -> None:
    record = json.loads((drive / names.RUN).read_text())
    (drive / names.RUN).write_text(json.dumps({**record, "country": "DE"}))
    shown = Reviewing(open_map(drive))
    shown.add({"row": 0, "kind": "correct", "class_name": "regulatory--yield--g1"})
    assert shown.sign(0)["values"]["code"] == "DE:205"  # type: ignore[index]
