"""Pieces of a map's files that are taken over from an older map."""

from __future__ import annotations

import os
import shutil
import zipfile
import zlib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from export_inputs import sign, write_run

from automap.export import pieces, stored_signs
from automap.export.kmz import DOCUMENT, joined_crc, write_kmz
from automap.export.pieces import Kept, TextPiece, edges_of, index_file
from automap.io import names
from automap.io.signs_table import write_signs
from automap.records import Sign
from pipeline.export import formats
from pipeline.export.content import stored_content
from tests.slow_cases import others_slow

FILES = {
    names.SIGNS_GEOJSON: formats.write_geojson,
    names.KML: formats.write_kml,
    names.KMZ: formats.write_kmz,
}


def many(count: int) -> list[Sign]:
    return [
        replace(
            sign(1),
            id=f"m{k}",
            lat_rad=0.8 + 1e-5 * k,
            class_name=f"regulatory--{k % 3}",
            support=f"p{k}",
        )
        for k in range(count)
    ]


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(pieces, "USUAL", 4)
    return write_run(tmp_path / "run", name="town")


def written(run: Path, signs: list[Sign], out: Path, kept: Kept | None) -> dict[str, bytes]:
    """The files of a map of these signs."""
    shutil.copytree(run, out)
    write_signs(out / names.SIGNS_RAW, signs)
    content = stored_content(out, "town", kept)
    for name, write in FILES.items():
        write(content, out / name)
    return {name: (out / name).read_bytes() for name in FILES}


@pytest.mark.slow
def test_a_map_with_pieces_of_an_older_one_has_the_bytes_of_one_from_nothing(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    signs = many(60)
    written(run, signs, tmp_path / "old", Kept())
    # one goes, one comes, one is moved
    signs = [*signs[:20], replace(signs[3], id="x", support=""), *signs[21:]]
    signs[40] = replace(signs[40], height_m=77.0)
    nothing = written(run, signs, tmp_path / "nothing", Kept())
    assert written(run, signs, tmp_path / "plain", None) == nothing
    made: list[str] = []

    take = pieces.Index.take

    def told(self: pieces.Index, key: str) -> object:
        found = take(self, key)
        if key:
            made.append("taken" if found else "made")
        return found

    monkeypatch.setattr(pieces.Index, "take", told)
    assert written(run, signs, tmp_path / "new", Kept(tmp_path / "old")) == nothing
    assert made.count("taken") > 3 * made.count("made") > 0
    # the index of a map that took over serves the next
    made.clear()
    assert written(run, signs, tmp_path / "next", Kept(tmp_path / "new")) == nothing
    assert set(made) == {"taken"}


@pytest.mark.parametrize("harm", others_slow(["bytes", "short", "gone", "index", "no list"], 2))
def test_an_older_map_that_is_damaged_is_not_taken_from(
    run: Path, tmp_path: Path, harm: str
) -> None:
    signs = many(30)
    nothing = written(run, signs, tmp_path / "old", Kept())
    for name, data in nothing.items():
        path = tmp_path / "old" / name
        if harm == "bytes":
            path.write_bytes(bytes(255 - value for value in data))
        elif harm == "short":
            path.write_bytes(data[: len(data) // 2])
        elif harm == "gone":
            path.unlink()
        else:
            index_file(path).write_text("{" if harm == "index" else '{"a": 3}')
    assert written(run, signs, tmp_path / "new", Kept(tmp_path / "old")) == nothing


def test_what_another_version_wrote_is_written_again(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    signs = many(9)
    monkeypatch.setattr(stored_signs, "code", lambda: "older")
    written(run, signs, tmp_path / "old", Kept())
    monkeypatch.undo()
    content = stored_content(tmp_path / "old", "town", Kept(tmp_path / "old"))
    index = pieces.index_of(tmp_path / "new" / names.KML, content.kept)
    assert index.known
    assert all(piece.key not in " ".join(index.known) for piece in content.source.pieces())


def test_ellipses_that_the_date_line_cuts_are_never_lost(run: Path, tmp_path: Path) -> None:
    signs = [
        replace(own, lon_rad=np.radians(179.9999999), cov_enu=np.diag([9.0, 9.0, 9.0]))
        for own in many(12)
    ]
    nothing = written(run, signs, tmp_path / "old", Kept())
    assert nothing[names.KML].count(b"<Polygon>") == 24
    assert written(run, signs, tmp_path / "new", Kept(tmp_path / "old")) == nothing


def test_a_sign_more_changes_two_pieces_at_most() -> None:
    ids = [f"m{k}" for k in range(30_000)]
    cut = {ids[edge] for edge in edges_of(ids)[1:-1]}
    more = [*ids[:9000], "x", *ids[9000:]]
    again = {more[edge] for edge in edges_of(more)[1:-1]}
    assert len(cut) > 5
    assert len(cut ^ again) <= 2
    # ids that never say so are cut all the same
    assert edges_of(["a"] * 40_000) == [0, 16_384, 32_768, 40_000]
    assert edges_of([]) == [0]


def test_the_packed_document_is_one_that_all_can_read(tmp_path: Path) -> None:
    texts = [os.urandom(300) * 20, b"", b"x" * 70_000, b"end"]

    def document() -> Iterator[bytes | TextPiece]:
        yield texts[0]
        yield TextPiece("a", lambda: [texts[1]])
        yield TextPiece("b", lambda: [texts[2][:9], texts[2][9:]])
        yield texts[3]

    for large in (False, True):
        path = tmp_path / f"{large}.kmz"
        write_kmz(path, document(), {"files/a.png": b"png"}, large)
        with zipfile.ZipFile(path) as archive:
            assert archive.testzip() is None
            assert archive.read(DOCUMENT) == b"".join(texts)
            assert archive.read("files/a.png") == b"png"
    assert (tmp_path / "False.kmz").stat().st_size < 20_000


def test_the_sum_of_two_texts_is_that_of_both() -> None:
    for first, second in ((b"", b""), (b"abc", b""), (b"abc", os.urandom(12_345))):
        both = joined_crc(zlib.crc32(first), zlib.crc32(second), len(second))
        assert both == zlib.crc32(first + second)
