"""What lies below a map: every kind of file shows each place where it is, or says why not."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable
from pathlib import Path
from typing import Any

import backgrounds as made
import numpy as np
import pytest

from automap.errors import InputError
from automap.io import tile_archives
from automap.io.background import check_below, cut_out, open_background
from automap.io.web_tiles import decoded, from_world, to_world, zoom_for
from tests.slow_cases import others_slow


def grid(half_m: float, px: int) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    """Longitudes and latitudes of a picture about the middle, as the report's is."""
    at = (np.arange(px) + 0.5) / px * 2 - 1
    east, north = np.meshgrid(at * half_m / 73_000, -at * half_m / 111_200)
    return made.EAST + east, made.NORTH + north


KINDS: dict[str, Callable[[Path], Path]] = {
    "tiles.mbtiles": made.write_mbtiles,
    "tiles.pmtiles": made.write_pmtiles,
    "utm.tif": made.write_geotiff,
    "degrees.tif": lambda path: made.write_geotiff(path, 4326),
    "mercator.tif": lambda path: made.write_geotiff(path, 3857),
    "laea.tif": lambda path: made.write_geotiff(path, 3035),
    "utm.gpkg": made.write_geopackage,
    "degrees.gpkg": lambda path: made.write_geopackage(path, 4326),
}


@pytest.mark.parametrize("name", KINDS)
@pytest.mark.parametrize("half_m", others_slow([900.0, 120.0]))
def test_each_place_is_where_it_lies(tmp_path: Path, name: str, half_m: float) -> None:
    background = open_background(KINDS[name](tmp_path / name))
    check_below(background, (made.EAST, made.NORTH, made.EAST, made.NORTH), tmp_path / name)
    lon, lat = grid(half_m, 150)
    image = cut_out(background, lon, lat)
    assert image is not None
    # a level of red is 18 m, of green 19 m; JPEG and the middle of a pixel blur two of them
    off = image[..., :3].astype(int) - made.colour(lon, lat).astype(int)
    assert (image[..., 3] == 255).all()
    assert np.abs(off).max() <= 3
    assert np.abs(off.mean(axis=(0, 1))).max() < 0.6
    assert background.name == name


@pytest.mark.parametrize("name", ["utm.tif", "degrees.gpkg"])
def test_tiles_beside_a_picture_are_empty_and_on_its_rim_transparent(
    tmp_path: Path, name: str
) -> None:
    background = open_background(KINDS[name](tmp_path / name))
    west, south, east, north = background.bounds
    assert west < made.EAST < east
    assert south < made.NORTH < north
    zoom = background.most_zoom
    # UTM is turned by the convergence: its box in degrees is no wider than a tenth more
    assert (east - west) * 73_000 < 1.1 * 3 * made.SPAN_M
    x, y = (int(v[0] * 2**zoom) for v in to_world(np.array([west]), np.array([made.NORTH])))
    data = background.tile(zoom, x, y)
    image = None if data is None else decoded(data)
    assert image is not None
    assert {0, 255} <= set(np.unique(image[..., 3]).tolist())
    assert background.tile(zoom, 0, 0) is None


def test_roads_are_drawn_where_they_lie(tmp_path: Path) -> None:
    background = open_background(made.write_roads(tmp_path / "roads.geojson"))
    x, y = (float(v[0]) for v in to_world(np.array([made.EAST + 0.004]), np.array([made.NORTH])))
    data = background.tile(17, int(x * 2**17), int(y * 2**17))
    assert data is not None
    image = decoded(data)
    assert image is not None
    row = round(y * 2**17 % 1 * 512)
    assert (image[row - 1 : row + 1, :, 3] > 100).all()
    assert (image[..., 3] > 0).mean() < 0.05
    assert background.tile(17, int(x * 2**17), int(y * 2**17) + 3) is None


def test_world_and_degrees_are_inverse() -> None:
    lon, lat = np.linspace(-180, 180, 41), np.linspace(-85, 85, 41)
    assert np.allclose(from_world(*to_world(lon, lat)), [lon, lat])
    assert [zoom_for(156_543.03 / 2**k) for k in (0, 7, 18)] == [0, 7, 18]


def broken(path: Path, write: Callable[[Path], Path]) -> Path:
    data = write(path).read_bytes()
    path.write_bytes(data[: len(data) // 2])
    return path


def holding(path: Path, data: bytes) -> Path:
    path.write_bytes(data)
    return path


WRONG: dict[str, tuple[Callable[[Path], Path], str]] = {
    "nowhere.tif": (lambda p: made.write_geotiff(p, placed=False), "does not say where it lies"),
    "bare.tif": (lambda p: made.write_geotiff(p, None), "no coordinate system"),
    "own.tif": (lambda p: made.write_geotiff(p, stated=32767), "EPSG"),
    "unknown.tif": (lambda p: made.write_geotiff(p, stated=9999), "cannot be used"),
    "half.tif": (lambda p: broken(p, made.write_geotiff), "cannot be read as a GeoTIFF"),
    "half.mbtiles": (lambda p: broken(p, made.write_mbtiles), "half.mbtiles"),
    "half.gpkg": (lambda p: broken(p, made.write_geopackage), "half.gpkg"),
    "half.pmtiles": (lambda p: holding(p, b"PMTiles\x03" + bytes(20)), "PMTiles"),
    "vector.mbtiles": (lambda p: made.write_mbtiles(p, kind="pbf"), "vector tiles"),
    "vector.pmtiles": (lambda p: made.write_pmtiles(p, kind="MVT"), "vector tiles"),
    "text.txt": (lambda p: holding(p, b"not a map"), "text.txt"),
    "missing.tif": (lambda p: p, "no such file"),
}


@pytest.mark.parametrize("name", others_slow(WRONG, 4))
def test_what_cannot_be_shown_is_one_sentence(tmp_path: Path, name: str) -> None:
    write, told = WRONG[name]
    with pytest.raises(InputError, match=told) as failure:
        open_background(write(tmp_path / name))
    assert "\n" not in str(failure.value)
    assert name in str(failure.value)


def test_a_picture_of_elsewhere_is_refused(tmp_path: Path) -> None:
    path = made.write_geotiff(tmp_path / "a.tif", east=40_000.0)
    background = open_background(path)
    d = 0.01
    box = (made.EAST - d, made.NORTH - d, made.EAST + d, made.NORTH + d)
    with pytest.raises(InputError, match=r"48\.9.*N.*8\.47.*E"):
        check_below(background, box, path)
    check_below(background, None, path)
    assert cut_out(background, *grid(100.0, 10)) is None


def test_a_large_picture_is_shown_by_its_reduced_copy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from PIL import Image, ImageSequence

    path = made.write_geotiff(tmp_path / "a.tif")
    with Image.open(path) as picture:
        first = next(iter(ImageSequence.Iterator(picture))).copy()
        info = picture.tag_v2  # type: ignore[attr-defined]
        keep = {tag: info[tag] for tag in (33550, 33922, 34735)}
        first.save(
            path, "TIFF", tiffinfo=keep, save_all=True, append_images=[first.resize((100, 100))]
        )
    monkeypatch.setattr("automap.io.geotiff.MOST_PIXELS", 20_000)
    lon, lat = grid(900.0, 60)
    image = cut_out(open_background(path), lon, lat)
    assert image is not None
    assert np.abs(image[..., :3].astype(int) - made.colour(lon, lat)).max() <= 6
    monkeypatch.setattr("automap.io.geotiff.MOST_PIXELS", 200)
    with pytest.raises(InputError, match="million pixels"):
        open_background(path)


def test_a_prj_and_a_world_file_beside_a_picture_are_taken(tmp_path: Path) -> None:
    from pyproj import CRS

    path = made.write_geotiff(tmp_path / "a.tif", None, placed=False)
    _, west, north, step_x, step_y = made.picture_of(25832)
    (tmp_path / "a.prj").write_text(CRS.from_epsg(25832).to_wkt("WKT1_ESRI"))
    lines = (step_x, 0, 0, -step_y, west + step_x / 2, north - step_y / 2)
    (tmp_path / "a.tfw").write_text("\n".join(map(str, lines)))
    lon, lat = grid(500.0, 60)
    image = cut_out(open_background(path), lon, lat)
    assert image is not None
    assert np.abs(image[..., :3].astype(int) - made.colour(lon, lat)).max() <= 3


def test_a_damaged_tile_leaves_a_hole_and_no_more(tmp_path: Path) -> None:
    path = made.write_mbtiles(tmp_path / "a.mbtiles", range(16, 17))
    with sqlite3.connect(path) as base:
        base.execute(
            "UPDATE tiles SET tile_data = x'89504E47000102' WHERE rowid IN "
            "(SELECT rowid FROM tiles WHERE rowid % 3 = 0)"
        )
    base.close()
    lon, lat = grid(900.0, 80)
    image = cut_out(open_background(path), lon, lat)
    assert image is not None
    solid = image[..., 3] == 255
    assert 0.3 < solid.mean() < 0.9
    off = image[..., :3].astype(int) - made.colour(lon, lat)
    assert np.median(np.abs(off[solid])) <= 1


def test_a_database_cannot_keep_its_reader_for_ever(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Neither by a zoom of millions nor by a view that has no last row."""
    far = made.write_mbtiles(tmp_path / "far.mbtiles", range(13, 14))
    with sqlite3.connect(far) as base:
        base.execute("INSERT INTO tiles VALUES (4611686018427387904, 0, 0, x'00')")
        base.execute("INSERT INTO tiles VALUES ('far', 'a', 'b', x'00')")
    base.close()
    assert open_background(far).most_zoom == 13
    endless = made.write_mbtiles(tmp_path / "endless.mbtiles", range(13, 14))
    with sqlite3.connect(endless) as base:
        base.execute("ALTER TABLE tiles RENAME TO some")
        base.execute(
            "CREATE VIEW tiles AS WITH RECURSIVE n(k) AS (SELECT 1 UNION ALL SELECT k + 1 FROM n) "
            "SELECT some.* FROM n, some"
        )
    base.close()
    monkeypatch.setattr(tile_archives, "_MOST_STEPS", 3)
    with pytest.raises(InputError, match="interrupted"):
        open_background(endless)


# --- in the report and on the command line


def test_the_report_has_the_part_below_its_map(tmp_path: Path) -> None:
    import base64
    import json

    from export_inputs import write_run

    from pipeline.report.background import MOST_BYTES
    from pipeline.report.render import report_html
    from pipeline.shared.products import load_products

    out = write_run(tmp_path / "out")
    background = open_background(made.write_mbtiles(tmp_path / "city.mbtiles"))
    page = report_html(load_products(out), "demo", {}, background)
    data = json.loads(page.split('id="map-data">')[1].split("</script>")[0])
    below = data["background"]
    assert below["opaque"]
    assert "city.mbtiles" in below["text"]
    content = base64.b64decode(below["src"].partition(",")[2])
    assert len(content) <= MOST_BYTES
    image = decoded(content)
    assert image is not None
    # a sign's place in metres of the map has the colour of its longitude and latitude
    west, south, east, north = below["box"]
    for (x, y), (lon, lat) in zip(data["signs"]["xy"], data["signs"]["lonlat"], strict=True):
        column = int((x - west) / (east - west) * image.shape[1])
        row = int((north - y) / (north - south) * image.shape[0])
        off = image[row, column, :3].astype(int) - made.colour(lon, lat)
        assert np.abs(off).max() <= 8
    bare = report_html(load_products(out), "demo", {})
    assert '"background":null' in bare
    elsewhere = open_background(made.write_geotiff(tmp_path / "far.tif", east=90_000.0))
    page = report_html(load_products(out), "demo", {}, elsewhere)
    assert "far.tif shows nothing of the map" in page


def test_a_merged_maps_report_has_it_too(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    import json

    from export_inputs import write_run

    from pipeline.cli.root import run_command

    out, city = write_run(tmp_path / "out"), tmp_path / "city"
    file = made.write_mbtiles(tmp_path / "below.mbtiles")
    command = ["merge", str(out), "-o", str(city), "--background"]
    assert run_command([*command, str(file)]) == 0
    page = (city / "report.html").read_text(encoding="utf-8")
    data = json.loads(page.split('id="map-data">')[1].split("</script>")[0])
    assert "below.mbtiles" in data["background"]["text"]
    assert str(tmp_path) not in page
    # what cannot be shown takes no map away
    file.write_bytes(b"no tiles")
    capsys.readouterr()
    assert run_command([*command, str(file)]) == 0
    assert "The report's map has no background" in capsys.readouterr().err
    page = (city / "report.html").read_text(encoding="utf-8")
    assert "no background: below.mbtiles: " in page
    assert str(tmp_path) not in page
    assert run_command([*command, str(tmp_path / "none.tif")]) == 2
    assert "no such file" in capsys.readouterr().err


def test_lines_below_the_report_leave_the_rest_clear(tmp_path: Path) -> None:
    from export_inputs import write_run

    from pipeline.export.content import map_content
    from pipeline.report.map_data import map_data
    from pipeline.shared.products import load_products

    out = write_run(tmp_path / "out")
    background = open_background(made.write_roads(tmp_path / "roads.geojson"))
    signs = map_content(out, "demo").signs
    data = map_data(load_products(out), signs, (), background)
    assert data is not None
    assert data["background"]["src"].startswith("data:image/png")
    assert not data["background"]["opaque"]


def test_a_background_that_cannot_be_shown_ends_the_viewer_with_a_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from export_inputs import write_run

    from pipeline.cli.root import run_command

    out = str(write_run(tmp_path / "out"))
    far = made.write_geotiff(tmp_path / "far.tif", east=40_000.0)
    bare = made.write_geotiff(tmp_path / "bare.tif", None)
    for file, code in ((tmp_path / "none.tif", 2), (bare, 3), (far, 3)):
        assert run_command(["view", out, "--no-browser", "--background", str(file)]) == code
        told = capsys.readouterr().err
        assert file.name in told
        assert "Traceback" not in told


def test_a_drives_own_background_is_shown_or_told_of(tmp_path: Path) -> None:
    import json

    from export_inputs import write_run
    from fake_stages import make_drive

    from automap.io import names
    from pipeline.view.command import serving

    drive = make_drive(tmp_path / "drive")
    out = write_run(drive / "_automap")
    record = json.loads((out / names.RUN).read_text())
    record["drive"] = {"name": "demo", "path": str(drive)}
    (out / names.RUN).write_text(json.dumps(record))
    made.write_geotiff(drive / "air.tif")
    made.write_geotiff(tmp_path / "outside.tif")
    made.write_geotiff(drive / "far.tif", east=40_000.0)

    def shown(stated: str) -> tuple[str | None, list[str]]:
        text = f'schema = "automap.drive/1"\n[site]\nbackground = "{stated}"\n'
        (drive / names.MANIFEST).write_text(text)
        with serving(out) as server:
            below = server.shown.background
            return None if below is None else below.name, server.shown.problems

    assert shown("air.tif") == ("air.tif", [])
    for stated, told in (
        ("../outside.tif", "--allow-outside"),
        ("far.tif", "the map lies at"),
        ("none.tif", "no such file"),
    ):
        name, problems = shown(stated)
        assert name is None
        assert told in problems[0]
