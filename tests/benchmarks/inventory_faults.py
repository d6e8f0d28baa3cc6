"""How well a comparison finds faults put into an inventory, on simulated drives of many seeds.

``python tests/benchmarks/inventory_faults.py [SEEDS] [FIRST]`` in the project's folder prints, for
a map without errors of its own kind, for one drive as it usually is (8 % missed, 3 % false, 3 %
misread) and for merged maps of two, three and five such, per kind: due; all statements told,
their precision and recall; the sure ones, likewise. "At most" is the recall that an order by the
map's own beliefs leaves to whoever knows every pair, where nine of ten of each list are to be
right: of new signs beside what is none, of wrong classes beside misread ones. Then how often
statements of each probability were right.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "unit"))
from inventory_case import CLEAN, KINDS, Faulty, correct, due, faulty, merged_town, town_and_drive
from merge_scene import Errors

from automap.inventory.comparison import compare_inventory
from automap.inventory.findings import class_belief, existence_belief
from automap.inventory.limits import SURE
from automap.records import IntArray, Sign

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
        beliefs: dict[str, list[list[tuple[float, bool]]]] = {"new": [], "class": []}
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
            for kind, told in believed(signs, case, truth).items():
                beliefs[kind].append(told)
        print(f"{label}\n  kind       due  told  prec  rec   sure  prec  rec")
        for kind in KINDS:
            print(f"  {kind:8} {wanted[kind]:5}", end="")
            for only_sure in (False, True):
                told = [right for _, right, sure in rows[kind] if sure or not only_sure]
                good = sum(told)
                print(f"  {len(told):5} {good / max(len(told), 1):.2f} ", end="")
                print(f"{good / max(wanted[kind], 1):.2f}", end="")
            print(f"  at most {at_most(beliefs[kind]):.2f}" if beliefs.get(kind) else "")
        every = np.array([row for kind in KINDS if kind != "matched" for row in rows[kind]])
        for low, high in pairwise(EDGES):
            part = every[(every[:, 0] >= low) & (every[:, 0] < high)]
            if len(part):
                stated, true, _ = part.mean(axis=0)
                print(f"  stated {stated:.3f}: right {true:.3f} of {len(part)}")


def believed(
    signs: Sequence[Sign], case: Faulty, truth: IntArray
) -> dict[str, list[tuple[float, bool]]]:
    """The map's beliefs in what is new, or is none, and in the classes of signs that the list calls
    otherwise; whether each is due."""
    row = {int(k): r for r, k in enumerate(case.origin) if k >= 0}
    told: dict[str, list[tuple[float, bool]]] = {"new": [], "class": []}
    for sign, k in zip(signs, truth.tolist(), strict=True):
        if k < 0 or k in case.deleted:
            told["new"].append((existence_belief(sign), k >= 0))
        elif case.inventory.class_name[row[k]] != sign.class_name:
            told["class"].append((class_belief(sign), bool(case.kind[row[k]] == "class")))
    return told


def at_most(lists: Sequence[list[tuple[float, bool]]]) -> float:
    """The largest recall of the most believed of each list, as long as ``SURE`` of them are due."""
    best = total = 0.0
    for beliefs in lists:
        right = np.array([due for _, due in sorted(beliefs, reverse=True)], np.float64)
        found = np.cumsum(right)
        good = found >= SURE * np.arange(1, len(right) + 1)
        best, total = best + float(found[good].max(initial=0.0)), total + float(right.sum())
    return best / max(total, 1.0)


if __name__ == "__main__":
    main(
        int(sys.argv[1]) if len(sys.argv) > 1 else 8,
        int(sys.argv[2]) if len(sys.argv) > 2 else 100,
    )
