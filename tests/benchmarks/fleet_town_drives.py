"""A town of streets at right angles, and drives along them as folders of sensor logs and boxes.

Used by ``fleet_town.py``. Streets and signs are those of ``merge_million.py``, some with a
neighbour 1.5 m away. A drive is about a minute with one of ``configs/receivers``; its inertial
sensors, mounting and camera have errors as large as the manifest states. Boxes are missed, called
another class and put where nothing is as ``drive_to_map.py`` does it, and some signs a drive does
not see at all: something stands before them.
"""

from __future__ import annotations

import datetime
import shutil
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from automap.earth import local_ned, metres_per_radian
from automap.io import names
from automap.records import FloatArray, IntArray
from automap.signs.vocabulary import load_vocabulary
from automap.simulation.route import STEP_M, profile_route
from automap.simulation.scenario import Route, Vehicle, parse_scenario
from automap.simulation.scene import SceneSign
from pipeline.simulate.drive_writer import DETECTIONS_FILE, write_drive
from pipeline.simulate.receivers import with_receiver
from tests.benchmarks.drive_to_map import spoil
from tests.benchmarks.merge_million import BLOCK_M, City

LAT_DEG, LON_DEG, HEIGHT_M = 0.0, 37.07, 1900.0
"""On the equator streets that run north and east close to a millimetre in a kilometre."""
GEOID_M = -21.0
RECEIVERS = {"u-blox": 0.4, "phone": 0.3, "rtk": 0.2, "phone-canyon": 0.1}
BLOCKS = 4
"""Of a drive: 600 m, about 65 s."""
PASSES = 10
"""Of a street in one direction, in the mean."""
KEPT = 0.5
"""Of the signs of that city, which are many: one every 75 m in each direction is left."""
HIDDEN = 0.05
RADIUS_M = 12.0
NEAR_M = 80.0
"""Signs that far from a drive's streets are looked for by its camera."""
MOUNT_SD_DEG, LATE_SD_S = 1.0, 0.05
FIRST = datetime.datetime(2026, 3, 2, 20, 0, tzinfo=datetime.UTC)
EVERY_MIN = 20


@dataclass(frozen=True)
class Town:
    """The streets of a ``seed`` with their signs, for so many ``drives``."""

    seed: int
    drives: int
    city: City

    @staticmethod
    def of(seed: int, drives: int) -> Town:
        """As many streets as are driven PASSES times."""
        side = max(4, round(np.sqrt(drives * BLOCKS / PASSES / 4)) + 1)
        rng = np.random.default_rng(seed)
        city = City(rng, side)
        kept = rng.random(len(city.position)) < KEPT
        for name in ("along", "block", "position", "facing", "code"):
            setattr(city, name, getattr(city, name)[kept])
        return Town(seed, drives, city)

    def route(self, number: int) -> IntArray:
        """Directed blocks that a drive takes."""
        return self.city.route(np.random.default_rng([self.seed, number, 1]), BLOCKS)

    def hidden(self, number: int) -> np.ndarray[Any, Any]:
        """Signs [n] that something hides from a drive."""
        rng = np.random.default_rng([self.seed, number, 2])
        return np.asarray(rng.random(len(self.city.position)) < HIDDEN)

    def passed(self, number: int) -> np.ndarray[Any, Any]:
        """Signs [n] on the streets of a drive that nothing hides."""
        return np.isin(self.city.block, self.route(number)) & ~self.hidden(number)

    def centres(self) -> FloatArray:
        """Middles of the signs [n, 3] east, north, up of where the IMU drives."""
        return np.asarray(self.city.position - [0.0, 0.0, Vehicle().imu_height_m])

    def geodetic(self, enu: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Latitude and longitude in rad and height of points [n, 3] east, north, up."""
        north, east = (float(v) for v in metres_per_radian(np.radians(LAT_DEG), HEIGHT_M))
        lat = np.radians(LAT_DEG) + enu[:, 1] / north
        return lat, np.radians(LON_DEG) + enu[:, 0] / east, HEIGHT_M + enu[:, 2]


@cache
def corner_m() -> float:
    """How far before a crossing a turn of 90 degrees begins, its transitions included."""
    straight = 60.0
    legs = [
        {"length_m": straight},
        {"turn_deg": 90.0, "radius_m": RADIUS_M},
        {"length_m": straight},
    ]
    profile = profile_route(Route.model_validate({"legs": legs}), Vehicle())
    # the middle of each step
    heading = np.cumsum(profile.curvature) * STEP_M - 0.5 * profile.curvature * STEP_M
    return float(np.cos(heading[:-1]).sum() * STEP_M) - straight


def legs_of(town: Town, route: IntArray, rng: np.random.Generator) -> list[dict[str, float]]:
    """Straights and turns along the blocks."""
    legs: list[dict[str, float]] = []
    steps = town.city.steps[route]
    heading = np.degrees(np.arctan2(steps[:, 0], steps[:, 1]))
    length = BLOCK_M
    for turn in [*np.diff(heading).tolist(), None]:
        if turn is not None and abs(turn) < 1.0:
            length += BLOCK_M
            continue
        into = corner_m() if turn is not None else 0.0
        legs.append({"length_m": length - into, "speed_m_s": float(rng.uniform(9.0, 15.0))})
        if turn is not None:
            turn = (turn + 180.0) % 360.0 - 180.0
            legs.append({"turn_deg": turn, "radius_m": RADIUS_M, "speed_m_s": 6.0})
            length = BLOCK_M - into
    return legs


def scenario_of(town: Town, number: int) -> dict[str, Any]:
    """A drive as a scenario without signs."""
    rng = np.random.default_rng([town.seed, number, 3])
    route = town.route(number)
    begin = np.append(town.city.starts[route[0]], 0.0)[None]
    lat, lon, _ = town.geodetic(begin)
    step = town.city.steps[route[0]]
    receiver = str(rng.choice(list(RECEIVERS), p=list(RECEIVERS.values())))
    turned, late = np.radians(rng.normal(0.0, MOUNT_SD_DEG, 3)), float(rng.normal(0.0, LATE_SD_S))
    when = FIRST + datetime.timedelta(minutes=EVERY_MIN * number)
    return {
        "schema": "automap.scenario/1",
        "name": f"town-{town.seed}-{number:05d}",
        "seed": int(rng.integers(1 << 30)),
        "start": {
            "utc": when,
            "lat_deg": float(np.degrees(lat[0])),
            "lon_deg": float(np.degrees(lon[0])),
            "height_m": HEIGHT_M,
            "heading_deg": float(np.degrees(np.arctan2(step[0], step[1]))),
        },
        "gnss": {
            "receiver": receiver,
            "lever_arm_m": [0.4, 0.1, -1.2],
            "geoid_separation_m": GEOID_M,
        },
        "camera": {
            "frame_rate_hz": 5.0,
            "box_sd_px": 1.0,
            "lever_arm_sigma_m": 0.02,
            "mount_rpy_sigma_deg": MOUNT_SD_DEG,
            "time_offset_sigma_s": LATE_SD_S,
        },
        "scenery": dict.fromkeys(("buildings", "trees", "parked_cars", "billboards"), False),
        "site": {"country": "KE", "traffic_side": "left"},
        "errors": {
            "camera_boresight": dict(zip(("roll", "pitch", "yaw"), turned.tolist(), strict=True)),
            "camera_time_offset": {"s": late},
            "accel_bias": dict(zip("xyz", rng.normal(0.0, 0.08, 3).tolist(), strict=True)),
            "gyro_bias": dict(zip("xyz", rng.normal(0.0, 0.003, 3).tolist(), strict=True)),
            "accel_scale": dict(zip("xyz", rng.normal(0.0, 0.002, 3).tolist(), strict=True)),
            "gyro_scale": dict(zip("xyz", rng.normal(0.0, 0.002, 3).tolist(), strict=True)),
        },
        "route": {"legs": legs_of(town, route, rng)},
    }


def signs_of(town: Town, number: int, start: dict[str, Any]) -> list[SceneSign]:
    """The signs about a drive that it can see, in metres about its start."""
    city = town.city
    route = town.route(number)
    ends = np.vstack([city.starts[route], city.starts[route] + city.steps[route]])
    low, high = ends.min(axis=0) - NEAR_M, ends.max(axis=0) + NEAR_M
    plan = city.position[:, :2]
    about = ((plan > low) & (plan < high)).all(axis=1) & ~town.hidden(number)
    rows = np.flatnonzero(about)
    ref = tuple(np.radians([start["lat_deg"], start["lon_deg"]]).tolist())
    middle = town.centres()[rows]
    centre = local_ned(*town.geodetic(middle), (*ref, HEIGHT_M))
    foot = local_ned(
        *town.geodetic(middle - city.position[rows] * [0.0, 0.0, 1.0]), (*ref, HEIGHT_M)
    )
    classes = load_vocabulary().classes
    return [
        SceneSign(
            name, centre[k], foot[k], float(city.facing[row]), classes[name].size_m, 1.0
        )
        for k, row in enumerate(rows.tolist())
        for name in (city.names[city.code[row]],)
    ]  # fmt: skip


def make_drive(town: Town, number: int, folder: Path) -> Path:
    """The folder of a drive, without truth; as it was where it is there already."""
    path = folder / f"d{number:05d}"
    if path.is_dir():
        return path
    aside = folder / f".{path.name}"
    shutil.rmtree(aside, ignore_errors=True)
    aside.mkdir(parents=True)
    content = scenario_of(town, number)
    scenario = parse_scenario(with_receiver(content), path)
    write_drive(scenario, aside, signs=signs_of(town, number, content["start"]))
    spoil(aside / "video" / DETECTIONS_FILE, np.random.default_rng([town.seed, number, 4]))
    shutil.rmtree(aside / names.TRUTH_DIR)
    aside.rename(path)
    return path
