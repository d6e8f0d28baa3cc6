"""A merge of drives whose receivers err by other than they state.

    python tests/benchmarks/merge_receivers.py FIRST LAST

Towns FIRST to LAST - 1 by seed: 36 drives with receivers of three kinds, which all state the same,
along one street in common and then along one that its kind alone drives. Prints of each street's
signs how many are in their 95 % ellipses, the root mean square of errors in sigmas and in m, and
the mean logarithmic score of the stated distribution (less is better).
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "unit"))

from merge_scene import to_enu
from test_merge_correlation import drive

from automap.gates import gate
from automap.mapping.merge import merge_drives
from automap.mapping.sightings import DriveSigns
from automap.records import FloatArray

KINDS = {"careful": (0.4, 0.5), "honest": (1.0, 1.0), "too sure": (1.8, 1.5)}
"""True errors over stated ones: of the path, and of each sighting."""
DRIVES, SHARED_SD, OWN_SD = 36, np.array([1.0, 1.0, 1.5]), 0.25
TAU_S, STEP_S, STEP_M = 30.0, 4.0, 40.0
IN_COMMON, PASSED, ALONE, SEEN = 20, 12, 12, 0.8
REACH_M = 5.0


def wandering(rng: np.random.Generator, time_s: FloatArray) -> FloatArray:
    """An error [n, 3] of unit variance at times [n] as a path has it that inertial sensors smooth:
    noise that is low-passed twice."""
    apart = np.abs(time_s[:, None] - time_s) / TAU_S
    root = np.linalg.cholesky((1.0 + apart) * np.exp(-apart) + 1e-9 * np.eye(len(time_s)))
    return np.asarray(root @ rng.normal(size=(len(time_s), 3)))


def street(rng: np.random.Generator, east: float, north: float, signs: int) -> FloatArray:
    """Signs [n, 3] along a street, m."""
    along = np.arange(signs)
    even = np.column_stack([east + STEP_M * along, north + 0.0 * along, 2.0 + 0.0 * along])
    return even + rng.normal(size=(signs, 3)) * [2.0, 2.0, 0.2]


def town(seed: int) -> tuple[list[DriveSigns], dict[str, FloatArray]]:
    """Drives, and the signs [n, 3] of the streets."""
    rng = np.random.default_rng(seed)
    streets = {"all": street(rng, 0.0, 0.0, IN_COMMON)}
    for k, kind in enumerate(KINDS):
        streets[kind] = street(rng, 900.0, 300.0 * (k + 1), ALONE)
    drives = []
    for number in range(DRIVES):
        kind = list(KINDS)[number % len(KINDS)]
        path, own = KINDS[kind]
        begin = rng.integers(0, IN_COMMON - PASSED)
        way = np.vstack([streets["all"][begin : begin + PASSED], streets[kind]])
        seen = rng.random(len(way)) < SEEN
        way, time_s = way[seen], STEP_S * np.flatnonzero(seen)
        shared = rng.normal(size=3) + wandering(rng, time_s)
        error = path * SHARED_SD * np.sqrt(0.5) * shared + own * OWN_SD * rng.normal(size=way.shape)
        cov = np.tile(np.diag(SHARED_SD**2 + OWN_SD**2), (len(way), 1, 1))
        drives.append(drive(number, way + error, cov, SHARED_SD, time_s))
    return drives, streets


def main() -> None:
    told: dict[str, list[tuple[float, float, float]]] = {}
    for seed in range(*map(int, sys.argv[1:3])):
        drives, streets = town(seed)
        found = merge_drives(drives).adjusted
        place = to_enu(found.lat, found.lon, found.height)[:, :2]
        for name, signs in streets.items():
            for sign in signs[:, :2]:
                k = int(np.argmin(np.linalg.norm(place - sign, axis=1)))
                error, cov = place[k] - sign, found.cov_enu[k, :2, :2]
                if np.linalg.norm(error) < REACH_M:
                    square = float(error @ np.linalg.solve(cov, error))
                    score = 0.5 * (square + np.linalg.slogdet(cov)[1])
                    told.setdefault(name, []).append((square, score, float(error @ error)))
    for name, rows in told.items():
        square, score, length = np.array(rows).T
        print(
            f"{name}: {len(rows)} signs, {np.mean(square < gate(0.05, 2)):.3f} inside, "
            f"{np.sqrt(np.mean(square) / 2.0):.2f} sigmas, {np.sqrt(np.mean(length)):.3f} m, "
            f"score {np.mean(score):.2f}"
        )


if __name__ == "__main__":
    main()
