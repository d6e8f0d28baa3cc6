"""How well a list's wrong classes are told from the detector's mistakes, on passes of signs.

python tests/benchmarks/listed_classes.py --data DATA --work WORK [--draws N [N ...]] [--elsewhere]

The passes are those of ``sign_probability.py``, which keeps them in WORK: held-out tracks and drawn
faces that the classifier was not trained on. A list has the true class of each, or one in 25 times
another one, half of these of the same colour and shape. Fitted on the one half are shift and slope
of ``inventory_classes``; told of the other half are, of the class as it is named with its
probability and of the shares of its views: precision and recall of what is sure, and the loss.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from automap.inventory.classes import class_ratio, of_another_class
from automap.inventory.findings import Finding, mark_sure
from automap.records import BoolArray, FloatArray
from automap.signs.classes import load_classes
from automap.vision.voting import PoolingRules, group_of, mean_shares, vote
from pipeline.train.passes import Pass
from tests.benchmarks.sign_probability import make_passes, rules_for

SETS = {"tracks, Germany": ("tracks",), "Australia": ("AU seen", "AU held"),
        "no country": ("all seen", "all held")}  # fmt: skip
WRONG = 0.04
OTHERS = 6
"""Wrong classes, of the same look and likewise of another, that each pass is asked about."""


@dataclass(frozen=True)
class Listed:
    """Listed classes [n] of passes: ``ratio`` and ``by_views`` as ``inventory_classes`` has them,
    ``by_name`` what the class named and its probability tell, ``wrong`` and their ``weight``."""

    ratio: FloatArray
    by_views: FloatArray
    by_name: FloatArray
    wrong: BoolArray
    weight: FloatArray


def listed(passes: Sequence[Pass], rng: np.random.Generator, rules: PoolingRules) -> Listed:
    """All that lists may say of the passes, which are pooled by ``rules``."""
    names, rows = list(load_classes()), []
    for one in passes:
        shares, told = dict(mean_shares(one.views)), vote(one.views, rules)
        alike = [n for n in names if group_of(n) == group_of(one.name) and n != one.name]
        unlike = [n for n in names if group_of(n) != group_of(one.name)]
        asked = [(one.name, False, 1.0 - WRONG)]
        for pool in (part for part in (alike, unlike) if part):
            weight = WRONG / OTHERS * (0.5 if alike else 1.0)
            asked += [(str(n), True, weight) for n in rng.choice(pool, OTHERS)]
        for name, wrong, weight in asked:
            same = told.name in (name, group_of(name))
            rows.append((
                class_ratio(shares, name), of_another_class(shares, name, bool(rules.foreign)),
                0.0 if same else told.probability, wrong, weight,
            ))  # fmt: skip
    table = np.array(rows, np.float64)
    ratio, by_views, by_name, wrong, weight = table.T
    return Listed(ratio, by_views, by_name, wrong > 0.0, weight / weight.sum())


def fitted(parts: Sequence[Listed]) -> FloatArray:
    """Shift and slope that are the most likely, each part counting alike."""
    from scipy.optimize import minimize

    def loss(x: FloatArray) -> float:
        odds = [np.log(WRONG / (1.0 - WRONG)) + x[0] + x[1] * p.ratio for p in parts]
        return float(sum(p.weight @ (np.logaddexp(0.0, z) - p.wrong * z)
                         for p, z in zip(parts, odds, strict=True)))  # fmt: skip

    return np.asarray(minimize(loss, np.zeros(2)).x)


def scores(right: FloatArray, part: Listed) -> str:
    """Of what is told with the map being right [n] so surely."""
    p = right * WRONG / (right * WRONG + (1.0 - right) * (1.0 - WRONG))
    # each row as often as it weighs
    often = np.maximum(np.rint(part.weight / part.weight.min()).astype(int), 1)
    found = mark_sure(
        [Finding("class", k, k, float(p[k])) for k in np.repeat(range(len(p)), often)]
    )
    sure = np.array([f.sure for f in found])
    wrong = np.repeat(part.wrong, often)
    inside = np.clip(p, 1e-4, 1.0 - 1e-4)
    loss = -part.weight @ np.log(np.where(part.wrong, inside, 1.0 - inside))
    precision = (wrong & sure).sum() / max(sure.sum(), 1)
    return f"{precision:.2f} / {(wrong & sure).sum() / wrong.sum():.2f}, loss {loss:.4f}"


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--work", type=Path, required=True)
    parser.add_argument("--draws", type=int, nargs="+", default=[0], help="which passes")
    parser.add_argument("--elsewhere", action="store_true", help="without a country alone")
    options = parser.parse_args()
    passes: dict[str, list[Pass]] = {}
    for draw in options.draws:
        for kind, of in make_passes(options.data, options.work, draw, options.elsewhere).items():
            passes.setdefault(kind, []).extend(of)
    chosen = {name: kinds for name, kinds in SETS.items() if passes.keys() >= set(kinds)}
    rng = np.random.default_rng(7)
    halves = [
        {
            name: listed(
                [p for kind in kinds for p in passes[kind] if p.check == check],
                rng,
                rules_for(kinds[0]),
            )
            for name, kinds in chosen.items()
        }
        for check in (False, True)
    ]
    for where, sets in (("at home", list(SETS)[:2]), ("elsewhere", list(SETS)[2:])):
        for half, parts in zip(("fit", "check"), halves, strict=True):
            if parts.keys() >= set(sets):
                shift, slope = fitted([parts[name] for name in sets])
                print(f"{where}, half to {half}: shift {shift:.2f}, slope {slope:.2f}")
    for name, part in halves[1].items():
        print(f"{name}: by the name {scores(part.by_name, part)}; by the views "
              f"{scores(part.by_views, part)}")  # fmt: skip


if __name__ == "__main__":
    main()
