"""What no library of effects holds: by which ways such an error gets into a recording."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from tests.hidden_effects.geodesy import Array
from tests.hidden_effects.imu import Clock, Extra, Readings
from tests.hidden_effects.motion import Body, Motion, State

FixExtra = Callable[[Motion, Array], tuple[Array, Array]]
"""Errors (position [n, 3] m, velocity [n, 3] m/s, north, east, down) of the fixes at instants [n]
of a motion."""


Flex = Callable[[State], Array]
"""Roll, pitch, yaw [n, 3] rad by which a camera is turned further about its own axes."""


@dataclass(frozen=True)
class Extras:
    """One error at its size, None where it does not act.

    ``imu`` adds to the readings what the true motion says; ``readings`` changes them after bias
    and noise; ``clock`` is by how much IMU stamps are late; ``fix`` adds to the fixes; ``body``
    turns the vehicle against its path; ``nhc`` adds [n, 2] m/s to what the constraint says;
    ``flex`` turns the camera.
    """

    imu: Extra | None = None
    readings: Readings | None = None
    clock: Clock | None = None
    fix: FixExtra | None = None
    body: Body | None = None
    nhc: Callable[[Motion, Array], Array] | None = None
    flex: Flex | None = None


NOTHING = Extras()
