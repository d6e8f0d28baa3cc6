"""What a simulated drive is made of: the scenario file, ``automap.scenario/1``.

Lengths in metres, angles in degrees where the key says so, everything else SI. Sensor
errors carry the names and units of the effects (errors of the reading).
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from automap.effects.limits import WARM_UP_S
from automap.errors import ConfigError
from automap.records import LEVER_ARM_SD_M
from automap.simulation import quantities as q


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


_SHORTEST_M, _LONGEST_M = 1.0, 400e3
"""Of a route; the longest is that of its legs."""
_AUSTRALIA = (-44.0, -9.0), (112.0, 154.5)
"""Latitudes and longitudes, deg."""


class Start(_Part):
    """Where and when the drive begins, heading clockwise from north."""

    utc: q.Utc
    lat_deg: q.Latitude
    lon_deg: q.Longitude
    height_m: q.Height = 0.0
    heading_deg: q.Angle = 0.0
    standstill_s: q.LongTime = 5.0


class Vehicle(_Part):
    """How the vehicle moves; suspension angles are per m/s^2 of acceleration."""

    accel: q.Acceleration = 1.6
    brake: q.Acceleration = 2.0
    lateral_accel: q.Acceleration = 2.2
    roll_per_accel_deg: q.SmallAngle = 0.45
    pitch_per_accel_deg: q.SmallAngle = 0.4
    road_roughness_deg: q.Roughness = 0.12
    imu_height_m: q.ImuHeight = 0.5


class Leg(_Part):
    """One piece of the route: a straight when ``turn_deg`` is 0, else an arc (right positive).

    Adjoining curvatures are joined by smooth transitions of some ``transition_m``.
    """

    length_m: q.Length = 0.0
    turn_deg: q.Turn = 0.0
    radius_m: q.Radius | None = None
    grade_percent: q.Slope = 0.0
    bank_deg: q.Slope = 0.0
    speed_m_s: q.Speed = 12.0

    @property
    def way_m(self) -> float:
        """How long it is, an arc along its circle."""
        return self.length_m + (self.radius_m or 0.0) * math.radians(abs(self.turn_deg))

    @model_validator(mode="after")
    def _straight_or_arc(self) -> Leg:
        if (self.radius_m is None) != (self.turn_deg == 0.0):
            raise ValueError("an arc has radius_m and turn_deg, a straight has neither")
        if (self.radius_m is None) != (self.length_m > 0.0):
            raise ValueError("a straight has length_m above 0, an arc has none")
        return self


class Stop(_Part):
    """A halt at a distance along the route."""

    at_m: q.Length
    hold_s: q.Hold


class Route(_Part):
    """The legs driven, one after the other, with the halts on them."""

    legs: Annotated[list[Leg], Field(min_length=1)]
    stops: list[Stop] = []
    transition_m: q.Transition = 14.0
    end_standstill_s: q.LongTime = 3.0

    @model_validator(mode="after")
    def _goes_somewhere(self) -> Route:
        way = sum(leg.way_m for leg in self.legs)
        if not _SHORTEST_M <= way <= _LONGEST_M:
            raise ValueError(
                f"its legs are {way:g} m long; give {_SHORTEST_M:g} m to {_LONGEST_M:g} m"
            )
        for stop in self.stops:
            if stop.at_m > way:
                raise ValueError(f"a stop at {stop.at_m:g} m is beyond its {way:.0f} m")
        return self


class Clock(_Part):
    """Host clock against GPS: stamp of the drive's begin, and its rate error."""

    start_ns: Annotated[int, Field(ge=0)] = 1_000_000_000_000
    drift_ppm: q.DriftPpm = 8.0


class WarmUp(_Part):
    """The IMU's temperature after switching on: from ``start_c`` up by ``rise_k`` in the end."""

    start_c: q.Celsius = 20.0
    rise_k: q.Kelvin = 15.0
    time_constant_s: q.LastingTime = WARM_UP_S


class Imu(_Part):
    """Sampling and white noise (densities, per square root of hertz).

    With ``warm_up`` the recording has a temperature; an effect that follows it brings it too.
    """

    rate_hz: q.ImuRate = 100.0
    gyro_noise: q.GyroNoise = 1.0e-4
    accel_noise: q.AccelNoise = 1.5e-3
    stamp_jitter_s: q.Delay = 2.0e-5
    warm_up: WarmUp | None = None


class Solution(_Part):
    """A kind of solution that a receiver has for a while: what it says it is (``fix``), for how
    many seconds in the mean (exponentially), and its position errors, one sigma per axis.

    ``stated_sd_m`` is the accuracy that the receiver states, the true one where not given;
    ``then`` names the solutions that may follow, each with its weight.
    """

    fix: Literal["none", "3d", "dgnss", "float", "fixed"] = "3d"
    mean_s: q.LastingTime = 60.0
    sigma_correlated_m: q.PositionSd = (0.8, 0.8, 1.4)
    correlation_s: q.LastingTime = 60.0
    sigma_white_m: q.PositionSd = (0.25, 0.25, 0.5)
    stated_sd_m: q.StatedSd | None = None
    then: dict[str, q.Weight] = {}


class Replay(_Part):
    """Errors of a recorded receiver in place of drawn ones.

    ``errors`` is a drive folder with truth or a table (CSV) of errors; from ``start_s`` s of it
    on, which the seed chooses where it is not given. A series that is shorter than the drive is
    refused, or begins anew with ``wrap``.
    """

    errors: str
    start_s: q.LongTime | None = None
    wrap: bool = False


class Gnss(_Part):
    """Receiver: rate, antenna, errors (one sigma per axis), dropouts, output delay.

    ``receiver`` names a preset of ``configs/receivers``, whose values stand where this section
    and ``errors`` give none. It states the accuracy of the errors here, or ``stated_sd_m`` and
    ``stated_sd_velocity``, and knows nothing of the effects. ``solutions`` take the place of the
    position errors here: the drive begins with the first. As ``nmea`` it states neither
    accuracies nor vertical velocity. The manifest states ``output_delay_s`` unless it is not
    ``output_delay_known``, as that of few receivers is.
    """

    receiver: str = ""
    format: Literal["ubx", "nmea"] = "ubx"
    rate_hz: q.FixRate = 5.0
    lever_arm_m: q.Arm = (0.0, 0.0, 0.0)
    sigma_correlated_m: q.PositionSd = (0.8, 0.8, 1.4)
    correlation_s: q.LastingTime = 60.0
    sigma_white_m: q.PositionSd = (0.25, 0.25, 0.5)
    sigma_velocity: q.VelocitySd = (0.06, 0.06, 0.09)
    stated_sd_m: q.StatedSd | None = None
    stated_sd_velocity: q.StatedVelocitySd | None = None
    solutions: dict[str, Solution] = {}
    replay: Replay | None = None
    dropouts: list[tuple[q.LongTime, q.LongTime]] = []
    geoid_separation_m: q.Geoid = 0.0
    output_delay_s: q.Delay = 0.07
    output_delay_known: bool = True
    arrival_jitter_s: q.Delay = 0.008
    burst_probability: q.Share = 0.02
    burst_s: q.Delay = 0.12

    @model_validator(mode="after")
    def _solutions_follow(self) -> Gnss:
        for name, solution in self.solutions.items():
            unknown = set(solution.then) - set(self.solutions)
            if unknown:
                raise ValueError(f"after {name} comes {min(unknown)}, which is no solution")
            if solution.then and not any(solution.then.values()):
                raise ValueError(f"nothing that follows {name} has a weight above 0")
        return self


class Odometer(_Part):
    """Wheel speed in ``odometer.csv``: rate, white noise and resolution in m/s."""

    rate_hz: q.ImuRate = 20.0
    noise: q.SpeedNoise = 0.02
    resolution: q.SpeedNoise = 0.0


class CameraSetup(_Part):
    """Camera on the vehicle; ``mount_rpy_deg`` is true, the manifest's differs by the error.

    With ``box_sd_px`` no video is drawn: the boxes that a detector would find are written, their
    edges with so much noise. Only such a camera can have effects under ``errors``.
    """

    width: q.Pixels = 1280
    height: q.Pixels = 720
    focal_px: q.Focal = 1000.0
    frame_rate_hz: q.FrameRate = 10.0
    lever_arm_m: q.Arm = (1.2, 0.0, -0.9)
    lever_arm_sigma_m: q.ArmSd = LEVER_ARM_SD_M
    mount_rpy_deg: q.Angles = (0.0, 0.0, 0.0)
    mount_error_deg: q.Angles = (0.0, 0.0, 0.0)
    mount_rpy_sigma_deg: q.AngleSd = 1.0
    frame_jitter_s: q.Delay = 0.004
    stamp_noise_s: q.Delay = 0.001
    time_offset_sigma_s: q.DelaySd = 0.02
    image_noise: q.GreyNoise = 2.5
    blur_px: q.Blur = 0.6
    quality: q.Quality = 27
    box_sd_px: q.BoxSd | None = None


class SignPlacement(_Part):
    """A sign by the road: ``offset_m`` from the path, right positive; ``height_m`` of its centre
    above the road; ``turned_deg`` away from facing the oncoming driver squarely."""

    at_m: q.Length
    sign: str
    offset_m: q.Aside
    height_m: q.SignHeight = 2.2
    size_m: q.SignSize | None = None
    turned_deg: q.Turned = 0.0


class Scenery(_Part):
    """What stands along the road besides signs, and the light."""

    road_half_width_m: q.RoadWidth = 4.0
    lane_centre_m: q.Aside = 2.0
    buildings: bool = True
    trees: bool = True
    parked_cars: bool = True
    billboards: bool = True
    brightness: q.Brightness = 1.0


class Site(_Part):
    """Where the drive takes place, for the manifest, which has what is said here."""

    country: q.Country | None = None
    traffic_side: Literal["left", "right"] | None = None


class Scenario(_Part):
    """A whole simulated drive.

    ``errors`` maps effect names to their parameters, ``earth_rotation`` to true or false. The
    manifest knows nothing of them: it gives the antenna's lever arm of ``gnss``, for instance,
    and ``gnss_lever_arm`` is how far the antenna stands from there.
    """

    schema_: Literal["automap.scenario/1"] = Field(alias="schema")
    name: str
    seed: Annotated[int, Field(ge=0)] = 1
    start: Start
    vehicle: Vehicle = Vehicle()
    route: Route
    clock: Clock = Clock()
    imu: Imu = Imu()
    errors: dict[str, bool | dict[str, float]] = {}
    gnss: Gnss | None = None
    odometer: Odometer | None = None
    camera: CameraSetup | None = None
    signs: list[SignPlacement] = []
    scenery: Scenery = Scenery()
    site: Site = Site()

    @property
    def place(self) -> Site:
        """The site; of a drive in Australia that says nothing of it Australia's."""
        (south, north), (west, east) = _AUSTRALIA
        there = south < self.start.lat_deg < north and west < self.start.lon_deg < east
        if self.site.country is None and there:
            return Site(country="AU", traffic_side=self.site.traffic_side or "left")
        return self.site


def parse_scenario(data: Mapping[str, Any], path: Path) -> Scenario:
    """Check the content of a scenario file.

    Raises ConfigError naming the file, the key and, for an unknown key, the nearest one.
    """
    try:
        return Scenario.model_validate(data)
    except ValidationError as error:
        raise ConfigError(f"{path}: {_first_reason(error)}") from None


def _first_reason(error: ValidationError) -> str:
    found = error.errors(include_url=False)
    # of the ways in which a value may be written the one that it came nearest to
    ways = (e for e in found if e["loc"][:2] == found[0]["loc"][:2])
    first = max(ways, key=lambda e: len(e["loc"]))
    place = ".".join(str(part) for part in first["loc"] if "[" not in str(part))
    if first["type"] == "extra_forbidden":
        word = str(first["loc"][-1])
        near = difflib.get_close_matches(word, sorted(_all_keys(Scenario)), n=1, cutoff=0.6)
        advice = f"did you mean {near[0]}?" if near else "remove it"
        return f"unknown key {place}; {advice}"
    if first["type"] == "missing":
        return f"the key {place} is missing; add it"
    reason = first["msg"].removeprefix("Value error, ")
    return f"{place} is not accepted: {reason}" if place else reason


def _all_keys(model: type[BaseModel]) -> set[str]:
    keys: set[str] = set()
    for name, info in model.model_fields.items():
        keys.add(info.alias or name)
        for part in _models_in(info.annotation):
            keys |= _all_keys(part)
    return keys


def _models_in(annotation: Any) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [m for a in getattr(annotation, "__args__", ()) for m in _models_in(a)]
