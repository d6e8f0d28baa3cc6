"""Time and memory of every stage of a long simulated drive.

    python tests/benchmarks/long_drive.py HOURS [FOLDER]

A sign every 75 m, IMU at 100 Hz, fixes at 5 Hz, boxes as `drive_to_map.py` draws its routes; every
stage is a process of its own, so that its peak is told apart. Last the trajectory as texts.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from drive_to_map import draw_scenario, toml

STAGES = ("ingest", "sync", "fuse", "detect", "geolocate", "export", "report")
TEXTS = ("kitti", "trajectory-csv")
MAIN = "from pipeline.cli import main; main()"


def scenario(hours: float) -> dict[str, Any]:
    """A drive of about so many hours, always the same, with a stop every 900 m."""
    drawn = draw_scenario(np.random.default_rng(7), 3600.0 * hours * 0.93)
    drawn["signs"] = drawn["signs"][::2]
    metres = sum(
        leg.get("length_m", 0.0)
        + abs(np.radians(leg.get("turn_deg", 0.0))) * leg.get("radius_m", 0.0)
        for leg in drawn["route"]["legs"]
    )
    rng = np.random.default_rng(8)
    drawn["route"]["stops"] = [
        {"at_m": float(at), "hold_s": float(rng.uniform(3.0, 20.0))}
        for at in np.arange(300.0, metres - 300.0, 900.0)
    ]
    return drawn


def measured(*words: object) -> tuple[float, float, float]:
    """Wall and processor seconds of a command, and its peak in GB."""
    started = time.monotonic()
    process = subprocess.Popen([sys.executable, "-c", MAIN, *map(str, words)])
    _, status, used = os.wait4(process.pid, 0)
    if status:
        raise SystemExit(f"{' '.join(map(str, words))}: {os.waitstatus_to_exitcode(status)}")
    return time.monotonic() - started, used.ru_utime + used.ru_stime, used.ru_maxrss / 1e6


def main() -> None:
    hours = float(sys.argv[1])
    with tempfile.TemporaryDirectory(dir=sys.argv[2] if len(sys.argv) > 2 else None) as folder:
        file, drive = Path(folder) / "scenario.toml", Path(folder) / "drive"
        drawn = scenario(hours)
        file.write_text("".join(f"{name} = {toml(value)}\n" for name, value in drawn.items()))
        print(f"{hours:g} h, {len(drawn['signs'])} signs: wall and processor s, peak GB")
        for stage in ("simulate", *STAGES, *TEXTS):
            words: tuple[object, ...] = ("simulate", file, "-o", drive)
            if stage in TEXTS:
                words = (
                    "export",
                    drive / "_automap",
                    "--format",
                    stage,
                    "-o",
                    file.with_suffix(""),
                )
            elif stage != "simulate":
                words = ("run", drive, "--only", stage, "--quiet")
            print(f"{stage:<14}{'{:9.1f}{:9.1f}{:8.3f}'.format(*measured(*words))}", flush=True)


if __name__ == "__main__":
    main()
