"""Merged maps in the viewer: views of every drive that saw a sign, wherever the runs are now."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from export_inputs import CLOCK, sign, write_run

from automap.errors import InputError
from automap.io import names
from automap.io.clock_json import write_clock
from automap.io.map_tables import SIGHTINGS, write_sightings
from automap.io.review_json import read_review
from automap.io.signs_table import write_signs
from pipeline.view.command import serving
from pipeline.view.opening import open_map
from pipeline.view.reviewing import Reviewing
from tests.browser import launched
from tests.unit.view_page_case import opened, until


@pytest.fixture
def merged(tmp_path: Path) -> Path:
    """A map of two runs; both saw its first sign, the first run as s0001."""
    for name in ("monday", "tuesday"):
        write_run(tmp_path / name, signs=2, name=name)
    out = tmp_path / "map"
    out.mkdir()
    write_signs(
        out / names.SIGNS_RAW,
        [
            sign(1, id="abc", drives=("monday", "tuesday")),
            sign(2, id="def", drives=("tuesday",)),
        ],
    )
    write_clock(out / names.SYNC, CLOCK)
    drives = [{"name": n, "folder": str(tmp_path / n)} for n in ("monday", "tuesday")]
    (out / names.MERGE).write_text(json.dumps({"schema": "automap.merge/1", "drives": drives}))
    texts = {
        "key": ["1", "2", "3"],
        "drive": ["monday", "tuesday", "tuesday"],
        "drive_sign": ["s0001", "s0002", "s0001"],
        "sign_id": ["abc", "abc", "def"],
    }
    write_sightings(out / SIGHTINGS, texts, {"existence": [1.0, 1.0, 1.0]})
    return out


def make_boxes(folder: Path) -> None:
    """Boxes of the run's signs, in the place of the made-up observations."""
    import numpy as np

    from automap.io.tables import write_columns

    t_ns = CLOCK.ref_ns + np.arange(4) * 1_000_000_000
    write_columns(
        folder / names.OBSERVATIONS,
        {
            "camera": np.array(["front"] * 4, object),
            "frame": np.arange(4),
            "t_ns": t_ns,
            "class": np.array(["stop"] * 4, object),
            "x_min": np.zeros(4),
            "y_min": np.zeros(4),
            "x_max": np.full(4, 10.0),
            "y_max": np.arange(4) + 10.0,
            "score": np.full(4, 0.9),
            "sign_id": np.array(["s0001", "s0001", "s0002", None], object),
        },
    )


def test_a_merged_sign_has_the_views_of_all_its_drives(merged: Path) -> None:
    for name in ("monday", "tuesday"):
        make_boxes(merged.parent / name)
    shown = open_map(merged)
    assert (shown.merged, shown.name) == (True, "map")
    assert shown.overview()["drives"] == ["monday", "tuesday"]
    first = Reviewing(shown).sign(0)
    assert first is not None
    assert [(v["drive"], v["frame"]) for v in first["views"]] == [(0, 0), (0, 1), (1, 2)]
    assert first["values"]["first_seen"].startswith("2026-")
    second = Reviewing(shown).sign(1)
    assert second is not None
    assert [(v["drive"], v["frame"]) for v in second["views"]] == [(1, 0), (1, 1)]
    assert shown.drives[1].overview()["path"] is not None


@pytest.mark.slow
def test_views_stand_under_the_names_of_their_drives(merged: Path) -> None:
    for name in ("monday", "tuesday"):
        make_boxes(merged.parent / name)
    with launched() as browser, serving(merged) as server:
        page, troubles = opened(browser, server.url)
        page.keyboard.press("n")
        until(page, "() => document.querySelectorAll('#views button').length === 3")
        assert page.locator("#views span").all_inner_texts() == ["monday", "tuesday"]
        label = page.locator("#views button").last.get_attribute("aria-label")
        assert label == "View in frame 2 of tuesday, 12 px"
        assert not troubles


def test_a_review_of_a_merged_map_lies_in_the_map(merged: Path) -> None:
    shown = open_map(merged)
    told = Reviewing(shown).add({"row": 1, "kind": "reject"})
    assert [(v["row"], v["status"]) for v in told["verdicts"]] == [(1, "rejected")]
    assert [a.sign for a in read_review(merged / names.REVIEW)] == ["def"]


def test_runs_that_moved_with_the_map_are_found(merged: Path, tmp_path: Path) -> None:
    elsewhere = tmp_path / "usb"
    elsewhere.mkdir()
    for name in ("map", "monday"):
        shutil.move(str(tmp_path / name), str(elsewhere / name))
    shutil.rmtree(tmp_path / "tuesday")
    shown = open_map(elsewhere / "map")
    monday, tuesday = shown.drives
    assert monday.overview()["path"] is not None
    overview = tuesday.overview()
    assert overview["path"] is None
    assert "tuesday" in overview["problems"][0]
    assert Reviewing(shown).sign(0) is not None


def test_a_damaged_merge_is_one_sentence(merged: Path) -> None:
    for content in ("{", "[]", '{"drives": [{}]}'):
        (merged / names.MERGE).write_text(content)
        with pytest.raises(InputError, match=r"merge\.json"):
            open_map(merged)
