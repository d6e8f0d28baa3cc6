"""What synchronisation found out."""

from __future__ import annotations

from dataclasses import dataclass, field

from automap.records import ClockModel
from automap.sync.arrival import ClockFit
from automap.sync.coarse import CoarseOffset
from automap.sync.correlation import Lag


@dataclass(frozen=True)
class SyncResult:
    """A drive's clock and how it was found.

    ``fit`` is there for a clock from arrival times. ``lag`` is the delay of the IMU stamps
    behind the receiver's epochs under that clock, None where it cannot be seen;
    ``lag_source`` says whether it is that of the "position" or of the "velocity".
    ``lags`` holds both, where found. ``shown_offset_s`` by how much the stamps are later than the
    clock says, to some tenths of a second, where the motions leave no doubt that it is off.
    """

    clock: ClockModel
    fit: ClockFit | None = None
    lag: Lag | None = None
    lag_source: str | None = None
    lags: dict[str, Lag] = field(default_factory=dict)
    coarse: CoarseOffset | None = None
    shown_offset_s: float | None = None
    warnings: list[str] = field(default_factory=list)
