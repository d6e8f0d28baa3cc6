"""How a recording ended, in figures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any

from pipeline.record.camera import Camera
from pipeline.record.streams import GnssStream, ImuStream
from pipeline.record.ublox import Outcome


@dataclass(frozen=True)
class Ending:
    """How a recording ended. ``lost_bytes``: came in and are on no disk; ``summary`` is what
    stands in ``recording.json``."""

    folder: Path
    seconds: float
    gnss_bytes: int
    epochs: int
    samples: int
    frames: dict[str, int]
    lost_bytes: int
    warnings: tuple[str, ...]
    summary: dict[str, Any] = field(default_factory=dict)

    @property
    def empty(self) -> bool:
        """Whether nothing came in that can be read."""
        messages = self.summary.get("gnss", {}).get("messages")
        return not (messages or self.samples or any(self.frames.values()))


def describe(
    folder: Path,
    begun: datetime,
    seconds: float,
    lost_bytes: int,
    warnings: tuple[str, ...],
    gnss: GnssStream | None,
    imu: ImuStream | None,
    cameras: Sequence[Camera],
    outcome: Outcome | None,
) -> Ending:
    """The figures of a recording whose threads have ended; ``outcome`` is that of the receiver's
    settings."""
    states = {camera.name: camera.state(0) for camera in cameras}
    summary: dict[str, Any] = {
        "schema": "automap.recording/1",
        "begun_utc": begun.isoformat(timespec="seconds"),
        "seconds": round(seconds, 3),
        "lost_bytes": lost_bytes,
        "warnings": list(warnings),
    }
    if gnss is not None:
        summary["gnss"] = _port(gnss) | {
            "epochs": gnss.watch.state.epochs,
            "gaps": gnss.watch.state.gaps,
            "longest_gap_s": gnss.watch.state.longest_gap_s,
            "messages": dict(gnss.watch.kinds),
            "stray_bytes": gnss.messages.stray_bytes,
            "receiver": str(outcome.version) if outcome else None,
            "set": outcome.done if outcome else [],
            "refused": outcome.refused if outcome else [],
        }
    if imu is not None:
        summary["imu"] = _port(imu) | {
            "format": imu.form.name,
            "samples": imu.decoder.samples,
            "damaged": imu.decoder.bad,
            "other": imu.decoder.other,
            "gaps": imu.watch.state.gaps,
            "longest_gap_s": imu.watch.state.longest_gap_s,
            "clock_skew": imu.clock.skew,
            "clock_resets": imu.clock.resets,
        }
    summary["cameras"] = {
        name: {"frames": state.frames, "missed": state.missed} for name, state in states.items()
    }
    return Ending(
        folder=folder,
        seconds=seconds,
        gnss_bytes=gnss.log.data.size if gnss else 0,
        epochs=gnss.watch.state.epochs if gnss else 0,
        samples=imu.decoder.samples if imu else 0,
        frames={name: state.frames for name, state in states.items()},
        lost_bytes=lost_bytes,
        warnings=warnings,
        summary=summary,
    )


def _port(stream: GnssStream | ImuStream) -> dict[str, Any]:
    reader = stream.reader
    return {
        "port": reader.device,
        "baud": reader.baud,
        "bytes": stream.log.data.size,
        "interruptions": reader.interruptions,
        "driver_overruns": reader.overruns,
    }
