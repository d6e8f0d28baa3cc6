"""A map in the datum of its country: what GIS files and tables get with ``--datum``."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from automap.errors import ConfigError
from automap.export.datum import Datum, InDatum, decimal_year, parse_datum, to_datum
from automap.records import FixType, Trajectory
from pipeline.export.content import MapContent
from pipeline.shared.products import RunProducts

DATUM_FORMATS = ("gpkg", "parquet", "flatgeobuf", "csv", "xlsx", "shapefile")
"""Formats that can hold another datum; GeoJSON, KML, GPX and OSM are WGS-84 by definition."""


def in_datum(content: MapContent, text: str) -> MapContent:
    """The same content with all positions in the datum ``text``, such as GDA2020@2026.5.

    Signs, path and trajectory move; the content's lineage says by which operation. Raises
    ConfigError for a datum that does not exist, InputError when there is no transformation
    good enough.
    """
    datum = parse_datum(text)
    if datum.is_native:
        return content
    recorded = recorded_year(content)
    signs = content.signs
    moved = to_datum(signs.lon_deg, signs.lat_deg, signs.height_m, datum, recorded)
    path, path_moved = content.path, None
    if path is not None:
        path_moved = to_datum(path.lon_deg, path.lat_deg, path.height_m, datum, recorded)
        path = replace(
            path,
            lon_deg=path_moved.lon_deg,
            lat_deg=path_moved.lat_deg,
            height_m=path_moved.height_m,
        )
    told = moved if len(signs) or path_moved is None else path_moved
    warnings = [*content.warnings, *told.warnings, *_corrections_warning(content.products, datum)]
    return replace(
        content,
        source=replace(
            signs, lon_deg=moved.lon_deg, lat_deg=moved.lat_deg, height_m=moved.height_m
        ),
        path=path,
        products=_products(content.products, datum, recorded),
        warnings=warnings,
        crs=datum.code,
        lineage=content.lineage | _lineage(told),
    )


def check_format(text: str, fmt: str) -> None:
    """Raise ConfigError when ``fmt`` cannot be in the datum ``text``."""
    if text and not parse_datum(text).is_native and fmt not in DATUM_FORMATS:
        raise ConfigError(
            f"--datum {text}: {fmt} is always WGS-84; take one of {', '.join(DATUM_FORMATS)}."
        )


def recorded_year(content: MapContent) -> float | None:
    """Year of the recording, by the trajectory or else by the sightings of the signs."""
    epoch = content.lineage.get("coordinate_epoch")
    if isinstance(epoch, float):
        return epoch
    clock = content.products.clock
    stamps = [t for t in content.signs.values["last_seen_t_ns"] if t is not None]
    if clock is None or not stamps:
        return None
    return decimal_year(float(np.mean(clock.gps_s(np.array(stamps, np.int64)))))


def _products(products: RunProducts, datum: Datum, recorded: float | None) -> RunProducts:
    """The products with the trajectory, on which the detections are placed, in the datum."""
    moved = {name: _moved(t, datum, recorded) for name, t in products.trajectories.items()}
    if products.trajectory is None:
        return replace(products, tracks=moved)
    return replace(products, trajectory=moved[""])


def _moved(trajectory: Trajectory, datum: Datum, recorded: float | None) -> Trajectory:
    if len(trajectory) == 0:
        return trajectory
    moved = to_datum(
        np.degrees(trajectory.lon_rad), np.degrees(trajectory.lat_rad), trajectory.height_m,
        datum, recorded,
    )  # fmt: skip
    return replace(
        trajectory,
        lon_rad=np.radians(moved.lon_deg),
        lat_rad=np.radians(moved.lat_deg),
        height_m=moved.height_m,
    )


def _corrections_warning(products: RunProducts, datum: Datum) -> list[str]:
    fixes = products.fixes
    if fixes is None or not len(fixes):
        return []
    corrected = np.isin(fixes.fix_type, (int(FixType.FLOAT), int(FixType.FIXED)))
    if corrected.mean() < 0.5:
        return []
    return [
        f"Most fixes are corrected ones (RTK): they are in the frame of the correction service, "
        f"while --datum {datum.name} takes them for WGS-84 as broadcast; if the service is in "
        f"{datum.name} already, leave --datum out."
    ]


def _lineage(told: InDatum) -> dict[str, Any]:
    shift = None if np.isnan(told.largest_shift_m) else round(told.largest_shift_m, 3)
    return {
        "datum": f"{told.datum.name} ({told.datum.code}), heights above its ellipsoid",
        "datum_operation": told.operation,
        "datum_accuracy_m": told.accuracy_m,
        "datum_largest_shift_m": shift,
        "coordinate_epoch": told.epoch,
    }
