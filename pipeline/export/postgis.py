"""``automap export --format postgis``: a finished map into a database."""

from __future__ import annotations

import os
from pathlib import Path

from automap.errors import ConfigError
from pipeline.export.command import check_run
from pipeline.export.content import map_content
from pipeline.export.roads import put_on_roads
from pipeline.shared.run_record import drive_of


def export_postgis(
    out: Path, fmt: str, url: str, least: float, roads: Path | None = None
) -> tuple[str, list[str]]:
    """Mirror the map of OUT in the database ``url``; a sentence, and warnings.

    Signs less sure than ``least`` are left out; ``roads`` is a layer to put them on. Raises
    ConfigError for an address that is none, InputError where the database cannot take the map.
    """
    from automap.export.postgis import TABLE, parse_url, write_postgis

    if fmt != "postgis" or not url:
        raise ConfigError("--format postgis and --to postgresql://... belong together.")
    database = parse_url(url, os.environ)
    check_run(out)
    content = map_content(out, drive_of(out)[0], least, roads is None)
    if roads is not None:
        put_on_roads(content, roads)
    written = write_postgis(database, content.name, content.signs, content.lineage)
    told = f"{written.n_written} signs of the map {content.name} in {database.schema}.{TABLE}"
    if written.n_removed:
        told += f", {written.n_removed} taken out that the map no longer has"
    return told, content.warnings
