"""What GDAL leaves out of a GeoPackage: the meaning of the columns, and QGIS's styles.

The meanings follow the schema extension of OGC GeoPackage 1.3 (annex F.9); the styles stand in
the table ``layer_styles``, from which QGIS takes a layer's default look.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Mapping, Sequence
from contextlib import closing
from pathlib import Path

from automap.errors import StageError
from automap.export.dictionary import LAYERS
from automap.export.qml import QgisStyle

_DATE = "1980-01-01T00:00:00.000Z"
"""In place of the time of writing, as in a .kmz: the same map is then the same file."""

_STYLES_TABLE = """
CREATE TABLE layer_styles (
  id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL,
  f_table_catalog TEXT(256), f_table_schema TEXT(256), f_table_name TEXT(256),
  f_geometry_column TEXT(256), styleName TEXT(30), styleQML TEXT, styleSLD TEXT,
  useAsDefault BOOLEAN, description TEXT, owner TEXT(30), ui TEXT(30),
  update_time DATETIME DEFAULT (strftime('%Y-%m-%dT%H:%M:%fZ','now')))
"""

_DATA_COLUMNS = """
CREATE TABLE IF NOT EXISTS gpkg_data_columns (
  table_name TEXT NOT NULL, column_name TEXT NOT NULL, name TEXT, title TEXT, description TEXT,
  mime_type TEXT, constraint_name TEXT,
  CONSTRAINT pk_gdc PRIMARY KEY (table_name, column_name),
  CONSTRAINT gdc_tn UNIQUE (table_name, name))
"""

_CONSTRAINTS = """
CREATE TABLE IF NOT EXISTS gpkg_data_column_constraints (
  constraint_name TEXT NOT NULL, constraint_type TEXT NOT NULL, value TEXT, min NUMERIC,
  min_is_inclusive BOOLEAN, max NUMERIC, max_is_inclusive BOOLEAN, description TEXT,
  CONSTRAINT gdcc_ntv UNIQUE (constraint_name, constraint_type, value))
"""

_EXTENSIONS = """
CREATE TABLE IF NOT EXISTS gpkg_extensions (
  table_name TEXT, column_name TEXT, extension_name TEXT NOT NULL, definition TEXT NOT NULL,
  scope TEXT NOT NULL, CONSTRAINT ge_tce UNIQUE (table_name, column_name, extension_name))
"""


_DATED = (
    ("gpkg_contents", "last_change"),
    ("gpkg_metadata_reference", "timestamp"),
    ("layer_styles", "update_time"),
)


def complete_geopackage(
    path: Path, layers: Sequence[str], styles: Sequence[QgisStyle], epoch: float | None = None
) -> None:
    """Add the columns' meanings, the styles and the coordinates' ``epoch`` in years to a GeoPackage
    that GDAL has written, and take out when that was. StageError where SQLite cannot."""
    try:
        with closing(sqlite3.connect(path)) as file, file:
            _describe(file, layers)
            if epoch is not None:
                _set_epoch(file, layers, epoch)
            if styles:
                _add_styles(file, styles)
            present = {row[0] for row in file.execute("SELECT name FROM sqlite_master")}
            for table, column in _DATED:
                if table in present:
                    file.execute(f"UPDATE {table} SET {column} = ?", (_DATE,))
    except sqlite3.Error as error:
        raise StageError(
            f"cannot write {path} ({error}); check the disk or the network share and run the same "
            "command again."
        ) from error


def _triggers_of(file: sqlite3.Connection, layer: str) -> set[str]:
    """Names of a layer's triggers, a * for its own."""
    rows = file.execute(
        "SELECT name FROM sqlite_master WHERE type = 'trigger' AND tbl_name = ?", (layer,)
    )
    return {name.replace(layer, "*") for (name,) in rows}


_GPKG = int.from_bytes(b"GPKG")
"""What SQLite's header says the file is (OGC GeoPackage 1.3, requirement 2)."""


def lost_of(path: Path, counts: Mapping[str, int]) -> str:
    """What a GeoPackage lacks of layers with so many features, in words; "" where it has all.

    GDAL does not tell of every write that failed.
    """
    try:
        with closing(sqlite3.connect(path)) as file:
            (state,) = file.execute("PRAGMA quick_check(1)").fetchone()
            if state != "ok":
                return f"it is damaged ({state})"
            if file.execute("PRAGMA application_id").fetchone() != (_GPKG,):
                return "its header does not say that it is a GeoPackage"
            for layer, count in counts.items():
                (found,) = file.execute(f'SELECT COUNT(*) FROM "{layer}"').fetchone()
                if found != count:
                    return f"the layer {layer} has {found} of {count} features"
                told = file.execute(
                    "SELECT feature_count FROM gpkg_ogr_contents WHERE table_name = ?", (layer,)
                ).fetchone()
                if told != (count,):
                    return f"the layer {layer} does not say that it has {count} features"
            # what keeps numbers and indices right when a layer is edited is the same for all
            triggers = {layer: _triggers_of(file, layer) for layer in counts}
            for layer, own in triggers.items():
                if lacking := set().union(*triggers.values()) - own:
                    return f"the layer {layer} lacks {', '.join(sorted(lacking))}"
    except sqlite3.DatabaseError as error:
        return f"it is damaged ({error})"
    return ""


def _describe(file: sqlite3.Connection, layers: Sequence[str]) -> None:
    for statement in (_DATA_COLUMNS, _CONSTRAINTS, _EXTENSIONS):
        file.execute(statement)
    for layer, meaning, fields in LAYERS:
        if layer not in layers:
            continue
        file.execute(
            "UPDATE gpkg_contents SET description = ? WHERE table_name = ?", (meaning, layer)
        )
        present = {row[1] for row in file.execute(f'PRAGMA table_info("{layer}")')}
        for field in fields:
            if field.name not in present:
                continue
            unit = f" ({field.unit})" if field.unit else ""
            file.execute(
                "INSERT OR REPLACE INTO gpkg_data_columns (table_name, column_name, description) "
                "VALUES (?, ?, ?)",
                (layer, field.name, f"{field.meaning}{unit}"),
            )
    for table in ("gpkg_data_columns", "gpkg_data_column_constraints"):
        file.execute(
            "INSERT OR IGNORE INTO gpkg_extensions VALUES (?, NULL, 'gpkg_schema', "
            "'http://www.geopackage.org/spec/#extension_schema', 'read-write')",
            (table,),
        )


def _set_epoch(file: sqlite3.Connection, layers: Sequence[str], epoch: float) -> None:
    """Column ``epoch`` of the layers' systems: OGC GeoPackage, annex F.10, CRS WKT 1.1."""
    present = {row[1] for row in file.execute("PRAGMA table_info(gpkg_spatial_ref_sys)")}
    if "definition_12_063" not in present:
        file.execute(
            "ALTER TABLE gpkg_spatial_ref_sys ADD COLUMN definition_12_063 TEXT NOT NULL "
            "DEFAULT 'undefined'"
        )
        for srs, text in _wkt2(file):
            file.execute(
                "UPDATE gpkg_spatial_ref_sys SET definition_12_063 = ? WHERE srs_id = ?",
                (text, srs),
            )
    if "epoch" not in present:
        file.execute("ALTER TABLE gpkg_spatial_ref_sys ADD COLUMN epoch DOUBLE")
    for layer in layers:
        file.execute(
            "UPDATE gpkg_spatial_ref_sys SET epoch = ? WHERE srs_id = "
            "(SELECT srs_id FROM gpkg_geometry_columns WHERE table_name = ?)",
            (round(epoch, 3), layer),
        )
    file.execute("DELETE FROM gpkg_extensions WHERE extension_name LIKE 'gpkg_crs_wkt%'")
    for column in ("definition_12_063", "epoch"):
        file.execute(
            "INSERT INTO gpkg_extensions VALUES ('gpkg_spatial_ref_sys', ?, 'gpkg_crs_wkt_1_1', "
            "'http://www.geopackage.org/spec/#extension_crs_wkt', 'read-write')",
            (column,),
        )


def _wkt2(file: sqlite3.Connection) -> list[tuple[int, str]]:
    """The systems' numbers, and their texts by OGC 18-010."""
    from pyproj import CRS

    rows = file.execute(
        "SELECT srs_id, organization, organization_coordsys_id FROM gpkg_spatial_ref_sys "
        "WHERE organization = 'EPSG'"
    ).fetchall()
    return [(srs, CRS.from_authority("EPSG", code).to_wkt()) for srs, _, code in rows]


def _add_styles(file: sqlite3.Connection, styles: Sequence[QgisStyle]) -> None:
    file.execute(_STYLES_TABLE)
    file.execute(
        "INSERT INTO gpkg_contents (table_name, data_type, identifier) "
        "VALUES ('layer_styles', 'attributes', 'layer_styles')"
    )
    geometry = dict(file.execute("SELECT table_name, column_name FROM gpkg_geometry_columns"))
    for style in styles:
        if style.layer not in geometry:
            continue
        file.execute(
            "INSERT INTO layer_styles (f_table_catalog, f_table_schema, f_table_name, "
            "f_geometry_column, styleName, styleQML, styleSLD, useAsDefault, description, owner) "
            "VALUES ('', '', ?, ?, ?, ?, ?, 1, ?, '')",
            (
                style.layer,
                geometry[style.layer],
                style.layer,
                style.qml,
                style.sld,
                style.description,
            ),
        )
