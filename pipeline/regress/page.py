"""regress.html: what moved, with both maps laid over one another; one file, no requests."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from automap.earth import metres_per_radian
from automap.export.uncertainty import principal_axes
from automap.frames import wrap_pi
from automap.gates import OUTSIDE_95, gate
from automap.records import FloatArray
from automap.regression.record import DriveRecord
from automap.regression.signs import StoredSign
from pipeline.pages.render import render
from pipeline.regress.session import DriveResult


def page_html(results: Sequence[DriveResult]) -> str:
    """The page for these drives, those that moved or failed first."""
    order = {"failed": 0, "moved": 1, "no stored figures": 2, "same": 3}
    drives = sorted(results, key=lambda result: order[result.verdict])
    maps = [_map(result) for result in drives]
    return render(
        "regress.html.j2",
        leaflet=True,
        drives=drives,
        counts={verdict: sum(r.verdict == verdict for r in results) for verdict in order},
        maps=maps,
    )


def _map(result: DriveResult) -> dict[str, Any] | None:
    """Both maps in metres east and north of one origin, None when there is nothing to draw."""
    runs = {"then": result.then, "now": result.now}
    origin = next((o for o in (_origin(run) for run in runs.values()) if o is not None), None)
    if origin is None:
        return None
    return {kind: _layer(run, origin) if run is not None else None for kind, run in runs.items()}


def _origin(record: DriveRecord | None) -> tuple[float, float] | None:
    if record is None:
        return None
    if len(record.epochs):
        return float(record.epochs.lat_rad[0]), float(record.epochs.lon_rad[0])
    if record.signs:
        return record.signs[0].lat_rad, record.signs[0].lon_rad
    return None


def _layer(record: DriveRecord, origin: tuple[float, float]) -> dict[str, Any]:
    epochs = record.epochs
    shift = (
        _metres(epochs.lat_rad[:1], epochs.lon_rad[:1], origin)[0] if len(epochs) else np.zeros(2)
    )
    sd = np.nan_to_num(epochs.sd[:, [1, 0]])
    return {
        "path": [[round(e + shift[0], 2), round(n + shift[1], 2)] for e, n in record.path_en_m],
        "epochs": _rounded(_metres(epochs.lat_rad, epochs.lon_rad, origin)),
        "sd": _rounded(sd),
        "signs": [_sign(sign, origin) for sign in record.signs],
    }


def _sign(sign: StoredSign, origin: tuple[float, float]) -> dict[str, Any]:
    at = _metres(np.array([sign.lat_rad]), np.array([sign.lon_rad]), origin)[0]
    ellipse = None
    if np.isfinite(sign.cov_en).all():
        (major,), (minor,), (azimuth,) = principal_axes(
            *(np.array([v]) for v in (sign.cov_en[0, 0], sign.cov_en[0, 1], sign.cov_en[1, 1]))
        )
        scale = float(np.sqrt(gate(OUTSIDE_95, 2)))
        ellipse = [round(major * scale, 2), round(minor * scale, 2), round(float(azimuth), 4)]
    return {
        "at": _rounded(at[None])[0],
        "ellipse": ellipse,
        "name": f"{sign.id} {sign.class_name}",
        "confidence": round(sign.confidence, 2),
    }


def _metres(lat: FloatArray, lon: FloatArray, origin: tuple[float, float]) -> FloatArray:
    """East and north [n, 2] of the origin, m."""
    north, east = metres_per_radian(origin[0], 0.0)
    return np.column_stack([wrap_pi(lon - origin[1]) * east, (lat - origin[0]) * north])


def _rounded(values: FloatArray) -> list[list[float]]:
    return [[round(float(v), 2) for v in row] for row in np.nan_to_num(values)]
