"""``automap record --replay``: a drive sent from pseudo-terminals, for a recorder to record."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

from automap.errors import StageError


@dataclass(frozen=True)
class ReplayRequest:
    """A drive to be played, ``speed`` times as fast, into terminals in ``links``."""

    drive: Path
    links: Path
    speed: float = 1.0
    baud: int = 460_800
    logs: bool = False
    timeout_s: float | None = None


def play_drive(request: ReplayRequest) -> list[str]:
    """Play a drive into pseudo-terminals once a recorder has opened them; lines on how it went.

    ``replay.json`` in the folder of the terminals says which host time is which of the drive.
    Raises InputError for a drive with nothing to play, StageError when nobody listens.
    """
    from automap.io.atomic import write_json
    from automap.io.drive import load_drive
    from pipeline.record.replay import Replay, drive_feeds
    from pipeline.shared.terminal import progress_bar

    drive = load_drive(request.drive)
    player = Replay(drive_feeds(drive), request.links, request.baud)
    try:
        for name, terminal in player.terminals.items():
            print(f"{name}: {terminal.link}  ({terminal.device}, {request.baud} baud)", flush=True)
        limit = float("inf") if request.timeout_s is None else request.timeout_s
        if not player.wait_opened(limit):
            raise StageError(f"nobody opened the terminals within {limit:g} s; start a recorder.")
        with progress_bar("replay") as progress:
            results, origin, start = player.play(
                request.speed,
                logs=request.links if request.logs else None,
                tick=lambda fraction: progress(fraction, ""),
            )
        time.sleep(0.5)  # the reader fetches the last bytes before the hang-up
    finally:
        player.close()
    write_json(
        request.links / "replay.json",
        {"drive": str(request.drive), "drive_ns": origin, "host_ns": start, "speed": request.speed},
    )
    short = [r for r in results if r.sent < r.total]
    if short:
        raise StageError(
            f"{short[0].name}: only {short[0].sent} of {short[0].total} bytes were taken; the "
            "recorder stopped reading."
        )
    return [
        f"{r.name}: {r.sent} bytes in {r.seconds:.1f} s, at most {r.late_s * 1e3:.1f} ms late"
        for r in results
    ]
