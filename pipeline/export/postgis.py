"""``automap export --format postgis``: a finished map into a database."""

from __future__ import annotations

import os
from pathlib import Path

from automap.errors import ConfigError
from pipeline.export.command import check_run
from pipeline.export.content import map_content, refuse_lost_signs
from pipeline.export.projected import check_projected, in_projection
from pipeline.export.roads import put_on_roads
from pipeline.shared.run_record import drive_of


def export_postgis(
    out: Path,
    fmt: str,
    url: str,
    least: float,
    roads: Path | None = None,
    crs: str = "",
    heights: str = "",
) -> tuple[str, list[str]]:
    """Mirror the map of OUT in the database ``url``; a sentence, and warnings.

    Signs less sure than ``least`` are left out; ``roads`` is a layer to put them on; ``crs`` a
    projected system to have them in besides, with ``heights``. Raises ConfigError for an address
    that is none, InputError where the database cannot take the map.
    """
    from automap.export.postgis import TABLE, Projected, parse_url, write_postgis

    check_projected(crs, heights, "", "postgis")
    if fmt != "postgis" or not url:
        raise ConfigError("--format postgis and --to postgresql://... belong together.")
    database = parse_url(url, os.environ)
    check_run(out)
    content = map_content(out, drive_of(out)[0], least, roads is None)
    refuse_lost_signs(content)
    if roads is not None:
        put_on_roads(content, roads)
    lineage, warnings, flat = content.lineage, content.warnings, None
    if crs:
        moved = in_projection(content, crs, heights, "")
        signs, warnings = moved.signs, moved.warnings
        # geom stays as it was
        other = {k: v for k, v in moved.lineage.items() if content.lineage.get(k) != v}
        lineage = {**content.lineage, "projected": other}
        assert moved.plane is not None
        places = moved.plane.points(signs.lon_deg, signs.lat_deg, signs.height_m)
        flat = Projected(int(moved.plane.projection.code.partition(":")[2]), *places)
    written = write_postgis(database, content.name, content.signs, lineage, flat)
    told = f"{written.n_written} signs of the map {content.name} in {database.schema}.{TABLE}"
    if written.n_removed:
        told += f", {written.n_removed} taken out that the map no longer has"
    return told, warnings
