"""Exports in GDAL's own commands and in JOSM, where they are installed."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "unit"))

from export_inputs import write_run

from pipeline.export.command import export_run

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_run(tmp_path_factory.mktemp("run") / "out")


def gdal(*words: str) -> str:
    if shutil.which(words[0]) is None:
        pytest.skip("GDAL's commands are not installed: Debian's package gdal-bin")
    done = subprocess.run(words, capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 0, done.stderr
    assert not done.stderr, done.stderr
    return done.stdout


@pytest.mark.parametrize(
    ("fmt", "layer", "facing"),
    [
        ("gpkg", "signs", "facing_deg (Real) = 331."),
        ("geojson", "signs", "facing_deg (Real) = 331."),
        ("kml", "Signs", "facing_deg (Real) = 331."),
        ("kmz", "Signs", "facing_deg (String) = 331.4"),
        ("flatgeobuf", "signs", "facing_deg (Real) = 331."),
        ("shapefile", "signs", "facing (Real) = 331.3"),
    ],
)
def test_gdal_reads_all_signs_and_columns(fmt: str, layer: str, facing: str, out: Path) -> None:
    path, _ = export_run(out, fmt)
    source = f"/vsizip/{path}/signs.shp" if fmt == "shapefile" else str(path)
    told = gdal("ogrinfo", "-q", "-al", source, layer)
    assert told.count("OGRFeature(") == 12
    assert told.count(facing) == 12
    assert "id (String) = s0012" in told


def test_gdal_sees_the_epoch(out: Path) -> None:
    path, _ = export_run(out, "gpkg")
    assert "Coordinate epoch: 2026.197" in gdal("ogrinfo", "-so", str(path), "signs")


def test_gdal_turns_the_map_into_other_formats(out: Path, tmp_path: Path) -> None:
    path, _ = export_run(out, "gpkg")
    gdal("ogr2ogr", "-f", "FlatGeobuf", str(tmp_path / "a.fgb"), str(path), "signs")
    geojson, _ = export_run(out, "geojson")
    gdal("ogr2ogr", "-f", "FlatGeobuf", str(tmp_path / "b.fgb"), str(geojson))
    assert "Feature Count: 12" in gdal("ogrinfo", "-so", str(tmp_path / "b.fgb"), "signs")


def test_gpx_has_waypoints_and_track(out: Path) -> None:
    path, _ = export_run(out, "gpx")
    told = gdal("ogrinfo", "-q", "-al", str(path), "waypoints")
    assert told.count("OGRFeature(") == 12
    assert "geoidheight (Real) = 48" in told


def test_projected_coordinates_are_gdals(out: Path, tmp_path: Path) -> None:
    """The same by GDAL's PROJ, from the degrees in the datum."""
    degrees, _ = export_run(out, "gpkg", tmp_path / "deg.gpkg", datum="ETRS89")
    plane, _ = export_run(out, "gpkg", tmp_path / "plane.gpkg", crs="EPSG:25832")
    words = ("-f", "GPKG", "-t_srs", "EPSG:25832", str(tmp_path / "gdal.gpkg"))
    gdal("ogr2ogr", *words, str(degrees), "signs")

    def points(path: Path) -> list[list[float]]:
        told = gdal("ogrinfo", "-q", "-al", str(path), "signs")
        rows = [row for row in told.splitlines() if row.strip().startswith("POINT")]
        return [[float(v) for v in row.split("(")[1].rstrip(")").split()[:2]] for row in rows]

    ours, theirs = points(plane), points(tmp_path / "gdal.gpkg")
    assert len(ours) == 12
    for one, other in zip(ours, theirs, strict=True):
        assert one == pytest.approx(other, abs=0.001)


def test_josm_finds_nothing_wrong(out: Path, tmp_path: Path) -> None:
    xvfb, josm = shutil.which("xvfb-run"), shutil.which("josm")
    if xvfb is None or josm is None:
        pytest.skip("JOSM is not installed: Debian's packages josm and xvfb")
    path, _ = export_run(out, "osm")
    report = tmp_path / "josm.geojson"
    words = [xvfb, "-a", josm, "validate", "--input", str(path), "--output", str(report)]
    done = subprocess.run(words, capture_output=True, text=True, check=False, timeout=120)
    assert done.returncode == 0, done.stderr
    assert f"Validating {path}" in done.stdout + done.stderr
    # one line a finding
    assert report.read_text() == ""
