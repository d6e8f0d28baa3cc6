"""Reading a large mixed receiver log, end to end from bytes to tables and fixes.

    python tests/benchmarks/receiver_log.py [RECORDINGS] [--size MB]

The log repeats real captures (UBX with raw measurements, NMEA, both interleaved) up to the
size. The peer, pyubx2, reads one round of the same bytes in the same run; both rates and
their ratio are printed. A second figure is for the densest log there is, short UBX and NMEA
epochs and nothing else.
"""

from __future__ import annotations

import argparse
import io
import os
import time
from pathlib import Path

import pyubx2

from automap.io.receiver import read_receiver_bytes

MIXTURE = (
    "gnss_logs/gpsd/ublox-glo.log",
    "gnss_logs/gpsd/ublox-neo-m9n-nmea.log",
    "drives/kitti-20110930-0020/gnss.ubx",
    "gnss_logs/walk-m8-rawx/gnss_1730.ubx",
    "gnss_logs/gpsd/ublox-8.log",
)
DENSE = ("drives/kitti-20110930-0020/gnss.ubx",)
ROUNDS = 5


def rate_of_reader(data: bytes) -> tuple[float, int]:
    """MB/s of the best of a few rounds, and the number of fixes."""
    best, count = 0.0, 0
    for _ in range(ROUNDS):
        start = time.process_time()
        count = len(read_receiver_bytes(data, "benchmark").fixes)
        best = max(best, len(data) / (time.process_time() - start) / 1e6)
    return best, count


def rate_of_peer(data: bytes) -> float:
    """MB/s of pyubx2, UBX and NMEA parsed."""
    start = time.process_time()
    messages = 0
    for _, message in pyubx2.UBXReader(io.BytesIO(data), protfilter=3, quitonerror=0):
        messages += message is not None
    return len(data) / (time.process_time() - start) / 1e6


def main() -> None:
    default = os.environ.get("AUTOMAP_SHARED_DATA", "../shared/data")
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("recordings", nargs="?", type=Path, default=Path(default))
    parser.add_argument("--size", type=float, default=50.0, help="MB of the log")
    options = parser.parse_args()
    read_receiver_bytes((options.recordings / DENSE[0]).read_bytes(), "warm-up")
    for title, names in (("mixed captures", MIXTURE), ("short epochs only", DENSE)):
        once = b"".join((options.recordings / name).read_bytes() for name in names)
        data = once * max(1, round(options.size * 1e6 / len(once)))
        mine, fixes = rate_of_reader(data)
        theirs = rate_of_peer(once)
        print(
            f"{title}: {len(data) / 1e6:.0f} MB, {fixes} fixes: {mine:.0f} MB/s; "
            f"pyubx2 {theirs:.2f} MB/s; ratio {mine / theirs:.0f}"
        )


if __name__ == "__main__":
    main()
