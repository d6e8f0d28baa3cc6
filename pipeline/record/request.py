"""What a recording is to be."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

AUTO, NONE = "auto", "none"


@dataclass(frozen=True)
class RecordRequest:
    """What the command line asks for. ``gnss`` and ``imu`` are a port, "auto" or "none"."""

    out: Path | None = None
    gnss: str = AUTO
    imu: str = AUTO
    imu_format: str | None = None
    cameras: tuple[str, ...] = ()
    rig: Path | None = None
    rate_hz: float | None = None
    raw: bool = False
    pvt: bool = False
    gnss_baud: int | None = None
    restore: bool = False
    duration_s: float | None = None
    plain: bool = False
    time_scale: float = 1.0
