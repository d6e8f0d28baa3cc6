"""Clocks: what ties the stamps of a recording to GPS time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from automap.records.arrays import FloatArray


@dataclass(frozen=True)
class ClockModel:
    """Host clock to GPS time: ``gps_s = ref_gps_s + (1 + drift) * (t_ns - ref_ns) * 1e-9``.

    ``sd_offset_s`` and ``sd_drift`` are one sigma at the reference. ``method`` says how it
    was found ("arrival", "identity", "unix", "correlation").
    ``output_delay_s`` is what was taken for the receiver's least output delay, None when it
    is unknown and left to the fusion to estimate.
    """

    ref_ns: int
    ref_gps_s: float
    drift: float
    sd_offset_s: float
    sd_drift: float
    method: str
    output_delay_s: float | None = None

    def gps_s(self, t_ns: npt.NDArray[np.int64]) -> FloatArray:
        """GPS seconds [n] of host stamps [n]."""
        dt = (np.asarray(t_ns, np.int64) - self.ref_ns) * 1e-9
        return np.asarray(self.ref_gps_s + (1.0 + self.drift) * dt, dtype=np.float64)

    def t_ns(self, gps_s: npt.ArrayLike) -> npt.NDArray[np.int64]:
        """Host stamps [n] of GPS seconds [n], rounded to the nanosecond."""
        dt = (np.asarray(gps_s, np.float64) - self.ref_gps_s) / (1.0 + self.drift)
        return self.ref_ns + np.rint(dt * 1e9).astype(np.int64)


@dataclass(frozen=True)
class ReceiverFilter:
    """Time constants, s, of the first-order filters that a receiver's velocities and positions came
    through; 0 where there is none."""

    velocity_s: float = 0.0
    position_s: float = 0.0


@dataclass(frozen=True)
class DriveClocks:
    """The clocks of a drive.

    ``clock`` leads from the stamps of the trajectory, which are ``time_base`` ("boot_ns",
    "gps_ns" or "unix_ns"), to GPS time; ``arrival`` from the arrival times of the receiver's
    bytes where those are another clock, ``arrival_time_base``. ``receiver_filter`` is what makes
    fixes late beside their times. ``shown_offset_s`` by how much the stamps are later than
    ``clock`` says, where motions leave no doubt that it is off.
    """

    clock: ClockModel
    time_base: str
    arrival: ClockModel | None = None
    arrival_time_base: str | None = None
    receiver_filter: ReceiverFilter | None = None
    shown_offset_s: float | None = None
