"""The export stage and command on whole, partial and damaged OUT folders."""

from __future__ import annotations

import csv
import json
import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pyogrio
import pytest
from export_inputs import HOSTILE, write_run

from automap.errors import ConfigError, InputError
from automap.io import names
from pipeline.cli.root import run_command
from pipeline.export.command import export_run
from pipeline.export.content import _as_beside
from pipeline.export.formats import FORMATS
from pipeline.report.render import report_html
from pipeline.run.stage import StageContext
from pipeline.run.stages.export import STAGE
from pipeline.settings.load import load_settings
from pipeline.shared.products import geoid_separation, load_products
from tests.slow_cases import others_slow


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_run(tmp_path_factory.mktemp("run") / "out", name=HOSTILE)


@pytest.fixture
def out(finished: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(finished, tmp_path / "out"))


def run_stage(out: Path, roads: str | None = None) -> tuple[Path, StageContext]:
    work = out / "export.tmp"
    work.mkdir()
    drive: Any = SimpleNamespace(
        name="demo",
        path=out,
        videos={},
        manifest=SimpleNamespace(site=SimpleNamespace(roads=roads)),
    )
    context = StageContext(drive=drive, out=out, work=work, settings=load_settings())
    STAGE.run(context)
    return work, context


def written(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}


SOMETIMES = (names.REJECTED, names.PICTURES, names.PICTURE_INDEX, names.SIGN_ROADS)
ALWAYS = set(STAGE.outputs) - set(SOMETIMES)


def test_stage_writes_all_declared_files(out: Path) -> None:
    work, context = run_stage(out)
    assert written(work) == ALWAYS
    assert context.warnings == []
    assert context.metrics["signs"] == 12
    features = json.loads((work / names.SIGNS_GEOJSON).read_text())["features"]
    assert len(features) == pq.read_metadata(work / names.SIGNS_TABLE).num_rows == 12
    assert "absolute" in (work / names.KML).read_text()


def test_the_same_results_give_the_same_bytes(out: Path) -> None:
    """When a map was written stands in none of its files."""
    first, _ = run_stage(out)
    before = {name: (first / name).read_bytes() for name in written(first)}
    shutil.rmtree(first)
    record = json.loads((out / names.RUN).read_text())
    (out / names.RUN).write_text(json.dumps(record | {"started": "2031-01-01T00:00:00Z"}))
    again, _ = run_stage(out)
    for name, content in before.items():
        assert (again / name).read_bytes() == content, name


def test_signs_get_their_place_on_a_road(out: Path) -> None:
    path = pq.read_table(out / names.TRAJECTORY, columns=["lon_deg", "lat_deg"]).to_pydict()
    line = [list(place) for place in zip(path["lon_deg"], path["lat_deg"], strict=True)]
    road = {
        "type": "Feature",
        "properties": {"road_id": "B 7", "name": "Main"},
        "geometry": {"type": "LineString", "coordinates": line},
    }
    roads = out / "roads.geojson"
    roads.write_text(json.dumps({"type": "FeatureCollection", "features": [road]}))
    work, context = run_stage(out, roads.name)
    rows = list(csv.DictReader((work / names.SIGN_ROADS).open(encoding="utf-8", newline="")))
    assert rows, context.warnings
    assert {row["road_id"] for row in rows} == {"B 7"}
    assert "road_id" in pyogrio.read_info(work / names.GPKG, layer="signs")["fields"]


def test_roads_that_cannot_be_read_are_a_warning(out: Path) -> None:
    work, context = run_stage(out, "none.gpkg")
    assert written(work) == ALWAYS
    assert any("none.gpkg: no such file" in text for text in context.warnings)


@pytest.mark.parametrize("missing", STAGE.needs)
def test_any_input_may_be_missing(out: Path, missing: str) -> None:
    (out / missing).unlink(missing_ok=True)
    work, _ = run_stage(out)
    assert written(work) == ALWAYS


@pytest.mark.parametrize("damaged", others_slow(STAGE.needs, 4))
def test_a_damaged_input_is_said_and_left_out(out: Path, damaged: str) -> None:
    (out / damaged).write_bytes(b"PAR1 not really")
    work, context = run_stage(out)
    assert written(work) == ALWAYS
    assert any(damaged in text for text in context.warnings), context.warnings


def test_empty_folder_gives_an_empty_map_and_says_so(tmp_path: Path) -> None:
    work, context = run_stage(tmp_path)
    assert json.loads((work / names.SIGNS_GEOJSON).read_text())["features"] == []
    assert any("no trajectory" in text for text in context.warnings)
    assert any("signs" in text for text in context.warnings)


@pytest.mark.parametrize("fmt", FORMATS)
def test_every_format_of_the_command(out: Path, tmp_path: Path, fmt: str) -> None:
    path, warnings = export_run(out, fmt)
    assert path.parent == out
    # its signs hang on no post
    assert path.stat().st_size > (40 if fmt == "assemblies" else 500)
    assert warnings == []
    target = tmp_path / "elsewhere" / path.name
    assert export_run(out, fmt, target)[0] == target
    assert target.stat().st_size == pytest.approx(path.stat().st_size, rel=0.01)


def test_wrong_format_and_wrong_folder_are_named(out: Path, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="geojson"):
        export_run(out, "dxf")
    with pytest.raises(InputError, match="nowhere"):
        export_run(tmp_path / "nowhere", "kml")
    (tmp_path / "bare").mkdir()
    with pytest.raises(InputError, match="neither"):
        export_run(tmp_path / "bare", "kml")


def test_geoid_comes_from_the_fixes(out: Path) -> None:
    products = load_products(out)
    assert products.trajectory is not None
    separation = geoid_separation(products, products.trajectory.t_ns[::100])
    assert separation is not None
    assert set(separation.tolist()) == {48.0}
    assert products.fixes is not None
    none = replace(products.fixes, geoid_sep_m=np.zeros(len(products.fixes)))
    nothing = replace(products, fixes=none)
    assert geoid_separation(nothing, products.trajectory.t_ns[:3]) is None
    (out / names.FIXES).unlink()
    assert geoid_separation(load_products(out), products.trajectory.t_ns[:3]) is None


def test_clock_falls_back_on_the_trajectory(out: Path) -> None:
    exact = load_products(out).clock
    (out / names.SYNC).unlink()
    fallback = load_products(out).clock
    assert exact is not None
    assert fallback is not None
    assert fallback.method == "trajectory"
    stamp = exact.t_ns([exact.ref_gps_s + 60.0])
    assert fallback.gps_s(stamp)[0] == pytest.approx(exact.ref_gps_s + 60.0, abs=1e-5)


def test_a_run_of_another_form_is_refused(
    out: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    record = json.loads((out / names.RUN).read_text(encoding="utf-8"))
    (out / names.RUN).write_text(json.dumps(record | {"schema": "automap.run/9"}))
    target = tmp_path / "signs.csv"
    words = ["export", str(out), "--format", "csv", "-o", str(target)]
    assert run_command(words) == 3
    assert "run.json: schema 'automap.run/9' is not known" in capsys.readouterr().err
    assert not target.exists()


def test_nothing_that_leaves_says_where_this_computer_keeps_its_files(out: Path) -> None:
    record = json.loads((out / names.RUN).read_text(encoding="utf-8"))
    home = "/media/somebody/monday"
    record["inputs"] = {"imu.csv": "a" * 64, f"{home}/detector.onnx": "b" * 64}
    record["drive"] = {"name": "monday", "path": home}
    record["command"] = f"automap run {home} -o {home}/_automap"
    record["warnings"] = [f"{home}/gnss.ubx: 3 of 9 epochs have no position"]
    record["settings"] = {"detect": {"model": f"{home}/detector.onnx"}}
    (out / names.RUN).write_text(json.dumps(record), encoding="utf-8")
    work, _ = run_stage(out)
    page = report_html(load_products(out), "monday", record)
    (work / "report.html").write_text(page, encoding="utf-8")
    for path in (p for p in work.rglob("*") if p.is_file()):
        content = path.read_bytes()
        assert b"somebody" not in content, path.name
        assert str(out).encode() not in content, path.name
    assert "gnss.ubx: 3 of 9 epochs" in page
    assert "detector.onnx" in (work / names.SIGNS_GEOJSON).read_text(encoding="utf-8")


def test_a_sign_of_unknown_geoid_has_that_of_the_nearest_one() -> None:
    """Within a kilometre, also over the date line; beyond, and where the sign is nowhere, none."""
    lat = np.array([10.0, 10.02, 10.004, 10.018, 10.3, np.nan])
    lon = np.array([179.9995, 179.9995, -179.9995, 179.9995, 0.0, 0.0])
    signs = SimpleNamespace(lat_deg=lat, lon_deg=lon, located=np.isfinite(lat))
    geoid = np.array([40.0, 41.0, np.nan, np.nan, np.nan, np.nan])
    found = _as_beside(signs, geoid)  # type: ignore[arg-type]
    np.testing.assert_array_equal(found, [40.0, 41.0, 40.0, 41.0, np.nan, np.nan])
    none = np.full(6, np.nan)
    np.testing.assert_array_equal(_as_beside(signs, none), none)  # type: ignore[arg-type]
