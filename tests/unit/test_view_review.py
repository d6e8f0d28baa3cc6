"""What reviewers decide: kept whatever happens, applied to the right signs."""

from __future__ import annotations

import json
import multiprocessing
import os
import signal
import threading
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from export_inputs import HOSTILE, sign, write_run
from hypothesis import given, settings
from hypothesis import strategies as st

from automap.errors import InputError
from automap.io import names
from automap.io.review_json import action_of, append_action, read_review
from automap.io.signs_table import write_signs
from automap.records import ReviewAction, Sign
from automap.review.reviewed import apply_review
from automap.review.verdicts import verdicts
from pipeline.cli.root import run_command
from pipeline.shared.products import load_products

NOON = "2026-03-14T12:00:00Z"


def action(number: int, kind: str, of: Sign | None = None, **fields: Any) -> ReviewAction:
    """An action on a sign as the page sends it."""
    of = sign(1) if of is None else of
    return action_of(
        {
            "id": f"a{number}",
            "time": f"2026-03-14T09:20:{number % 60:02d}Z",
            "sign": of.id,
            "kind": kind,
            "seen_class": of.class_name,
            "seen_lon_deg": float(np.degrees(of.lon_rad)),
            "seen_lat_deg": float(np.degrees(of.lat_rad)),
            **fields,
        }
    )


def status(*actions: ReviewAction) -> str:
    found = verdicts(actions)
    return found["s0001"].status if "s0001" in found else "none"


def test_the_last_word_counts() -> None:
    accept, reject = action(1, "accept"), action(2, "reject")
    assert status(accept) == "accepted"
    assert status(accept, reject) == "rejected"
    assert status(reject, action(3, "accept")) == "accepted"
    assert status(action(1, "correct", class_name="yield"), action(3, "accept")) == "corrected"
    assert status(accept, action(4, "reset")) == "none"
    assert status(action(5, "note", note="rusty")) == ""
    assert status() == "none"


def test_undo_and_its_undoing() -> None:
    accept, reject = action(1, "accept"), action(2, "reject")
    undo = action(3, "undo", undoes="a2")
    assert status(accept, reject, undo) == "accepted"
    assert status(accept, reject, undo, action(4, "undo", undoes="a3")) == "rejected"
    assert status(accept, action(2, "reset"), undo) == "accepted"


def test_decisions_change_their_signs_and_no_other() -> None:
    signs = [sign(i, path_offset_m=3.0) for i in range(1, 6)]
    done = apply_review(
        signs,
        [
            action(1, "accept", signs[0]),
            action(2, "reject", signs[1]),
            action(
                3, "correct", signs[2], class_name="yield", lon_deg=8.471, lat_deg=48.971, sd_m=0.5
            ),
        ],
    )
    assert [s.id for s in done.signs] == ["s0001", "s0003", "s0004", "s0005"]
    assert [s.id for s in done.rejected] == ["s0002"]
    accepted, corrected, *rest = done.signs
    assert accepted.status == "accepted"
    assert (corrected.status, corrected.class_name) == ("corrected", "yield")
    assert np.degrees([corrected.lon_rad, corrected.lat_rad]) == pytest.approx([8.471, 48.971])
    assert corrected.cov_enu[0, 0] == corrected.cov_enu[1, 1] == 0.25
    assert corrected.cov_enu[2, 2] == signs[2].cov_enu[2, 2]
    # how far it is from the path was of its older place
    assert np.isnan(corrected.path_offset_m)
    assert rest == signs[3:]
    assert done.problems == []


def test_what_a_detector_believed_of_one_class_is_not_told_of_another() -> None:
    believed = sign(1, class_probability=0.6, group_probability=0.9)
    (changed,) = apply_review([believed], [action(1, "correct", class_name="yield")]).signs
    assert np.isnan([changed.class_probability, changed.group_probability]).all()
    (kept,) = apply_review([believed], [action(1, "accept")]).signs
    assert kept.class_probability == 0.6


def test_a_sign_with_another_number_is_found_where_it_was() -> None:
    old = [sign(1), sign(2)]
    # a new run numbers the signs the other way round and moves them by half a metre
    new = [
        sign(1, id="s0002", lat_rad=old[0].lat_rad + 8e-8),
        sign(2, id="s0001", lat_rad=old[1].lat_rad + 8e-8),
    ]
    done = apply_review(new, [action(1, "reject", old[0])])
    assert [s.id for s in done.rejected] == ["s0002"]


def test_a_sign_that_is_gone_is_said_and_kept() -> None:
    done = apply_review([sign(4)], [action(1, "reject", sign(1))])
    assert len(done.signs) == 1
    assert "s0001" in done.problems[0]
    assert apply_review([], [action(1, "accept")]).problems


def test_two_signs_on_a_pole_are_told_apart_by_their_id() -> None:
    pair = [sign(1), sign(2, lat_rad=sign(1).lat_rad, lon_rad=sign(1).lon_rad, class_name="stop")]
    done = apply_review(pair, [action(1, "reject", pair[1])])
    assert [s.id for s in done.rejected] == ["s0002"]


@pytest.mark.parametrize(
    "value",
    [
        [],
        {},
        {"id": "a", "time": "yesterday", "sign": "s", "kind": "accept"},
        {"id": "a", "time": NOON, "sign": "s", "kind": "destroy"},
        {"id": "a", "time": NOON, "sign": "s", "kind": "accept", "extra": 1},
        {"id": "a", "time": NOON, "sign": "", "kind": "accept"},
        {"id": "a", "time": NOON, "sign": ["s"], "kind": "accept"},
        {"id": "a", "time": NOON, "sign": "s", "kind": "correct", "lon_deg": "8", "lat_deg": 4},
        {"id": "a", "time": NOON, "sign": "s", "kind": "correct", "lon_deg": 8, "lat_deg": 94},
        {"id": "a", "time": NOON, "sign": "s", "kind": "correct", "sd_m": -1},
        {"id": "a", "time": NOON, "sign": "s", "kind": "correct", "sd_m": 0},
        {"id": "a", "time": NOON, "sign": "s", "kind": "correct", "lon_deg": 48, "lat_deg": 11}
        | {"seen_lon_deg": 11.0, "seen_lat_deg": 48.0},
        {"id": "a", "time": NOON, "sign": "s", "kind": "correct", "lon_deg": float("nan")},
        {"id": "a", "time": NOON, "sign": "s", "kind": "correct", "lon_deg": True},
    ],
)
def test_what_is_no_action_is_refused(value: Any) -> None:
    with pytest.raises((ValueError, KeyError)):
        action_of(value)


@settings(max_examples=15)
@given(
    st.lists(
        st.tuples(
            st.sampled_from(["accept", "reject", "correct", "note", "reset", "undo"]),
            st.text(max_size=8),
            st.integers(1, 4),
        ),
        max_size=12,
    )
)
def test_a_file_gives_back_what_was_put_in(rows: list[tuple[str, str, int]]) -> None:
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / names.REVIEW
        put = [
            action(n, kind, sign(number), note=text or None, undoes=f"a{n - 1}")
            for n, (kind, text, number) in enumerate(rows)
        ]
        for one in put:
            append_action(path, one)
        assert read_review(path) == put


def test_a_damaged_review_is_neither_used_nor_overwritten(tmp_path: Path) -> None:
    path = tmp_path / names.REVIEW
    for content in ('{"schema": "automap.review/1", "acti', '{"actions": []}', "[]"):
        path.write_text(content)
        with pytest.raises(InputError, match=r"review\.json"):
            read_review(path)
        with pytest.raises(InputError):
            append_action(path, action(1, "accept"))
        assert path.read_text() == content


def _append_many(path: Path, start: int, count: int) -> None:
    for number in range(start, start + count):
        append_action(path, action(number, "note", note=str(number)))


def test_threads_and_processes_lose_nothing(tmp_path: Path) -> None:
    path = tmp_path / names.REVIEW
    context = multiprocessing.get_context("fork")
    workers: list[Any] = [
        context.Process(target=_append_many, args=(path, 100 * k, 12)) for k in range(2)
    ]
    workers += [
        threading.Thread(target=_append_many, args=(path, 100 * k, 12)) for k in range(2, 4)
    ]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    assert len({a.id for a in read_review(path)}) == 48


def test_a_kill_in_the_middle_loses_nothing_that_was_said(tmp_path: Path) -> None:
    path = tmp_path / names.REVIEW
    told, tell = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(told)
        number = 0
        while True:
            append_action(path, action(number, "accept"))
            os.write(tell, b".")
            number += 1
    os.close(tell)
    acknowledged = b""
    while len(acknowledged) < 20:
        acknowledged += os.read(told, 1)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    with os.fdopen(told, "rb") as rest:
        acknowledged += rest.read()
    kept = read_review(path)
    assert len(acknowledged) <= len(kept) <= len(acknowledged) + 1
    append_action(path, action(9999, "accept"))
    assert len(read_review(path)) == len(kept) + 1


def test_the_next_export_has_what_the_review_says(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = write_run(tmp_path / "out", signs=4)
    for one in (
        action(1, "reject", sign(1)),
        action(2, "correct", sign(2), class_name=HOSTILE),
        action(3, "accept", sign(3)),
    ):
        append_action(out / names.REVIEW, one)
    assert run_command(["export", str(out), "--format", "geojson"]) == 0
    content = json.loads((out / names.SIGNS_GEOJSON).read_text(encoding="utf-8"))
    found = {f["id"]: f["properties"] for f in content["features"]}
    assert list(found) == ["s0002", "s0003", "s0004"]
    assert (found["s0002"]["status"], found["s0002"]["class"]) == ("corrected", HOSTILE)
    assert found["s0003"]["status"] == "accepted"
    assert [s.id for s in load_products(out).rejected] == ["s0001"]
    capsys.readouterr()


def test_notes_are_in_every_export_and_fixme_is_for_the_unseen(tmp_path: Path) -> None:
    out = write_run(tmp_path / "out", signs=3)
    for one in (
        replace(action(1, "note", sign(1), note="leans & rusts"), reviewer="Anna"),
        action(2, "accept", sign(2)),
    ):
        append_action(out / names.REVIEW, one)
    for fmt, name in (
        ("geojson", "a.geojson"),
        ("csv", "a.csv"),
        ("kml", "a.kml"),
        ("osm", "a.osm"),
    ):
        assert run_command(["export", str(out), "--format", fmt, "-o", str(tmp_path / name)]) == 0
        text = (tmp_path / name).read_text(encoding="utf-8")
        # of who wrote a note and when no decision tells
        by = f"rusts (Anna, {action(1, 'note').time[:10]})"
        assert f"leans & {by}" in text or f"leans &amp; {by}" in text, fmt
    nodes = (tmp_path / "a.osm").read_text(encoding="utf-8").split("<node ")[1:]
    assert ['k="fixme"' in node for node in nodes] == [True, False, True]


def test_a_review_of_another_map_is_a_warning(tmp_path: Path) -> None:
    out = write_run(tmp_path / "out", signs=2)
    write_signs(out / names.SIGNS_RAW, [sign(7)])
    append_action(out / names.REVIEW, action(1, "reject", sign(1)))
    products = load_products(out)
    assert len(products.signs or []) == 1
    assert any("s0001" in text for text in products.problems)
    review = [action(k, "correct", sign(k), class_name=c) for k, c in ((1, "stopp"), (2, "stop"))]
    of_map = [sign(1), sign(2)]
    assert ["'stopp' of s0001" in text for text in apply_review(of_map, review).problems] == [True]
    assert apply_review(of_map, review[1:]).problems == []
    (out / names.REVIEW).write_text("{broken")
    assert any(names.REVIEW in text for text in load_products(out).problems)
