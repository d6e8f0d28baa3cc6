"""Formats that GDAL writes, where a file cannot get as long as it has to be, unseen by GDAL."""

from __future__ import annotations

import resource
import sys
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from export_inputs import CLOCK, sign

from automap.errors import StageError
from automap.export import gis, layers
from automap.export.shapefile import whole, write_shapefile
from automap.export.sign_columns import SignColumns, sign_columns
from automap.export.tiles import write_pmtiles

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="no limits of a file's size")

FORMATS: dict[str, Callable[[Path, SignColumns], None]] = {
    "signs.fgb": lambda p, c: gis.write_layers(p, [layers.sign_layer(c)], driver="FlatGeobuf"),
    "signs.gpkg": lambda p, c: gis.write_layers(p, [layers.sign_layer(c)]),
    "signs.zip": lambda p, c: write_shapefile(p, c, "EPSG:4326"),
    "signs.pmtiles": lambda p, c: write_pmtiles(p, c, None),
}


@pytest.fixture(scope="module")
def columns() -> SignColumns:
    signs = [sign(number, lat_rad=-0.616 + 1e-5 * number) for number in range(1, 7)]
    return sign_columns([*signs, sign(7, lat_rad=np.nan)], CLOCK)


@contextmanager
def files_end_at(size: int) -> Iterator[None]:
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.mark.parametrize("name", FORMATS)
@pytest.mark.parametrize("part", [0.0, 0.3, 0.9])
def test_a_file_that_finds_no_room_is_told_and_not_kept(
    name: str, part: float, columns: SignColumns, tmp_path: Path
) -> None:
    path = tmp_path / name
    FORMATS[name](path, columns)
    size = path.stat().st_size
    path.unlink()
    with files_end_at(int(part * size)), pytest.raises(StageError, match="signs"):
        FORMATS[name](path, columns)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("kind", ["shp", "shx", "dbf", "prj", "cpg"])
def test_a_shapefile_lacks_no_byte(kind: str, columns: SignColumns, tmp_path: Path) -> None:
    write_shapefile(tmp_path / "a.zip", columns, "EPSG:4326")
    with zipfile.ZipFile(tmp_path / "a.zip") as archive:
        # the day of the last update: the same signs give the same bytes on any
        assert tuple(archive.read("signs.dbf")[1:4]) == (80, 1, 1)
    with zipfile.ZipFile(tmp_path / "a.zip") as archive:
        parts = {name: archive.read(name) for name in archive.namelist()}
    count = len(columns)
    assert whole(parts, count)
    assert not whole(parts, count + 1)
    name = f"signs.{kind}"
    content = parts.pop(name)
    assert not whole(parts, count)
    if kind in ("shp", "shx", "dbf"):
        for length in (*range(0, len(content) - 1, 97), len(content) - 2):
            assert not whole(parts | {name: content[:length]}, count)
    if kind in ("shp", "dbf"):
        # what failed once and then went on leaves a hole
        for start in range(0, len(content) - 300, 97):
            hole = content[:start] + bytes(300) + content[start + 300 :]
            assert hole == content or not whole(parts | {name: hole}, count), start
