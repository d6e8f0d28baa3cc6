"""Signs in DuckDB: what its own Parquet reader makes of the table, with no extension loaded."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from export_inputs import write_run

from automap.io import names
from automap.io.signs_table import read_signs
from pipeline.export.command import export_run

duckdb = pytest.importorskip("duckdb")

SIGNS = 40


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = write_run(tmp_path_factory.mktemp("run") / "out", signs=SIGNS)
    export_run(folder, "parquet")
    return folder


def ask(out: Path, statement: str) -> list[tuple]:
    return duckdb.sql(statement.replace("SIGNS", f"'{out / names.SIGNS_TABLE}'")).fetchall()


def test_columns_have_their_types(out: Path) -> None:
    types = {name: kind for name, kind, *_ in ask(out, "DESCRIBE SELECT * FROM SIGNS")}
    expected = {"id": "VARCHAR", "facing_deg": "DOUBLE", "drives": "VARCHAR[]"}
    expected |= {"n_views": "BIGINT", "first_seen": "TIMESTAMP WITH TIME ZONE"}
    assert {name: types[name] for name in expected} == expected
    assert types["bbox"].startswith("STRUCT(xmin DOUBLE, ymin DOUBLE")


def test_signs_are_counted_by_class_and_drive(out: Path) -> None:
    signs = read_signs(out / names.SIGNS_RAW)
    told = dict(ask(out, 'SELECT "class", count(*) FROM SIGNS GROUP BY ALL'))
    assert told == {name: sum(s.class_name == name for s in signs) for name in told}
    assert sum(told.values()) == SIGNS
    (count,) = ask(out, "SELECT count(*) FROM SIGNS WHERE list_contains(drives, 'demo')")[0]
    assert count == SIGNS
    ((most,),) = ask(out, "SELECT max(ce95_m) FROM SIGNS WHERE confidence > 0.5")
    assert most > 0.0


def test_a_box_finds_the_signs_in_it(out: Path) -> None:
    signs = read_signs(out / names.SIGNS_RAW)
    lon = np.degrees([s.lon_rad for s in signs])
    lat = np.degrees([s.lat_rad for s in signs])
    west, east = np.quantile(lon, [0.25, 0.75])
    south, north = np.quantile(lat, [0.1, 0.6])
    expected = {
        s.id
        for s, x, y in zip(signs, lon, lat, strict=True)
        if west <= x <= east and south <= y <= north
    }
    found = ask(
        out,
        f"SELECT id FROM SIGNS WHERE bbox.xmax >= {west} AND bbox.xmin <= {east} "
        f"AND bbox.ymax >= {south} AND bbox.ymin <= {north}",
    )
    assert {name for (name,) in found} == expected
    assert 0 < len(expected) < SIGNS


def test_the_geometry_is_named_in_the_files_metadata(out: Path) -> None:
    ((text,),) = ask(
        out, "SELECT decode(value) FROM parquet_kv_metadata(SIGNS) WHERE decode(key) = 'geo'"
    )
    assert json.loads(text)["primary_column"] == "geometry"
