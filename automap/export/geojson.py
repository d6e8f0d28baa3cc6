"""``signs.geojson``: a feature collection of points by RFC 7946, and its reader.

Coordinates are WGS-84 longitude and latitude in degrees (seven decimals, about 1 cm) and the
ellipsoidal height in metres (three decimals); the standard allows no other datum.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from automap.errors import InputError
from automap.export.fields import SIGN_FIELDS, Field
from automap.export.sign_columns import SignColumns
from automap.records import NO_TIME, ClockModel, FloatArray, Sign

_encode = json.JSONEncoder(ensure_ascii=False).encode


def signs_geojson(columns: SignColumns) -> str:
    """The text of the file: one feature a line, in the order of the signs.

    A sign without a position has a null geometry (RFC 7946, section 3.2); an unknown value is
    null. ``bbox`` is left out of an empty collection.
    """
    names = [field.name for field in SIGN_FIELDS]
    tokens = [json_tokens(field, columns.values[field.name]) for field in SIGN_FIELDS]
    template = ", ".join(f"{_encode(name)}: %s" for name in names)
    properties = [template % row for row in zip(*tokens, strict=True)]
    features = [
        f'{{"type": "Feature", "id": {id_}, "geometry": {geometry}, "properties": {{{values}}}}}'
        for id_, geometry, values in zip(tokens[0], _geometries(columns), properties, strict=True)
    ]
    head = '{"type": "FeatureCollection",\n'
    box = bounding_box(columns)
    if box is not None:
        head += f'"bbox": [{", ".join(box)}],\n'
    return head + '"features": [\n' + ",\n".join(features) + "\n]}\n"


def json_tokens(field: Field, values: Any) -> list[str]:
    """One column [n] as JSON texts; what is not finite becomes null."""
    if field.kind == "real":
        numbers = np.asarray(values, np.float64)
        pattern = "%.6g" if field.decimals is None else f"%.{field.decimals}f"
        texts = [pattern % value for value in numbers.tolist()]
        for row in np.flatnonzero(~np.isfinite(numbers)):
            texts[row] = "null"
        return texts
    if field.kind == "integer":
        return [str(value) for value in np.asarray(values).tolist()]
    return _text_tokens(values)


def _text_tokens(values: Iterable[Any]) -> list[str]:
    # few different values are the rule (class, side, drives), so each is encoded once
    known: dict[Any, str] = {}
    texts = []
    for value in values:
        key = tuple(value) if isinstance(value, list) else value
        if key not in known:
            known[key] = _safe_text(value)
        texts.append(known[key])
    return texts


def _safe_text(value: Any) -> str:
    # lone surrogates (from odd file names) cannot be written as UTF-8
    text = _encode(value)
    return text.encode("utf-8", "replace").decode("utf-8")


def _geometries(columns: SignColumns) -> list[str]:
    rows = zip(
        columns.lon_deg.tolist(), columns.lat_deg.tolist(), columns.height_m.tolist(), strict=True
    )
    located = columns.located.tolist()
    high = np.isfinite(columns.height_m).tolist()
    return [
        "null"
        if not there
        else f'{{"type": "Point", "coordinates": [{lon:.7f}, {lat:.7f}, {height:.3f}]}}'
        if has_height
        else f'{{"type": "Point", "coordinates": [{lon:.7f}, {lat:.7f}]}}'
        for (lon, lat, height), there, has_height in zip(rows, located, high, strict=True)
    ]


def bounding_box(columns: SignColumns) -> list[str] | None:
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
        content = json.loads(Path(path).read_text(encoding="utf-8-sig"))
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
        n_views=int(properties.get("n_views") or 0),
        first_seen_ns=to_ns(properties.get("first_seen")),
        last_seen_ns=to_ns(properties.get("last_seen")),
        height_above_road_m=real("height_above_road_m"),
        facing_rad=float(np.radians(real("facing_deg"))),
        size_m=real("size_m"),
        side=str(properties.get("side") or ""),
        status=str(properties.get("status") or "ok"),
        drives=(drives,) if isinstance(drives, str) else tuple(str(name) for name in drives),
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
