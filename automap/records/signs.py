"""Signs on the map: as located, as sighted by others, as decided by a person."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import numpy.typing as npt

from automap.records.arrays import NO_TIME, FloatArray, IntArray

ReviewKind = Literal[
    "accept", "reject", "correct", "note", "reset", "undo", "add", "split", "merge"
]

BY_SIZE = ("by_size_e_m", "by_size_n_m", "by_size_u_m")


@dataclass(frozen=True)
class Sign:
    """One located sign. Position WGS-84; covariance [3, 3] in ENU metres, trajectory included.

    ``facing_rad`` clockwise from north, with one sigma ``facing_sd_rad`` (NaN unknown).
    ``support`` names the post or gantry, the same for all signs on it ("" unknown); ``note`` is
    what a reviewer wrote, with who and when, ``reviewer`` who decided about it last and
    ``reviewed`` when (UTC, ISO 8601; "" for nobody); ``geoid_m`` the geoid's height above the
    ellipsoid there, where that is known without the fixes of a drive (NaN else); ``existence`` the
    probability that a sign stands there (NaN unknown), ``class_probability`` that it is what
    ``class_name`` says, if it is a sign, and ``group_probability`` that it is of that shape and
    colour (NaN where the detector does not tell them); ``path_offset_m`` how far to the right of
    the drive's path it stands (NaN where it is on a map of several, or was placed by hand).
    ``contrast`` of the face with the standard deviation ``contrast_sd`` from view to view (NaN:
    ``contrast_note`` says why, "" where nothing looked); of the ``n_looked`` frames that should
    have shown it the part ``seen_share`` that did (NaN unknown); ``n_back_views`` views of its back
    in other passes.
    ``by_size_e_m``, ``by_size_n_m``, ``by_size_u_m`` how far a sigma of the size that a drive took
    the sign for moves it east, north and up (NaN unknown): every drive takes it for that size.
    """

    id: str
    class_name: str
    lat_rad: float
    lon_rad: float
    height_m: float
    cov_enu: FloatArray
    confidence: float
    n_views: int
    first_seen_ns: int
    last_seen_ns: int
    height_above_road_m: float
    facing_rad: float
    size_m: float
    side: str
    status: str = "ok"
    drives: tuple[str, ...] = ()
    detection_rows: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    support: str = ""
    sd_above_road_m: float = float("nan")
    facing_sd_rad: float = float("nan")
    geoid_m: float = float("nan")
    existence: float = float("nan")
    class_probability: float = float("nan")
    group_probability: float = float("nan")
    path_offset_m: float = float("nan")
    contrast: float = float("nan")
    contrast_sd: float = float("nan")
    contrast_note: str = ""
    seen_share: float = float("nan")
    n_looked: int = 0
    n_back_views: int = 0
    note: str = ""
    reviewer: str = ""
    reviewed: str = ""
    by_size_e_m: float = float("nan")
    by_size_n_m: float = float("nan")
    by_size_u_m: float = float("nan")


@dataclass(frozen=True)
class SignPoints:
    """Positions of signs [n], with what is known of their uncertainty.

    ``cov_en`` [n, 2, 2] east and north, square metres (NaN unknown); ``sd_m`` [n] one sigma
    per horizontal axis of a truth's own error (zero when the source gives none).
    """

    lat_rad: FloatArray
    lon_rad: FloatArray
    class_name: npt.NDArray[np.object_]
    cov_en: FloatArray
    sd_m: FloatArray

    def __len__(self) -> int:
        return len(self.lat_rad)


@dataclass(frozen=True)
class Bearings:
    """Sightings [n]: camera position, bearing clockwise from north, depth (NaN unknown),
    class ("" unknown), one-sigma error of the bearing (NaN unknown)."""

    lat_rad: FloatArray
    lon_rad: FloatArray
    bearing_rad: FloatArray
    depth_m: FloatArray
    class_name: npt.NDArray[np.object_]
    sd_rad: FloatArray

    def __len__(self) -> int:
        return len(self.lat_rad)


@dataclass(frozen=True)
class SeenIn:
    """A view of a sign: ``frame`` of a drive's camera, and where in it a reviewer clicked, in
    pixels of the whole frame (NaN: the view is a box of the detector's)."""

    drive: str
    camera: str
    frame: int
    x_px: float = float("nan")
    y_px: float = float("nan")


@dataclass(frozen=True)
class PlacedSign:
    """What was computed of a sign when a reviewer added, split or merged it; degrees and metres,
    ``cov_m2`` the variances and covariance ee, en, nn, uu of the place (NaN, "" and ``NO_TIME``:
    unknown)."""

    lon_deg: float
    lat_deg: float
    cov_m2: tuple[float, float, float, float]
    height_m: float = float("nan")
    height_above_road_m: float = float("nan")
    sd_above_road_m: float = float("nan")
    facing_deg: float = float("nan")
    facing_sd_deg: float = float("nan")
    size_m: float = float("nan")
    side: str = ""
    n_views: int = 0
    first_seen_ns: int = NO_TIME
    last_seen_ns: int = NO_TIME


@dataclass(frozen=True)
class ReviewAction:
    """One decision. Positions are degrees; ``seen_*`` is the sign as it was before any review.

    ``kind`` "correct" sets ``class_name``, the position, the facing or the height, "note" the text
    ``note``; "reset" drops what was decided about the sign before, "undo" the action ``undoes``.
    "add" makes the sign itself, ``place`` and ``views`` say where. "split" takes ``views`` from the
    sign and makes ``other`` of them at ``other_place``; what is left stands at ``place``. "merge"
    makes the sign ``other``, seen as ``other_seen_*``, one with it at ``place``. ``reviewer`` is
    who did it ("" unknown); ``settles`` that it was done in view of what others decided.
    """

    id: str
    time: str
    sign: str
    kind: ReviewKind
    seen_class: str = ""
    seen_lon_deg: float = float("nan")
    seen_lat_deg: float = float("nan")
    class_name: str | None = None
    lon_deg: float | None = None
    lat_deg: float | None = None
    sd_m: float | None = None
    note: str | None = None
    undoes: str | None = None
    reviewer: str = ""
    settles: bool = False
    facing_deg: float | None = None
    height_above_road_m: float | None = None
    place: PlacedSign | None = None
    views: tuple[SeenIn, ...] = ()
    other: str | None = None
    other_place: PlacedSign | None = None
    other_seen_class: str = ""
    other_seen_lon_deg: float = float("nan")
    other_seen_lat_deg: float = float("nan")


@dataclass(frozen=True)
class Roads:
    """Roads [n]: ``lines``, points [k, 2] longitude and latitude in degrees in the digitised
    direction; ``ids``, ``names`` ("" unknown); ``start_m`` [n] chainage of the first
    point; ``kinds``, as "motorway" ("" unknown); ``oneway`` [n] 1 for roads that are driven in the
    digitised direction alone, -1 against it alone, 0 in both. Empty where the layer tells neither.
    ``unread``: the layer's columns, where it has none of ids and the ``ids`` are as "row 3".
    """

    lines: list[FloatArray]
    ids: list[str]
    names: list[str]
    start_m: FloatArray
    kinds: list[str] = field(default_factory=list)
    oneway: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    unread: tuple[str, ...] = ()

    def kind(self, road: int) -> str:
        """The kind of a road, "" unknown."""
        return self.kinds[road] if self.kinds else ""

    def __len__(self) -> int:
        return len(self.lines)


@dataclass(frozen=True)
class RoadPosition:
    """Where a sign stands on a road: ``road`` its place among the roads, ``chainage_m`` of its foot
    point, ``offset_m`` from the line, positive to the right of the digitised direction; ``side``
    "left" or "right" of it, ``direction``, "forward" or "backward", of the traffic that
    it speaks to."""

    road: int
    chainage_m: float
    offset_m: float
    side: str
    direction: str
