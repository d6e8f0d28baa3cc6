"""How far the existence that a merged map tells can be believed, on simulated drives.

    python tests/benchmarks/merge_existence.py [SEEDS] [FIRST]

A street passed by one to five drives, each of which misses 8 % of the signs and tells a calibrated
existence of everything it has; 6 % of its sightings are no signs. Of these none, or 30 %, are
look-alikes that stand there for every drive and are taken for a sign by the same look; the others
each drive has alone. Printed are, by drives: map signs of all beliefs, the expected
calibration error over ten equal parts of the probability, the log loss, what is stated and what is
right by belief, and of the signs that one drive saw.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "unit"))
from inventory_case import calibrated, there_and_back
from merge_scene import Errors, drive_through, street

from automap.mapping.merge import merge_drives
from automap.mapping.sightings import DriveSigns
from automap.records import FloatArray

LENGTH_M, SPACING_M = 6000.0, 25.0
FALSE, MISSED = 0.06, 0.08
EDGES = (0.0, 0.5, 0.8, 0.9, 0.97, 0.99, 0.999, 1.001)


def rows(seed: int, drives: int, lasting: float) -> FloatArray:
    """Per sign of the merged map [m, 3]: existence told, whether it is a sign, drives."""
    rng = np.random.default_rng([seed, 31])
    town = street(rng, LENGTH_M, SPACING_M)
    n = len(town.position)
    alike = rng.random(n) < FALSE * lasting
    looks = calibrated(rng, ~alike, 1.0 - FALSE)
    parts: list[DriveSigns] = []
    known: dict[str, FloatArray] = {}
    for number in range(drives):
        errors = Errors(missed=MISSED, clutter=FALSE * (1.0 - lasting))
        drive, truth = drive_through(
            rng,
            town,
            there_and_back(LENGTH_M),
            12.0,
            f"d{number}",
            1.4e9 + 86400.0 * number,
            errors,
        )
        real = (truth >= 0) & ~alike[truth]
        told = calibrated(rng, real, 1.0 - FALSE)
        told = np.where((truth >= 0) & alike[truth], looks[truth], told)
        parts.append(replace(drive, existence=told))
        known[drive.name] = real.astype(np.float64)
    merged = merge_drives(parts)
    s, m = merged.sightings, len(merged)
    real = np.array([known[merged.drives[d].name][r] for d, r in zip(s.drive, s.row, strict=True)])
    sign = merged.sign
    share = np.bincount(sign, real, m) / np.bincount(sign, minlength=m)
    seen_by = [len(drives) for drives in merged.attributes.drives]
    return np.column_stack([merged.existence, share > 0.5, seen_by])


def calibration_error(told: FloatArray, right: FloatArray) -> float:
    """Expected calibration error over ten equal parts of the probability."""
    part = np.minimum((told * 10.0).astype(np.int64), 9)
    gap = np.bincount(part, told - right, 10)
    return float(np.abs(gap).sum() / len(told))


def main(seeds: int, first: int) -> None:
    """Print the tables."""
    for lasting in (0.0, 0.3):
        for drives in (1, 2, 3, 5):
            found = np.vstack([rows(seed, drives, lasting) for seed in range(first, first + seeds)])
            told, right, by = found.T
            p = np.clip(told, 1e-6, 1.0 - 1e-6)
            loss = -np.log(np.where(right > 0.0, p, 1.0 - p)).sum()
            print(
                f"lasting {lasting}, {drives} drives: {len(told)} signs, calibration error "
                f"{calibration_error(told, right):.3f}, log loss {loss:.1f}",
                flush=True,
            )
            for low, high in pairwise(EDGES):
                part = (told >= low) & (told < high)
                if part.any():
                    print(f"  {told[part].mean():.4f} {right[part].mean():.4f} of {part.sum()}")
            alone = by == 1
            print(
                f"  one drive {told[alone].mean():.3f} {right[alone].mean():.3f} of {alone.sum()}"
            )


if __name__ == "__main__":
    main(*(int(word) for word in [*sys.argv[1:], *("8", "100")[len(sys.argv) - 1 :]]))
