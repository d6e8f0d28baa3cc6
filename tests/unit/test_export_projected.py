"""Projected coordinates and national heights, against a series of Krueger's written out here."""

from __future__ import annotations

import csv
import json
import sqlite3
from pathlib import Path

import numpy as np
import openpyxl
import pyarrow.parquet as pq
import pyogrio.raw
import pytest
import shapely
from export_inputs import write_run

from automap.errors import ConfigError, InputError
from automap.export.datum import parse_datum, to_datum
from automap.export.projected import parse_projection, plane_of
from automap.io import names
from automap.io.signs_table import read_signs
from automap.io.vector_layer import to_degrees
from pipeline.cli.root import run_command
from pipeline.export.command import export_run
from pipeline.export.projected import PROJECTED_FORMATS
from tests.slow_cases import others_slow

UTM = "EPSG:25832"


def utm32(lon_deg: float, lat_deg: float) -> tuple[float, float]:
    """Easting, northing: Karney (2011), Transverse Mercator with an accuracy of a few nanometers,
    equations 7 to 11 and 35, to the third order (below a millimetre within the zone)."""
    f, a = 1.0 / 298.257222101, 6378137.0
    n = f / (2.0 - f)
    e = np.sqrt(f * (2.0 - f))
    lat, lon = np.radians(lat_deg), np.radians(lon_deg - 9.0)
    tau = np.tan(lat)
    sigma = np.sinh(e * np.arctanh(e * tau / np.hypot(1.0, tau)))
    tau = tau * np.hypot(1.0, sigma) - sigma * np.hypot(1.0, tau)
    xi, eta = np.arctan2(tau, np.cos(lon)), np.arcsinh(np.sin(lon) / np.hypot(tau, np.cos(lon)))
    alpha = (
        n / 2 - 2 * n**2 / 3 + 5 * n**3 / 16,
        13 * n**2 / 48 - 3 * n**3 / 5,
        61 * n**3 / 240,
    )
    x, y = eta, xi
    for j, own in enumerate(alpha, 1):
        y += own * np.sin(2 * j * xi) * np.cosh(2 * j * eta)
        x += own * np.cos(2 * j * xi) * np.sinh(2 * j * eta)
    radius = 0.9996 * a / (1 + n) * (1 + n**2 / 4 + n**4 / 64)
    return 500000.0 + radius * x, radius * y


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_run(tmp_path_factory.mktemp("run") / "out")


@pytest.fixture(scope="module")
def expected(out: Path) -> np.ndarray:
    """Easting and northing [n, 2] of the signs, from the degrees in the datum."""
    path, _ = export_run(out, "csv", out.parent / "etrs89.csv", datum="ETRS89")
    rows = list(csv.DictReader(path.open(newline="")))
    return np.array([utm32(float(r["lon_deg"]), float(r["lat_deg"])) for r in rows])


@pytest.mark.parametrize("fmt", [f for f in PROJECTED_FORMATS if f != "postgis"])
def test_every_format_has_the_plane(fmt: str, out: Path, expected: np.ndarray) -> None:
    ends = {"shapefile": "shp.zip", "flatgeobuf": "fgb"}
    target = out.parent / f"plane.{ends.get(fmt, fmt)}"
    path, _ = export_run(out, fmt, target, crs=UTM)
    if fmt == "csv":
        rows = list(csv.DictReader(path.open(newline="")))
        got = np.array([[float(r["easting"]), float(r["northing"])] for r in rows])
        assert {r["crs"] for r in rows} == {UTM}
        assert [float(r["crs_height"]) for r in rows] == [float(r["height_m"]) for r in rows]
    elif fmt == "xlsx":
        head, *cells = openpyxl.load_workbook(path)["signs"].iter_rows(values_only=True)
        table = [dict(zip(head, row, strict=True)) for row in cells]
        got = np.array([[row["easting"], row["northing"]] for row in table], np.float64)
        assert {row["crs"] for row in table} == {UTM}
    elif fmt == "parquet":
        table = pq.read_table(path)
        got = shapely.get_coordinates(shapely.from_wkb(table["geometry"].to_numpy()))
        about = json.loads(table.schema.metadata[b"geo"])["columns"]["geometry"]
        assert about["crs"]["id"] == {"authority": "EPSG", "code": 25832}
        assert about["bbox"][0] == got[:, 0].min()
        assert "epoch" not in about
    else:
        layer = {} if fmt in ("shapefile", "flatgeobuf") else {"layer": "signs"}
        meta, _, wkb, _ = pyogrio.raw.read(path, **layer)
        got = shapely.get_coordinates(shapely.from_wkb(wkb))
        assert meta["crs"] == UTM
    order = np.argsort(got[:, 1])
    assert np.abs(got[order] - expected[np.argsort(expected[:, 1])]).max() < 0.002


def test_all_layers_of_a_geopackage_move(out: Path) -> None:
    path, _ = export_run(out, "gpkg", out.parent / "all.gpkg", crs=UTM)
    for layer in ("signs", "observations", "trajectory", "ellipses"):
        meta, _, wkb, _ = pyogrio.raw.read(path, layer=layer)
        low = shapely.get_coordinates(shapely.from_wkb(wkb)).min(axis=0)
        assert meta["crs"] == UTM
        assert 400_000 < low[0] < 500_000
        assert 5_400_000 < low[1] < 5_500_000


@pytest.mark.parametrize(("crs", "epoch"), [("", 2026.197), ("EPSG:32632", 2026.197), (UTM, None)])
def test_systems_that_move_have_an_epoch(crs: str, epoch: float | None, out: Path) -> None:
    path, _ = export_run(out, "gpkg", out.parent / f"epoch{crs[5:]}.gpkg", crs=crs)
    with sqlite3.connect(path) as file:
        columns = {row[1] for row in file.execute("PRAGMA table_info(gpkg_spatial_ref_sys)")}
        # only what the layers are in has one
        told = file.execute(
            "SELECT DISTINCT epoch, definition_12_063 FROM gpkg_spatial_ref_sys JOIN "
            "gpkg_geometry_columns USING (srs_id)"
        ).fetchall() if "epoch" in columns else [(None, "")]  # fmt: skip
        extensions = file.execute(
            "SELECT COUNT(*) FROM gpkg_extensions WHERE extension_name = 'gpkg_crs_wkt_1_1'"
        ).fetchone()[0]
    assert [row[0] for row in told] == [epoch]
    if epoch is not None:
        assert "WGS 84" in told[0][1]
        assert extensions == 2


def test_lineage_states_operation_and_accuracy(out: Path) -> None:
    path, _ = export_run(out, "parquet", out.parent / "told.parquet", crs=UTM)
    lineage = json.loads(pq.read_schema(path).metadata[b"automap"])
    assert lineage["projection"] == "ETRS89 / UTM zone 32N (EPSG:25832)"
    assert 0.0 <= lineage["datum_accuracy_m"] <= 0.25
    assert "ITRF" in lineage["datum_operation"]


def test_one_code_for_plane_and_heights() -> None:
    whole = parse_projection("epsg:5555")
    assert (whole.code, whole.heights) == (UTM, "EPSG:5783")
    assert parse_projection(UTM, "EPSG:7837").crs == "EPSG:25832+7837"


@pytest.mark.parametrize("text", ["25832", " epsg:25832", "ETRS89 / UTM zone 32N"])
def test_a_system_is_named_as_compare_takes_it(text: str) -> None:
    assert parse_projection(text, "7837").crs == "EPSG:25832+7837"
    lon, lat = to_degrees(np.array([500e3]), np.array([5.3e6]), text, Path("list.csv"))
    assert (lon[0], lat[0]) == pytest.approx((9.0, 47.85), abs=0.01)


@pytest.mark.parametrize("fmt", ["geojson", "kml", "kmz", "osm", "pmtiles", "gpx"])
def test_formats_of_longitude_and_latitude_refuse(fmt: str, out: Path) -> None:
    with pytest.raises(ConfigError, match="longitude and latitude only; take one of gpkg"):
        export_run(out, fmt, crs=UTM)


@pytest.mark.parametrize(
    ("options", "code", "sentence"),
    [
        (["--crs", "EPSG:4258"], 2, "no projected system"),
        (["--crs", "EPSG:999999"], 2, "PROJ knows no such code"),
        (["--crs", "UTM32"], 2, "PROJ knows no such code"),
        (["--crs", "+proj=utm +zone=32 +lon_0=1"], 2, "no code of EPSG"),
        (["--crs", UTM, "--heights", "EPSG:25833"], 2, "no height system"),
        (["--heights", "EPSG:7837"], 2, "belongs to --crs"),
        (["--crs", UTM, "--datum", "GDA2020"], 2, "belongs to the datum ETRS89"),
        (["--crs", "EPSG:7855"], 3, "the map lies elsewhere"),
        (["--crs", "EPSG:31467"], 3, "DHDN / 3-degree Gauss-Kruger zone 3): the transformation"),
        (["--crs", UTM, "--heights", "EPSG:5783"], 3, "PROJ has none"),
    ],
)
def test_refusals(
    options: list[str], code: int, sentence: str, out: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    target = out.parent / "refused.gpkg"
    words = ["export", str(out), "--format", "gpkg", *options, "-o", str(target)]
    assert run_command(words) == code
    assert sentence in " ".join(capsys.readouterr().err.split())
    assert not target.exists()


def test_a_system_that_stretches_lengths_is_told(out: Path) -> None:
    """Web Mercator, which everybody has at hand."""
    _, warnings = export_run(out, "csv", out.parent / "mercator.csv", crs="EPSG:3857")
    lat = read_signs(out / names.SIGNS_RAW)[0].lat_rad
    told = [text for text in warnings if "times those in metres on the ground" in text]
    assert len(told) == 1
    assert f"{1.0 / np.cos(lat):.1f}" in told[0]
    _, warnings = export_run(out, "csv", out.parent / "utm.csv", crs=UTM)
    assert not any("on the ground" in text for text in warnings)


@pytest.mark.parametrize(("fmt", "name"), [("csv", "a.xlsx"), ("gpkg", "a.shp"), ("kml", "a.kmz")])
def test_a_file_is_not_named_as_one_of_another_format(out: Path, fmt: str, name: str) -> None:
    with pytest.raises(ConfigError, match="has the name of another format than"):
        export_run(out, fmt, out.parent / name)
    assert not (out.parent / name).exists()


def test_without_the_grid_heights_are_refused(out: Path) -> None:
    with pytest.raises(
        InputError, match=r"needs the grid de_bkg_gcg2016\.tif, which PROJ does not"
    ):
        export_run(out, "gpkg", out.parent / "heights.gpkg", crs=UTM, heights="EPSG:7837")


PLACES = {
    # system, longitude, latitude; the shift's accuracy in m, or the grid that is missing
    "Germany": ("EPSG:25832", 8.5, 50.1, 0.1),
    "France": ("EPSG:2154", 2.35, 48.85, 0.2),
    "Switzerland": ("EPSG:2056", 8.0, 46.9, 0.2),
    "Ireland": ("EPSG:2157", -7.0, 53.3, 0.1),
    "Poland": ("EPSG:2180", 19.0, 52.0, 0.1),
    "Italy": ("EPSG:6707", 11.5, 42.0, 0.1),
    "Spain": ("EPSG:25830", -3.7, 40.4, 0.1),
    "Australia": ("EPSG:7856", 151.0, -33.8, 0.031),
    "United States": ("EPSG:6339", -120.0, 38.0, 0.0),
    "Great Britain": ("EPSG:27700", -1.5, 52.5, "uk_os_OSTN15_NTv2_OSGBtoETRS.tif"),
    "Netherlands": ("EPSG:28992", 5.1, 52.1, "nl_nsgi_rdtrans2018.tif"),
    "Austria": ("EPSG:31287", 14.5, 47.5, "at_bev_AT_GIS_GRID_2021_09_28.tif"),
    "Belgium": ("EPSG:31370", 4.5, 50.6, "be_ign_bd72lb72_etrs89lb08.tif"),
    "Sweden": ("EPSG:3006", 15.0, 59.0, "eur_nkg_nkgrf17vel.tif"),
    "New Zealand": ("EPSG:2193", 174.8, -41.2, "nz_linz_nzgd2000-20180701.json"),
    "Japan": ("EPSG:6677", 139.7, 35.7, "EPSG:32654 (WGS 84)"),
    "Brazil": ("EPSG:31983", -46.6, -23.5, "EPSG:32723 (WGS 84)"),
}


@pytest.mark.parametrize("country", others_slow(PLACES, 6))
def test_national_systems_work_or_say_what_is_missing(country: str) -> None:
    code, lon, lat, expected = PLACES[country]
    projection = parse_projection(code)
    place = np.array([lon]), np.array([lat]), np.array([100.0])
    if isinstance(expected, str):
        with pytest.raises(InputError) as told:
            to_datum(*place, projection.datum, 2026.2)
        assert expected in str(told.value)
        return
    moved = to_datum(*place, projection.datum, 2026.2)
    assert moved.accuracy_m == pytest.approx(expected)
    east, north, _ = plane_of(projection, moved.lon_deg, moved.lat_deg).points(
        moved.lon_deg, moved.lat_deg, moved.height_m
    )
    assert np.isfinite([east, north]).all()


def test_two_steps_are_the_published_projection_of_etrs89() -> None:
    """Lambert-93 at a point of its definition: on the meridian of 3 deg, at the latitude of origin,
    where EPSG's guidance note 7-2 gives false easting and northing. RGF93 is ETRS89 realised."""
    etrs89 = to_datum(*(np.array([v]) for v in (3.0, 46.5, 0.0)), parse_datum("ETRS89"), 2026.2)
    moved = to_datum(*(np.array([v]) for v in (3.0, 46.5, 0.0)), parse_datum("EPSG:4965"), 2026.2)
    assert moved.lon_deg == pytest.approx(etrs89.lon_deg, abs=1e-10)
    assert moved.lat_deg == pytest.approx(etrs89.lat_deg, abs=1e-10)
    assert 0.7 < moved.largest_shift_m < 1.0
    plane = plane_of(parse_projection("EPSG:2154"), np.array([3.0]), np.array([46.5]))
    x, y, _ = plane.points(np.array([3.0]), np.array([46.5]), np.array([0.0]))
    assert (x[0], y[0]) == pytest.approx((700_000.0, 6_600_000.0), abs=1e-3)
