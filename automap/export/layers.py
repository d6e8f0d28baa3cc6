"""The map as layers of features: geometry as WKB and columns, for any GIS format."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from automap.export.clock import utc_of_stamps
from automap.export.fields import STAMP_FIELDS
from automap.export.path import Path
from automap.export.sign_columns import SignColumns, Signs, ellipse_rings, wrap_degrees
from automap.export.storable import gdal_texts
from automap.records import ClockModel, FloatArray, IntArray, Trajectory

if TYPE_CHECKING:
    import pyarrow as pa

WkbArray = npt.NDArray[np.object_]
_LINES = 65_536
"""Of a path at once."""


@dataclass(frozen=True)
class Layer:
    """Features [n] of one kind. ``wkb`` holds bytes or None, longitude before latitude.

    ``columns`` are numpy arrays [n]: int64, float64, bool, datetime64[ms] (UTC) or objects
    that are text or None; ``missing`` marks the unknown entries of integer columns.
    """

    name: str
    geometry_type: str
    wkb: WkbArray
    columns: dict[str, npt.NDArray[Any]]
    missing: dict[str, npt.NDArray[np.bool_]]

    def __len__(self) -> int:
        return len(self.wkb)


@dataclass(frozen=True)
class LayerParts:
    """A layer of ``count`` features as parts, at least one, made one after another as often as
    they are asked for."""

    name: str
    geometry_type: str
    count: int
    parts: Callable[[], Iterable[Layer]]

    def changed(self, change: Callable[[Layer], Layer]) -> LayerParts:
        """The same with each part changed."""
        return LayerParts(
            self.name, self.geometry_type, self.count, lambda: map(change, self.parts())
        )


def in_one(layer: Layer) -> LayerParts:
    """A layer that is one part."""
    return LayerParts(layer.name, layer.geometry_type, len(layer), lambda: [layer])


def sign_parts(signs: Signs) -> LayerParts:
    """The layer of signs part by part."""
    return LayerParts(
        "signs", sign_geometry(signs), len(signs), lambda: map(sign_layer, signs.parts())
    )


def ellipse_parts(signs: Signs) -> LayerParts:
    """Their ellipses part by part."""
    return LayerParts("ellipses", "Polygon", len(signs), lambda: map(ellipse_layer, signs.parts()))


def sign_geometry(columns: Signs) -> str:
    """The type of signs' geometry: points with a height, without one, or both."""
    heights = np.isfinite(columns.height_m[columns.located])
    return "Point Z" if heights.all() else "Unknown" if heights.any() else "Point"


def sign_layer(columns: SignColumns) -> Layer:
    """Signs as points with ellipsoidal height, all fields of the data dictionary.

    The two times are UTC (null without a known clock); the host stamps stand beside them.
    """
    return _of_signs("signs", sign_geometry(columns), point_wkb(columns), columns)


def ellipse_layer(columns: SignColumns) -> Layer:
    """The 95 % ellipses of the horizontal position as polygons, with the signs' fields."""
    import shapely

    wkb = np.full(len(columns), None, object)
    if len(columns):
        rings = ellipse_rings(columns)
        drawable = columns.located & np.isfinite(rings).all(axis=(1, 2))
        wkb[drawable] = shapely.to_wkb(shapely.polygons(rings[drawable]))
    return _of_signs("ellipses", "Polygon", wkb, columns)


def _of_signs(name: str, geometry_type: str, wkb: WkbArray, columns: SignColumns) -> Layer:
    arrays: dict[str, npt.NDArray[Any]] = {}
    missing: dict[str, npt.NDArray[np.bool_]] = {}
    for field in (*columns.fields, *STAMP_FIELDS):
        values = columns.values[field.name]
        if field.kind == "real":
            arrays[field.name] = np.asarray(values, np.float64)
        elif field.kind == "integer":
            unknown = np.array([value is None for value in values], bool)
            arrays[field.name] = np.array([value or 0 for value in values], np.int64)
            missing[field.name] = unknown
        elif field.kind == "time":
            texts = values if columns.utc_known else [None] * len(columns)
            arrays[field.name] = times_of_texts(texts)
        elif field.kind == "list":
            arrays[field.name] = _objects([", ".join(value) or None for value in values])
        else:
            arrays[field.name] = _objects(values)
    return Layer(name, geometry_type, wkb, arrays, missing)


def times_of_texts(texts: list[str | None]) -> npt.NDArray[np.datetime64]:
    """ISO texts ending in Z as datetime64[ms]; None becomes NaT."""
    return np.array([text[:-1] if text else "NaT" for text in texts], "datetime64[ms]")


def point_wkb(columns: SignColumns) -> WkbArray:
    """Positions as WKB points [n], three-dimensional where the height is known, else None."""
    wkb = np.full(len(columns), None, object)
    at = columns.located
    wkb[at] = wkb_of_points(columns.lon_deg[at], columns.lat_deg[at], columns.height_m[at])
    return wkb


def wkb_of_points(lon: FloatArray, lat: FloatArray, height: FloatArray) -> WkbArray:
    """WKB points [n], three-dimensional where the height is known."""
    import shapely

    wkb = np.full(len(lon), None, object)
    high = np.isfinite(height)
    wkb[~high] = shapely.to_wkb(shapely.points(lon[~high], lat[~high]))
    wkb[high] = shapely.to_wkb(shapely.points(lon[high], lat[high], height[high]), flavor="iso")
    return wkb


def path_layer(path: Path) -> Layer:
    """The trajectory as one short line from each point of the path to the next.

    So that a GIS can colour it by speed or uncertainty, which are those of a line's start.
    """
    return _lines(path, _starts(path))


def path_parts(path: Path) -> LayerParts:
    """The same in parts of some thousand lines."""
    starts = _starts(path)
    pieces = [starts[k : k + _LINES] for k in range(0, max(len(starts), 1), _LINES)]
    lines = partial(_lines, path)
    return LayerParts("trajectory", "LineString Z", len(starts), lambda: map(lines, pieces))


def _starts(path: Path) -> IntArray:
    return np.concatenate(
        [np.arange(run.start, run.stop - 1) for run in path.runs] or [np.zeros(0, np.int64)]
    ).astype(np.int64)


def _lines(path: Path, starts: IntArray) -> Layer:
    """Lines from points ``starts`` of the path to the next ones."""
    import shapely

    ends = [
        np.column_stack([path.lon_deg[at], path.lat_deg[at], np.nan_to_num(path.height_m[at])])
        for at in (starts, starts + 1)
    ]
    lines = shapely.linestrings(np.stack(ends, axis=1))
    columns: dict[str, npt.NDArray[Any]] = {
        "t_ns": path.t_ns[starts],
        "utc": path.utc[starts],
        "speed_m_s": path.speed_m_s[starts],
        "roll_deg": path.rpy_deg[starts, 0],
        "pitch_deg": path.rpy_deg[starts, 1],
        "yaw_deg": path.rpy_deg[starts, 2],
        "sd_h_m": path.sd_h_m[starts],
        "sd_d_m": path.sd_d_m[starts],
    }
    if path.drives:
        ends_at = np.cumsum([n for _, n in path.drives])
        own = np.searchsorted(ends_at, starts, "right").tolist()
        columns["drive"] = _objects([path.drives[k][0] for k in own])
    wkb = np.asarray(shapely.to_wkb(lines, flavor="iso"), object)
    return Layer("trajectory", "LineString Z", wkb, columns, {})


def observation_layer(
    table: pa.Table, trajectories: Mapping[str, Trajectory], clock: ClockModel | None
) -> Layer:
    """Detections with all their columns, each placed where the vehicle was: on the trajectory of
    its drive, or on that of the name "" where the table names no drive.

    Without a trajectory, or outside of it, the geometry is null.
    """
    columns: dict[str, npt.NDArray[Any]] = {}
    missing: dict[str, npt.NDArray[np.bool_]] = {}
    for name in table.column_names:
        values, unknown = _column(table.column(name))
        columns[name] = values
        if unknown is not None:
            missing[name] = unknown
    wkb = np.full(table.num_rows, None, object)
    if "t_ns" in columns and "t_ns" not in missing:
        columns["utc"] = utc_of_stamps(columns["t_ns"], clock)
        drive = columns.get("drive", np.full(table.num_rows, "", object))
        for name, trajectory in trajectories.items():
            rows = np.flatnonzero(drive == name)
            wkb[rows] = _places(trajectory, columns["t_ns"][rows])
    return Layer("observations", "Point Z", wkb, columns, missing)


def _places(trajectory: Trajectory, t_ns: IntArray) -> WkbArray:
    """Where a vehicle was at stamps [n], as points; None where that is not known."""
    import shapely

    from automap.interpolation import poses_at

    wkb = np.full(len(t_ns), None, object)
    if len(trajectory) > 1:
        poses = poses_at(trajectory, t_ns)
        there = poses.covered & np.isfinite(poses.lat_rad) & np.isfinite(poses.lon_rad)
        points = shapely.points(
            wrap_degrees(np.degrees(poses.lon_rad[there])),
            np.degrees(poses.lat_rad[there]),
            np.nan_to_num(poses.height_m[there]),
        )
        wkb[there] = shapely.to_wkb(points, flavor="iso")
    return wkb


def _column(column: pa.ChunkedArray) -> tuple[npt.NDArray[Any], npt.NDArray[np.bool_] | None]:
    import pyarrow as pa

    kind = column.type
    if pa.types.is_floating(kind):
        return np.asarray(column.to_numpy(), np.float64), None
    if pa.types.is_boolean(kind) or pa.types.is_integer(kind):
        unknown = np.asarray(column.is_null().to_numpy(), bool)
        target: type = bool if pa.types.is_boolean(kind) else np.int64
        filled = column.fill_null(False if target is bool else 0)
        return np.asarray(filled.to_numpy(), target), unknown if unknown.any() else None
    texts = [None if value is None else str(value) for value in column.to_pylist()]
    return _objects(texts), None


def _objects(values: list[Any]) -> npt.NDArray[np.object_]:
    array = np.empty(len(values), object)
    array[:] = gdal_texts(values)
    return array
