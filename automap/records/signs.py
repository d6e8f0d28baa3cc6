"""Signs on the map: as located, as sighted by others, as decided by a person."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import numpy.typing as npt

from automap.records.arrays import FloatArray, IntArray

ReviewKind = Literal["accept", "reject", "correct", "note", "reset", "undo"]


@dataclass(frozen=True)
class Sign:
    """One located sign. Position WGS-84; covariance [3, 3] in ENU metres, trajectory included.

    ``facing_rad`` clockwise from north, with one sigma ``facing_sd_rad`` (NaN unknown).
    ``support`` names the post or gantry, the same for all signs on it ("" unknown); ``note`` is
    what a reviewer wrote; ``geoid_m`` the geoid's height above the ellipsoid there, where that is
    known without the fixes of a drive (NaN else); ``existence`` the probability that a thing of
    that size stands there (NaN unknown), ``class_probability`` that it is what ``class_name`` says,
    if it is a sign, and ``group_probability`` that it is of that shape and colour (NaN where the
    detector does not tell them).
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
    note: str = ""


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
class ReviewAction:
    """One decision. Positions are degrees; ``seen_*`` is the sign as it was before any review.

    ``kind`` "correct" sets ``class_name`` or the position (or both), "note" the text ``note``;
    "reset" drops all that was decided about the sign before, "undo" the action ``undoes``.
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


@dataclass(frozen=True)
class Roads:
    """Roads [n]: ``lines``, points [k, 2] longitude and latitude in degrees in the digitised
    direction; ``ids``, ``names`` ("" unknown); ``start_m`` [n] chainage of the first
    point."""

    lines: list[FloatArray]
    ids: list[str]
    names: list[str]
    start_m: FloatArray

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
