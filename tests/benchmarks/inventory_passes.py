"""Inventories with known faults against maps whose classes the sign classifier itself read.

python tests/benchmarks/inventory_passes.py --data DATA --work WORK [--seeds N] [--first N]
    [--faces N [N ...]]

Street, boxes, path and list are those of ``inventory_world.py`` with one drive; but a sign shows
the face of a pass of ``sign_probability.py`` (WORK keeps them), of the half to check, and the map
has what the classifier makes of it: the class that it names or none, its probability, and what the
views give to each class. Of the list's wrong classes half have the same colour and shape. Printed
are, per kind, how many are due and told for sure, with precision and recall, and the same where all
lists are one, in which more is sure: of four findings one that is doubted is a quarter; and of the
findings of another class that are likelier than not, what is stated and how many are right.
``--faces`` draws other faces for the same streets, once for each number.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "unit"))
from inventory_case import KINDS, correct, due

from automap.inventory.comparison import compare_inventory
from automap.inventory.findings import Finding, mark_sure
from automap.signs.classes import load_classes
from automap.vision.voting import PoolingRules, group_of, mean_shares, vote
from pipeline.train.passes import Pass
from tests.benchmarks.inventory_world import Case, case
from tests.benchmarks.listed_classes import SETS
from tests.benchmarks.sign_probability import make_passes, rules_for

Shares = list[dict[str, float]]


def with_passes(
    one: Case, passes: Sequence[Pass], seed: int, rules: PoolingRules
) -> tuple[Case, Shares]:
    """The case with faces of the passes, pooled by ``rules``, and what their views give to each
    class."""
    rng = np.random.default_rng([seed, 9])
    n = int(max(one.truth.max(initial=0), one.faulty.origin.max(initial=0))) + 1
    shown = [passes[k] for k in rng.integers(0, len(passes), n).tolist()]
    listed = list(one.faulty.inventory.class_name)
    for row, (origin, kind) in enumerate(
        zip(one.faulty.origin.tolist(), one.faulty.kind.tolist(), strict=True)
    ):
        face = shown[origin].name if origin >= 0 else passes[int(rng.integers(len(passes)))].name
        listed[row] = _another(face, rng) if kind == "class" else face
    signs, shares = [], []
    for sign, true in zip(one.signs, one.truth.tolist(), strict=True):
        views = (shown[true] if true >= 0 else passes[int(rng.integers(len(passes)))]).views
        told = vote(views, rules)
        signs.append(replace(
            sign, class_name=told.name, class_probability=told.probability,
            group_probability=told.group_probability,
            confidence=sign.existence * told.probability,
        ))  # fmt: skip
        shares.append(dict(mean_shares(views)))
    inventory = replace(one.faulty.inventory, class_name=listed)
    return replace(one, signs=signs, faulty=replace(one.faulty, inventory=inventory)), shares


def _another(name: str, rng: np.random.Generator) -> str:
    alike = [n for n in load_classes() if group_of(n) == group_of(name) and n != name]
    others = [n for n in load_classes() if group_of(n) != group_of(name)]
    return str(rng.choice(alike if alike and rng.random() < 0.5 else others))


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--work", type=Path, required=True)
    parser.add_argument("--seeds", type=int, default=4)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument(
        "--faces", type=int, nargs="+", default=[0], help="added to the seed of the faces"
    )
    options = parser.parse_args()
    kept = make_passes(options.data, options.work)
    seeds = range(options.first, options.first + options.seeds)
    cases = {seed: case(seed, 1) for seed in seeds}
    for name, kinds in SETS.items():
        passes = [p for kind in kinds for p in kept[kind] if p.check]
        for how in ("by the name", "by the views"):
            wanted = dict.fromkeys(KINDS, 0)
            told: list[tuple[Finding, bool]] = []
            for seed, faces in product(cases, options.faces):
                rules = rules_for(kinds[0])
                one, shares = with_passes(cases[seed], passes, seed + faces, rules)
                given = shares if how == "by the views" else []
                at_home = bool(rules.foreign)
                result = compare_inventory(
                    one.signs, one.faulty.inventory, one.drives, given, at_home
                )
                for kind in KINDS:
                    wanted[kind] += due(result, one.faulty, one.truth, kind)
                told += [
                    (f, correct(f, one.faulty, one.truth))
                    for f in result.findings
                    if f.kind in KINDS
                ]
            print(f"{name}, {how}")
            as_one = mark_sure([replace(f, sure=False) for f, _ in told])
            for kind in KINDS:
                text = ""
                for findings in ([f for f, _ in told], as_one):
                    right = [
                        r for f, (_, r) in zip(findings, told, strict=True)
                        if f.sure and f.kind == kind
                    ]  # fmt: skip
                    good, n = sum(right), max(wanted[kind], 1)
                    text += f"  {len(right):5} {good / max(len(right), 1):.2f} {good / n:.2f}"
                print(f"  {kind:8} {wanted[kind]:5}{text}", flush=True)
            likely = [(f.probability, r) for f, r in told if f.kind == "class"]
            stated, right = np.array([row for row in likely if row[0] > 0.5] or [(0.5, 0.0)]).T
            print(f"  stated {stated.mean():.3f}: right {right.sum():.0f} of {len(right)}")


if __name__ == "__main__":
    main()
