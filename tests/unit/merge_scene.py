"""Made-up towns: true signs along streets, and what drives with errors of their own see."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from automap.earth import metres_per_radian
from automap.mapping.adjustment import rough_places
from automap.mapping.cells import cell_of
from automap.mapping.drive_levels import drive_squares, error_levels
from automap.mapping.sightings import CameraView, DriveSigns, Sightings
from automap.records import DrivePath, FloatArray, IntArray

ORIGIN = (np.radians(-35.28), np.radians(149.13), 580.0)
CLASSES = (
    "regulatory--stop--g1",
    "regulatory--yield--g1",
    "regulatory--maximum-speed-limit-50--g1",
    "regulatory--maximum-speed-limit-60--g1",
    "information--parking--g1",
    "warning--children--g2",
)


@dataclass(frozen=True)
class Town:
    """True signs: ``position`` [n, 3] m east, north, up of the origin, ``facing`` [n] rad,
    ``class_name`` [n]."""

    position: FloatArray
    facing: FloatArray
    class_name: np.ndarray


@dataclass(frozen=True)
class Errors:
    """What a drive gets wrong; one sigma in metres. ``tau_s`` None: a constant offset."""

    shared: tuple[float, float, float] = (0.55, 0.55, 0.95)
    tau_s: float | None = 60.0
    own_across: float = 0.15
    own_along: float = 0.35
    own_up: float = 0.12
    missed: float = 0.08
    clutter: float = 0.03
    wrong_class: float = 0.03
    facing: float = 0.15


USUAL = Errors()


@dataclass
class Scene:
    """Drives and, for each sighting of each, the number of the true sign (-1 clutter)."""

    town: Town
    drives: list[DriveSigns] = field(default_factory=list)
    truth: list[IntArray] = field(default_factory=list)


def street(rng: np.random.Generator, length_m: float, spacing_m: float) -> Town:
    """Signs on both sides of a straight street to the north, facing both ways."""
    n = int(length_m / spacing_m)
    along = np.sort(rng.uniform(0.0, length_m, n))
    north_bound = rng.random(n) < 0.5
    side = np.where(rng.random(n) < 0.8, 1.0, -1.0) * np.where(north_bound, -5.0, 5.0)
    position = np.column_stack([side, along, rng.uniform(2.0, 3.0, n)])
    facing = np.where(north_bound, np.pi, 0.0)
    return Town(position, facing, rng.choice(np.array(CLASSES, object), n))


def wandering(
    rng: np.random.Generator, time_s: FloatArray, sd: FloatArray, tau_s: float | None
) -> FloatArray:
    """Errors [k, 3] with standard deviations ``sd`` [3] and exponential correlation."""
    value = rng.standard_normal(3)
    result = np.empty((len(time_s), 3))
    for k in range(len(time_s)):
        if k and tau_s is not None:
            keep = np.exp(-(time_s[k] - time_s[k - 1]) / tau_s)
            value = keep * value + np.sqrt(1.0 - keep**2) * rng.standard_normal(3)
        result[k] = value
    return result * sd


def to_geodetic(enu: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Latitude, longitude, height of positions [n, 3] near the origin (small plane)."""
    north, east = metres_per_radian(ORIGIN[0], ORIGIN[2])
    return ORIGIN[0] + enu[:, 1] / north, ORIGIN[1] + enu[:, 0] / east, ORIGIN[2] + enu[:, 2]


def to_enu(lat: FloatArray, lon: FloatArray, height: FloatArray) -> FloatArray:
    """The inverse of ``to_geodetic``."""
    north, east = metres_per_radian(ORIGIN[0], ORIGIN[2])
    return np.column_stack(
        [(lon - ORIGIN[1]) * east, (lat - ORIGIN[0]) * north, height - ORIGIN[2]]
    )


def drive_through(
    rng: np.random.Generator,
    town: Town,
    path: FloatArray,
    speed: float,
    name: str,
    start_gps_s: float,
    errors: Errors = USUAL,
    standing: np.ndarray | None = None,
) -> tuple[DriveSigns, IntArray]:
    """What one drive along ``path`` [k, 2] (corners, east and north) sees of the town.

    A sign is in view within 30 m and 35 deg of the heading when it faces the car. Only signs
    ``standing`` [n] are there.
    """
    step = np.linalg.norm(np.diff(path, axis=0), axis=1)
    length = np.concatenate([[0.0], np.cumsum(step)])
    at = np.arange(0.0, length[-1], 4.0)
    car = np.column_stack([np.interp(at, length, path[:, k]) for k in range(2)])
    heading = np.gradient(car, axis=0)
    yaw = np.arctan2(heading[:, 0], heading[:, 1])
    time = start_gps_s + at / speed
    shared = wandering(rng, time, np.array(errors.shared), errors.tau_s)
    rows, when, bearing = [], [], []
    present = np.ones(len(town.position), bool) if standing is None else standing
    for k in np.flatnonzero(present):
        difference = town.position[k, :2] - car
        distance = np.linalg.norm(difference, axis=1)
        azimuth = np.arctan2(difference[:, 0], difference[:, 1])
        seen = (distance > 6.0) & (distance < 30.0)
        seen &= np.abs(_turn(azimuth - yaw)) < np.radians(35.0)
        seen &= np.abs(_turn(azimuth + np.pi - town.facing[k])) < np.radians(60.0)
        if seen.sum() >= 2 and rng.random() > errors.missed:
            rows.append(k)
            when.append(int(np.flatnonzero(seen)[-1]))
            bearing.append(azimuth[seen].mean())
    truth, last = np.array(rows, np.int64), np.array(when, np.int64)
    place, facing = town.position[truth], np.array(bearing) + np.pi
    class_name = town.class_name[truth].copy()
    false = rng.poisson(errors.clutter * len(truth))
    if false:
        last = np.concatenate([last, rng.integers(0, len(car), false)])
        extra = car[last[-false:]] + rng.uniform(-15, 15, (false, 2))
        place = np.vstack([place, np.column_stack([extra, rng.uniform(1, 4, false)])])
        facing = np.concatenate([facing, yaw[last[-false:]] + np.pi])
        class_name = np.concatenate([class_name, rng.choice(np.array(CLASSES, object), false)])
        truth = np.concatenate([truth, np.full(false, -1)])
    n = len(truth)
    wrong = rng.random(n) < errors.wrong_class
    class_name[wrong] = rng.choice(np.array(CLASSES, object), int(wrong.sum()))
    along = np.column_stack([np.sin(yaw[last]), np.cos(yaw[last])])
    across = np.column_stack([along[:, 1], -along[:, 0]])
    own = errors.own_along * along * rng.standard_normal((n, 1))
    own = own + errors.own_across * across * rng.standard_normal((n, 1))
    up = errors.own_up * rng.standard_normal((n, 1))
    measured = place + shared[last] + np.column_stack([own, up])
    covariance = np.zeros((n, 3, 3))
    covariance[:, :2, :2] = (
        errors.own_along**2 * along[:, :, None] * along[:, None, :]
        + errors.own_across**2 * across[:, :, None] * across[:, None, :]
    )
    covariance[:, 2, 2] = errors.own_up**2
    covariance += np.diag(np.square(errors.shared))
    lat, lon, height = to_geodetic(measured)
    path_lat, path_lon, _ = to_geodetic(np.column_stack([car, np.zeros(len(car))]) + shared)
    drive = DriveSigns(
        name=name,
        start_gps_s=start_gps_s,
        ids=tuple(f"s{k + 1:04d}" for k in range(n)),
        class_name=class_name,
        lat_rad=lat,
        lon_rad=lon,
        height_m=height,
        cov_enu=covariance,
        confidence=np.where(truth >= 0, rng.uniform(0.8, 0.99, n), rng.uniform(0.4, 0.9, n)),
        n_views=rng.integers(5, 30, n),
        first_gps_s=time[last] - 2.0,
        last_gps_s=time[last],
        height_above_road_m=place[:, 2],
        facing_sd_rad=np.full(n, 0.1),
        sd_above_road_m=np.full(n, 0.1),
        facing_rad=np.mod(facing + errors.facing * rng.standard_normal(n), 2 * np.pi),
        size_m=np.full(n, 0.6),
        side=np.full(n, "left", object),
        status=np.full(n, "ok", object),
        path=DrivePath(time, path_lat, path_lon, yaw, np.tile(errors.shared, (len(car), 1))),
        cameras=(CameraView(0.0, np.radians(35.0)),),
    )
    return drive, truth


def levels_told(sightings: Sightings, sign: IntArray) -> tuple[FloatArray, FloatArray]:
    """The levels [3] of drives, and factors [d, 3] on them, by the signs [n] of their sightings."""
    homes = np.unique(cell_of(*rough_places(sightings, sign))).tolist()
    told = [drive_squares(sightings, sign, home) for home in homes]
    return error_levels(told, sightings.n_drives)


def _turn(angle: FloatArray) -> FloatArray:
    return (angle + np.pi) % (2 * np.pi) - np.pi


def street_scene(
    seed: int, drives: int, length_m: float = 1500.0, spacing_m: float = 25.0,
    errors: Errors = USUAL, both_ways: bool = True,
) -> Scene:  # fmt: skip
    """Passes of one street, days apart, with ``both_ways`` every third the other way."""
    rng = np.random.default_rng(seed)
    town = street(rng, length_m, spacing_m)
    scene = Scene(town)
    ends = np.array([[-1.5, -40.0], [-1.5, length_m + 40.0]])
    for number in range(drives):
        back = both_ways and number % 3 == 2
        path = ends[::-1] * [-1, 1] if back else ends
        start = 1.4e9 + 86400.0 * number
        drive, truth = drive_through(
            rng, town, path, 12.0, f"pass-{number:02d}", start, errors
        )  # fmt: skip
        scene.drives.append(drive)
        scene.truth.append(truth)
    return scene
