"""Signs as columns in the units of the result files, shared by every format."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from automap.export.assembly import on_post
from automap.export.clock import iso_texts, utc_of_stamps
from automap.export.fields import ROAD_FIELDS, SIGN_FIELDS, Field
from automap.export.icons import sign_words
from automap.export.uncertainty import ce95, ellipse_outlines
from automap.records import NO_TIME, ClockModel, FloatArray, IntArray, Sign
from automap.signs.national import national_code, shown_value


@dataclass(frozen=True)
class SignColumns:
    """Signs [n] ready to be written.

    ``lon_deg`` in [-180, 180], ``lat_deg``, ``height_m`` (ellipsoidal, NaN unknown).
    ``values`` holds one array or list [n] for every name of ``fields.SIGN_FIELDS`` and
    ``fields.STAMP_FIELDS``, with a layer of roads of ``fields.ROAD_FIELDS`` too; an
    unknown number is NaN, an unknown text or time None. When the clock is unknown ``first_seen``
    and ``last_seen`` hold host stamps (int) and ``utc_known`` is False.
    """

    lon_deg: FloatArray
    lat_deg: FloatArray
    height_m: FloatArray
    values: dict[str, Any]
    utc_known: bool

    def __len__(self) -> int:
        return len(self.lon_deg)

    @property
    def fields(self) -> tuple[Field, ...]:
        """What every format writes of these signs: without a layer of roads nothing of roads."""
        return (*SIGN_FIELDS, *(f for f in ROAD_FIELDS if f.name in self.values))

    @property
    def located(self) -> np.ndarray:
        """Which signs [n] have a position that a map can show."""
        return np.isfinite(self.lon_deg) & np.isfinite(self.lat_deg) & (abs(self.lat_deg) <= 90)


def sign_columns(
    signs: Sequence[Sign], clock: ClockModel | None = None, country: str | None = None
) -> SignColumns:
    """Columns of ``signs`` in file units; times become UTC when ``clock`` is given, codes and units
    are those of the ``country`` (ISO 3166 alpha-2)."""

    def real(name: str) -> FloatArray:
        return np.array([getattr(sign, name) for sign in signs], np.float64)

    def stamps(name: str) -> IntArray:
        return np.array([getattr(sign, name) for sign in signs], np.int64)

    covariance = np.array([sign.cov_enu for sign in signs], np.float64).reshape(-1, 3, 3)
    cov_ee, cov_en, cov_nn = covariance[:, 0, 0], covariance[:, 0, 1], covariance[:, 1, 1]
    with np.errstate(invalid="ignore"):
        sd_u = np.sqrt(np.where(covariance[:, 2, 2] >= 0, covariance[:, 2, 2], np.nan))
    first, last = stamps("first_seen_ns"), stamps("last_seen_ns")
    hung = on_post(signs)
    shown = [shown_value(sign.class_name, country) for sign in signs]
    values: dict[str, Any] = {
        "id": [sign.id for sign in signs],
        "class": [sign.class_name for sign in signs],
        "name": [sign_words(sign.class_name) or None for sign in signs],
        "code": [national_code(sign.class_name, country) for sign in signs],
        "value": np.array([np.nan if one is None else one[0] for one in shown], np.float64),
        "value_unit": [None if one is None else one[1] for one in shown],
        "confidence": real("confidence"),
        "existence": real("existence"),
        "class_probability": real("class_probability"),
        "group_probability": real("group_probability"),
        "n_views": stamps("n_views"),
        "first_seen": _times(first, clock),
        "last_seen": _times(last, clock),
        "height_above_road_m": real("height_above_road_m"),
        "sd_above_road_m": real("sd_above_road_m"),
        # known only with the receiver's geoid, which whoever reads the run fills in
        "height_msl_m": np.full(len(signs), np.nan),
        "facing_deg": np.mod(np.degrees(real("facing_rad")), 360.0),
        "facing_sd_deg": np.degrees(real("facing_sd_rad")),
        "size_m": real("size_m"),
        "side": [sign.side for sign in signs],
        "path_offset_m": real("path_offset_m"),
        "support": [sign.support or None for sign in signs],
        "face_order": hung.order,
        "main_sign": hung.main,
        "n_back_views": stamps("n_back_views"),
        "contrast": real("contrast"),
        "contrast_sd": real("contrast_sd"),
        "contrast_note": [sign.contrast_note or None for sign in signs],
        "seen_share": real("seen_share"),
        "n_looked": stamps("n_looked"),
        # known only with the pictures beside the map
        "picture_file": [None] * len(signs),
        "street_file": [None] * len(signs),
        "cov_ee_m2": cov_ee,
        "cov_en_m2": cov_en,
        "cov_nn_m2": cov_nn,
        "sd_u_m": sd_u,
        "ce95_m": ce95(cov_ee, cov_en, cov_nn),
        "drives": [list(sign.drives) for sign in signs],
        "status": [sign.status for sign in signs],
        "note": [sign.note or None for sign in signs],
        "reviewer": [sign.reviewer or None for sign in signs],
        "reviewed": [sign.reviewed or None for sign in signs],
        "first_seen_t_ns": _known(first),
        "last_seen_t_ns": _known(last),
    }
    return SignColumns(
        lon_deg=wrap_degrees(np.degrees(real("lon_rad"))),
        lat_deg=np.degrees(real("lat_rad")),
        height_m=real("height_m"),
        values=values,
        utc_known=clock is not None,
    )


def _known(stamps: IntArray) -> list[int | None]:
    return [None if stamp == NO_TIME else stamp for stamp in stamps.tolist()]


def _times(stamps: IntArray, clock: ClockModel | None) -> list[str | None] | list[int | None]:
    return _known(stamps) if clock is None else iso_texts(utc_of_stamps(stamps, clock))


def wrap_degrees(lon_deg: FloatArray) -> FloatArray:
    """Longitudes [n] in [-180, 180]; values already there are unchanged."""
    wrapped = np.mod(lon_deg + 180.0, 360.0) - 180.0
    return np.where(np.abs(lon_deg) <= 180.0, lon_deg, wrapped)


def ellipse_rings(columns: SignColumns, points: int = 36) -> FloatArray:
    """95 % ellipses [n, points + 1, 2] as longitude and latitude in degrees, closed rings.

    Longitudes run on past 180 beside the date line, so that a ring stays in one piece.
    """
    from automap.earth import metres_per_radian

    values = columns.values
    outline = ellipse_outlines(
        values["cov_ee_m2"], values["cov_en_m2"], values["cov_nn_m2"], points
    )
    height = np.where(np.isfinite(columns.height_m), columns.height_m, 0.0)
    north, east = metres_per_radian(np.radians(columns.lat_deg), height)
    per_radian = np.stack([np.maximum(east, 1.0), north], axis=1)
    centre = np.stack([columns.lon_deg, columns.lat_deg], axis=1)
    return np.asarray(centre[:, None, :] + np.degrees(outline / per_radian[:, None, :]))
