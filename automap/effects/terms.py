"""How the parameters of effects act on what is measured: the one form that all effects have.

reading = true + parameter * weight * signal, along one axis or in one of the ways of ``Kind``. The
simulator applies a term exactly, the filter and the gap finder to first order. Neither knows any
effect by name.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

GYRO = "gyro"
ACCEL = "accel"
POSITION = "position"
VELOCITY = "velocity"
VEHICLE = "vehicle"
"""The velocity, in vehicle axes, of the point that does not slide: its forward part is what wheels
report, its other two are nothing by the vehicle constraint."""
FIX = (POSITION, VELOCITY)
INERTIAL = (GYRO, ACCEL)

ONE = "1"
TEMPERATURE = "temperature"
"""Of the sensor, above its reference, K."""
SPEED_SQUARED = "speed_squared"
WARM_UP = "warm_up"
"""What is left of the cold after switching on: 1 at the first inertial sample, then dying away."""
ELAPSED = "elapsed"
"""Seconds since the first inertial sample."""
FORWARD_ACCELERATION = "forward_acceleration"
LATERAL_ACCELERATION = "lateral_acceleration"
"""Of the vehicle along its own axes, m/s^2, right positive."""
POSITION_ACCURACY = (
    *("position_sd_n", "position_sd_e", "position_sd_d"),
    *("quick_sd_n", "quick_sd_e", "quick_sd_d"),
)
"""What a fix states of its own error, m, and what errors of seconds go by, which are larger than
that in some stretches."""
TRAVEL = ("travel_n", "travel_e")
"""The direction of travel, of length one, of none where the vehicle stands."""
STATE_SIGNALS = (ONE, ELAPSED, FORWARD_ACCELERATION, LATERAL_ACCELERATION)
"""Signals that follow from the state where it is measured; all others are columns over time."""


class Kind(IntEnum):
    """In which way a term acts.

    ``AXIS`` adds along an axis: of the sensor, of NED for fixes, of the vehicle. ``POINT`` moves
    the measured point along an axis of the vehicle (m). ``TIME`` measures what is so many seconds
    later (of the vehicle: its forward speed, for the other two parts are nothing at any time).
    ``COURSE`` measures its direction in the plane, not its size, so many seconds later. ``LAG``
    passes it through a low-pass of that time constant. ``TURN`` turns the sensor against the
    vehicle about an axis (rad, ZYX to first order), ``SLIP`` the vehicle's velocity against the
    vehicle. ``SCALE`` lengthens the component along an axis by that share.
    """

    AXIS = 0
    POINT = 1
    TIME = 2
    LAG = 3
    TURN = 4
    SLIP = 5
    SCALE = 6
    COURSE = 7


@dataclass(frozen=True)
class Term:
    """One way in which a ``parameter`` acts ``on`` a measurement; see ``Kind``.

    ``axis`` 0..2; the parameter is multiplied by ``weight`` and by a ``signal``: one of
    ``STATE_SIGNALS``, or for inertial readings a true reading (``rate_x``), a shape of it
    (``abs_rate_x``, ``sq_force_x``), what it reads more where it is late (``late_force_x``; see
    ``automap.effects.inertial_signals``), ``temperature`` above its reference,
    ``speed_squared``, ``warm_up``, or what follows from the drive: ``TRAVEL``, a user's signal (see
    ``automap.effects.user``).
    """

    parameter: str
    on: str
    kind: Kind = Kind.AXIS
    axis: int = 0
    signal: str = ONE
    weight: float = 1.0


@dataclass(frozen=True)
class GaussMarkov:
    """Makes the terms' parameters correlated errors instead of constants.

    ``tau_setting`` and ``sd_setting`` name the options of the fusion that hold the time constant
    in s and the standard deviation, which is in units of the terms' signal. ``size_levels`` name
    the noise levels that scale the size of each, ``time_level`` that of the time.
    """

    tau_setting: str
    sd_setting: str
    size_levels: tuple[str, ...]
    time_level: str = ""
