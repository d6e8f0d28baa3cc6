"""Projected coordinates and national heights, against a series of Krueger's written out here."""

from __future__ import annotations

import csv
import json
import sqlite3
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pyogrio.raw
import pytest
import shapely
from export_inputs import write_run

from automap.errors import ConfigError, InputError
from automap.export.projected import parse_projection
from pipeline.cli.root import run_command
from pipeline.export.command import export_run
from pipeline.export.projected import PROJECTED_FORMATS

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


@pytest.mark.parametrize("fmt", PROJECTED_FORMATS)
def test_every_format_has_the_plane(fmt: str, out: Path, expected: np.ndarray) -> None:
    ends = {"shapefile": "shp.zip", "flatgeobuf": "fgb"}
    target = out.parent / f"plane.{ends.get(fmt, fmt)}"
    path, _ = export_run(out, fmt, target, crs=UTM)
    if fmt == "csv":
        rows = list(csv.DictReader(path.open(newline="")))
        got = np.array([[float(r["easting"]), float(r["northing"])] for r in rows])
        assert {r["crs"] for r in rows} == {UTM}
        assert [float(r["crs_height"]) for r in rows] == [float(r["height_m"]) for r in rows]
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


@pytest.mark.parametrize("fmt", ["geojson", "kml", "kmz", "osm", "pmtiles", "gpx", "xlsx"])
def test_formats_of_longitude_and_latitude_refuse(fmt: str, out: Path) -> None:
    with pytest.raises(ConfigError, match="longitude and latitude only; take one of gpkg"):
        export_run(out, fmt, crs=UTM)


@pytest.mark.parametrize(
    ("options", "code", "sentence"),
    [
        (["--crs", "EPSG:4258"], 2, "no projected system"),
        (["--crs", "EPSG:999999"], 2, "PROJ knows no such code"),
        (["--crs", "UTM32"], 2, "give a code of EPSG"),
        (["--crs", UTM, "--heights", "EPSG:25833"], 2, "no height system"),
        (["--heights", "EPSG:7837"], 2, "belongs to --crs"),
        (["--crs", UTM, "--datum", "GDA2020"], 2, "belongs to the datum ETRS89"),
        (["--crs", "EPSG:7855"], 3, "the map lies elsewhere"),
        (["--crs", "EPSG:31467"], 3, "DHDN"),
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


def test_without_the_grid_heights_are_refused(out: Path) -> None:
    with pytest.raises(
        InputError, match=r"needs the grid de_bkg_gcg2016\.tif, which PROJ does not"
    ):
        export_run(out, "gpkg", out.parent / "heights.gpkg", crs=UTM, heights="EPSG:7837")


def test_postgis_says_how(out: Path, capsys: pytest.CaptureFixture[str]) -> None:
    where = ["--format", "postgis", "--to", "postgresql://a@b/c"]
    assert run_command(["export", str(out), *where, "--crs", UTM]) == 2
    assert "ST_Transform" in capsys.readouterr().err
