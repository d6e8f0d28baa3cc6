"""Pictures of signs: which views, nothing beyond the sign, and the folder beside the map."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pyarrow as pa
import pytest
from export_inputs import HOSTILE, sign, write_run

from automap.export.pictures import choose_views, safe_name, sign_picture
from automap.io import names
from automap.io.review_json import action_of, append_action
from pipeline.export.command import export_run
from pipeline.export.content import map_content
from pipeline.shared.pictures import (
    Picture,
    Wanted,
    read_pictures,
    take_pictures,
    write_pictures,
)
from pipeline.shared.products import RunProducts, load_products


def observations(sizes: list[float], sign_id: str = "s0001", used: bool = True) -> pa.Table:
    n = len(sizes)
    return pa.table(
        {
            "camera": ["front"] * n,
            "frame": list(range(n)),
            "t_ns": [10**9 * k for k in range(n)],
            "x_min": [100.0] * n,
            "y_min": [50.0] * n,
            "x_max": [100.0 + size for size in sizes],
            "y_max": [50.0 + size for size in sizes],
            "score": [0.9] * n,
            "sign_id": [sign_id] * n,
            "used": [used] * n,
            "range_m": [600.0 / size for size in sizes],
        }
    )


def test_the_nearest_view_comes_first_and_others_from_farther() -> None:
    views = choose_views(observations([10, 14, 19, 27, 38, 54, 80]), ["s0001"])
    by_rank = {view.rank: view.box[2] - view.box[0] for view in views}
    assert by_rank == {1: 80.0, 2: 38.0, 3: 19.0}
    assert [view.frame for view in views] == sorted(view.frame for view in views)


def test_views_of_the_same_size_are_shown_once() -> None:
    assert len(choose_views(observations([40.0] * 9), ["s0001"])) == 1


def test_a_sign_that_the_edge_cuts_off_is_shown_where_there_is_no_other_view_of_it() -> None:
    table = observations([20.0, 40.0, 80.0])
    beside = {"front": (175.0, 500.0)}
    assert [view.frame for view in choose_views(table, ["s0001"], beside)] == [0, 1]
    assert [view.frame for view in choose_views(table.slice(2), ["s0001"], beside)] == [2]
    left = table.set_column(3, "x_min", [[100.0, 100.0, -8.0]])
    assert [view.frame for view in choose_views(left, ["s0001"])] == [0, 1]


@pytest.mark.parametrize(
    "table",
    [
        observations([20.0], used=False),
        observations([20.0], sign_id="another"),
        observations([0.5]),
        observations([20.0]).drop_columns(["x_min"]),
    ],
)
def test_what_is_no_view_of_the_sign_has_no_picture(table: pa.Table) -> None:
    assert choose_views(table, ["s0001"]) == []


def test_a_picture_shows_the_sign_and_nothing_around_it() -> None:
    frame = np.full((720, 1280, 3), (0, 0, 255), np.uint8)
    frame[300:401, 600:701] = (0, 255, 0)
    jpeg = sign_picture(frame, np.array([600.0, 300.0, 700.0, 400.0]))
    assert jpeg is not None
    picture = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
    assert max(picture.shape) <= 128
    around = (picture[:, :, 2] > 128).mean()
    # the rim is six hundredths of the box on each side
    assert 0 < around < 0.26
    middle = picture[15:-15, 15:-15]
    assert (middle[:, :, 1] > 200).all()


@pytest.mark.parametrize(
    "box", [[0, 0, 1279, 719], [1300, 10, 1400, 100], [5, 5, 5, 5], [-90, -90, -10, -10]]
)
def test_boxes_that_are_no_sign_give_no_picture(box: list[float]) -> None:
    frame = np.zeros((720, 1280, 3), np.uint8)
    assert sign_picture(frame, np.array(box, np.float64)) is None


@pytest.mark.parametrize("sign_id", ["../../etc/passwd", HOSTILE, "", "a" * 300, "é", "x\udce9"])
def test_a_name_stays_in_its_folder(sign_id: str) -> None:
    name = safe_name(sign_id)
    assert name.replace("_", "").isalnum()
    assert len(name) < 64
    assert safe_name("s0001") == "s0001"
    assert safe_name("other") != name


def small_picture() -> bytes:
    return bytes(cv2.imencode(".jpg", np.zeros((20, 20, 3), np.uint8))[1].tobytes())


def test_pictures_are_read_as_they_were_written(tmp_path: Path) -> None:
    bad = "=HYPERLINK(1)" + HOSTILE
    table = pa.concat_tables([observations([30.0, 60.0]), observations([30.0], sign_id=bad)])
    views = choose_views(table, ["s0001", bad])
    written = [Picture(view, small_picture()) for view in views]
    write_pictures(tmp_path, written)
    read = read_pictures(RunProducts(tmp_path))
    assert [p.view.sign_id for p in read] == [p.view.sign_id for p in written]
    assert [p.jpeg for p in read] == [p.jpeg for p in written]
    np.testing.assert_array_equal([p.view.box for p in read], [p.view.box for p in written])
    text = (tmp_path / names.PICTURE_INDEX).read_text()
    assert "=HYPERLINK" in text
    assert not [cell for line in text.splitlines() for cell in line.split(",") if cell[:1] == "="]


def test_an_index_cannot_name_files_elsewhere(tmp_path: Path) -> None:
    (tmp_path / "secret.jpg").write_bytes(b"\xff\xd8 secret")
    view = choose_views(observations([30.0]), ["s0001"])[0]
    write_pictures(tmp_path, [Picture(view, small_picture())])
    index = tmp_path / names.PICTURE_INDEX
    index.write_text(index.read_text().replace("s0001-1.jpg,s0001", "../secret.jpg,../secret"))
    assert read_pictures(RunProducts(tmp_path)) == []


def test_a_run_without_video_has_no_pictures(tmp_path: Path) -> None:
    products = load_products(write_run(tmp_path / "out"))
    assert take_pictures(products, {}) == []


def test_pictures_of_the_same_boxes_are_not_taken_again(tmp_path: Path) -> None:
    products = load_products(write_run(tmp_path / "out"))
    products.signs = [sign(1)]
    products.observations = observations([30.0, 60.0])
    views = choose_views(products.observations, ["s0001"])
    write_pictures(products.out, [Picture(view, small_picture()) for view in views])
    # there is no video to take them from
    assert len(take_pictures(products, {})) == len(views) == 2
    products.observations = observations([31.0, 61.0])
    assert take_pictures(products, {}) == []


def street_picture(grey: int) -> bytes:
    image = np.full((20, 40, 3), grey, np.uint8)
    return bytes(cv2.imencode(".jpg", image)[1].tobytes())


def test_the_street_around_a_sign_is_kept_with_whether_it_is_hidden(tmp_path: Path) -> None:
    products = load_products(write_run(tmp_path / "out"))
    products.signs = [sign(1)]
    products.observations = observations([30.0, 60.0])
    views = choose_views(products.observations, ["s0001"])
    pictures = [
        Picture(view, small_picture(), street_picture(90) if view.rank == 1 else None, False)
        for view in views
    ]
    write_pictures(products.out, pictures)
    assert (products.out / names.PICTURES / "s0001-context.jpg").is_file()
    near = next(p for p in read_pictures(products) if p.view.rank == 1)
    assert near.context == street_picture(90)
    assert not near.hidden
    # shown when it is to be hidden: the picture of the sign stays, the street goes
    again = take_pictures(products, {}, Wanted(hide=True))
    assert [p.context for p in again] == [None, None]
    assert len(take_pictures(products, {}, Wanted(hide=False))[0].context or b"") > 0
    assert all(p.context is None for p in take_pictures(products, {}, Wanted(context=False)))


def test_after_a_review_each_sign_still_has_its_street_and_names_files_that_are_there(
    tmp_path: Path,
) -> None:
    out = write_run(tmp_path / "out")
    ids = [f"s{k:04d}" for k in (1, 2, 3)]
    seen = [observations([30.0 + k, 60.0 + k], sign_id=name) for k, name in enumerate(ids)]
    pictures = [
        Picture(view, small_picture(), street_picture(90) if view.rank == 1 else None)
        for view in choose_views(pa.concat_tables(seen), ids)
    ]
    write_pictures(out, pictures)
    views = [["", "front", p.view.frame] for p in pictures if p.view.sign_id == "s0001"][:1]
    place = {"lon_deg": 8.47, "lat_deg": 48.98, "cov_m2": [0.3, 0.1, 0.2, None]}
    act = {
        "id": "a1", "time": "2026-03-14T09:20:00Z", "sign": "s0001", "kind": "split",
        "seen_class": sign(1).class_name, "place": place, "other": "r1", "other_place": place,
        "other_seen_class": "yield", "views": views,
        "seen_lon_deg": float(np.degrees(sign(1).lon_rad)),
        "seen_lat_deg": float(np.degrees(sign(1).lat_rad)),
        "other_seen_lon_deg": 8.47, "other_seen_lat_deg": 48.98,
    }  # fmt: skip
    append_action(out / names.REVIEW, action_of(act))
    values = map_content(out, "demo").signs.values
    named = {
        name: [best, street]
        for name, best, street in zip(
            *(values[k] for k in ("id", "picture_file", "street_file")), strict=True
        )
    }
    assert named["s0003"] == ["pictures/s0003-1.jpg", "pictures/s0003-context.jpg"]
    for name in ("s0001", "r1"):
        assert named[name][0] is not None
    told = [file for pair in named.values() for file in pair if file]
    assert all((out / file).is_file() for file in told), told


def test_a_file_that_is_written_elsewhere_is_told_to_want_the_pictures_beside_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out, away = write_run(tmp_path / "out"), tmp_path / "away"
    away.mkdir()
    monkeypatch.chdir(away)
    views = choose_views(observations([30.0, 60.0]), ["s0001"])
    write_pictures(out, [Picture(view, small_picture(), None) for view in views])

    def told(fmt: str, target: Path | None) -> list[str]:
        return [text for text in export_run(out, fmt, target)[1] if "copy the folder" in text]

    (text,) = told("csv", away / "signs.csv")
    assert str(out / names.PICTURES) in text
    assert told("csv", Path("signs.csv"))[0].endswith("to this folder.")
    # beside the pictures, with them inside, or without any
    assert told("csv", None) == told("xlsx", away / "signs.xlsx") == []
    assert told("tum", away / "path.tum") == []
    (away / names.PICTURES).mkdir()
    assert told("csv", away / "signs.csv") == []
