"""The street around a sign in the report's cards and the KMZ, of a run and of a merged map."""

from __future__ import annotations

import base64
import zipfile
from pathlib import Path

import cv2
import numpy as np
import pytest
from export_inputs import write_run

from automap.export.pictures import SignView
from automap.io import names
from automap.io.signs_table import read_signs
from pipeline.cli.root import run_command
from pipeline.report import sign_cards as cards
from pipeline.shared.pictures import Picture, read_pictures, write_pictures
from pipeline.shared.products import load_products


def jpeg(shade: int) -> bytes:
    return bytes(cv2.imencode(".jpg", np.full((40, 60, 3), shade, np.uint8))[1].tobytes())


@pytest.fixture(scope="module")
def maps(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """A run whose first sign has two views and the street around the nearest, and its merge."""
    root = tmp_path_factory.mktemp("context")
    run = write_run(root / "monday", name="monday")
    first = read_signs(run / names.SIGNS_RAW)[0]
    boxes = [np.array([10.0, 10.0, 10.0 + size, 10.0 + size]) for size in (80.0, 40.0)]
    write_pictures(run, [
        Picture(SignView(first.id, rank, "front", 7 - rank, first.last_seen_ns, box, 0.9, 9.0),
                jpeg(60 * rank), jpeg(200) if rank == 1 else None)
        for rank, box in enumerate(boxes, start=1)
    ])  # fmt: skip
    other = write_run(root / "tuesday", name="tuesday")
    merge = ["merge", str(run), str(other), "-o", str(root / "map"), "--quiet"]
    assert run_command(merge) == 0
    assert run_command(["export", str(run), "--format", "kmz"]) == 0
    return [run, root / "map"]


@pytest.mark.parametrize("number", [0, 1])
def test_the_kmz_holds_the_street_and_the_balloon_shows_it_once(
    maps: list[Path], number: int
) -> None:
    with zipfile.ZipFile(maps[number] / names.KMZ) as archive:
        streets = [name for name in archive.namelist() if name.endswith("-context.jpg")]
        assert len(streets) == 1
        assert archive.read(streets[0]) == jpeg(200)
        assert archive.read("doc.kml").decode().count(streets[0]) == 1


@pytest.mark.parametrize("number", [0, 1])
def test_cards_show_it_behind_the_views(maps: list[Path], number: int) -> None:
    products = load_products(maps[number])
    pictures = read_pictures(products)
    rows = range(len(products.signs or []))
    shown = [c["pictures"] for c in cards.sign_cards(products, pictures, list(rows))]
    (own,) = [pictures for pictures in shown if pictures]
    assert [bool(p.get("wide")) for p in own] == [False, False, True]
    assert base64.b64decode(own[-1]["src"].partition(",")[2]) == jpeg(200)


def test_signs_come_before_streets_where_room_is_short(
    maps: list[Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    products = load_products(maps[0])
    pictures = read_pictures(products)
    monkeypatch.setattr(cards, "PICTURE_BUDGET", sum(len(p.jpeg) for p in pictures) + 10)
    found = cards.sign_cards(products, pictures, [0])[0]["pictures"]
    assert [bool(p.get("wide")) for p in found] == [False, False]
