"""Host stamps as UTC, for people and for formats that know no other time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from automap.records import NO_TIME, ClockModel, IntArray, Trajectory

if TYPE_CHECKING:
    from automap.records import FloatArray

TimeArray = npt.NDArray[np.datetime64]


def clock_from_trajectory(trajectory: Trajectory) -> ClockModel | None:
    """The straight line through a trajectory's two clocks; None when it has no GPS time.

    It goes before the clock of ``sync.json``, which does not know the receiver's delay that the
    fusion estimates: signs would be dated by so much earlier than the path beside them.
    """
    good = np.flatnonzero(np.isfinite(trajectory.gps_s))
    if len(good) < 2:
        return None
    first, last = good[0], good[-1]
    span = float(trajectory.t_ns[last] - trajectory.t_ns[first]) * 1e-9
    if span <= 0:
        return None
    rate = float(trajectory.gps_s[last] - trajectory.gps_s[first]) / span
    return ClockModel(
        ref_ns=int(trajectory.t_ns[first]),
        ref_gps_s=float(trajectory.gps_s[first]),
        drift=rate - 1.0,
        sd_offset_s=float("nan"),
        sd_drift=float("nan"),
        method="trajectory",
    )


_MOST_S = 9e15  # in milliseconds still a 64-bit integer


def utc_of_gps(gps_s: FloatArray) -> TimeArray:
    """GPS seconds [n] as UTC to the millisecond, datetime64[ms]; NaT where not finite or beyond
    what 64 bits hold."""
    from automap.timebase import gps_to_unix

    known = np.abs(gps_s) < _MOST_S
    unix = np.asarray(gps_to_unix(np.where(known, gps_s, 0.0)), np.float64)
    milliseconds = np.rint(unix * 1e3).astype(np.int64).astype("datetime64[ms]")
    return np.where(known, milliseconds, np.datetime64("NaT", "ms"))


def utc_of_stamps(t_ns: IntArray, clock: ClockModel | None) -> TimeArray:
    """Host stamps [n] as UTC, datetime64[ms]; NaT where the stamp or the clock is unknown."""
    stamps = np.asarray(t_ns, np.int64)
    if clock is None:
        return np.full(len(stamps), np.datetime64("NaT", "ms"))
    known = stamps != NO_TIME
    gps_s = clock.gps_s(np.where(known, stamps, clock.ref_ns))
    return utc_of_gps(np.where(known, gps_s, np.nan))


def iso_texts(times: TimeArray) -> list[str | None]:
    """ISO 8601 texts with milliseconds and the Z of UTC [n]; None where not known."""
    texts = np.datetime_as_string(times, unit="ms")
    return [None if text == "NaT" else f"{text}Z" for text in texts.tolist()]
