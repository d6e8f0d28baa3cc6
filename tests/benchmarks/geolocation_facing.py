"""Which way signs face, on simulated drives with turned signs.

    python tests/benchmarks/geolocation_facing.py [--drives N] [--first SEED] [--only NAME]
        [--seconds S]

Drives of ten minutes, or as long as is said, as ``geolocation_simulated.py`` makes them, with faces
that are turned from the direction against the traffic, each distribution of turns with boxes of
several kinds of error. Boxes are those of round faces, from points on the rim and not from the
estimator's formula. Printed are the median and the largest error of the direction a face looks, the
coverage of its 95 % interval, and the rms of error over sigma; at last the same of all turned faces
together.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np

from automap.gates import sigmas
from automap.geolocation.locate import locate_signs
from automap.records import FloatArray
from tests.benchmarks.geolocation_world import CLASSES, Difficulty, make_world

ROUND = (
    *(f"regulatory--maximum-speed-limit-{v}--g1" for v in (30, 40, 50, 60, 70, 80, 90, 100)),
    *("regulatory--no-entry--g1", "regulatory--keep-left--g1", "regulatory--keep-right--g1"),
    "regulatory--roundabout--g1",
)
ONE = Difficulty(twice=False, faces=ROUND)
WORLDS = {
    "square on": ONE,
    "normal 8": replace(ONE, turned_deg=8.0),
    "uniform +-25": replace(ONE, turned="uniform", turned_deg=25.0 / np.sqrt(3.0)),
    "laplace 12, alike": replace(ONE, turned="laplace", turned_deg=12.0, box_alike=0.7),
    "some, margins": replace(ONE, turned="some", turned_deg=5.0, margin_px=1.5),
    "normal 12, wide, tails": replace(ONE, turned_deg=12.0, wide=0.03, box_freedom=3.0),
    "normal 10, plates": replace(ONE, turned_deg=10.0, faces=CLASSES),
    "normal 10, two laps": replace(ONE, turned_deg=10.0, twice=True),
    # looked at once, when nothing was changed any more
    "normal 4, unseen": replace(ONE, turned_deg=4.0, margin_px=0.7, box_alike=0.4),
    "uniform +-40, unseen": replace(ONE, turned="uniform", turned_deg=40.0 / np.sqrt(3.0)),
    "some, tails, unseen": replace(ONE, turned="some", turned_deg=9.0, box_freedom=4.0, wide=0.02),
}


def errors(d: Difficulty, seed: int) -> FloatArray:
    """Errors and sigmas [n, 2], deg, of the signs of one drive; a located sign is the true one that
    most of its boxes show."""
    world = make_world(seed, d)
    result = locate_signs(world.trajectory, [world.detections], {"front": world.camera})
    rows = []
    for sign in result.signs:
        shown = world.owner[sign.detection_rows]
        if (shown >= 0).any():
            true = int(np.bincount(shown[shown >= 0]).argmax())
            off = (sign.facing_rad - world.facing[true] + np.pi) % (2.0 * np.pi) - np.pi
            rows.append((np.degrees(off), np.degrees(sign.facing_sd_rad)))
    return np.array(rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--drives", type=int, default=4)
    parser.add_argument("--first", type=int, default=0, help="seed of the first drive")
    parser.add_argument("--only", help="the worlds whose names contain this")
    parser.add_argument("--seconds", type=float, default=600.0, help="length of a drive")
    arguments = parser.parse_args()
    turned = []
    for name, d in WORLDS.items():
        if arguments.only and arguments.only not in name:
            continue
        d = replace(d, duration_s=arguments.seconds)
        seeds = range(arguments.first, arguments.first + arguments.drives)
        rows = np.concatenate([errors(d, seed) for seed in seeds])
        _told(name, rows)
        if d.turned_deg:
            turned.append(rows)
    if turned:
        _told("all turned", np.concatenate(turned))


def _told(name: str, rows: FloatArray) -> None:
    off, sd = rows.T
    told = {
        "signs": len(off),
        "median": np.median(abs(off)),
        "max": abs(off).max(),
        "sd": np.median(sd),
        "inside 95 %": np.mean(abs(off) < sigmas(0.05) * sd),
        "rms error/sd": np.sqrt(np.mean((off / sd) ** 2)),
    }
    print(f"{name:24s}", "  ".join(f"{k} {v:.3g}" for k, v in told.items()), flush=True)


if __name__ == "__main__":
    main()
