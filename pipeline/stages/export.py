"""Stage export: the map for people and for other software."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from automap.io import names
from pipeline.stage import Stage, StageContext

if TYPE_CHECKING:
    from automap.io.drive import Drive


def run(context: StageContext) -> None:
    """Write signs.geojson, map.kml, map.gpkg and signs.parquet; whatever is missing is said."""
    from pipeline.export import FORMATS, STANDARD_FORMATS, map_content, write_rejected

    content = map_content(context.out, context.drive.name)
    for text in content.warnings:
        context.warn(text)
    for number, fmt in enumerate(STANDARD_FORMATS):
        file_name, write = FORMATS[fmt]
        context.progress(number / len(STANDARD_FORMATS), file_name)
        write(content, context.work / file_name)
    if content.products.rejected:
        write_rejected(content, context.work / names.REJECTED)
    context.metric("signs", len(content.signs))
    points = 0 if content.path is None else len(content.path)
    context.result = f"{len(content.signs)} signs and a path of {points} points in 4 formats"


def _inputs(drive: Drive) -> list[Path]:
    return []


STAGE = Stage(
    name="export",
    version=1,
    run=run,
    inputs=_inputs,
    needs=(
        names.SIGNS_RAW,
        names.OBSERVATIONS,
        names.TRAJECTORY,
        names.TRAJECTORY_ADJUSTED,
        names.FIXES,
        names.SYNC,
        names.REVIEW,
    ),
    outputs=(
        names.SIGNS_GEOJSON,
        names.KML,
        names.GPKG,
        names.SIGNS_TABLE,
        names.REJECTED,
    ),
    settings=("export",),
)
