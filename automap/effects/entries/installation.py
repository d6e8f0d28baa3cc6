"""How the inertial sensors sit in the vehicle, in time and on the Earth."""

from __future__ import annotations

from automap.effects.effect import Effect
from automap.effects.entries.parts import ROLL_PITCH_YAW, axes, named, one
from automap.effects.terms import ELAPSED, FIX, VEHICLE, Kind

EARTH = "earth_rotation"
"""On or off: an effect without parameters."""

_LONG_DRIVE = "record a drive of half an hour or more"

INSTALLATION = (
    Effect(
        "imu_mounting",
        "vehicle",
        named(ROLL_PITCH_YAW, "rad", 0.05),
        "IMU axes turned against the vehicle's",
        axes((*FIX, VEHICLE), Kind.TURN, ROLL_PITCH_YAW),
        looks_like="a tilt",
    ),
    Effect(
        "imu_time_offset",
        "clock",
        named("s", "s", 0.1),
        "IMU stamps later than the truth",
        one("s", (*FIX, VEHICLE), Kind.TIME),
        first_order=("gnss_latency", -1.0),
        told_apart=(
            (
                "gnss_latency",
                "late fixes and late IMU stamps look the same to IMU and receiver; compare with "
                "wheel speeds on the host clock, or tap the IMU against a timed event",
            ),
        ),
    ),
    Effect(
        "imu_clock_skew",
        "clock",
        # a crystal keeps time to 1e-4, an inertial sensor's own oscillator to 1e-2
        named("skew", "s/s", 1e-3),
        "IMU clock runs fast",
        one("skew", (*FIX, VEHICLE), Kind.TIME, signal=ELAPSED),
        unknown_epoch="imu_time_offset",
        told_apart=(("imu_time_offset", _LONG_DRIVE), ("gnss_latency", _LONG_DRIVE)),
    ),
    Effect(
        EARTH,
        "earth",
        (),
        "the Earth turns under the sensor",
        setting="fuse.earth_rotation",
    ),
)
