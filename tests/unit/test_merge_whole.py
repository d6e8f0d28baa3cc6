"""A merged map has what its drives have: heights, pictures, tracks, observations, notes."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import cv2
import numpy as np
import pyarrow.parquet as pq
import pyogrio
import pytest
from export_inputs import HOSTILE, write_run
from export_inputs import sign as made_sign

from automap.export.pictures import SignView
from automap.export.sign_columns import sign_columns
from automap.io import names
from automap.io.map_tables import TRACKS, read_tracks
from automap.io.review_json import append_action
from automap.io.signs_table import read_signs
from automap.io.tables import read_fixes, write_fixes
from automap.records import PlacedSign, ReviewAction
from pipeline.cli.root import run_command
from pipeline.merge import whole
from pipeline.merge.inputs import read_run
from pipeline.merge.whole import TRACK_STEP_M, Whole, complete, thinned
from pipeline.report import map_data
from pipeline.shared.pictures import Picture, read_pictures, write_pictures
from pipeline.shared.products import load_products

GEOID_M = 48.0


def with_picture(out: Path, height_px: float, shade: int) -> None:
    box = np.array([100.0, 100.0, 100.0 + height_px, 100.0 + height_px])
    first = read_signs(out / names.SIGNS_RAW)[0]
    view = SignView(first.id, 1, "front", 7, first.last_seen_ns, box, 0.9, 12.0)
    _, jpeg = cv2.imencode(".jpg", np.full((20, 20, 3), shade, np.uint8))
    write_pictures(out, [Picture(view, jpeg.tobytes())])


@pytest.fixture(scope="module")
def merged(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("whole")
    runs = [write_run(root / name, name=name) for name in ("monday", HOSTILE.replace("/", ""))]
    # the other is of a week later: fixes of one time would be those of one recording
    fixes = read_fixes(runs[1] / names.FIXES)
    write_fixes(runs[1] / names.FIXES, replace(fixes, gps_s=fixes.gps_s + 7 * 86400.0))
    for run, size, shade in zip(runs, (40.0, 80.0), (50, 200), strict=True):
        with_picture(run, size, shade)
    sign = read_signs(runs[0] / names.SIGNS_RAW)[0]
    lon, lat = float(np.degrees(sign.lon_rad)), float(np.degrees(sign.lat_rad))
    note = ReviewAction(
        "a1", "2026-11-23T10:00:00Z", sign.id, "note", sign.class_name, lon, lat,
        note="leans <b>left</b>",
    )  # fmt: skip
    append_action(runs[0] / names.REVIEW, note)
    accept = ReviewAction(
        "a2", "2026-11-23T10:05:00Z", sign.id, "accept", sign.class_name, lon, lat, reviewer="Anna"
    )
    append_action(runs[0] / names.REVIEW, accept)
    assert run_command(["merge", *map(str, runs), "-o", str(root / "map")]) == 0
    # a second merge into the same folder takes the place of the first
    assert run_command(["merge", *map(str, runs), "-o", str(root / "map")]) == 0
    return root / "map"


def features(folder: Path) -> list[dict[str, Any]]:
    content = json.loads((folder / names.SIGNS_GEOJSON).read_text(encoding="utf-8"))
    return [
        {**f["properties"], "height_m": f["geometry"]["coordinates"][2]}
        for f in content["features"]
    ]


def test_heights_above_the_sea_are_those_of_the_drives_receivers(merged: Path) -> None:
    for sign in features(merged):
        assert sign["height_m"] - sign["height_msl_m"] == pytest.approx(GEOID_M, abs=0.01)


def test_notes_of_reviews_of_the_drives_say_whose_they_are(merged: Path) -> None:
    noted = [sign["note"] for sign in features(merged) if sign["note"]]
    assert noted == ["monday: leans <b>left</b> (2026-11-23)"]


def test_who_decided_about_a_sign_in_a_drive_is_in_the_map(merged: Path) -> None:
    told = [(sign["reviewer"], sign["reviewed"]) for sign in features(merged) if sign["reviewer"]]
    assert told == [("Anna", "2026-11-23T10:05:00Z")]


def test_a_class_that_a_reviewer_of_a_drive_gave_is_the_maps() -> None:
    """And what another one only accepted before does not count against it; the other signs are as
    the drives together have them."""
    one = made_sign(1, class_name="stop", class_probability=0.9, existence=0.8, confidence=0.7)
    told = Whole(
        reviews={
            one.id: [
                ("2026-11-24T10:00:00Z", "Ben", "corrected", "yield"),
                ("2026-11-23T10:00:00Z", "Anna", "accepted", "stop"),
            ]
        }
    )
    first, second = complete([one, replace(one, id="s0002")], told)
    assert (first.class_name, first.status, first.reviewer) == ("yield", "corrected", "Ben")
    assert np.isnan(first.class_probability)
    assert first.confidence == first.existence == 0.8
    assert (second.class_name, second.class_probability, second.status) == ("stop", 0.9, "ok")
    assert (second.confidence, second.reviewer) == (0.7, "")


def test_a_sign_that_a_reviewer_added_is_there_and_is_seen_as_the_drive_passes(
    tmp_path: Path,
) -> None:
    """It has no times of its own, at which a merge had ended."""
    run = write_run(tmp_path / "monday", name="monday")
    path = read_run(run).signs.path
    assert path is not None
    lon, lat = (float(np.degrees(v[40])) for v in (path.lon_rad, path.lat_rad))
    place = PlacedSign(lon, lat, (1.0, 0.0, 1.0, 4.0))
    add = ReviewAction(
        "a1", "2026-11-23T10:00:00Z", "r1", "add", "stop", lon, lat, "stop", place=place
    )
    append_action(run / names.REVIEW, add)
    signs = read_run(run).signs
    row = signs.ids.index("r1")
    assert abs(signs.last_gps_s[row] - path.gps_s[40]) < 1.0
    assert signs.existence[row] > 0.999


def test_the_best_view_comes_first(merged: Path) -> None:
    pictures = read_pictures(load_products(merged))
    assert [p.view.rank for p in pictures] == [1, 2]
    assert pictures[0].view.box[3] - pictures[0].view.box[1] == 80.0
    assert cv2.imdecode(np.frombuffer(pictures[0].jpeg, np.uint8), 1).mean() > 150.0
    assert {p.view.sign_id for p in pictures} < {sign["id"] for sign in features(merged)}


def test_observations_have_the_maps_names_and_lie_on_their_drives_tracks(merged: Path) -> None:
    table = pq.read_table(merged / names.OBSERVATIONS)
    ids = {sign["id"] for sign in features(merged)}
    assert set(table["sign_id"].to_pylist()) <= ids
    assert len(set(table["drive"].to_pylist())) == 2
    _, _, geometry, fields = pyogrio.raw.read(merged / names.GPKG, layer="observations")
    assert len(fields) > 0
    assert len(geometry) == len(table)
    assert all(wkb is not None for wkb in geometry)


def test_every_drive_has_its_track_in_each_format_that_holds_tracks(merged: Path) -> None:
    tracks = read_tracks(merged / TRACKS)
    drives = {name for sign in features(merged) for name in sign["drives"].split(", ")}
    assert set(tracks) == drives
    assert run_command(["export", str(merged), "--format", "gpx"]) == 0
    root = ElementTree.parse(merged / "trajectory.gpx").getroot()
    found = [t.findtext("{*}name") for t in root.iterfind("{*}trk")]
    assert len(found) == 2
    assert "monday" in found
    kml = ElementTree.parse(merged / names.KML).getroot()
    assert len(kml.findall(".//{*}Track")) == 2
    meta, _, _, columns = pyogrio.raw.read(merged / names.GPKG, layer="trajectory")
    assert set(columns[list(meta["fields"]).index("drive")]) == drives


def test_a_track_keeps_its_course(merged: Path) -> None:
    full = load_products(merged.parent / "monday").trajectory
    assert full is not None
    track = thinned(full)
    assert len(track) < 0.2 * len(full)
    assert track.t_ns[0] == full.t_ns[0]
    assert track.t_ns[-1] == full.t_ns[-1]
    step = np.diff(track.t_ns) * 1e-9 * np.hypot(*track.vel_ned[1:, :2].T)
    assert step.max() < 1.5 * TRACK_STEP_M


def test_a_map_of_very_many_things_leaves_them_with_their_drives(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(whole, "MOST_OBSERVATIONS", 100)
    monkeypatch.setattr(whole, "MOST_PICTURED", 3)
    runs = [write_run(tmp_path / name, name=name) for name in ("one", "two")]
    with_picture(runs[0], 40.0, 50)
    assert run_command(["merge", *map(str, runs), "-o", str(tmp_path / "map")]) == 0
    told = capsys.readouterr()
    assert "more than 100 observations" in told.out + told.err
    assert "more than 3 signs" in told.out + told.err
    assert not (tmp_path / "map" / names.OBSERVATIONS).exists()
    assert not (tmp_path / "map" / names.PICTURES).exists()


def test_other_formats_of_trajectories_say_where_to_find_them(
    merged: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_command(["export", str(merged), "--format", "pos"]) == 3
    assert "the folder of one drive" in capsys.readouterr().err


def test_the_page_has_map_list_and_cards(merged: Path) -> None:
    page = (merged / names.REPORT).read_text(encoding="utf-8")
    start = page.index('id="map-data">') + len('id="map-data">')
    data = json.loads(page[start : page.index("</script>", start)])
    assert len(data["tracks"]) == 2
    assert len(data["signs"]["rows"]) == len(features(merged))
    assert sum(len(card["pictures"]) for card in data["signs"]["cards"]) == 2
    assert "<b>left" not in page
    assert 'id="sign-table"' in page


def test_a_drive_without_a_clock_is_told_and_does_without(tmp_path: Path) -> None:
    runs = [write_run(tmp_path / name, name=name) for name in ("one", "two")]
    (runs[1] / names.SYNC).unlink()
    trajectory = pq.read_table(runs[1] / names.TRAJECTORY)
    at = trajectory.column_names.index("gps_s")
    bare = trajectory.set_column(at, "gps_s", [np.full(len(trajectory), np.nan)])
    pq.write_table(bare, runs[1] / names.TRAJECTORY)
    assert run_command(["merge", *map(str, runs), "-o", str(tmp_path / "map")]) == 0
    assert list(read_tracks(tmp_path / "map" / TRACKS)) == ["one"]
    shutil.rmtree(tmp_path / "map")


def test_the_page_draws_some_of_very_many_tracks(
    merged: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    products = load_products(merged)
    monkeypatch.setattr(map_data, "TRACK_LIMIT", 1)
    data = map_data.map_data(products, sign_columns(products.signs or [], products.clock))
    assert data is not None
    assert len(data["tracks"]) == 1
    assert "One in 2 of 2 tracks is drawn; tracks.parquet has all." in data["notes"]


def test_classes_that_are_said_alike_are_told_apart() -> None:
    from types import SimpleNamespace

    from pipeline.merge.report import _class_section

    kinds = ("warning--roundabout--g2", "regulatory--roundabout--g1", "regulatory--stop--g1")
    signs: Any = SimpleNamespace(classes=kinds)
    told = [row[0] for row in _class_section(signs).rows]
    assert told == ["roundabout (warning)", "roundabout (regulatory)", "stop"]


def test_the_page_says_why_no_drive_saw_a_sign() -> None:
    from pipeline.merge.report import _seen_section

    rows = _seen_section(np.array([2, 0, 2]), np.array([1.0, 2.4, 3.0])).rows
    assert rows == [("none: a reviewer added it", "1", "2.40"), ("2", "2", "2.00")]


def test_a_warning_of_the_page_names_the_drive_and_no_folder() -> None:
    from pipeline.merge.report import _without_folders

    text = "/home/anna/runs/2/_automap/signs.parquet was changed; /mnt/b/list.csv was not."
    told = _without_folders(text, {"/home/anna/runs/2/_automap": "tuesday"})
    assert told == "tuesday/signs.parquet was changed; list.csv was not."


@pytest.mark.slow
def test_rejected_signs_of_a_merged_map_stand_apart_until_the_rejection_is_taken_back(
    merged: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    runs = [d["folder"] for d in json.loads((merged / names.MERGE).read_text())["drives"]]
    out = tmp_path / "map"
    shutil.copytree(merged, out)
    first = features(out)[0]["id"]
    sign = next(s for s in read_signs(out / names.SIGNS_RAW) if s.id == first)
    lon, lat = float(np.degrees(sign.lon_rad)), float(np.degrees(sign.lat_rad))
    when = "2026-11-24T10:00:00Z"
    reject = ReviewAction("b1", when, first, "reject", sign.class_name, lon, lat, note="no sign")
    append_action(out / names.REVIEW, reject)
    other, at = read_signs(out / names.SIGNS_RAW)[1], (0.0, 0.0)
    for who, kind in (("Anna", "reject"), ("Ben", "accept")):
        said = ReviewAction(who, when, other.id, kind, other.class_name, *at, reviewer=who)
        append_action(out / names.REVIEW, said)
    assert run_command(["merge", *runs, "-o", str(out)]) == 0
    page = (out / names.REPORT).read_text(encoding="utf-8")
    assert f"Reviewers disagree about 1 sign, as about {other.id} (Ben against Anna)" in page
    assert f"<b>{len(features(out))}</b><span>signs</span>" in page
    # what is printed and what merge.json says are the map after the review
    summary = json.loads((out / names.MERGE).read_text())
    assert (summary["signs"], summary["rejected_signs"]) == (len(features(out)), 1)
    assert json.loads((out / names.RUN).read_text())["metrics"]["signs"] == summary["signs"]
    left = summary["unlikely_signs"] + 1
    assert f"  signs       {summary['signs']}, {left} unlikely or" in capsys.readouterr().out
    apart = json.loads((out / names.REJECTED).read_text())["features"]
    assert [f["id"] for f in apart] == [first]
    assert first not in {s["id"] for s in features(out)}
    undo = ReviewAction("b2", when, first, "undo", sign.class_name, lon, lat, undoes="b1")
    append_action(out / names.REVIEW, undo)
    assert run_command(["merge", *runs, "-o", str(out)]) == 0
    assert not (out / names.REJECTED).exists()
    assert first in {s["id"] for s in features(out)}
