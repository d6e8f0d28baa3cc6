"""Positions and classes of signs from a GeoJSON file: a truth, or the map itself."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from automap.errors import InputError
from automap.io.json_text import parse_json
from automap.records import SignPoints


def read_sign_points(path: Path) -> SignPoints:
    """Read the point features of ``path``: coordinates, ``class``, covariance and ``sd_m``.

    Longitude comes first; a missing class is "", a missing covariance NaN, a missing sd zero.
    Raises InputError when the file is no GeoJSON or a feature is not a point.
    """
    try:
        document = parse_json(path.read_text(encoding="utf-8"))
        features = document["features"]
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}).") from error
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(
            f"{path}: is not a GeoJSON FeatureCollection ({error}); write one with a list "
            '"features" of points.'
        ) from error
    if not isinstance(features, list):
        raise InputError(f'{path}: "features" is not a list of GeoJSON features.')
    n = len(features)
    lon_lat, covariance, sd = np.empty((n, 2)), np.full((n, 2, 2), np.nan), np.zeros(n)
    names = np.empty(n, np.object_)
    for row, feature in enumerate(features):
        try:
            if feature["geometry"]["type"] != "Point":
                raise ValueError(f"a {feature['geometry']['type']}, not a Point")
            lon_lat[row] = [float(v) for v in feature["geometry"]["coordinates"][:2]]
            properties: dict[str, Any] = feature.get("properties") or {}
            names[row] = str(properties.get("class") or "")
            sd[row] = float(properties.get("sd_m") or 0.0)
            ee, en, nn = (
                float("nan") if properties.get(key) is None else float(properties[key])
                for key in ("cov_ee_m2", "cov_en_m2", "cov_nn_m2")
            )
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            raise InputError(
                f"{path}: feature {row} cannot be used ({error}); every feature must be a "
                "Point with longitude and latitude."
            ) from error
        covariance[row] = [[ee, en], [en, nn]]
    if not (np.abs(lon_lat[:, 1]) <= 90.0).all() or not np.isfinite(lon_lat).all():
        row = int(np.flatnonzero(~(np.abs(lon_lat[:, 1]) <= 90.0) | ~np.isfinite(lon_lat[:, 0]))[0])
        raise InputError(
            f"{path}: feature {row} has no valid latitude; coordinates are longitude first."
        )
    return SignPoints(
        lat_rad=np.radians(lon_lat[:, 1]),
        lon_rad=np.radians(lon_lat[:, 0]),
        class_name=names,
        cov_en=covariance,
        sd_m=sd,
    )
