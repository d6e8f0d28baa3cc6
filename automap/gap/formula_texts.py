"""Which formulas are tried: quantities on every axis of the sensors, and those of one channel.

One of a family: from there the others are found (``neighbours``).
"""

from __future__ import annotations

import numpy as np

from automap.effects import Signals
from automap.effects.user import INERTIAL, OF_FIXES
from automap.gap.fit import Fit

QUANTITIES = (
    "speed",
    "speed^3",
    "sin(heading)",
    "cos(heading)",
    "sin(2 * heading)",
    "cos(2 * heading)",
    "abs(rate_z)",
    "rate_z^2",
    "rate_z * speed",
    "force_x^2",
    "force_y^2",
    "force_x * force_y",
    "force_x * rate_z",
    "force_y * rate_z",
    "force_x * speed",
    "force_y * speed",
    "force_x^3",
    "force_y^3",
    "rate_z^3",
    "max(force_x, 0)",
    "max(force_y, 0)",
    "rate^2",
    "rate_y^2",
    "tanh(acceleration / 0.1)",
    "tanh(rate_z / 0.01)",
    # one axis late by itself, and where inside the housing an axis is
    "angular_acceleration_x",
    "angular_acceleration_y",
    "angular_acceleration_z",
    "jerk_x",
    "jerk_y",
    "jerk_z",
    "time",
    # what sun or standing air warms at rest, and wind cools
    "lag(step(1 - speed), 20.0)",
    "lag(speed, 20.0)",
)
ON_FIXES = (
    *(
        (on, text)
        for on in OF_FIXES
        for text in ("speed", "acceleration", "lateral_acceleration", "abs(rate_z)")
        # a latency, a lever arm and a factor on velocities say these already
        if (on, text)
        not in {
            ("velocity_along", "speed"),
            ("position_along", "speed"),
            ("velocity_along", "acceleration"),
            ("velocity_across", "lateral_acceleration"),
        }
    ),
    ("velocity_along", "speed^2"),
    ("position_along", "speed^2"),
)
REMEMBERED = (
    # an axis that hangs behind what it measures by a play: hysteresis
    *((f"accel_{a}", f"(force_{a} - play(force_{a}, 0.5))") for a in "xy"),
    ("gyro_z", "(rate_z - play(rate_z, 0.05))"),
    # courses that a receiver holds until they have turned by more, and that hang behind by so much
    ("velocity_across", "(speed * (heading - play(heading, 0.01)))"),
    # receivers that run on; of velocities that is what a low-pass does, which has a name
    ("position_along", "lag(acceleration, 2.0)"),
    ("position_across", "lag(lateral_acceleration, 2.0)"),
)
"""Formulas of what has been: channel and text. Widths and times are refined where one is found."""
ON_VEHICLE = (
    # a slip that does not grow with the force alone, a wind, an axle that bends under load
    ("nhc_y", "speed * lateral_acceleration^3"),
    ("nhc_y", "speed^2 * lateral_acceleration"),
    ("nhc_y", "speed * acceleration"),
    ("nhc_y", "speed * sin(heading)"),
    ("nhc_y", "speed * cos(heading)"),
)
"""What the point that follows the road does aside: channel and text."""
ALONE = (*ON_FIXES, *REMEMBERED, *ON_VEHICLE)
"""Formulas that are tried on their own channel only."""


def warm(fit: Fit) -> bool:
    """Whether a drive has temperatures."""
    temperature = fit.opened.drive.imu.temp_c
    return temperature is not None and bool(np.isfinite(temperature).any())


def formula_terms(signals: Signals, has_temperature: bool) -> list[tuple[str, str]]:
    """The dictionary for drives like one of these signals: channel and text of each."""
    texts = list(QUANTITIES)
    if has_temperature:
        rise = f"(temperature - {float(np.median(signals.temperature)):.1f})"
        # of a sensor whose core follows its case, what lies between the two
        texts += [f"{rise}^2", "(temperature - lag(temperature, 40.0))", f"{rise} * speed"]
    return [*((on, text) for text in texts for on in INERTIAL), *ALONE]
