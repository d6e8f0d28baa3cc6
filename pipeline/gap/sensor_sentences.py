"""Errors of the inertial sensors in plain words."""

from __future__ import annotations

from automap.earth import STANDARD_GRAVITY as G
from pipeline.gap.sentence_parts import (
    AT_20_M_S,
    DEGREES,
    LEANS,
    M_S2,
    MINUTE,
    Sentence,
    along,
    around,
    axes,
    by_sign,
    one,
    pairs,
)

INERTIAL = {
    "accel_bias": Sentence("The accelerometer reads {}.", along(1.0, M_S2)),
    "gyro_bias": Sentence("The gyro reads {}.", around(DEGREES, "°/s")),
    "accel_scale": Sentence("The accelerometer reads {}.", along(100.0, "%")),
    "gyro_scale": Sentence("The gyro reads {}.", around(100.0, "%")),
    "accel_bias_walk": Sentence(
        "The accelerometer's zero drifts faster than stated: by {} in a minute.",
        one("x", "{}", factor=MINUTE, unit=M_S2),
    ),
    "gyro_bias_walk": Sentence(
        "The gyro's zero drifts faster than stated: by {} in a minute.",
        one("x", "{}", factor=MINUTE * DEGREES, unit="°/s"),
    ),
    "accel_misalignment": Sentence(
        "The accelerometer's axes are not square to each other: {}.",
        pairs("yx zx zy", *LEANS, DEGREES, "°"),
    ),
    "gyro_misalignment": Sentence(
        "The gyro's axes are not square to each other and to the accelerometer's: {}.",
        pairs("xy xz yx yz zx zy", *LEANS, DEGREES, "°"),
    ),
    "accel_scale_asymmetry": Sentence("The accelerometer reads {}.", by_sign("along")),
    "gyro_scale_asymmetry": Sentence("The gyro reads {}.", by_sign("about")),
    "accel_quadratic": Sentence(
        "The accelerometer is not linear: at 1 g it reads {}.", along(G**2, M_S2)
    ),
    "gyro_g_sensitivity": Sentence(
        "The gyro feels acceleration and tilt: {}.",
        pairs(
            "xx xy xz yx yy yz zx zy zz",
            "1 g along the [by] axis adds {} about the [out] axis",
            "1 g along the [by] axis takes {} from the turn about the [out] axis",
            DEGREES * G,
            "°/s",
        ),
    ),
    "accel_temperature": Sentence(
        "The accelerometer's zero follows the temperature: 10 K warmer it reads {}.",
        along(10.0, M_S2),
    ),
    "gyro_temperature": Sentence(
        "The gyro's zero follows the temperature: 10 K warmer it reads {}.",
        around(10.0 * DEGREES, "°/s"),
    ),
    "speed_vibration": Sentence(
        "Vibration shifts the accelerometer's zero with the speed: at 20 m/s it reads {}.",
        along(AT_20_M_S, M_S2),
    ),
    "gyro_speed_vibration": Sentence(
        "Vibration shifts the gyro's zero with the speed: at 20 m/s it reads {}.",
        around(AT_20_M_S * DEGREES, "°/s"),
    ),
    "imu_filter_delay": Sentence(
        "Accelerometer and gyro are not in step: the accelerometer's readings come {}.",
        axes(
            "{} later than the gyro's along the [axis] axis",
            "{} earlier than the gyro's along the [axis] axis",
            1e3,
            "ms",
        ),
    ),
    "accel_saturation": Sentence(
        "The accelerometer loses strong forces: at 1 g it reads {}.",
        axes(
            "{} too little along its [axis] axis", "{} too much along its [axis] axis", G**3, M_S2
        ),
    ),
    "gyro_saturation": Sentence(
        "The gyro loses fast turns: at 1 rad/s it reads {}.",
        axes(
            "{} too little about its [axis] axis",
            "{} too much about its [axis] axis",
            DEGREES,
            "°/s",
        ),
    ),
    "accel_dead_zone": Sentence(
        "The accelerometer does not feel small forces: {}.",
        axes("none below {} along its [axis] axis", "", 1.0, M_S2),
    ),
    "gyro_dead_zone": Sentence(
        "The gyro does not feel slow turns: {}.",
        axes("none below {} about its [axis] axis", "", DEGREES, "°/s"),
    ),
    "accel_warm_up": Sentence(
        "The accelerometer is off while it warms up: just after switching on it reads {}.",
        along(1.0, M_S2),
    ),
    "gyro_warm_up": Sentence(
        "The gyro is off while it warms up: just after switching on it reads {}.",
        around(DEGREES, "°/s"),
    ),
}
