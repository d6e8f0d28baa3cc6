"""Whether the probabilities of existence are what happens: simulated drives with much clutter.

    python tests/benchmarks/geolocation_existence.py [--drives N] [--first SEED]

Everything that boxes were joined to is asked, also what the map leaves out: how often things of a
probability are signs, and the expected calibration error (Naeini, Cooper and Hauskrecht, AAAI 2015)
over eight bins.
"""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np

from automap.geolocation import locate
from automap.geolocation.landmark import Landmark, SizePrior
from automap.geolocation.rules import GeolocationRules
from automap.geolocation.views import Views
from automap.records import FloatArray
from tests.benchmarks.geolocation_world import Difficulty, World, make_world

EDGES = np.array([0.0, 0.05, 0.2, 0.4, 0.6, 0.8, 0.95, 0.99, 1.0])


def told(world: World) -> FloatArray:
    """Probability, and 1 for a sign, of everything [n, 2] that boxes were joined to."""
    rows: list[tuple[float, float]] = []
    by_boxes, by_size = locate.existence_probabilities, locate.face_probabilities
    exists = np.zeros(0)

    def boxes_tell(*given: Any) -> FloatArray:
        nonlocal exists
        exists = by_boxes(*given)
        return exists

    def sizes_tell(views: Views, landmarks: list[Landmark], prior: SizePrior) -> FloatArray:
        face = by_size(views, landmarks, prior)
        for mark, p in zip(landmarks, (exists * face).tolist(), strict=True):
            if mark.ok:
                shown = world.owner[views.row[mark.rows]]
                rows.append((p, float(np.mean(shown >= 0) > 0.5)))
        return face

    locate.existence_probabilities = boxes_tell
    locate.face_probabilities = sizes_tell  # type: ignore[assignment]
    try:
        rules = GeolocationRules(min_existence=0.0)
        locate.locate_signs(world.trajectory, [world.detections], {"front": world.camera}, rules)
    finally:
        locate.existence_probabilities = by_boxes
        locate.face_probabilities = by_size
    return np.array(rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--drives", type=int, default=4)
    parser.add_argument("--first", type=int, default=0, help="seed of the first drive")
    arguments = parser.parse_args()
    for clutter in (0.1, 0.4):
        d = Difficulty(twice=False, clutter=clutter)
        seeds = range(arguments.first, arguments.first + arguments.drives)
        p, sign = np.concatenate([told(make_world(seed, d)) for seed in seeds]).T
        number = np.clip(np.searchsorted(EDGES, p, side="right") - 1, 0, len(EDGES) - 2)
        print(f"{clutter} false boxes a frame: {len(p)} things, {sign.mean():.3f} of them signs")
        error = 0.0
        for k in np.unique(number).tolist():
            here = number == k
            error += here.sum() * abs(p[here].mean() - sign[here].mean())
            print(
                f"  {EDGES[k]:.2f} to {EDGES[k + 1]:.2f}: {here.sum():5d}, "
                f"said {p[here].mean():.3f}, were {sign[here].mean():.3f}"
            )
        print(f"  expected calibration error {error / len(p):.4f}")


if __name__ == "__main__":
    main()
