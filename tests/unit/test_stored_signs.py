"""The files of a map whose signs are read part by part are those of one that is written at once."""

from __future__ import annotations

import sqlite3
import zipfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from export_inputs import HOSTILE, sign, write_run

from automap.errors import InputError
from automap.export import assemblies, gis, layers, stored_signs
from automap.export.sign_columns import sign_columns
from automap.io import map_tables, names
from automap.io.map_tables import TRACKS, StoredTracks, read_tracks, write_tracks
from automap.io.signs_table import read_sign_list, read_signs, write_signs
from automap.records import Sign
from automap.records.sign_lists import Names, SignList, changed, joined_names, values_of
from pipeline.cli.root import run_command
from pipeline.export import formats
from pipeline.export.content import map_content
from pipeline.merge import output

SAME = (
    names.SIGNS_GEOJSON, names.KML, names.KMZ, names.SIGNS_TABLE, names.SIGNS_RAW, names.REPORT,
    names.MERGE, names.RUN,
)  # fmt: skip


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    root = tmp_path_factory.mktemp("runs")
    made = [write_run(root / name, name=name) for name in ("monday", HOSTILE.replace("/", ""))]
    table = made[0] / names.SIGNS_RAW
    signs = read_signs(table)
    # on one post with its neighbour, at the end of another part
    beside = replace(signs[0], id="beside", height_m=signs[0].height_m + 0.7)
    write_signs(table, [*signs, beside])
    return [str(run) for run in made]


def rows_of(file: Path) -> dict[str, list[tuple[Any, ...]]]:
    with sqlite3.connect(file) as opened:
        tables = ("signs", "assemblies", "ellipses", "trajectory", "layer_styles")
        return {t: opened.execute(f"SELECT * FROM {t}").fetchall() for t in tables}


def test_a_map_in_parts_has_the_bytes_of_one_at_once(
    runs: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert run_command(["merge", *runs, "-o", str(tmp_path / "map")]) == 0
    once = {name: (tmp_path / "map" / name).read_bytes() for name in SAME}
    once_rows = rows_of(tmp_path / "map" / names.GPKG)
    assert len({row[0] for row in once_rows["assemblies"]}) > 2
    (tmp_path / "map").rename(tmp_path / "once")
    monkeypatch.setattr(output, "MOST_PICTURED", 1)
    monkeypatch.setattr(stored_signs, "ROWS", 3)
    monkeypatch.setattr(assemblies, "_POSTS", 2)
    monkeypatch.setattr(layers, "_LINES", 5)

    def refused(*_: object) -> list[Sign]:
        raise AssertionError("all signs are read at once")

    for place in ("pipeline.export.content.map_content", "pipeline.export.content.sign_columns"):
        monkeypatch.setattr(place, refused)
    assert run_command(["merge", *runs, "-o", str(tmp_path / "map")]) == 0
    for name in SAME:
        assert (tmp_path / "map" / name).read_bytes() == once[name], name
    assert rows_of(tmp_path / "map" / names.GPKG) == once_rows
    # as a process of its own does it
    (tmp_path / "map" / names.KMZ).unlink()
    output.write_stored(tmp_path / "map", "map", None)
    assert (tmp_path / "map" / names.KMZ).read_bytes() == once[names.KMZ]


def test_signs_in_parts_are_no_signs_for_what_takes_them_all(
    runs: list[str], tmp_path: Path
) -> None:
    from pipeline.export.content import stored_content

    assert run_command(["merge", *runs, "-o", str(tmp_path / "map")]) == 0
    stored, whole = stored_content(tmp_path / "map", "map"), map_content(tmp_path / "map", "map")
    with pytest.raises(AssertionError, match="part by part"):
        _ = stored.signs
    for name in ("lon_deg", "lat_deg", "height_m", "classes", "located", "fields"):
        assert np.array_equal(getattr(stored.source, name), getattr(whole.source, name)), name
    assert np.array_equal(stored.source.radii_m(), whole.source.radii_m())
    assert np.array_equal(stored.source.seen_by(), whole.source.seen_by())
    assert stored.source.first(2).values["id"] == whole.signs.values["id"][:2]


def test_a_list_of_columns_has_the_records_of_the_table(runs: list[str], tmp_path: Path) -> None:
    signs = read_signs(Path(runs[0]) / names.SIGNS_RAW)
    signs[1] = replace(signs[1], drives=("a", "b", "a"))
    path = tmp_path / "signs.parquet"
    write_signs(path, signs)
    found = read_sign_list(path)
    bare = [replace(sign, detection_rows=np.zeros(0, np.int64)) for sign in signs]
    assert repr(list(found)) == repr(bare)
    assert repr(list(found[1:3])) == repr(bare[1:3])
    assert repr(list(found.at(np.array([2, 0])))) == repr([bare[2], bare[0]])
    assert list(values_of(found, "note")) == [sign.note for sign in signs]
    renamed = changed(found, id=[f"x{k}" for k in range(len(found))])
    assert [sign.id for sign in renamed] == [f"x{k}" for k in range(len(signs))]
    # what was written of columns is what was written of records
    write_signs(tmp_path / "again.parquet", found)
    write_signs(path, bare)
    assert (tmp_path / "again.parquet").read_bytes() == path.read_bytes()
    write_signs(path, [])
    assert list(read_sign_list(path)) == []


def test_a_table_that_is_none_is_told(tmp_path: Path, runs: list[str]) -> None:
    import pyarrow.parquet as pq

    path = tmp_path / "signs.parquet"
    table = pq.read_table(Path(runs[0]) / names.SIGNS_RAW)
    pq.write_table(table.drop_columns(["confidence"]), path)
    with pytest.raises(InputError, match="lacks the column"):
        read_sign_list(path)
    # columns that earlier versions did not have are as a record has them
    pq.write_table(table.drop_columns(["contrast", "reviewer"]), path)
    assert np.isnan(read_sign_list(path)[0].contrast)
    path.write_bytes(b"PAR1")
    with pytest.raises(InputError, match="cannot be read"):
        read_sign_list(path)
    signs = read_signs(Path(runs[0]) / names.SIGNS_RAW)
    write_signs(path, [*signs, replace(signs[0], id="far", lat_rad=2.0)])
    with pytest.raises(InputError, match="far lies nowhere"):
        read_sign_list(path)


def test_names_of_parts_are_put_together() -> None:
    one = Names(("a", "b"), np.array([0, 1, 1]), np.array([0, 2, 2, 3]))
    assert list(one) == [("a", "b"), (), ("b",)]
    assert list(one[1:]) == [(), ("b",)]
    other = Names(("b", "c"), np.array([1, 0]), np.array([0, 1, 2]))
    assert list(joined_names([one[2:], other])) == [("b",), ("c",), ("b",)]
    assert list(one.at(np.array([2, 0]))) == [("b",), ("a", "b")]
    assert len(SignList({}, np.zeros((0, 3, 3)))) == 0


def test_tracks_are_read_drive_by_drive(
    runs: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from pipeline.shared.products import load_products

    track = load_products(Path(runs[0])).trajectory
    assert track is not None
    monkeypatch.setattr(map_tables, "_TRACK_ROWS", len(track) + 3)
    path = tmp_path / TRACKS
    write_tracks(path, ((f"d{k}", track) for k in range(3)))
    stored, whole = StoredTracks(path), read_tracks(path)
    assert list(stored) == list(whole) == ["d0", "d1", "d2"]
    for name, values in whole.items():
        assert repr(stored[name]) == repr(values)
    write_tracks(tmp_path / "none.parquet", iter(()))
    assert not (tmp_path / "none.parquet").exists()


@pytest.mark.parametrize("error", [InputError("the grid ends here"), KeyboardInterrupt()])
def test_what_goes_wrong_in_a_part_is_told_as_it_is(tmp_path: Path, error: BaseException) -> None:
    layer = layers.sign_layer(sign_columns([sign(1), sign(2)]))

    def parts() -> Iterator[layers.Layer]:
        yield layer
        raise error

    broken = layers.LayerParts("signs", layer.geometry_type, 4, parts)
    with pytest.raises(type(error)):
        gis.write_layers(tmp_path / "a.gpkg", [broken])
    assert list(tmp_path.iterdir()) == []


def test_an_archive_may_have_a_document_beyond_the_old_limit(
    runs: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    content = map_content(Path(runs[0]), "monday")
    document = tmp_path / "a.kml"
    formats.write_kml(content, document)
    # the estimate that decides is on the safe side
    assert document.stat().st_size < formats._document_size(content)
    monkeypatch.setattr(zipfile, "ZIP64_LIMIT", 1000)
    with pytest.raises((RuntimeError, zipfile.LargeZipFile)):
        formats.write_kmz(content, tmp_path / "a.kmz")
    monkeypatch.setattr(formats, "_LARGE", 1000)
    formats.write_kmz(content, tmp_path / "a.kmz")
    with zipfile.ZipFile(tmp_path / "a.kmz") as archive:
        assert archive.testzip() is None
        assert archive.infolist()[0].file_size > 1000


def test_two_that_write_formats_take_each_once(tmp_path: Path) -> None:
    one, other = output._not_begun(tmp_path), output._not_begun(tmp_path)
    taken = [next(one), next(other), next(other), *one, *other]
    assert taken == list(output.LONGEST_FIRST)
    assert set(taken) == set(formats.STANDARD_FORMATS)
