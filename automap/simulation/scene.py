"""What stands along a simulated road, in local metres north, east, down."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from automap import earth
from automap.records import FloatArray
from automap.signs.vocabulary import load_vocabulary
from automap.simulation.scenario import Scenario
from automap.simulation.trajectory import DriveMotion

Colour = tuple[int, int, int]
"""Blue, green, red."""

_STEP_M = 2.0
"""Distance between cross-sections of the street that is drawn."""
_WALLS: tuple[Colour, ...] = (
    (170, 180, 190), (120, 140, 170), (90, 110, 150), (200, 205, 205), (140, 150, 150),
    (95, 100, 120), (160, 190, 205),
)  # fmt: skip
_CARS: tuple[Colour, ...] = (
    (40, 40, 170), (150, 80, 30), (225, 225, 225), (60, 60, 60), (30, 170, 210), (130, 130, 130),
)  # fmt: skip
_PAINTS: tuple[Colour, ...] = ((40, 30, 190), (165, 85, 10), (20, 190, 240), (60, 140, 40))


@dataclass(frozen=True)
class Patch:
    """A flat polygon: corners [k, 3] NED and its colour.

    With ``outward`` [3] it is seen only from the side that vector points to.
    """

    corners: FloatArray
    colour: Colour
    outward: FloatArray | None = None


@dataclass(frozen=True)
class Ball:
    """A round blob of foliage: centre [3] NED, radius in m."""

    centre: FloatArray
    radius_m: float
    colour: Colour


@dataclass(frozen=True)
class SceneSign:
    """A sign: ``centre`` [3] NED of its face, ``facing_rad`` the bearing it looks towards,
    ``foot`` [3] where its pole meets the ground."""

    name: str
    centre: FloatArray
    foot: FloatArray
    facing_rad: float
    size_m: float
    shade: float


@dataclass(frozen=True)
class Thing:
    """Parts, drawn in their order, that are sorted by distance as one."""

    centre: FloatArray
    parts: tuple[Patch | Ball | SceneSign, ...]


@dataclass(frozen=True)
class Scene:
    """Ground strips in drawing order, then everything that stands; ``ref`` lat, lon, height."""

    ref: tuple[float, float, float]
    ground: tuple[Patch, ...]
    things: tuple[Thing, ...]
    signs: tuple[SceneSign, ...] = field(default=())


@dataclass(frozen=True)
class RoadLine:
    """The driven line on the road surface: distance [n], position [n, 3] NED, heading [n]."""

    s: FloatArray
    ned: FloatArray
    heading: FloatArray
    curvature: FloatArray

    @cached_property
    def _columns(self) -> FloatArray:
        """North, east, down [3, n]: a column of ``ned`` would be copied at every place."""
        return np.ascontiguousarray(self.ned.T)

    @cached_property
    def level(self) -> cKDTree:
        """What finds the line's nearest point in plan."""
        return cKDTree(self.ned[:, :2])

    def place(self, s: float, offset_m: float, up_m: float = 0.0) -> tuple[FloatArray, float]:
        """Point [3] beside the line (right positive) and the heading there.

        Before the begin and beyond the end the line goes on straight.
        """
        at = float(np.clip(s, self.s[0], self.s[-1]))
        point = np.array([np.interp(at, self.s, column) for column in self._columns])
        heading = float(np.interp(at, self.s, self.heading))
        forward = np.array([np.cos(heading), np.sin(heading), 0.0])
        right = np.array([-np.sin(heading), np.cos(heading), 0.0])
        point += (s - at) * forward + offset_m * right
        point[2] -= up_m
        return point, heading


def build_scene(scenario: Scenario, drive: DriveMotion, rng: np.random.Generator) -> Scene:
    """Lay out the road, the scenery and the signs of a scenario; the ground where it is filmed."""
    start = scenario.start
    ref = (float(np.deg2rad(start.lat_deg)), float(np.deg2rad(start.lon_deg)), start.height_m)
    line = _road_line(scenario, drive, ref)
    things: list[Thing] = []
    if scenario.scenery.buildings:
        things += _buildings(scenario, line, rng)
    if scenario.scenery.trees:
        things += _trees(scenario, line, rng)
    if scenario.scenery.parked_cars:
        things += _cars(scenario, line, rng)
    signs = _signs(scenario, line, rng)
    things += [Thing(sign.centre, (sign,)) for sign in signs]
    filmed = scenario.camera is not None and scenario.camera.box_sd_px is None
    # strips of every few metres: of ten hours gigabytes, which only frames show
    ground = _ground(scenario, line, rng) if filmed else ()
    return Scene(ref, ground, tuple(things), tuple(signs))


def _road_line(scenario: Scenario, drive: DriveMotion, ref: tuple[float, float, float]) -> RoadLine:
    t = np.arange(0.0, drive.duration_s, 0.02)
    s = drive.distance(t)
    grid = np.arange(0.0, s[-1], _STEP_M)
    keep = np.concatenate([[True], np.diff(s) > 1e-6])
    motion = drive.at(np.interp(grid, s[keep], t[keep]))
    ned = earth.local_ned(motion.lat_rad, motion.lon_rad, motion.height_m, ref)
    if drive.axle_m.any():
        # the point that does not slide follows the road, not the IMU
        ned[:, :2] += (motion.C_n_b @ drive.axle_m)[:, :2]
    ned[:, 2] += scenario.vehicle.imu_height_m
    assert drive.profile is not None  # only a recorded path has none, and that has no scene
    curvature = np.interp(grid, drive.profile.s, drive.profile.curvature)
    return RoadLine(grid, ned, motion.rpy[:, 2], curvature)


def _road_centre(scenario: Scenario) -> float:
    """Offset of the road's middle from the driven line, right positive."""
    side = 1.0 if scenario.place.traffic_side == "left" else -1.0
    return side * scenario.scenery.lane_centre_m


def _ground(scenario: Scenario, line: RoadLine, rng: np.random.Generator) -> tuple[Patch, ...]:
    centre, half = _road_centre(scenario), scenario.scenery.road_half_width_m
    grass, path, asphalt, kerb = (75, 125, 105), (150, 158, 162), (92, 90, 88), (165, 168, 170)
    bands = [
        (-40.0, 40.0, grass),
        (-half - 3.2, -half - 1.4, path),
        (half + 1.4, half + 3.2, path),
        (-half - 0.2, half + 0.2, kerb),
        (-half, half, asphalt),
    ]
    ahead = np.concatenate([[line.s[0] - 40.0, line.s[0] - 20.0], line.s,
                            line.s[-1] + np.arange(10.0, 130.0, 10.0)])  # fmt: skip
    patches: list[Patch] = []
    for left, right, colour in bands:
        for i, (a, b) in enumerate(itertools.pairwise(ahead)):
            shade = 1.0 + 0.05 * rng.standard_normal()
            tone = tuple(int(np.clip(c * shade, 0, 255)) for c in colour)
            bend = line.curvature[min(max(i - 2, 0), len(line.s) - 1)]
            # inside a bend a strip must not reach beyond the centre of the circle
            reach = 0.9 / max(abs(bend), 1e-3)
            low = max(centre + left, -reach) if bend < 0 else centre + left
            high = min(centre + right, reach) if bend > 0 else centre + right
            corners = [line.place(a, low)[0], line.place(a, high)[0],
                       line.place(b, high)[0], line.place(b, low)[0]]  # fmt: skip
            patches.append(Patch(np.array(corners), (tone[0], tone[1], tone[2])))
    for s in np.arange(0.0, line.s[-1] + 80.0, 9.0):
        corners = [line.place(s, centre - 0.07)[0], line.place(s, centre + 0.07)[0],
                   line.place(s + 3.0, centre + 0.07)[0],
                   line.place(s + 3.0, centre - 0.07)[0]]  # fmt: skip
        patches.append(Patch(np.array(corners), (225, 225, 225)))
    return tuple(patches)


def _is_clear(line: RoadLine, point: FloatArray, distance_m: float) -> bool:
    return bool(line.level.query(point[:2])[0] > distance_m)


@dataclass(frozen=True)
class Side:
    """One side of a box: corners [4, 3] and the direction it looks to."""

    corners: FloatArray
    outward: FloatArray

    def panel(self, x0: float, x1: float, y0: float, y1: float, colour: Colour) -> Patch:
        """A rectangle on this side, in fractions of its width and height."""
        origin = self.corners[0]
        across, up = self.corners[1] - origin, self.corners[3] - origin
        corners = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
        points = np.array([origin + x * across + y * up for x, y in corners])
        return Patch(points, colour, self.outward)

    def painted(self, colour: Colour) -> Patch:
        """The whole side in one colour."""
        return Patch(self.corners, colour, self.outward)


def _box(
    centre: FloatArray, heading: float, length: float, depth: float, height: float
) -> list[Side]:
    """Right, back, left, front wall and top of an upright box standing on ``centre``."""
    forward = np.array([np.cos(heading), np.sin(heading), 0.0])
    right = np.array([-np.sin(heading), np.cos(heading), 0.0])
    up = np.array([0.0, 0.0, -height])
    a, b = forward * length / 2, right * depth / 2
    base = [centre + a + b, centre - a + b, centre - a - b, centre + a - b]
    sides = [
        Side(np.array([base[i], base[(i + 1) % 4], base[(i + 1) % 4] + up, base[i] + up]), look)
        for i, look in enumerate((right, -forward, -right, forward))
    ]
    return [*sides, Side(np.array([corner + up for corner in base]), up)]


def _shaded(colour: Colour, factor: float) -> Colour:
    b, g, r = (int(np.clip(c * factor, 0, 255)) for c in colour)
    return b, g, r


def _buildings(scenario: Scenario, line: RoadLine, rng: np.random.Generator) -> list[Thing]:
    things: list[Thing] = []
    for side in (-1.0, 1.0):
        s = 0.0
        while s < line.s[-1] + 60.0:
            length = rng.uniform(9.0, 16.0)
            depth = rng.uniform(7.0, 11.0)
            height = rng.uniform(3.5, 8.0)
            back = scenario.scenery.road_half_width_m + rng.uniform(7.0, 12.0) + depth / 2
            centre, heading = line.place(s + length / 2, _road_centre(scenario) + side * back)
            colour = _WALLS[rng.integers(len(_WALLS))]
            paint = _PAINTS[rng.integers(len(_PAINTS))]
            shop = scenario.scenery.billboards and rng.random() < 0.35
            s += length + rng.uniform(3.0, 12.0)
            if not _is_clear(line, centre, depth / 2 + 9.0):
                continue
            faces = _box(centre, heading, length, depth, height)
            parts = [
                face.painted(_shaded(colour, shade))
                for face, shade in zip(faces, (1.0, 0.82, 0.95, 0.75, 0.55), strict=True)
            ]
            # a building on the left shows its right wall to the road
            front = faces[0] if side < 0 else faces[2]
            for wall in (faces[0], faces[2]):
                for x in np.arange(0.1, 0.85, 0.22):
                    parts.append(wall.panel(x, x + 0.12, 0.35, 0.62, (70, 60, 50)))
            if shop:
                x = rng.uniform(0.05, 0.35)
                parts.append(front.panel(x, x + 0.5, 0.72, 0.92, paint))
            things.append(Thing(centre, tuple(parts)))
    return things


def _trees(scenario: Scenario, line: RoadLine, rng: np.random.Generator) -> list[Thing]:
    things = []
    for s in np.arange(4.0, line.s[-1] + 60.0, 11.0):
        for side in (-1.0, 1.0):
            off = scenario.scenery.road_half_width_m + rng.uniform(4.5, 7.0)
            foot, heading = line.place(
                s + rng.uniform(-4.0, 4.0), _road_centre(scenario) + side * off
            )
            radius, trunk = rng.uniform(1.1, 2.0), rng.uniform(2.4, 3.4)
            if rng.random() < 0.35 or not _is_clear(line, foot, 5.5):
                continue
            wood = [face.painted((60, 80, 100)) for face in _box(foot, heading, 0.3, 0.3, trunk)]
            leaves = [
                Ball(
                    foot + np.append(rng.normal(0, 0.45 * radius, 2), -trunk - 0.6 * radius * k),
                    radius * rng.uniform(0.7, 1.0),
                    _shaded((45, 105, 75), rng.uniform(0.75, 1.25)),
                )
                for k in (0.2, 0.9, 0.5)
            ]
            things.append(Thing(foot, (*wood, *leaves)))
    return things


def _cars(scenario: Scenario, line: RoadLine, rng: np.random.Generator) -> list[Thing]:
    things = []
    for s in np.arange(15.0, line.s[-1] + 40.0, 23.0):
        side = -1.0 if rng.random() < 0.5 else 1.0
        off = scenario.scenery.road_half_width_m + 1.3
        foot, heading = line.place(s + rng.uniform(-6, 6), _road_centre(scenario) + side * off)
        colour = _CARS[rng.integers(len(_CARS))]
        if not _is_clear(line, foot, off - abs(_road_centre(scenario)) - 0.4):
            continue
        body = _box(foot - [0, 0, 0.25], heading, 4.3, 1.75, 0.65)
        cabin = _box(foot - [0, 0, 0.9], heading, 2.2, 1.55, 0.55)
        parts = [
            f.painted(_shaded(colour, k)) for f, k in zip(body, (1, 0.8, 1, 0.7, 1.1), strict=True)
        ]
        parts += [f.painted((50, 45, 40)) for f in cabin[:4]] + [cabin[4].painted(colour)]
        things.append(Thing(foot, tuple(parts)))
    return things


def _signs(scenario: Scenario, line: RoadLine, rng: np.random.Generator) -> list[SceneSign]:
    classes = load_vocabulary().classes
    signs = []
    for placed in scenario.signs:
        centre, heading = line.place(placed.at_m, placed.offset_m, placed.height_m)
        foot, _ = line.place(placed.at_m, placed.offset_m)
        signs.append(
            SceneSign(
                name=placed.sign,
                centre=centre,
                foot=foot,
                facing_rad=heading + np.pi + np.deg2rad(placed.turned_deg),
                size_m=placed.size_m or classes[placed.sign].size_m,
                shade=float(rng.uniform(0.72, 1.0)),
            )
        )
    return signs
