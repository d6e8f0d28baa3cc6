"""Signs as columns in the units of the result files, shared by every format."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from itertools import pairwise
from typing import Any, NamedTuple, Protocol

import numpy as np

from automap.export.assembly import OnPost, on_post
from automap.export.clock import iso_texts, utc_of_stamps
from automap.export.fields import ROAD_FIELDS, SIGN_FIELDS, Field
from automap.export.icons import sign_words
from automap.export.pieces import edges_of
from automap.export.uncertainty import ce95, ellipse_outlines
from automap.records import NO_TIME, BoolArray, ClockModel, FloatArray, IntArray, Sign
from automap.signs.national import national_code, shown_value


class SignPiece(NamedTuple):
    """Signs from number ``start`` on, before ``stop``; ``key`` tells all that is in their
    ``columns``, "" where that is not known."""

    start: int
    stop: int
    columns: Callable[[], SignColumns]
    key: str = ""


class Signs(Protocol):
    """Signs [n] that files are written of part by part. Whole are only the few columns that say
    what all have in common; positions as in ``SignColumns``, which are signs of a single part."""

    @property
    def lon_deg(self) -> FloatArray: ...
    @property
    def lat_deg(self) -> FloatArray: ...
    @property
    def height_m(self) -> FloatArray: ...
    @property
    def classes(self) -> Sequence[str]: ...
    @property
    def fields(self) -> tuple[Field, ...]: ...
    @property
    def located(self) -> BoolArray: ...
    def __len__(self) -> int: ...
    def parts(self) -> Iterator[SignColumns]:
        """All of them in their order, at least one part."""

    def pieces(self) -> Iterator[SignPiece]:
        """All of them in their order, as ``pieces`` cuts them."""

    def first(self, count: int) -> SignColumns:
        """At least the first ``count``, as far as there are so many."""

    def radii_m(self) -> FloatArray:
        """Radii [n] of the 95 % circles."""

    def seen_by(self) -> IntArray:
        """How many drives [n] saw each."""


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
    def located(self) -> BoolArray:
        """Which signs [n] have a position that a map can show."""
        return on_map(self.lon_deg, self.lat_deg)

    @property
    def classes(self) -> Sequence[str]:
        """The class of each [n]."""
        return list(self.values["class"])

    def parts(self) -> Iterator[SignColumns]:
        """These."""
        yield self

    def pieces(self) -> Iterator[SignPiece]:
        """These, cut."""
        for lo, hi in pairwise(edges_of(self.values["id"])):
            yield SignPiece(lo, hi, partial(self._between, slice(lo, hi)))

    def _between(self, rows: slice) -> SignColumns:
        values = {name: column[rows] for name, column in self.values.items()}
        places = self.lon_deg[rows], self.lat_deg[rows], self.height_m[rows]
        return SignColumns(*places, values, self.utc_known)

    def first(self, count: int) -> SignColumns:
        """These."""
        return self

    def radii_m(self) -> FloatArray:
        """Radii [n] of the 95 % circles."""
        return np.asarray(self.values["ce95_m"], np.float64)

    def seen_by(self) -> IntArray:
        """How many drives [n] saw each."""
        return np.array([len(drives) for drives in self.values["drives"]], np.int64)


def on_map(lon_deg: FloatArray, lat_deg: FloatArray) -> BoolArray:
    """Which positions [n] a map can show."""
    return np.isfinite(lon_deg) & np.isfinite(lat_deg) & (abs(lat_deg) <= 90)


def sign_columns(
    signs: Sequence[Sign], clock: ClockModel | None = None, country: str | None = None
) -> SignColumns:
    """Columns of ``signs`` in file units; times become UTC when ``clock`` is given, codes and units
    are those of the ``country`` (ISO 3166 alpha-2)."""
    covariance = np.array([sign.cov_enu for sign in signs], np.float64).reshape(-1, 3, 3)
    return columns_of(
        lambda name: [getattr(sign, name) for sign in signs], covariance, on_post(signs),
        clock, country,
    )  # fmt: skip


def columns_of(
    column: Callable[[str], Sequence[Any] | FloatArray],
    covariance: FloatArray,
    hung: OnPost,
    clock: ClockModel | None,
    country: str | None,
) -> SignColumns:
    """The same from a ``column`` [n] of each field of ``records.Sign``, the signs' ``covariance``
    [n, 3, 3] and where they hang."""

    def real(name: str) -> FloatArray:
        return np.asarray(column(name), np.float64)

    def stamps(name: str) -> IntArray:
        return np.asarray(column(name), np.int64)

    def texts(name: str) -> list[str | None]:
        return [text or None for text in column(name)]

    classes = list(column("class_name"))
    n = len(classes)
    cov_ee, cov_en, cov_nn = covariance[:, 0, 0], covariance[:, 0, 1], covariance[:, 1, 1]
    with np.errstate(invalid="ignore"):
        sd_u = np.sqrt(np.where(covariance[:, 2, 2] >= 0, covariance[:, 2, 2], np.nan))
    first, last = stamps("first_seen_ns"), stamps("last_seen_ns")
    told = [_of_class(name, country) for name in classes]
    values: dict[str, Any] = {
        "id": list(column("id")),
        "class": classes,
        "name": [one.words for one in told],
        "code": [one.code for one in told],
        "value": np.array([one.value for one in told], np.float64),
        "value_unit": [one.unit for one in told],
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
        "height_msl_m": np.full(n, np.nan),
        "facing_deg": np.mod(np.degrees(real("facing_rad")), 360.0),
        "facing_sd_deg": np.degrees(real("facing_sd_rad")),
        "size_m": real("size_m"),
        "side": list(column("side")),
        "path_offset_m": real("path_offset_m"),
        "support": texts("support"),
        "face_order": hung.order,
        "main_sign": hung.main,
        "n_back_views": stamps("n_back_views"),
        "contrast": real("contrast"),
        "contrast_sd": real("contrast_sd"),
        "contrast_note": texts("contrast_note"),
        "seen_share": real("seen_share"),
        "n_looked": stamps("n_looked"),
        # known only with the pictures beside the map
        "picture_file": [None] * n,
        "street_file": [None] * n,
        "cov_ee_m2": cov_ee,
        "cov_en_m2": cov_en,
        "cov_nn_m2": cov_nn,
        "sd_u_m": sd_u,
        "ce95_m": ce95(cov_ee, cov_en, cov_nn),
        "drives": [list(drives) for drives in column("drives")],
        "status": list(column("status")),
        "note": texts("note"),
        "reviewer": texts("reviewer"),
        "reviewed": texts("reviewed"),
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


@dataclass(frozen=True)
class _OfClass:
    """What a class says of all its signs in a country: words, code, value (NaN) and unit."""

    words: str | None
    code: str | None
    value: float
    unit: str | None


@lru_cache(maxsize=4096)
def _of_class(name: str, country: str | None) -> _OfClass:
    value, unit = shown_value(name, country) or (np.nan, None)
    return _OfClass(sign_words(name) or None, national_code(name, country), value, unit)


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
