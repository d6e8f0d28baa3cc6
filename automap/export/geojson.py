"""``signs.geojson``: a feature collection of points by RFC 7946, and its reader.

Coordinates are WGS-84 longitude and latitude in degrees (seven decimals, about 1 cm) and the
ellipsoidal height in metres (three decimals); the standard allows no other datum.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from automap.errors import InputError
from automap.export.fields import Field
from automap.export.pieces import Text, TextPiece, flat
from automap.export.sign_columns import SignColumns, SignPiece, Signs
from automap.export.text_columns import (
    TextColumn,
    constant,
    fixed_column,
    integer_column,
    line_chunks,
    significant_column,
    special_characters,
    text_column,
)
from automap.io.json_text import parse_json
from automap.records import NO_TIME, ClockModel, FloatArray, Sign

_encode = json.JSONEncoder(ensure_ascii=False).encode
_SPECIAL = special_characters('"\\')


def signs_geojson(columns: Signs, lineage: Mapping[str, Any] | None = None) -> str:
    """The text of the file: one feature a line, in the order of the signs.

    A sign without a position has a null geometry (RFC 7946, section 3.2); an unknown value is
    null. ``bbox`` is left out of an empty collection. ``lineage`` stands in the member
    ``automap`` (section 6.1 allows members of one's own).
    """
    return geojson_bytes(columns, lineage).decode()


def geojson_bytes(columns: Signs, lineage: Mapping[str, Any] | None = None) -> bytes:
    """The same as UTF-8."""
    return b"".join(flat(geojson_texts(columns, lineage)))


def geojson_texts(columns: Signs, lineage: Mapping[str, Any] | None = None) -> Iterator[Text]:
    """The same in parts, to be written one after another."""
    head = '{"type": "FeatureCollection",\n'
    if lineage:
        head += f'"automap": {_safe_text(dict(lineage))},\n'
    box = bounding_box(columns)
    if box is not None:
        head += f'"bbox": [{", ".join(box)}],\n'
    yield head.encode() + b'"features": ['
    for piece in columns.pieces():
        yield b",\n" if piece.start else b"\n"
        yield TextPiece(piece.key, partial(_text, piece))
    yield b"\n]}\n"


def _text(piece: SignPiece) -> Iterator[memoryview]:
    columns = piece.columns()
    for number, part in enumerate(line_chunks(_features(columns), len(columns))):
        # the comma before the first feature is one too many
        yield part[2:] if number == 0 else part


def _features(columns: SignColumns) -> list[str | TextColumn]:
    tokens = {
        field.name: json_column(field, columns.values[field.name]) for field in columns.fields
    }
    feature: list[str | TextColumn] = [',\n{"type": "Feature", "id": ', tokens["id"]]
    feature += [', "geometry": ', *_geometry(columns), ', "properties": {']
    for number, field in enumerate(columns.fields):
        feature += [f"{', ' if number else ''}{_encode(field.name)}: ", tokens[field.name]]
    return [*feature, "}}"]


def json_column(field: Field, values: Any) -> TextColumn:
    """One column [n] as JSON texts; what is not finite becomes null."""
    if field.kind == "real":
        numbers = np.asarray(values, np.float64)
        if field.decimals is None:
            return significant_column(numbers, missing="null")
        return fixed_column(numbers, field.decimals, missing="null")
    if field.kind == "integer" and isinstance(values, np.ndarray):
        return integer_column(values)
    if field.kind == "list":
        # one text as in the other formats: what has no lists (FlatGeobuf) is made from it as it is
        values = [", ".join(value) for value in values]
    return text_column(values, _safe_text, special=_SPECIAL, quote='"')


def json_tokens(field: Field, values: Any) -> list[str]:
    """The same as a list of texts."""
    return json_column(field, values).texts()


def _safe_text(value: Any) -> str:
    # lone surrogates (from odd file names) cannot be written as UTF-8
    return _encode(value).encode("utf-8", "replace").decode("utf-8")


def _geometry(columns: SignColumns) -> list[str | TextColumn]:
    n = len(columns)
    there = columns.located
    high = there & np.isfinite(columns.height_m)
    return [
        constant("null", n).where(~there),
        constant('{"type": "Point", "coordinates": [', n).where(there),
        fixed_column(columns.lon_deg, 7).where(there),
        constant(", ", n).where(there),
        fixed_column(columns.lat_deg, 7).where(there),
        constant(", ", n).where(high),
        fixed_column(columns.height_m, 3).where(high),
        constant("]}", n).where(there),
    ]


def bounding_box(columns: Signs) -> list[str] | None:
    """Numbers of the bbox member as texts, west first; None without a located sign.

    Six of them when every located sign has a height. West is greater than east when the
    smallest box crosses the date line (RFC 7946, section 5.2).
    """
    rows = columns.located
    if not rows.any():
        return None
    west, east = longitude_range(columns.lon_deg[rows])
    lat, height = columns.lat_deg[rows], columns.height_m[rows]
    low, high = [f"{west:.7f}", f"{lat.min():.7f}"], [f"{east:.7f}", f"{lat.max():.7f}"]
    if np.isfinite(height).all():
        low.append(f"{height.min():.3f}")
        high.append(f"{height.max():.3f}")
    return low + high


def longitude_range(lon_deg: FloatArray) -> tuple[float, float]:
    """West and east end of the shortest arc that holds all longitudes [n], n > 0."""
    lon = np.unique(lon_deg)
    if len(lon) == 1:
        return float(lon[0]), float(lon[0])
    gaps = np.diff(lon, append=lon[0] + 360.0)
    widest = int(np.argmax(gaps))
    return float(lon[(widest + 1) % len(lon)]), float(lon[widest])


def read_signs_geojson(path: Path, clock: ClockModel | None = None) -> list[Sign]:
    """Signs of a GeoJSON file of points, ours or anyone's.

    Unknown properties are passed over and missing ones become NaN (``id`` the feature's own
    or its number, ``status`` "ok"). Without a covariance a property ``sd_m`` is taken as the
    standard deviation east and north. Times become host stamps only with ``clock``. Raises
    InputError naming the file and the feature.
    """
    try:
        content = parse_json(Path(path).read_text(encoding="utf-8-sig"))
    except FileNotFoundError:
        raise InputError(f"{path} is missing; give the path of a GeoJSON file.") from None
    except (OSError, UnicodeDecodeError, json.JSONDecodeError, RecursionError) as error:
        raise InputError(f"{path} is not readable as GeoJSON: {error}.") from error
    features = content.get("features") if isinstance(content, dict) else None
    if not isinstance(features, list):
        raise InputError(f"{path} is not a GeoJSON FeatureCollection; its features are missing.")
    to_ns = _stamp_reader(clock)
    signs = []
    for number, feature in enumerate(features, start=1):
        try:
            signs.append(_sign(feature, number, to_ns))
        except (TypeError, ValueError, KeyError, AttributeError, IndexError) as error:
            raise InputError(
                f"{path}, feature {number}: not a sign as a point with longitude and latitude "
                f"({error}); correct or remove it."
            ) from error
    return signs


def _sign(feature: dict[str, Any], number: int, to_ns: Callable[[Any], int]) -> Sign:
    properties = feature.get("properties") or {}
    geometry = feature.get("geometry")
    lon = lat = height = float("nan")
    if geometry is not None:
        if geometry["type"] != "Point":
            raise ValueError(f"its geometry is a {geometry['type']}")
        lon, lat, *rest = (float(value) for value in geometry["coordinates"])
        height = rest[0] if rest else float("nan")
        if not (abs(lat) <= 90 and abs(lon) <= 540):
            raise ValueError(f"its coordinates {lon}, {lat} are no longitude and latitude")

    def real(name: str) -> float:
        value = properties.get(name)
        return float("nan") if value is None else float(value)

    drives = properties.get("drives") or ()
    return Sign(
        id=str(properties.get("id", feature.get("id", number))),
        class_name=str(properties.get("class", "")),
        lat_rad=float(np.radians(lat)),
        lon_rad=float(np.radians(lon)),
        height_m=height,
        cov_enu=_covariance(real),
        confidence=real("confidence"),
        existence=real("existence"),
        class_probability=real("class_probability"),
        group_probability=real("group_probability"),
        n_views=int(properties.get("n_views") or 0),
        first_seen_ns=to_ns(properties.get("first_seen")),
        last_seen_ns=to_ns(properties.get("last_seen")),
        height_above_road_m=real("height_above_road_m"),
        sd_above_road_m=real("sd_above_road_m"),
        facing_rad=float(np.radians(real("facing_deg"))),
        facing_sd_rad=float(np.radians(real("facing_sd_deg"))),
        size_m=real("size_m"),
        side=str(properties.get("side") or ""),
        path_offset_m=real("path_offset_m"),
        support=str(properties.get("support") or ""),
        status=str(properties.get("status") or "ok"),
        contrast=real("contrast"),
        contrast_sd=real("contrast_sd"),
        contrast_note=str(properties.get("contrast_note") or ""),
        seen_share=real("seen_share"),
        n_looked=int(properties.get("n_looked") or 0),
        n_back_views=int(properties.get("n_back_views") or 0),
        note=str(properties.get("note") or ""),
        reviewer=str(properties.get("reviewer") or ""),
        reviewed=str(properties.get("reviewed") or ""),
        drives=tuple(drives.split(", ") if isinstance(drives, str) else map(str, drives)),
    )


def _covariance(real: Callable[[str], float]) -> FloatArray:
    covariance = np.full((3, 3), np.nan)
    covariance[0, 0], covariance[1, 1] = real("cov_ee_m2"), real("cov_nn_m2")
    covariance[0, 1] = covariance[1, 0] = real("cov_en_m2")
    covariance[2, 2] = real("sd_u_m") ** 2
    if np.isnan(covariance[0, 0]) and not np.isnan(real("sd_m")):
        covariance[:2, :2] = np.eye(2) * real("sd_m") ** 2
    return covariance


def _stamp_reader(clock: ClockModel | None) -> Callable[[Any], int]:
    from automap.timebase import unix_to_gps

    def to_ns(value: Any) -> int:
        if isinstance(value, int):
            return value
        if value is None or clock is None:
            return NO_TIME
        when = datetime.fromisoformat(str(value))
        gps_s = float(np.asarray(unix_to_gps(when.timestamp())))
        return int(clock.t_ns(np.array([gps_s]))[0])

    return to_ns
