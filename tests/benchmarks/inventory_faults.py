"""How well a comparison finds faults put into an inventory, on simulated drives of many seeds.

``python tests/benchmarks/inventory_faults.py [SEEDS] [FIRST]`` in the project's folder prints, for
a map without errors of its own kind, for one drive as it usually is (8 % missed, 3 % false, 3 %
misread) and for merged maps of two, three and five such, per kind: due; all statements told, their
precision and recall; the sure ones, likewise. Then how often statements of each probability were
right.
"""

from __future__ import annotations

import sys
from itertools import pairwise
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "unit"))
from inventory_case import CLEAN, KINDS, correct, due, faulty, merged_town, town_and_drive
from merge_scene import Errors

from automap.inventory.comparison import compare_inventory

EDGES = (0.0, 0.5, 0.8, 0.9, 0.95, 0.99, 1.001)


def main(seeds: int, first: int) -> None:
    """Print the tables."""
    for label, make in (
        ("clean map, one drive", lambda seed: town_and_drive(seed, 6000.0, CLEAN)),
        ("one drive", lambda seed: town_and_drive(seed, 6000.0, Errors())),
        ("two drives, merged", lambda seed: merged_town(seed, 2, 6000.0, Errors())),
        ("three drives, merged", lambda seed: merged_town(seed, 3, 6000.0, Errors())),
        ("five drives, merged", lambda seed: merged_town(seed, 5, 6000.0, Errors())),
    ):
        rows: dict[str, list[tuple[float, bool, bool]]] = {kind: [] for kind in KINDS}
        wanted = dict.fromkeys(KINDS, 0)
        for seed in range(first, first + seeds):
            rng, town, drives, truth, signs = make(seed)
            case = faulty(rng, town)
            result = compare_inventory(signs, case.inventory, drives)
            for kind in KINDS:
                wanted[kind] += due(result, case, truth, kind)
            for finding in result.findings:
                if finding.kind in KINDS:
                    right = correct(finding, case, truth)
                    rows[finding.kind].append((finding.probability, right, finding.sure))
        print(f"{label}\n  kind       due  told  prec  rec   sure  prec  rec")
        for kind in KINDS:
            print(f"  {kind:8} {wanted[kind]:5}", end="")
            for only_sure in (False, True):
                told = [right for _, right, sure in rows[kind] if sure or not only_sure]
                good = sum(told)
                print(f"  {len(told):5} {good / max(len(told), 1):.2f} ", end="")
                print(f"{good / max(wanted[kind], 1):.2f}", end="")
            print()
        every = np.array([row for kind in KINDS if kind != "matched" for row in rows[kind]])
        for low, high in pairwise(EDGES):
            part = every[(every[:, 0] >= low) & (every[:, 0] < high)]
            if len(part):
                stated, true, _ = part.mean(axis=0)
                print(f"  stated {stated:.3f}: right {true:.3f} of {len(part)}")


if __name__ == "__main__":
    main(
        int(sys.argv[1]) if len(sys.argv) > 1 else 8,
        int(sys.argv[2]) if len(sys.argv) > 2 else 100,
    )
