"""What tyres, springs and wheels do."""

from __future__ import annotations

from automap.effects.effect import Effect
from automap.effects.entries.parts import axes, named, one, xyz
from automap.effects.terms import FORWARD_ACCELERATION, LATERAL_ACCELERATION, VEHICLE, Kind

VEHICLE_AND_WHEELS = (
    Effect(
        "vehicle_sideslip",
        "vehicle",
        named("coefficient", "rad/(m/s^2)", 0.005),
        "the car drifts outwards in curves",
        one("coefficient", VEHICLE, Kind.SLIP, 2, LATERAL_ACCELERATION),
        one_signed=True,
        looks_like="a slip",
    ),
    Effect(
        "vehicle_pitch",
        "vehicle",
        named("coefficient", "rad/(m/s^2)", 0.01),
        "the nose rises on its springs with the acceleration",
        one("coefficient", VEHICLE, Kind.SLIP, 1, FORWARD_ACCELERATION),
        nuisance=True,
    ),
    Effect(
        "nhc_lever_arm",
        "vehicle",
        xyz("m", 1.5),
        "from the IMU to the point that does not slide sideways",
        axes(VEHICLE, Kind.POINT),
        looks_like="a slip",
        told_apart=(
            (
                "vehicle_sideslip",
                "drive the same bend once slowly and once fast: slip grows with the square of the "
                "speed",
            ),
        ),
    ),
    Effect(
        "odometer_scale",
        "vehicle",
        named("relative", "", 0.03),
        "wheels turn too fast",
        one("relative", VEHICLE, Kind.SCALE, 0),
    ),
    Effect(
        "odometer_time_offset",
        "vehicle",
        named("s", "s", 0.3),
        "wheel speeds stamped later than the truth",
        one("s", VEHICLE, Kind.TIME, weight=-1.0),
    ),
)
