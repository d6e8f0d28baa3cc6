"""The map in every format, from what the earlier stages left in OUT."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from automap.errors import ConfigError, InputError
from automap.export import geojson, kml, trajectory_formats
from automap.export.datum import is_moving
from automap.export.fields import SIGN_FIELDS, Field
from automap.export.icons import class_icon
from automap.export.kml import KmlOptions
from automap.export.path import Path as MapPath
from automap.export.path import simplified_path
from automap.export.sign_columns import SignColumns, sign_columns
from automap.io import names
from automap.io.atomic import write_bytes, write_chunks, write_json, write_text
from automap.io.json_text import parse_json
from automap.records import NO_TIME, FloatArray, Trajectory
from pipeline.export.datum import check_format, in_datum, sea_level_heights
from pipeline.export.lineage import lineage
from pipeline.export.trajectory_view import TrajectoryView, viewed
from pipeline.shared.pictures import Picture, pictures_by_sign, read_pictures
from pipeline.shared.products import RunProducts, geoid_separation, load_products
from pipeline.shared.targets import spare_recordings, spare_results


@dataclass
class MapContent:
    """What goes on the map: signs, the simplified path, and where both came from."""

    name: str
    signs: SignColumns
    path: MapPath | None
    products: RunProducts
    warnings: list[str] = field(default_factory=list)
    every_row: bool = False
    """The trajectory's rows were asked for one by one: none is left out."""
    lineage: dict[str, Any] = field(default_factory=dict)
    """Run, versions and inputs, for the metadata of every file."""
    country: str | None = None
    pictures: list[Picture] = field(default_factory=list)
    crs: str | None = None
    """Coordinate system of the positions where it is not WGS-84."""


def map_content(out: Path, name: str, min_confidence: float = 0.0) -> MapContent:
    """Read OUT and prepare its signs and path, with a warning for all that is missing.

    Signs of less confidence than ``min_confidence`` are left out, and counted in a warning.
    """
    products = load_products(out)
    left_out = _drop_unsure(products, min_confidence)
    signs = sign_columns(products.signs or [], products.clock)
    path = simplified_path(products.trajectory) if products.trajectory is not None else None
    record = products.json(names.RUN)
    pictures = read_pictures(products)
    content = MapContent(
        name,
        signs,
        path,
        products,
        list(products.problems),
        lineage=lineage(record, name, products.trajectory),
        country=_country(record),
        pictures=pictures,
    )
    signs.values["height_msl_m"] = sea_level_heights(signs, _geoid(content)[0])
    if min_confidence > 0.0:
        content.lineage["min_confidence"] = min_confidence
    if left_out:
        content.warnings.append(
            f"{left_out} of {left_out + len(signs)} signs are less sure than {min_confidence:g}; "
            "they were left out."
        )
    if path is None or not len(path):
        content.warnings.append("There is no trajectory, so the map shows no path.")
    if products.signs is None:
        content.warnings.append("No signs were located, so the map has none.")
    lost = len(signs) - int(signs.located.sum())
    if lost:
        content.warnings.append(
            f"{lost} of {len(signs)} signs have no position; they are in the files without one."
        )
    if products.clock is None and len(signs):
        content.warnings.append(
            "The recording's clock is not tied to UTC, so first_seen and last_seen are host "
            "stamps in nanoseconds."
        )
    return content


def _drop_unsure(products: RunProducts, least: float) -> int:
    """Take signs below a confidence off the map; a confidence that is unknown is kept."""
    if least <= 0.0 or not products.signs:
        return 0
    kept = [sign for sign in products.signs if not sign.confidence < least]
    left_out = len(products.signs) - len(kept)
    products.signs = kept
    return left_out


def _country(record: dict[str, Any]) -> str | None:
    """The country that the drive's manifest named."""
    stages = record.get("stages")
    for stage in stages.values() if isinstance(stages, dict) else ():
        manifest = stage.get("manifest") if isinstance(stage, dict) else None
        country = manifest.get("site.country") if isinstance(manifest, dict) else None
        if isinstance(country, str):
            return country
    return None


def write_geojson(content: MapContent, path: Path) -> None:
    """Write the signs as GeoJSON."""
    write_bytes(path, geojson.geojson_bytes(content.signs, content.lineage))


def write_rejected(content: MapContent, path: Path) -> None:
    """Write the signs that a review took off the map, as GeoJSON."""
    products = content.products
    write_text(path, geojson.signs_geojson(sign_columns(products.rejected, products.clock)))


def write_kml(content: MapContent, path: Path) -> None:
    """Write signs and track as KML, in one file without pictures."""
    options = KmlOptions(*_geoid(content), lineage=content.lineage)
    write_chunks(path, kml.kml_chunks(content.name, content.signs, content.path, options))


def write_kmz(content: MapContent, path: Path) -> None:
    """Write the same with the faces of the classes and the pictures of the signs."""
    from automap.export import kmz

    icons, files = {}, {}
    for number, name in enumerate(sorted(set(content.signs.values["class"]))):
        icons[name] = f"files/class-{number}.png"
        files[icons[name]] = class_icon(name)
    pictures: dict[int, list[str]] = {}
    by_sign = pictures_by_sign(content.pictures)
    for row, sign_id in enumerate(content.signs.values["id"]):
        for picture in by_sign.get(sign_id, ()):
            href = f"files/{picture.view.file}"
            files[href] = picture.jpeg
            pictures.setdefault(row, []).append(href)
    options = KmlOptions(
        *_geoid(content),
        lineage=content.lineage,
        icons=icons,
        pictures=pictures,
        clamp_signs=True,
    )
    document = kml.kml_chunks(content.name, content.signs, content.path, options)
    kmz.write_kmz(path, document, files)


def _geoid(content: MapContent) -> tuple[FloatArray | None, FloatArray | None]:
    """Height of the geoid above the ellipsoid at the signs and along the path."""
    values = content.signs.values
    seen = [
        NO_TIME if first is None else (first if last is None else first + (last - first) // 2)
        for first, last in zip(values["first_seen_t_ns"], values["last_seen_t_ns"], strict=True)
    ]
    stamps = np.array(seen, np.int64)
    sign_geoid = geoid_separation(content.products, stamps)
    if sign_geoid is not None:
        sign_geoid = np.where(stamps == NO_TIME, np.nan, sign_geoid)
    track = content.path
    track_geoid = None if track is None else geoid_separation(content.products, track.t_ns)
    return sign_geoid, track_geoid


def write_gpkg(content: MapContent, path: Path) -> None:
    """Write the layers signs, observations, trajectory and ellipses as GeoPackage."""
    from automap.export import gis, layers, qgis_style
    from automap.export.uncertainty import sigma_classes, sigma_limits

    products = content.products
    classes = content.signs.values["class"]
    colours = kml.class_colours(classes)
    icons = {name: class_icon(name) for name in colours}
    built = [layers.sign_layer(content.signs)]
    styles = [qgis_style.sign_style(icons, colours)]
    if products.observations is not None:
        built.append(
            layers.observation_layer(products.observations, products.trajectory, products.clock)
        )
        styles.append(qgis_style.observation_style())
    if content.path is not None and len(content.path) > 1:
        built.append(layers.path_layer(content.path))
        sigma = content.path.sd_h_m
        styles.append(qgis_style.track_style(sigma_limits(sigma), sigma_classes(sigma)[1]))
    built.append(layers.ellipse_layer(content.signs))
    styles.append(qgis_style.ellipse_style())
    crs = content.crs or gis.WGS84_3D
    gis.write_layers(path, built, lineage=content.lineage, crs=crs, styles=styles)


def write_geoparquet(content: MapContent, path: Path) -> None:
    """Write the signs as GeoParquet."""
    from automap.export import gis

    # a national datum moves with its plate: its coordinates hold at all times
    moves = content.crs is None or is_moving(content.crs)
    epoch = content.lineage.get("coordinate_epoch") if moves else None
    gis.write_geoparquet(path, content.signs, content.lineage, crs=content.crs, epoch=epoch)


def write_flatgeobuf(content: MapContent, path: Path) -> None:
    """Write the signs as FlatGeobuf."""
    from automap.export import gis, layers

    layer = layers.sign_layer(content.signs)
    crs = content.crs or gis.WGS84_3D
    gis.write_layers(path, [layer], driver="FlatGeobuf", lineage=content.lineage, crs=crs)


def write_csv(content: MapContent, path: Path) -> None:
    """Write the signs as CSV, and beside it what its columns mean (CSV on the Web)."""
    from automap.export import gis
    from automap.export.dictionary import POSITION_FIELDS

    write_text(path, gis.signs_csv(content.signs))
    _describe_csv(content, path, (*POSITION_FIELDS, *SIGN_FIELDS))


def _describe_csv(content: MapContent, path: Path, fields: Sequence[Field]) -> None:
    from automap.export.dictionary import csv_metadata

    metadata = csv_metadata(path.name, fields, content.lineage)
    write_json(path.with_name(f"{path.name}-metadata.json"), metadata)


def write_osm(content: MapContent, path: Path) -> None:
    """Write the signs as nodes for review in JOSM."""
    from automap.export.osm import josm_file

    write_text(path, josm_file(content.signs, content.country))


def write_dictionary(path: Path) -> None:
    """Write what every column of a map means."""
    from automap.export.dictionary import dictionary_csv

    write_text(path, dictionary_csv())


def _trajectory(content: MapContent) -> Trajectory:
    trajectory = content.products.trajectory
    if trajectory is None or len(trajectory) == 0:
        raise InputError("there is no trajectory in OUT; run the drive first.")
    return trajectory


def write_trajectory_csv(content: MapContent, path: Path) -> None:
    """Write the trajectory as CSV, and beside it what its columns mean (CSV on the Web)."""
    from automap.export.dictionary import TRAJECTORY_COLUMNS

    write_text(path, trajectory_formats.trajectory_csv(_trajectory(content)))
    _describe_csv(content, path, TRAJECTORY_COLUMNS)


def write_pos(content: MapContent, path: Path) -> None:
    """Write the trajectory as an RTKLIB solution."""
    write_text(path, trajectory_formats.rtklib_pos(_trajectory(content)))


def write_tum(content: MapContent, path: Path) -> None:
    """Write the trajectory as TUM poses."""
    write_text(path, trajectory_formats.tum_poses(_trajectory(content)))


def write_kitti(content: MapContent, path: Path) -> None:
    """Write the trajectory as KITTI poses."""
    write_text(path, trajectory_formats.kitti_poses(_trajectory(content)))


def write_gpx(content: MapContent, path: Path) -> None:
    """Write the trajectory as a GPX track, with the signs as waypoints."""
    step_s = 0.0 if content.every_row else trajectory_formats.GPX_STEP_S
    text = trajectory_formats.gpx_track(
        _trajectory(content), content.name, step_s, content.signs, content.lineage
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
    "osm": ("signs.osm", write_osm),
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


def export_run(
    out: Path,
    fmt: str,
    target: Path | None = None,
    view: TrajectoryView | None = None,
    min_confidence: float = 0.0,
    datum: str = "",
) -> tuple[Path, list[str]]:
    """Write the map of a finished run in one format, and the data dictionary beside it.

    ``target`` is the file to write, by default the format's own name in OUT; ``view`` which
    trajectory, for the formats of one; ``min_confidence`` leaves out signs less sure;
    ``datum`` such as GDA2020@2026.5 moves the positions of GIS formats into it. Returns the
    file and the warnings. Raises ConfigError for an unknown format or a view of signs,
    InputError when OUT holds no run.
    """
    view = TrajectoryView() if view is None else view
    if fmt not in FORMATS:
        raise ConfigError(f"there is no format {fmt!r}; choose one of {', '.join(FORMATS)}.")
    if not view.is_plain and fmt not in TRAJECTORY_FORMATS:
        raise ConfigError(
            f"--at, --point and --filtered choose a trajectory, and {fmt} is a format of signs; "
            f"take one of {', '.join(TRAJECTORY_FORMATS)}."
        )
    check_format(datum, fmt)
    if not out.is_dir():
        raise InputError(f"{out} is no output folder of automap run; run the drive first.")
    has_run = (names.RUN, names.TRAJECTORY, names.SIGNS_RAW)
    if not any((out / name).is_file() for name in has_run):
        raise InputError(f"{out} holds neither a trajectory nor signs; run the drive first.")
    file_name, write = FORMATS[fmt]
    path = target if target is not None else out / file_name
    spare_results(path, out, file_name)
    spare_recordings(path, *([] if view.at is None else [view.at]))
    if path.name == names.DICTIONARY:
        raise ConfigError(f"{path} is where the meaning of the columns goes; name another file.")
    content = map_content(out, run_name(out), min_confidence)
    if not view.is_plain:
        content.products.trajectory = viewed(out, _trajectory(content), view)
        content.every_row = view.at is not None
    if datum:
        content = in_datum(content, datum)
    write(content, path)
    write_dictionary(path.with_name(names.DICTIONARY))
    if fmt in TRAJECTORY_FORMATS:
        # that there are no signs concerns no trajectory
        return path, list(content.products.problems)
    return path, content.warnings


def run_name(out: Path) -> str:
    """The drive's name in run.json, otherwise the folder's."""
    try:
        record = parse_json((out / names.RUN).read_text(encoding="utf-8"))
        drive = record.get("drive")
        name = drive.get("name") if isinstance(drive, dict) else record.get("name")
    except (OSError, ValueError, AttributeError):
        name = None
    return str(name) if name else out.resolve().name
