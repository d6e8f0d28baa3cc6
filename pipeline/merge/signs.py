"""The signs of a run as columns, for a merge."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from automap.errors import InputError
from automap.io import names
from automap.mapping import limits
from automap.mapping.attributes import REJECTED
from automap.mapping.grid import east_north
from automap.mapping.sureness import SUREST
from automap.records import NO_TIME, ClockModel, FloatArray, IntArray, Sign
from automap.records.signs import BY_SIZE
from automap.review.reviewed import Reviewed

GPS_CLOCK = ClockModel(0, 0.0, 0.0, 0.0, 0.0, "gps")
"""Stamps that are GPS time in nanoseconds."""
CONDITION = ("path_offset_m", "contrast", "contrast_sd", "seen_share", "n_looked", "n_back_views")


def sign_columns(folder: Path, clock: ClockModel | None, warnings: list[str]) -> dict[str, Any]:
    """Columns of ``DriveSigns`` from the run's table of signs, else from its GeoJSON; what is odd
    about its review goes to ``warnings``."""
    table, review = folder / names.SIGNS_RAW, folder / names.REVIEW
    if table.is_file() and not review.is_file():
        return _table_columns(table, clock)
    if table.is_file():
        from automap.io.review_json import read_review
        from automap.io.signs_table import read_signs
        from automap.review.reviewed import apply_review

        reviewed = apply_review(read_signs(table), read_review(review))
        warnings += [f"{review}: {text}" for text in reviewed.problems]
        return _columns([*reviewed.signs, *no_signs(reviewed)], clock)
    file = folder / names.SIGNS_GEOJSON
    if not file.is_file():
        raise InputError(
            f"{folder} holds no signs ({names.SIGNS_RAW} or {names.SIGNS_GEOJSON}); run the drive "
            "up to the export first."
        )
    from automap.export.geojson import read_signs_geojson

    # a clock that counts GPS nanoseconds turns the file's UTC into GPS time
    return _columns(read_signs_geojson(file, GPS_CLOCK), GPS_CLOCK)


def no_signs(reviewed: Reviewed) -> list[Sign]:
    """What a review rejected and other drives may take for a sign: but for what stands beside a
    sign that it kept, which is rejected for being there twice."""
    if not reviewed.signs:
        return reviewed.rejected
    lat, lon = (np.array([getattr(s, n) for s in reviewed.signs]) for n in ("lat_rad", "lon_rad"))
    return [
        sign
        for sign in reviewed.rejected
        if not (
            np.hypot(*east_north(lat, lon, sign.lat_rad, sign.lon_rad).T) < limits.SAME_PLACE_M
        ).any()
    ]


def _table_columns(path: Path, clock: ClockModel | None) -> dict[str, Any]:
    from automap.io.signs_table import COVARIANCE_COLUMNS
    from automap.io.tables import floats, ints, read_table

    wanted = (
        "id", "class", "lat_rad", "lon_rad", "height_m", "confidence", "n_views",
        "first_seen_ns", "last_seen_ns", "height_above_road_m", "facing_rad", "size_m", "side",
        "status", *(name for name, _, _ in COVARIANCE_COLUMNS),
    )  # fmt: skip
    table = read_table(path, wanted)
    # runs of earlier versions do not say how well they know it, or how surely it exists
    unknown = np.full(len(table), np.nan)
    covariance = np.empty((len(table), 3, 3))
    for name, i, j in COVARIANCE_COLUMNS:
        covariance[:, i, j] = covariance[:, j, i] = floats(table, name)

    def texts(name: str) -> npt.NDArray[np.object_]:
        return np.array([value or "" for value in table[name].to_pylist()], np.object_)

    told = table.column_names
    notes = texts("contrast_note") if "contrast_note" in told else np.full(len(table), "", object)
    return {
        "ids": tuple(table["id"].to_pylist()),
        "contrast_note": notes,
        "class_name": texts("class"),
        "cov_enu": covariance,
        "n_views": ints(table, "n_views"),
        "first_gps_s": _gps(ints(table, "first_seen_ns"), clock),
        "last_gps_s": _gps(ints(table, "last_seen_ns"), clock),
        "side": texts("side"),
        "status": texts("status"),
    } | {
        name: floats(table, name) if name in told else unknown
        for name in (
            "sd_above_road_m", "facing_sd_rad", "class_probability", "group_probability",
            "existence", *CONDITION, *BY_SIZE,
        )
    } | {
        name: floats(table, name)
        for name in (
            "lat_rad", "lon_rad", "height_m", "confidence", "height_above_road_m", "facing_rad",
            "size_m",
        )
    }  # fmt: skip


def _columns(signs: Sequence[Sign], clock: ClockModel | None) -> dict[str, Any]:
    def real(name: str) -> FloatArray:
        return np.array([getattr(sign, name) for sign in signs], np.float64)

    def stamps(name: str) -> FloatArray:
        return _gps(np.array([getattr(sign, name) for sign in signs], np.int64), clock)

    def texts(name: str) -> npt.NDArray[np.object_]:
        return np.array([getattr(sign, name) for sign in signs], np.object_)

    numbers = (
        "lat_rad", "lon_rad", "height_m", "confidence", "height_above_road_m", "sd_above_road_m",
        "facing_rad", "facing_sd_rad", "size_m", "class_probability", "group_probability",
        "existence", *CONDITION, *BY_SIZE,
    )  # fmt: skip
    # who looked at a sign knows whether it is there
    known = np.array([bool(sign.reviewed) for sign in signs], np.bool_)
    sure = np.where([sign.status == REJECTED for sign in signs], 1.0 - SUREST, SUREST)
    columns = {name: real(name) for name in numbers}
    columns |= {name: np.where(known, sure, columns[name]) for name in ("existence", "confidence")}
    return {
        "ids": tuple(sign.id for sign in signs),
        "class_name": texts("class_name"),
        "cov_enu": np.array([s.cov_enu for s in signs], np.float64).reshape(-1, 3, 3),
        "n_views": np.array([s.n_views for s in signs], np.int64),
        "first_gps_s": stamps("first_seen_ns"),
        "last_gps_s": stamps("last_seen_ns"),
        "side": texts("side"),
        "status": texts("status"),
        "contrast_note": texts("contrast_note"),
    } | columns


def _gps(stamps: IntArray, clock: ClockModel | None) -> FloatArray:
    if clock is None:
        return np.full(len(stamps), np.nan)
    known = stamps != NO_TIME
    return np.where(known, clock.gps_s(np.where(known, stamps, clock.ref_ns)), np.nan)
