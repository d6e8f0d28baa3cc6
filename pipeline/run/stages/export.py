"""Stage export: the map for people and for other software."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from automap.io import names
from automap.io.trust import check_inside
from automap.io.vector_layer import layer_files
from pipeline.run.stage import Stage, StageContext

if TYPE_CHECKING:
    from automap.io.drive import Drive


def run(context: StageContext) -> None:
    """Write the map in every standard format with its pictures; whatever is missing is said."""
    from automap.export.roads import roads_csv
    from automap.io.atomic import write_text
    from pipeline.export.content import map_content, set_pictures
    from pipeline.export.datum import DATUM_FORMATS, in_datum
    from pipeline.export.formats import (
        FORMATS,
        STANDARD_FORMATS,
        write_dictionary,
        write_rejected,
    )
    from pipeline.export.roads import tried_on_roads
    from pipeline.shared.pictures import Wanted, take_pictures, write_pictures

    settings = context.settings.export
    content = map_content(context.out, context.drive.name, settings.min_confidence, False)
    content.products.readable()
    set_pictures(content, [])
    if settings.pictures:
        pictures = take_pictures(
            content.products,
            context.drive.videos,
            Wanted(settings.context, context.settings.privacy.hide_street),
            context.warn,
            lambda done: context.progress(0.7 * done, "sign pictures"),
        )
        set_pictures(content, pictures)
        if pictures:
            write_pictures(context.work, pictures)
    roads = _roads_file(context.drive, settings.roads)
    rows = tried_on_roads(content, roads)
    if rows:
        write_text(context.work / names.SIGN_ROADS, roads_csv(rows))
    elsewhere = in_datum(content, settings.datum) if settings.datum else content
    for text in elsewhere.warnings:
        context.warn(text)
    for number, fmt in enumerate(STANDARD_FORMATS):
        file_name, write = FORMATS[fmt]
        context.progress(0.7 + 0.3 * number / len(STANDARD_FORMATS), file_name)
        write(elsewhere if fmt in DATUM_FORMATS else content, context.work / file_name)
    write_dictionary(context.work / names.DICTIONARY)
    if content.products.rejected:
        write_rejected(content, context.work / names.REJECTED)
    context.metric("signs", len(content.signs))
    points = 0 if content.path is None else len(content.path)
    context.result = (
        f"{len(content.signs)} signs and a path of {points} points in {len(STANDARD_FORMATS)} "
        f"formats, {len(content.pictures)} pictures"
    )


def _inputs(drive: Drive) -> list[Path]:
    roads = _roads_file(drive, "")
    chapters = [path for video in drive.videos.values() for path in video.chapters]
    return chapters if roads is None else [*chapters, *layer_files(roads)]


def _roads_file(drive: Drive, stated: str) -> Path | None:
    """The layer of roads that the settings name, else the drive's own."""
    own = drive.manifest.site.roads
    if stated or not own:
        return Path(stated) if stated else None
    check_inside(drive.path / own, drive.path, f"{drive.path / names.MANIFEST}: site.roads")
    return drive.path / own


STAGE = Stage(
    name="export",
    version=13,
    run=run,
    inputs=_inputs,
    needs=(
        names.RUN,
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
        names.KMZ,
        names.GPKG,
        names.SIGNS_TABLE,
        names.DICTIONARY,
        names.REJECTED,
        names.PICTURES,
        names.PICTURE_INDEX,
        names.SIGN_ROADS,
    ),
    settings=("export", "privacy"),
    setting_files=lambda s: layer_files(Path(s.export.roads)) if s.export.roads else [],
    manifest=("name", "video", "site"),
)
