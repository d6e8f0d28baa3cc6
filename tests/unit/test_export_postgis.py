"""Signs in PostGIS: against a real server, where Debian's packages are installed."""

from __future__ import annotations

import csv
import json
import os
import pwd
import shutil
import socket
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from export_inputs import HOSTILE, sign, write_run
from pg8000.native import Connection

from automap.errors import ConfigError
from automap.export.postgis import Database, parse_url
from automap.io import names
from automap.io.signs_table import read_signs, write_signs
from pipeline.cli.root import run_command
from pipeline.export.command import export_run

SIGNS = 12


def server_programs() -> Path | None:
    """Folder of the newest PostgreSQL server that has PostGIS."""
    for extension in sorted(Path("/usr/share/postgresql").glob("*/extension/postgis.control")):
        programs = Path("/usr/lib/postgresql") / extension.parts[4] / "bin"
        if (programs / "initdb").is_file():
            return programs
    return None


@pytest.fixture(scope="module")
def url() -> Iterator[str]:
    programs = server_programs()
    if programs is None:
        pytest.skip("no PostGIS: install Debian's packages postgresql and postgresql-15-postgis-3")
    as_user: list[str] = []
    folder = Path(tempfile.mkdtemp(prefix="automap-pg"))
    if os.geteuid() == 0:
        # the server refuses to run as root
        try:
            owner = pwd.getpwnam("postgres")
        except KeyError:
            pytest.skip("no user postgres to run the server as")
        os.chown(folder, owner.pw_uid, owner.pw_gid)
        as_user = ["runuser", "-u", "postgres", "--"]
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    data = folder / "data"

    def run(program: str, *arguments: object) -> None:
        command = [*as_user, str(programs / program), *map(str, arguments)]
        subprocess.run(command, check=True, capture_output=True, cwd=folder)

    run("initdb", "-D", data, "-U", "gis", "--auth=trust", "-E", "UTF8", "--no-sync")
    options = f"-p {port} -k {folder} -c listen_addresses=127.0.0.1 -c fsync=off"
    run("pg_ctl", "-D", data, "-l", folder / "log", "-o", options, "-w", "start")
    try:
        run("createdb", "-h", folder, "-p", port, "-U", "gis", "roads")
        yield f"postgresql://gis@127.0.0.1:{port}/roads"
    finally:
        run("pg_ctl", "-D", data, "-m", "immediate", "stop")
        shutil.rmtree(folder, ignore_errors=True)


def ask(url: str, statement: str) -> list[list[object]]:
    database = parse_url(url, {})
    connection = Connection(
        database.user, host=database.host, port=database.port, database=database.name
    )
    try:
        return list(connection.run(statement) or [])
    finally:
        connection.close()


def export(out: Path, url: str) -> int:
    return run_command(["export", str(out), "--format", "postgis", "--to", url])


def test_a_map_is_there_once_however_often_it_is_written(url: str, tmp_path: Path) -> None:
    out = write_run(tmp_path / "run", signs=SIGNS, name=HOSTILE)
    signs = read_signs(out / names.SIGNS_RAW)
    signs[2] = sign(3, class_name=HOSTILE, note="it's; DROP TABLE automap_signs; --")
    write_signs(out / names.SIGNS_RAW, signs)
    assert export(out, url) == 0
    assert export(out, url) == 0
    assert ask(url, "SELECT count(*), count(DISTINCT id) FROM automap_signs") == [[SIGNS, SIGNS]]
    ((lon, lat, height, drives, note),) = ask(
        url,
        "SELECT ST_X(geom), ST_Y(geom), height_m, drives, note FROM automap_signs "
        "WHERE id = 's0003'",
    )
    assert abs(lon - 180.0 / 3.141592653589793 * signs[2].lon_rad) < 1e-9
    assert abs(lat - 180.0 / 3.141592653589793 * signs[2].lat_rad) < 1e-9
    assert height == signs[2].height_m
    assert drives == ["demo"]
    assert note == "it's; DROP TABLE automap_signs; --"
    ((lineage,),) = ask(url, "SELECT lineage FROM automap_maps")
    assert lineage["software"].startswith("AutoMap")


def test_a_map_that_changed_takes_the_place_of_its_older_self_alone(
    url: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    first = write_run(tmp_path / "a", signs=4, name="a")
    second = write_run(tmp_path / "b", signs=5, name="b")
    assert export(first, url) == export(second, url) == 0
    signs = read_signs(first / names.SIGNS_RAW)
    write_signs(first / names.SIGNS_RAW, [sign(1, size_m=1.25), *signs[1:3]])
    capsys.readouterr()
    assert export(first, url) == 0
    assert "3 signs of the map a in public.automap_signs, 1 taken out" in capsys.readouterr().out
    rows = ask(url, "SELECT map, count(*) FROM automap_signs WHERE map IN ('a', 'b') GROUP BY 1")
    assert dict(map(tuple, rows)) == {"a": 3, "b": 5}
    assert ask(url, "SELECT size_m FROM automap_signs WHERE map = 'a' AND id = 's0001'") == [[1.25]]


def test_places_have_an_index_and_columns_their_meaning(url: str, tmp_path: Path) -> None:
    assert export(write_run(tmp_path / "c", name="c"), url + "?schema=survey") == 0
    kinds = ask(url, "SELECT indexdef FROM pg_indexes WHERE schemaname = 'survey'")
    assert any("gist (geom)" in str(row[0]) for row in kinds)
    told = ask(
        url,
        "SELECT col_description('survey.automap_signs'::regclass, attnum) FROM pg_attribute "
        "WHERE attrelid = 'survey.automap_signs'::regclass AND attname = 'facing_sd_deg'",
    )
    assert told == [["standard deviation of facing_deg (deg)"]]
    near = ask(
        url,
        "SELECT count(*) FROM survey.automap_signs WHERE ST_DWithin(geom::geography, "
        "(SELECT geom FROM survey.automap_signs WHERE id = 's0001')::geography, 1)",
    )
    assert near == [[1]]


@pytest.mark.slow
def test_a_plane_stands_beside_the_degrees(url: str, tmp_path: Path) -> None:
    out = write_run(tmp_path / "plane", name="plane")
    words = ["export", str(out), "--format", "postgis", "--to", url, "--crs", "EPSG:25832"]
    assert run_command(words) == run_command(words) == 0
    (told,) = ask(
        url,
        "SELECT count(geom_25832), min(ST_SRID(geom_25832)), min(ST_SRID(geom)), "
        "max(ST_Distance(geom_25832, ST_Transform(geom, 25832))), "
        "max(abs(height_25832 - height_m)) FROM automap_signs WHERE map = 'plane'",
    )
    assert told[:3] == [SIGNS, 25832, 4326]
    # the server takes WGS 84 for ETRS89, which moved 0.9 m away since 1989
    assert 0.6 < float(str(told[3])) < 1.1
    assert float(str(told[4])) < 0.2
    ((lineage,),) = ask(url, "SELECT lineage FROM automap_maps WHERE map = 'plane'")
    assert lineage["datum"].startswith("WGS-84")
    assert "ETRS89" in json.dumps(lineage["projected"])
    path, _ = export_run(out, "csv", tmp_path / "plane.csv", crs="EPSG:25832")
    rows = {row["id"]: row for row in csv.DictReader(path.open(newline=""))}
    for name, x, y in ask(
        url, "SELECT id, ST_X(geom_25832), ST_Y(geom_25832) FROM automap_signs WHERE map = 'plane'"
    ):
        assert float(str(x)) == pytest.approx(float(rows[str(name)]["easting"]), abs=1e-3)
        assert float(str(y)) == pytest.approx(float(rows[str(name)]["northing"]), abs=1e-3)


def test_what_a_server_refuses_is_one_sentence_and_changes_nothing(
    url: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = write_run(tmp_path / "d", name="d")
    ask(url, "CREATE SCHEMA broken; CREATE TABLE broken.automap_signs (map text)")
    assert export(out, url + "?schema=broken") == 3
    error = capsys.readouterr().err
    assert "nothing changed there" in error
    assert "Traceback" not in error
    assert ask(url, "SELECT count(*) FROM pg_tables WHERE schemaname = 'broken'") == [[1]]
    assert export(out, url.replace("/roads", "/nowhere")) == 3
    assert "nowhere" in capsys.readouterr().err


def test_without_a_server_a_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = write_run(tmp_path / "run", signs=1)
    assert export(out, "postgresql://gis:secret@127.0.0.1:1/roads") == 3
    error = capsys.readouterr().err
    assert "127.0.0.1:1/roads cannot be reached" in error
    assert "does not let us in" not in error
    assert "secret" not in error
    assert run_command(["export", str(out), "--format", "postgis"]) == 2
    assert run_command(["export", str(out), "--format", "csv", "--to", "postgresql://x/y"]) == 2


@pytest.mark.parametrize(
    "text",
    ["", "mysql://a/b", "postgresql://host", "postgresql://h/d?schema=a;b", "postgresql://h:x/d"],
)
def test_addresses_that_are_none(text: str) -> None:
    with pytest.raises(ConfigError, match="--to"):
        parse_url(text, {})


def test_an_address_is_completed_by_the_environment() -> None:
    got = parse_url("postgresql:///roads", {"PGUSER": "gis", "PGPASSWORD": "p", "PGPORT": "5433"})
    assert got == Database("localhost", 5433, "roads", "gis", "p", "public")
