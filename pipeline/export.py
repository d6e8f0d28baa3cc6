"""The map in every format, from what the earlier stages left in OUT."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from automap.errors import ConfigError, InputError
from automap.export import geojson, kml, trajectory_formats
from automap.export.path import Path as MapPath
from automap.export.path import simplified_path
from automap.export.sign_columns import SignColumns, sign_columns
from automap.io import names
from automap.io.atomic import write_text
from automap.records import NO_TIME, Trajectory
from pipeline.export_view import TrajectoryView, viewed
from pipeline.products import RunProducts, geoid_separation, load_products


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


def map_content(out: Path, name: str) -> MapContent:
    """Read OUT and prepare its signs and path, with a warning for all that is missing."""
    products = load_products(out)
    signs = sign_columns(products.signs or [], products.clock)
    path = simplified_path(products.trajectory) if products.trajectory is not None else None
    content = MapContent(name, signs, path, products, list(products.problems))
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


def write_geojson(content: MapContent, path: Path) -> None:
    """Write the signs as GeoJSON."""
    write_text(path, geojson.signs_geojson(content.signs))


def write_rejected(content: MapContent, path: Path) -> None:
    """Write the signs that a review took off the map, as GeoJSON."""
    products = content.products
    write_text(path, geojson.signs_geojson(sign_columns(products.rejected, products.clock)))


def write_kml(content: MapContent, path: Path) -> None:
    """Write signs and track as KML."""
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
    text = kml.map_kml(content.name, content.signs, track, sign_geoid, track_geoid)
    write_text(path, text)


def write_gpkg(content: MapContent, path: Path) -> None:
    """Write the layers signs, observations, trajectory and ellipses as GeoPackage."""
    from automap.export import gis, layers

    products = content.products
    built = [layers.sign_layer(content.signs)]
    if products.observations is not None:
        built.append(
            layers.observation_layer(products.observations, products.trajectory, products.clock)
        )
    if content.path is not None and len(content.path) > 1:
        built.append(layers.path_layer(content.path))
    built.append(layers.ellipse_layer(content.signs))
    gis.write_layers(path, built)


def write_geoparquet(content: MapContent, path: Path) -> None:
    """Write the signs as GeoParquet."""
    from automap.export import gis

    gis.write_geoparquet(path, content.signs)


def write_flatgeobuf(content: MapContent, path: Path) -> None:
    """Write the signs as FlatGeobuf."""
    from automap.export import gis, layers

    gis.write_layers(path, [layers.sign_layer(content.signs)], driver="FlatGeobuf")


def write_csv(content: MapContent, path: Path) -> None:
    """Write the signs as CSV."""
    from automap.export import gis

    write_text(path, gis.signs_csv(content.signs))


def _trajectory(content: MapContent) -> Trajectory:
    trajectory = content.products.trajectory
    if trajectory is None or len(trajectory) == 0:
        raise InputError("there is no trajectory in OUT; run the drive first.")
    return trajectory


def write_trajectory_csv(content: MapContent, path: Path) -> None:
    """Write the trajectory as CSV."""
    write_text(path, trajectory_formats.trajectory_csv(_trajectory(content)))


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
    """Write the trajectory as a GPX track."""
    step_s = 0.0 if content.every_row else trajectory_formats.GPX_STEP_S
    write_text(path, trajectory_formats.gpx_track(_trajectory(content), content.name, step_s))


Writer = Callable[[MapContent, Path], None]

FORMATS: dict[str, tuple[str, Writer]] = {
    "geojson": (names.SIGNS_GEOJSON, write_geojson),
    "kml": (names.KML, write_kml),
    "gpkg": (names.GPKG, write_gpkg),
    "parquet": (names.SIGNS_TABLE, write_geoparquet),
    "flatgeobuf": ("signs.fgb", write_flatgeobuf),
    "csv": ("signs.csv", write_csv),
    "trajectory-csv": ("trajectory.csv", write_trajectory_csv),
    "pos": ("trajectory.pos", write_pos),
    "tum": ("trajectory.tum", write_tum),
    "kitti": ("trajectory.kitti", write_kitti),
    "gpx": ("trajectory.gpx", write_gpx),
}
"""Format: the file's name in OUT and what writes it."""

TRAJECTORY_FORMATS = ("trajectory-csv", "pos", "tum", "kitti", "gpx")

STANDARD_FORMATS = ("geojson", "kml", "gpkg", "parquet")
"""What every run writes."""


def export_run(
    out: Path, fmt: str, target: Path | None = None, view: TrajectoryView | None = None
) -> tuple[Path, list[str]]:
    """Write the map of a finished run in one format.

    ``target`` is the file to write, by default the format's own name in OUT; ``view`` which
    trajectory, for the formats of one. Returns the file and the warnings. Raises ConfigError for
    an unknown format or a view of signs, InputError when OUT holds no run.
    """
    view = TrajectoryView() if view is None else view
    if fmt not in FORMATS:
        raise ConfigError(f"there is no format {fmt!r}; choose one of {', '.join(FORMATS)}.")
    if not view.is_plain and fmt not in TRAJECTORY_FORMATS:
        raise ConfigError(
            f"--at, --point and --filtered choose a trajectory, and {fmt} is a format of signs; "
            f"take one of {', '.join(TRAJECTORY_FORMATS)}."
        )
    if not out.is_dir():
        raise InputError(f"{out} is no output folder of automap run; run the drive first.")
    has_run = (names.RUN, names.TRAJECTORY, names.SIGNS_RAW)
    if not any((out / name).is_file() for name in has_run):
        raise InputError(f"{out} holds neither a trajectory nor signs; run the drive first.")
    file_name, write = FORMATS[fmt]
    path = target if target is not None else out / file_name
    content = map_content(out, run_name(out))
    if not view.is_plain:
        content.products.trajectory = viewed(out, _trajectory(content), view)
        content.every_row = view.at is not None
    write(content, path)
    if fmt in TRAJECTORY_FORMATS:
        # that there are no signs concerns no trajectory
        return path, list(content.products.problems)
    return path, content.warnings


def run_name(out: Path) -> str:
    """The drive's name in run.json, otherwise the folder's."""
    try:
        record = json.loads((out / names.RUN).read_text(encoding="utf-8"))
        drive = record.get("drive")
        name = drive.get("name") if isinstance(drive, dict) else record.get("name")
    except (OSError, ValueError, AttributeError):
        name = None
    return str(name) if name else out.resolve().name
