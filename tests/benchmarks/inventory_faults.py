"""How well a comparison finds faults put into an inventory, on simulated drives of many seeds.

``python tests/benchmarks/inventory_faults.py [SEEDS]`` in the project's folder prints, for a
map without errors of its own kind and for one drive as it usually is (8 % missed, 3 % false, 3 %
misread), per kind: right, told, due, precision, recall.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "unit"))
from merge_scene import Errors
from test_inventory import CLEAN, KINDS, faulty, judged, town_and_drive

from automap.mapping.inventory import compare_inventory


def main(seeds: int) -> None:
    """Print the table."""
    for label, errors in (("clean map", CLEAN), ("single drive", Errors())):
        total = {kind: np.zeros(3, np.int64) for kind in KINDS}
        for seed in range(100, 100 + seeds):
            rng, town, drives, truth, signs = town_and_drive(seed, 6000.0, errors)
            case = faulty(rng, town)
            result = compare_inventory(signs, case.inventory, drives)
            for kind, counts in judged(result, case, truth).items():
                total[kind] += counts
        print(label)
        for kind, (right, told, due) in total.items():
            print(
                f"  {kind:8} {right:5} {told:5} {due:5}  "
                f"{right / max(told, 1):.3f} {right / max(due, 1):.3f}"
            )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 8)
