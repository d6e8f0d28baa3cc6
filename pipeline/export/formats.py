"""The map in every format."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from automap.export import geojson, kml, trajectory_formats
from automap.export.datum import WGS84_3D, is_moving
from automap.export.fields import Field
from automap.export.icons import class_icon
from automap.export.kml import KmlOptions
from automap.export.layers import Layer
from automap.export.pieces import write_pieces
from automap.export.projected import projected_layer
from automap.export.sign_columns import sign_columns
from automap.io import names
from automap.io.atomic import write_chunks, write_json, write_text
from automap.records import Trajectory
from pipeline.export.content import MapContent, geoid_heights, trajectory_of
from pipeline.shared.pictures import pictures_by_sign
from pipeline.shared.products import geoid_separation

_LARGE = 1 << 30
"""Bytes of a document, by an estimate that may be half of it."""


def write_geojson(content: MapContent, path: Path) -> None:
    """Write the signs as GeoJSON."""
    texts = geojson.geojson_texts(content.source, content.lineage)
    write_pieces(path, texts, content.kept)


def write_rejected(content: MapContent, path: Path) -> None:
    """Write the signs that a review took off the map, as GeoJSON."""
    products = content.products
    signs = sign_columns(products.rejected, products.clock, content.country)
    write_text(path, geojson.signs_geojson(signs))


def write_kml(content: MapContent, path: Path) -> None:
    """Write signs and track as KML, in one file without pictures."""
    keyed = content.kept is not None
    options = KmlOptions(*geoid_heights(content), lineage=content.lineage, keyed=keyed)
    texts = kml.kml_texts(content.name, content.source, content.path, options)
    write_pieces(path, texts, content.kept)


def write_kmz(content: MapContent, path: Path) -> None:
    """Write the same with the faces of the classes and the pictures of the signs."""
    from automap.export import kmz

    icons, files = {}, {}
    for number, name in enumerate(sorted(set(content.source.classes))):
        icons[name] = f"files/class-{number}.png"
        files[icons[name]] = class_icon(name)
    pictures: dict[int, list[str]] = {}
    by_sign = pictures_by_sign(content.pictures)
    for row, sign_id in enumerate(content.signs.values["id"] if by_sign else ()):
        for picture in by_sign.get(sign_id, ()):
            href = f"files/{picture.view.file}"
            files[href] = picture.jpeg
            pictures.setdefault(row, []).append(href)
        for picture in by_sign.get(sign_id, ())[:1]:
            if picture.context is not None:
                href = f"files/{picture.view.context_file}"
                files[href] = picture.context
                pictures[row].append(href)
    options = KmlOptions(
        *geoid_heights(content),
        lineage=content.lineage,
        icons=icons,
        pictures=pictures,
        clamp_signs=True,
        typed=False,
        keyed=content.kept is not None,
    )
    document = kml.kml_texts(content.name, content.source, content.path, options)
    large = _document_size(content) > _LARGE
    kmz.write_kmz(path, document, files, large, content.kept)


def _document_size(content: MapContent) -> float:
    """Bytes of a KML document, rather too many: a sign has 3 kB and thrice the names of its drives,
    a point of the path 250."""
    points = 0 if content.path is None else len(content.path)
    return 4e3 * len(content.source) + 2e2 * float(content.source.seen_by().sum()) + 5e2 * points


def write_gpkg(content: MapContent, path: Path) -> None:
    """Write the layers signs, observations, trajectory and ellipses as GeoPackage."""
    from automap.export import gis, layers, qgis_style
    from automap.export.assemblies import assembly_parts
    from automap.export.uncertainty import sigma_classes, sigma_limits

    products, signs = content.products, content.source
    colours = kml.class_colours(signs.classes)
    icons = {name: class_icon(name) for name in colours}
    built = [layers.sign_parts(signs)]
    styles = [qgis_style.sign_style(icons, colours, signs.fields)]
    if products.observations is not None:
        seen = layers.observation_layer(
            products.observations, products.trajectories, products.clock
        )
        built.append(layers.in_one(seen))
        styles.append(qgis_style.observation_style())
    if content.path is not None and len(content.path) > 1:
        built.append(layers.path_parts(content.path))
        sigma = content.path.sd_h_m
        styles.append(qgis_style.track_style(sigma_limits(sigma), sigma_classes(sigma)[1]))
    built.append(assembly_parts(signs))
    styles.append(qgis_style.assembly_style())
    built.append(layers.ellipse_parts(signs))
    styles.append(qgis_style.ellipse_style())
    built = [layer.changed(lambda part: _placed(content, part)) for layer in built]
    crs = content.crs or WGS84_3D
    gis.write_layers(
        path, built, lineage=content.lineage, crs=crs, styles=styles, epoch=_epoch(content)
    )


def _epoch(content: MapContent) -> float | None:
    """The year at which the coordinates hold; None in a national datum, which moves with its plate,
    so that they hold at all times."""
    code = content.crs if content.plane is None else content.plane.projection.datum.code
    moves = code in (None, WGS84_3D) or is_moving(code)
    epoch = content.lineage.get("coordinate_epoch") if moves else None
    return float(epoch) if epoch is not None and np.isfinite(epoch) else None


def _placed(content: MapContent, layer: Layer) -> Layer:
    """The layer in the coordinates that were asked for."""
    return layer if content.plane is None else projected_layer(layer, content.plane)


def write_geoparquet(content: MapContent, path: Path) -> None:
    """Write the signs as GeoParquet."""
    from automap.export import geoparquet

    geoparquet.write_geoparquet(
        path,
        content.source,
        content.lineage,
        crs=content.crs,
        epoch=_epoch(content),
        plane=content.plane,
    )


def write_flatgeobuf(content: MapContent, path: Path) -> None:
    """Write the signs as FlatGeobuf."""
    from automap.export import gis, layers

    layer = _placed(content, layers.sign_layer(content.signs))
    crs = content.crs or WGS84_3D
    gis.write_layers(path, [layer], driver="FlatGeobuf", lineage=content.lineage, crs=crs)


def write_csv(content: MapContent, path: Path) -> None:
    """Write the signs as CSV, and beside it what its columns mean (CSV on the Web)."""
    from automap.export import gis
    from automap.export.dictionary import POSITION_FIELDS, plane_fields

    plane = content.plane
    write_text(path, gis.signs_csv(content.signs, plane))
    own = () if plane is None else plane_fields(plane.projection.crs)
    _describe_csv(content, path, (*POSITION_FIELDS, *own, *content.signs.fields))


def _describe_csv(content: MapContent, path: Path, fields: Sequence[Field]) -> None:
    from automap.export.dictionary import csv_metadata

    metadata = csv_metadata(path.name, fields, content.lineage)
    write_json(path.with_name(f"{path.name}-metadata.json"), metadata)


def write_xlsx(content: MapContent, path: Path) -> None:
    """Write the signs as a workbook with a picture of each."""
    from automap.export import xlsx

    best = {name: own[0].jpeg for name, own in pictures_by_sign(content.pictures).items()}
    xlsx.write_xlsx(path, content.signs, best, content.lineage, content.plane)


def write_shapefile(content: MapContent, path: Path) -> None:
    """Write the signs as a zipped Shapefile."""
    from automap.export import shapefile

    shapefile.write_shapefile(path, content.signs, content.crs or WGS84_3D, content.plane)


def write_pmtiles(content: MapContent, path: Path) -> None:
    """Write the signs as vector tiles."""
    from automap.export import tiles

    tiles.write_pmtiles(path, content.signs, content.path)


def write_assemblies(content: MapContent, path: Path) -> None:
    """Write posts and gantries with what hangs on them as GeoJSON."""
    from automap.export.assemblies import assemblies_geojson

    write_text(path, assemblies_geojson(content.signs))


def write_osm(content: MapContent, path: Path) -> None:
    """Write the signs as nodes for review in JOSM."""
    from automap.export.osm import josm_file

    write_text(path, josm_file(content.signs, content.country))


def write_dictionary(path: Path) -> None:
    """Write what every column of a map means."""
    from automap.export.dictionary import dictionary_csv

    write_text(path, dictionary_csv())


def write_trajectory_csv(content: MapContent, path: Path) -> None:
    """Write the trajectory as CSV, and beside it what its columns mean (CSV on the Web)."""
    from automap.export.dictionary import TRAJECTORY_COLUMNS

    _write_rows(content, path, trajectory_formats.trajectory_csv)
    _describe_csv(content, path, TRAJECTORY_COLUMNS)


def _write_rows(
    content: MapContent, path: Path, text_of: Callable[[Trajectory, Trajectory | None], str]
) -> None:
    """Write the trajectory's rows stretch by stretch."""
    parts = trajectory_formats.stretches(trajectory_of(content))
    write_chunks(path, (text_of(part, before).encode() for part, before in parts))


def write_pos(content: MapContent, path: Path) -> None:
    """Write the trajectory as an RTKLIB solution."""
    _write_rows(content, path, trajectory_formats.rtklib_pos)


def write_tum(content: MapContent, path: Path) -> None:
    """Write the trajectory as TUM poses."""
    _write_rows(content, path, trajectory_formats.tum_poses)


def write_kitti(content: MapContent, path: Path) -> None:
    """Write the trajectory as KITTI poses."""
    _write_rows(content, path, trajectory_formats.kitti_poses)


def write_gpx(content: MapContent, path: Path) -> None:
    """Write the trajectory as a GPX track, with the signs as waypoints."""
    step_s = 0.0 if content.every_row else trajectory_formats.GPX_STEP_S
    products = content.products
    # a merged map of before it had tracks has its signs alone
    bare = products.tracks or len(content.signs)
    trajectory = products.trajectory if bare else trajectory_of(content)
    geoid = None
    if trajectory is not None:
        geoid = geoid_separation(content.products, trajectory.t_ns)
    text = trajectory_formats.gpx_track(
        trajectory,
        content.name,
        step_s,
        content.signs,
        content.lineage,
        geoid,
        products.tracks,
    )
    write_text(path, text)


Writer = Callable[[MapContent, Path], None]

FORMATS: dict[str, tuple[str, Writer]] = {
    "geojson": (names.SIGNS_GEOJSON, write_geojson),
    "kml": (names.KML, write_kml),
    "kmz": (names.KMZ, write_kmz),
    "gpkg": (names.GPKG, write_gpkg),
    "parquet": (names.SIGNS_TABLE, write_geoparquet),
    "flatgeobuf": ("signs.fgb", write_flatgeobuf),
    "csv": ("signs.csv", write_csv),
    "xlsx": ("signs.xlsx", write_xlsx),
    "shapefile": ("signs.shp.zip", write_shapefile),
    "pmtiles": ("signs.pmtiles", write_pmtiles),
    "osm": ("signs.osm", write_osm),
    "assemblies": ("assemblies.geojson", write_assemblies),
    "trajectory-csv": ("trajectory.csv", write_trajectory_csv),
    "pos": ("trajectory.pos", write_pos),
    "tum": ("trajectory.tum", write_tum),
    "kitti": ("trajectory.kitti", write_kitti),
    "gpx": ("trajectory.gpx", write_gpx),
}
"""Format: the file's name in OUT and what writes it."""

TRAJECTORY_FORMATS = ("trajectory-csv", "pos", "tum", "kitti", "gpx")

STANDARD_FORMATS = ("geojson", "kml", "kmz", "gpkg", "parquet")
"""What every run writes."""
