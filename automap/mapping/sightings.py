"""What a drive brings to the map, and all drives' sightings in one set of columns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import numpy.typing as npt

from automap.earth import metres_per_radian
from automap.mapping import limits
from automap.records import DrivePath, FloatArray, IntArray
from automap.records.signs import BY_SIZE

UNTOLD: dict[str, float | str] = {
    "existence": np.nan, "class_probability": np.nan, "group_probability": np.nan,
    "path_offset_m": np.nan, "contrast": np.nan, "contrast_sd": np.nan, "contrast_note": "",
    "seen_share": np.nan, "n_looked": 0.0, "n_back_views": 0.0, **dict.fromkeys(BY_SIZE, np.nan),
}  # fmt: skip
"""What columns hold of drives that do not tell them."""


@dataclass(frozen=True)
class CameraView:
    """Where a camera looks: ``yaw_rad`` from the vehicle's forward axis, clockwise, and half
    of its horizontal field of view."""

    yaw_rad: float
    half_angle_rad: float


_UNTOLD: Any = None


@dataclass(frozen=True, kw_only=True)
class Told:
    """Columns [n] of signs as their drives tell them, which a map takes as they are.

    ``first_gps_s``, ``last_gps_s`` when the sign was in view; ``class_probability``,
    ``group_probability`` what the detector tells of the class, and of its colour and shape;
    ``existence`` how probable each is by its drive alone; ``path_offset_m`` to ``by_size_u_m`` as a
    sign has them. Unknown numbers are NaN.
    """

    confidence: FloatArray
    n_views: IntArray
    first_gps_s: FloatArray
    last_gps_s: FloatArray
    height_above_road_m: FloatArray
    sd_above_road_m: FloatArray
    facing_sd_rad: FloatArray
    size_m: FloatArray
    side: npt.NDArray[np.object_]
    status: npt.NDArray[np.object_]
    class_probability: FloatArray = _UNTOLD
    group_probability: FloatArray = _UNTOLD
    existence: FloatArray = _UNTOLD
    path_offset_m: FloatArray = _UNTOLD
    contrast: FloatArray = _UNTOLD
    contrast_sd: FloatArray = _UNTOLD
    contrast_note: npt.NDArray[np.object_] = _UNTOLD
    seen_share: FloatArray = _UNTOLD
    n_looked: FloatArray = _UNTOLD
    n_back_views: FloatArray = _UNTOLD
    by_size_e_m: FloatArray = _UNTOLD
    by_size_n_m: FloatArray = _UNTOLD
    by_size_u_m: FloatArray = _UNTOLD

    def __post_init__(self) -> None:
        for name, value in UNTOLD.items():
            if getattr(self, name) is None:
                kind = object if isinstance(value, str) else np.float64
                object.__setattr__(self, name, np.full(len(self.confidence), value, kind))


@dataclass(frozen=True, kw_only=True)
class DriveSigns(Told):
    """Signs [n] as one drive located them, its path and its cameras.

    ``name`` is what the map calls the drive; ``start_gps_s`` orders the drives (NaN unknown);
    ``key`` names the recording however often it is run anew ("" unknown).
    ``cov_enu`` [n, 3, 3] total covariances in m^2, trajectory included.
    """

    name: str
    start_gps_s: float
    ids: tuple[str, ...]
    class_name: npt.NDArray[np.object_]
    lat_rad: FloatArray
    lon_rad: FloatArray
    height_m: FloatArray
    cov_enu: FloatArray
    facing_rad: FloatArray
    path: DrivePath | None = None
    cameras: tuple[CameraView, ...] = ()
    key: str = ""

    def __len__(self) -> int:
        return len(self.ids)


@dataclass(frozen=True, kw_only=True)
class Sightings(Told):
    """Sightings [n] of all drives, ordered by drive and, within one, by time.

    ``drive`` [n] its place among the drives, ``row`` [n] the sign's among those of the drive,
    ``first`` [d + 1] where each drive begins. ``time_s`` [n] when the sign was last in view.
    Positions in rad and m, ``per_lat``, ``per_lon`` [n] metres per radian there. The error is
    the sum of its own, ``own`` [n, 3] (ee, en, nn) and ``own_u`` [n] in m^2, and of what the
    drive's signs share, ``shared_sd`` [n, 3] m east, north, up. ``code`` [n] numbers
    ``classes``.
    """

    drive: IntArray
    row: IntArray
    first: IntArray
    time_s: FloatArray
    lat: FloatArray
    lon: FloatArray
    height: FloatArray
    per_lat: FloatArray
    per_lon: FloatArray
    own: FloatArray
    own_u: FloatArray
    shared_sd: FloatArray
    facing: FloatArray
    code: IntArray
    id: npt.NDArray[np.object_]
    classes: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.lat)

    def at(self, rows: IntArray) -> Sightings:
        """Those of ``rows``, ascending, each once; drives and classes keep their numbers."""
        if len(rows) == len(self):
            # a million of them are some hundred MB
            return self
        columns = {name: getattr(self, name)[rows] for name in _COLUMNS}
        first = np.searchsorted(columns["drive"], np.arange(self.n_drives + 1))
        return Sightings(first=first, classes=self.classes, **columns)

    @property
    def n_drives(self) -> int:
        """Number of drives, with those that saw nothing."""
        return len(self.first) - 1


_COLUMNS = tuple(f.name for f in fields(Sightings) if f.name not in ("first", "classes"))


def canonical_order(drives: Sequence[DriveSigns]) -> list[int]:
    """Places of the drives by start and name, so that the order of the inputs is nothing."""

    def key(number: int) -> tuple[bool, float, str, str]:
        start = drives[number].start_gps_s
        known = bool(np.isfinite(start))
        return (not known, start if known else 0.0, drives[number].name, drives[number].key)

    return sorted(range(len(drives)), key=key)


def stack_sightings(drives: Sequence[DriveSigns]) -> Sightings:
    """Columns of all sightings that have a position, in the order of the drives given."""
    if not drives:
        empty: dict[str, Any] = {name: np.zeros(0) for name in _COLUMNS}
        empty |= {name: np.zeros(0, np.int64) for name in ("drive", "row", "code", "n_views")}
        empty |= {name: np.zeros((0, 3)) for name in ("own", "shared_sd")}
        empty |= {name: np.zeros(0, object) for name in ("id", "side", "status", "contrast_note")}
        return Sightings(first=np.zeros(1, np.int64), classes=(), **empty)
    names = sorted({str(name) for drive in drives for name in set(drive.class_name)})
    number = {name: k for k, name in enumerate(names)}
    parts = [_columns_of(drive, place, number) for place, drive in enumerate(drives)]
    stacked: dict[str, Any] = {n: np.concatenate([part[n] for part in parts]) for n in _COLUMNS}
    first = np.searchsorted(stacked["drive"], np.arange(len(drives) + 1))
    return Sightings(first=first, classes=tuple(names), **stacked)


def _columns_of(drive: DriveSigns, place: int, number: Mapping[str, int]) -> dict[str, Any]:
    """The columns of one drive; ``number`` of each class."""
    rows = np.flatnonzero(np.isfinite(drive.lat_rad) & np.isfinite(drive.lon_rad))
    rows = rows[np.lexsort((rows, drive.last_gps_s[rows]))].astype(np.int64)
    own, own_u, shared = split_covariance(drive.cov_enu[rows], shared_sd(drive, rows))
    height = drive.height_m[rows]
    north, east = metres_per_radian(drive.lat_rad[rows], np.nan_to_num(height))
    columns: dict[str, Any] = {
        "drive": np.full(len(rows), place, np.int64),
        "row": rows,
        "time_s": np.nan_to_num(drive.last_gps_s[rows]),
        "lat": drive.lat_rad[rows],
        "lon": drive.lon_rad[rows],
        "height": height,
        "per_lat": north,
        "per_lon": east,
        "own": own,
        "own_u": own_u,
        "shared_sd": shared,
        "facing": drive.facing_rad[rows],
        "code": np.array([number[str(name)] for name in drive.class_name[rows]], np.int64),
        "id": np.array([drive.ids[k] for k in rows.tolist()], np.object_),
    }
    told = {f.name: getattr(drive, f.name)[rows] for f in fields(Told)}
    return columns | told | {"confidence": np.nan_to_num(told["confidence"], nan=0.5)}


def shared_sd(drive: DriveSigns, rows: IntArray) -> FloatArray:
    """Sd [n, 3] east, north, up of the trajectory when each sign was last in view, m.

    Zero without a trajectory: nothing then says that the signs share an error.
    """
    path = drive.path
    if path is None or len(path) == 0:
        return np.zeros((len(rows), 3))
    times = drive.last_gps_s[rows]
    known = np.isfinite(path.gps_s)
    sd = np.zeros((len(rows), 3))
    for axis in range(3):
        values = path.sd_enu[:, axis]
        good = known & np.isfinite(values)
        if good.any():
            found = np.interp(times, path.gps_s[good], values[good])
            sd[:, axis] = np.where(np.isfinite(times), found, np.median(values[good]))
    return sd


_EARTH_M2 = 1e14
"""Variance of what may be anywhere on Earth, m^2: half of its circumference is 2e7 m."""


def split_covariance(
    cov_enu: FloatArray, shared: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Total covariances [n, 3, 3] into own ones [n, 3] (ee, en, nn), [n] up, and shared sd.

    The shared part is that of the trajectory, scaled down where a sign is better than that
    (seen in several passes): at least a small part of the total remains its own. What is no
    covariance counts as unknown.
    """
    ee, en, nn = cov_enu[:, 0, 0].copy(), cov_enu[:, 0, 1].copy(), cov_enu[:, 1, 1].copy()
    uu = cov_enu[:, 2, 2].copy()
    with np.errstate(invalid="ignore", over="ignore"):
        bad = ~((ee > 0) & (ee * nn > en * en) & (np.maximum(ee, nn) < _EARTH_M2))
    plain = limits.UNKNOWN_SD_M**2 + shared**2
    ee[bad], nn[bad], en[bad] = plain[bad, 0], plain[bad, 1], 0.0
    lost = ~((uu > 0) & (uu < _EARTH_M2))
    uu[lost] = plain[lost, 2]
    least = limits.LEAST_SD_M**2
    a, c = np.maximum(shared[:, 0], 1e-6), np.maximum(shared[:, 1], 1e-6)
    # smallest eigenvalue of the total in units of the shared part
    p, q, r = ee / a**2, nn / c**2, en / (a * c)
    smallest = 0.5 * (p + q) - np.sqrt(0.25 * (p - q) ** 2 + r**2)
    factor = np.sqrt(np.clip((1.0 - limits.LEAST_OWN_SHARE) * smallest, 0.0, 1.0))
    factor_u = np.sqrt(
        np.clip((1.0 - limits.LEAST_OWN_SHARE) * uu / np.maximum(shared[:, 2], 1e-6) ** 2, 0.0, 1.0)
    )
    scaled = shared * np.column_stack([factor, factor, factor_u])
    own = np.column_stack([ee - scaled[:, 0] ** 2, en, nn - scaled[:, 1] ** 2])
    own[:, [0, 2]] += least
    return own, uu - scaled[:, 2] ** 2 + least, scaled
