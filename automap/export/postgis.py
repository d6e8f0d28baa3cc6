"""Signs in a PostGIS database: a table that mirrors maps, a row a sign, found by map and name.

A map that is written again takes the place of its older self: rows of names that it still has are
updated, new ones added, those that it no longer has taken out, all or nothing.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any
from urllib.parse import parse_qs, unquote, urlsplit

import numpy as np

from automap.errors import ConfigError, InputError
from automap.export.fields import ROAD_FIELDS, SIGN_FIELDS, Field
from automap.export.kml_cells import clean_text
from automap.export.sign_columns import SignColumns
from automap.records import FloatArray

TABLE, MAPS = "automap_signs", "automap_maps"
_FIELDS = (*SIGN_FIELDS, *ROAD_FIELDS)
"""One table holds maps with and without roads."""
_TYPES = {"text": "text", "integer": "bigint", "real": "double precision"}
_TYPES |= {"time": "timestamptz", "list": "text[]"}
_BATCH = 2000
"""Rows a statement: far below the 65535 values that one may have, by parameter arrays."""


@dataclass(frozen=True)
class Database:
    """Where to: ``schema`` of the tables; ``password`` None asks the server for none."""

    host: str
    port: int
    name: str
    user: str
    password: str | None
    schema: str


@dataclass(frozen=True)
class Projected:
    """Positions [n] in the plane ``srid``: easting and northing in its unit, height in its height
    system or above the ellipsoid."""

    srid: int
    easting: FloatArray
    northing: FloatArray
    height: FloatArray


@dataclass(frozen=True)
class Written:
    """Rows written, and rows of the same map taken out since it has them no longer."""

    n_written: int
    n_removed: int


def parse_url(url: str, environment: Mapping[str, str]) -> Database:
    """``postgresql://user:password@host:port/database?schema=s``; what is missing is taken from
    libpq's variables (PGUSER, PGPASSWORD) or the usual. ConfigError for what is none."""
    parts = urlsplit(url)
    try:
        port = parts.port or int(environment.get("PGPORT", "5432"))
    except ValueError:
        port = 0
    name = unquote(parts.path.strip("/")) or environment.get("PGDATABASE", "")
    schema = parse_qs(parts.query).get("schema", ["public"])[0]
    if parts.scheme not in ("postgresql", "postgres") or not name or not port:
        raise ConfigError(
            "--to wants postgresql://user@host:port/database; the password may be in PGPASSWORD."
        )
    if not re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]{0,62}", schema):
        raise ConfigError(f"--to: {schema!r} is no plain name of a schema.")
    user = unquote(parts.username or "") or environment.get("PGUSER") or environment.get("USER", "")
    password = unquote(parts.password) if parts.password else environment.get("PGPASSWORD")
    host = unquote(parts.hostname or "") or environment.get("PGHOST", "localhost")
    return Database(host, port, name, user, password, schema)


def write_postgis(
    database: Database,
    map_name: str,
    columns: SignColumns,
    lineage: Mapping[str, Any],
    plane: Projected | None = None,
) -> Written:
    """Make the tables where they are missing, and the map's rows what the map is now.

    ``geom`` is WGS 84 always, as ``columns`` are; a ``plane`` has a geometry column of its own.

    Raises InputError where the server cannot be reached, has no PostGIS, or refuses.
    """
    from pg8000.exceptions import DatabaseError, InterfaceError
    from pg8000.native import Connection

    place = f"{database.host}:{database.port}/{database.name}"
    at = {"unix_sock": f"{database.host}/.s.PGSQL.{database.port}"}
    where = at if database.host.startswith("/") else {"host": database.host}
    try:
        connection = Connection(
            database.user, database=database.name, port=database.port,
            password=database.password, timeout=30, **where,
        )  # fmt: skip
    except (InterfaceError, DatabaseError, OSError) as error:
        if isinstance(error, OSError) or isinstance(error.__cause__, OSError):
            raise InputError(
                f"{place} cannot be reached: {_told(error)}; see that the server runs there and "
                "that host and port are right."
            ) from None
        raise InputError(f"{place} does not let us in: {_told(error)}.") from None
    try:
        connection.run("BEGIN")
        _make_tables(connection, database.schema)
        written = _mirror(connection, database.schema, map_name, columns, lineage)
        if plane is not None:
            _add_plane(connection, database.schema, map_name, columns, plane)
        connection.run("COMMIT")
    except (InterfaceError, DatabaseError, OSError) as error:
        raise InputError(
            f"{place} refused the map: {_told(error)}; nothing changed there."
        ) from None
    finally:
        connection.close()
    return written


def _told(error: Exception) -> str:
    """The server's own sentence."""
    detail = error.args[0] if error.args else ""
    text = detail.get("M", "") if isinstance(detail, dict) else str(detail)
    return text.strip().rstrip(".") or type(error).__name__


def _make_tables(connection: Any, schema: str) -> None:
    table, maps = f'"{schema}".{TABLE}', f'"{schema}".{MAPS}'
    if not connection.run("SELECT 1 FROM pg_extension WHERE extname = 'postgis'"):
        connection.run("CREATE EXTENSION postgis")
    connection.run(f'CREATE SCHEMA IF NOT EXISTS "{schema}"')
    own = ", ".join(f'"{f.name}" {_TYPES[f.kind]}' for f in _FIELDS)
    connection.run(
        f"CREATE TABLE IF NOT EXISTS {table} (map text NOT NULL, {own}, "
        "height_m double precision, geom geometry(Point, 4326), PRIMARY KEY (map, id))"
    )
    # tables of an earlier version lack what has been added since
    for field in _FIELDS:
        connection.run(
            f'ALTER TABLE {table} ADD COLUMN IF NOT EXISTS "{field.name}" {_TYPES[field.kind]}'
        )
        comment = f"{field.meaning}{f' ({field.unit})' if field.unit else ''}".replace("'", "''")
        connection.run(f"COMMENT ON COLUMN {table}.\"{field.name}\" IS '{comment}'")
    connection.run(f"COMMENT ON COLUMN {table}.height_m IS 'height above the ellipsoid (m)'")
    connection.run(f"CREATE INDEX IF NOT EXISTS {TABLE}_geom ON {table} USING gist (geom)")
    connection.run(f'CREATE INDEX IF NOT EXISTS {TABLE}_class ON {table} ("class")')
    connection.run(
        f"CREATE TABLE IF NOT EXISTS {maps} (map text PRIMARY KEY, lineage jsonb, "
        "written timestamptz NOT NULL DEFAULT now())"
    )


def _mirror(
    connection: Any, schema: str, map_name: str, columns: SignColumns, lineage: Mapping[str, Any]
) -> Written:
    table, maps = f'"{schema}".{TABLE}', f'"{schema}".{MAPS}'
    name = clean_text(map_name)
    values = _values(columns)
    connection.run(
        f"INSERT INTO {maps} (map, lineage) VALUES (:map, CAST(:lineage AS jsonb)) "
        "ON CONFLICT (map) DO UPDATE SET lineage = excluded.lineage, written = now()",
        map=name, lineage=json.dumps(dict(lineage), default=str),
    )  # fmt: skip
    fields = [f.name for f in _FIELDS]
    names = ", ".join(f'"{f}"' for f in fields)
    # lists travel as one text a sign, which no array of arrays could
    chosen = ", ".join(
        f"string_to_array(\"{f.name}\", E'\\x1f')" if f.kind == "list" else f'"{f.name}"'
        for f in _FIELDS
    )
    updates = ", ".join(f'"{f}" = excluded."{f}"' for f in (*fields[1:], "height_m", "geom"))
    arrays = ", ".join(f"CAST(:{f.name} AS {_TYPES[f.kind].removesuffix('[]')}[])" for f in _FIELDS)
    statement = (
        f"INSERT INTO {table} (map, {names}, height_m, geom) SELECT :map, {chosen}, height_m, "
        "ST_SetSRID(ST_MakePoint(lon_deg, lat_deg), 4326) "
        f"FROM unnest({arrays}, CAST(:height_m AS double precision[]), "
        "CAST(:lon_deg AS double precision[]), CAST(:lat_deg AS double precision[])) "
        f"AS one ({names}, height_m, lon_deg, lat_deg) "
        f"ON CONFLICT (map, id) DO UPDATE SET {updates}"
    )
    for start in range(0, len(columns), _BATCH):
        rows = slice(start, start + _BATCH)
        connection.run(statement, map=name, **{key: own[rows] for key, own in values.items()})
    connection.run(
        f"DELETE FROM {table} WHERE map = :map AND NOT id = ANY(CAST(:ids AS text[]))",
        map=name, ids=values["id"],
    )  # fmt: skip
    return Written(len(columns), int(connection.row_count))


def _add_plane(
    connection: Any, schema: str, map_name: str, columns: SignColumns, plane: Projected
) -> None:
    """The columns ``geom_SRID`` and ``height_SRID`` of the map's rows."""
    table, geom, high = f'"{schema}".{TABLE}', f"geom_{plane.srid}", f"height_{plane.srid}"
    connection.run(
        f"ALTER TABLE {table} ADD COLUMN IF NOT EXISTS {geom} geometry(Point, {plane.srid}), "
        f"ADD COLUMN IF NOT EXISTS {high} double precision"
    )
    connection.run(
        f"COMMENT ON COLUMN {table}.{geom} IS 'place in EPSG:{plane.srid}, by the operation that "
        f"the lineage of the map in {MAPS} names'"
    )
    connection.run(f"CREATE INDEX IF NOT EXISTS {TABLE}_{geom} ON {table} USING gist ({geom})")
    connection.run(
        f"UPDATE {table} AS t SET {geom} = ST_SetSRID(ST_MakePoint(x, y), {plane.srid}), "
        f"{high} = z FROM unnest(CAST(:ids AS text[]), CAST(:x AS double precision[]), "
        "CAST(:y AS double precision[]), CAST(:z AS double precision[])) AS one (id, x, y, z) "
        "WHERE t.map = :map AND t.id = one.id",
        map=clean_text(map_name), ids=[_plain(v) for v in columns.values["id"]],
        x=_numbers(plane.easting), y=_numbers(plane.northing), z=_numbers(plane.height),
    )  # fmt: skip


def _values(columns: SignColumns) -> dict[str, list[Any]]:
    """Lists [n] of what a statement takes, None where unknown."""
    values = {f.name: _column(f, columns) for f in _FIELDS}
    places = (columns.lon_deg, columns.lat_deg, columns.height_m)
    for name, numbers in zip(("lon_deg", "lat_deg", "height_m"), places, strict=True):
        values[name] = _numbers(np.where(columns.located, numbers, np.nan))
    return values


def _column(field: Field, columns: SignColumns) -> list[Any]:
    values = columns.values.get(field.name)
    if values is None:
        return [None] * len(columns)
    if field.kind == "real":
        return _numbers(values)
    if field.kind == "integer":
        return [None if v is None else int(v) for v in values]
    if field.kind == "time":
        return list(values) if columns.utc_known else [None] * len(columns)
    if field.kind == "list":
        return ["\x1f".join(_plain(v) for v in value) for value in values]
    return [None if v is None else _plain(v) for v in values]


def _plain(text: str) -> str:
    return clean_text(text).encode("utf-8", "replace").decode()


def _numbers(values: Sequence[float] | Any) -> list[float | None]:
    return [float(v) if np.isfinite(v) else None for v in values]
