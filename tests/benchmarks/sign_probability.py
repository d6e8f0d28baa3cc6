"""How far the probabilities of whole signs, class and group, can be believed.

python tests/benchmarks/sign_probability.py --data DATA --work WORK [--fit] [--picture FILE]

Passes of signs that the classifier was not trained on: held-out tracks of GTSRB at home, and drawn
faces set into held-out streets, of Australia with its country's set and of all countries without
one. Half of the drawings and tracks are to fit, half to check; the figures are of the latter.
WORK keeps the passes (minutes of processor time). Needs ``pip install 'automap[training]'``.
"""

from __future__ import annotations

import argparse
import pickle
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from scipy.optimize import minimize_scalar

from automap.records import FloatArray
from automap.signs.classes import load_classes
from automap.vision.classifier import SignClassifier
from automap.vision.voting import PoolingRules, group_of, pooling, vote
from pipeline.train.art import load_faces
from pipeline.train.passes import (
    Pass,
    drawn_passes,
    held_faces,
    seen_faces,
    track_passes,
)
from pipeline.train.street_data import load_streets

MIXES = {
    "German streets, tracks": {"tracks": 1.0},
    "Australian faces, drawn": {"AU seen": 0.58, "AU held": 0.29, "AU unknown": 0.13},
    "all countries', drawn": {"all seen": 0.25, "all held": 0.25, "all unknown": 0.5},
}
"""Shares of the kinds of passes: faces of no class are one in seven at home, one in two elsewhere,
as the classifier takes them to be (``limits.ODDS_AT_HOME``); of the classes two in three, or one in
two, look like a drawing that was trained on."""
COUNTRY = {"tracks": "DE", "AU": "AU", "all": None}
"""Whose set of signs the classifier knew, by the first word of a kind."""
COUNTS = {"AU": 1100, "": 500}
"""Passes of each kind of drawn faces."""
CORRELATIONS = (0.1, 0.25, 0.5, 1.0)
SURE, BINS = 0.9, 10
CHANCES = 200


@dataclass(frozen=True)
class Claims:
    """What was told of passes [n] and whether it is right; ``named`` whether a class was named,
    and ``weight`` of each pass."""

    probability: FloatArray
    right: FloatArray
    group_probability: FloatArray
    group_right: FloatArray
    named: FloatArray
    weight: FloatArray


def make_passes(data: Path, work: Path) -> dict[str, list[Pass]]:
    """All passes by kind, kept in ``work``."""
    kept = work / "passes.pickle"
    if kept.is_file():
        with kept.open("rb") as stream:
            passes: dict[str, list[Pass]] = pickle.load(stream)
        return passes
    faces = load_faces(data / "sign-art", work / "faces.pkl")
    streets = load_streets(data / "gtsdb", "tune")
    home = SignClassifier("DE")
    passes = {
        "tracks": track_passes(data / "gtsrb", "tune", home)
        + track_passes(data / "gtsrb", "test", home)
    }
    for country, count in COUNTS.items():
        name, classifier = country or "all", SignClassifier(country or None)
        known, unknown = held_faces(faces, country)
        seen = seen_faces(faces, country)
        seen = [seen[i] for i in np.random.default_rng(3).permutation(len(seen))]
        for kind, drawn, number, seed in (
            ("seen", seen, count * 2 // 3, 33),
            ("held", known, count, 31),
            ("unknown", unknown, count, 32),
        ):
            passes[f"{name} {kind}"] = drawn_passes(drawn, streets, classifier, number, seed)
    with kept.open("wb") as stream:
        pickle.dump(passes, stream)
    return passes


def claims(passes: Sequence[Pass], rules: PoolingRules) -> Claims:
    """What is told of the passes."""
    rows = []
    for one in passes:
        told, truth = vote(one.views, rules), group_of(one.name) or one.name
        of_group = (group_of(told.name) or told.name) == truth
        named = told.name in load_classes()
        right = told.name == one.name if named else of_group
        rows.append((told.probability, right, told.group_probability, of_group, named, 1.0))
    return Claims(*np.array(rows, np.float64).T)


def mixed(parts: dict[str, Claims], shares: dict[str, float]) -> Claims:
    """Several kinds together, each with its share of the weight."""
    chosen = [
        replace(parts[kind], weight=np.full(len(parts[kind].named), share / len(parts[kind].named)))
        for kind, share in shares.items()
    ]
    return Claims(
        *(np.concatenate([getattr(c, n) for c in chosen]) for n in Claims.__dataclass_fields__)
    )


def calibration_error(probability: FloatArray, right: FloatArray, weight: FloatArray) -> float:
    """Expected calibration error by bins of equal weight."""
    return float(sum(w * abs(p - y) for p, y, w in bins(probability, right, weight)))


def by_chance(probability: FloatArray, weight: FloatArray) -> float:
    """The median calibration error of passes whose probabilities are exactly right."""
    rng = np.random.default_rng(7)
    drawn = [(rng.random(len(probability)) < probability).astype(float) for _ in range(CHANCES)]
    return float(np.median([calibration_error(probability, right, weight) for right in drawn]))


def bins(
    probability: FloatArray, right: FloatArray, weight: FloatArray
) -> list[tuple[float, float, float]]:
    """Mean probability, share right and weight of bins of equal weight."""
    order = np.argsort(probability, kind="stable")
    place = np.cumsum(weight[order]) / weight.sum()
    number = np.minimum((place * BINS - 1e-9).astype(int), BINS - 1)
    found = []
    for k in np.unique(number):
        rows = order[number == k]
        share = weight[rows] / weight[rows].sum()
        mean = float(share @ probability[rows]), float(share @ right[rows])
        found.append((*mean, float(weight[rows].sum() / weight.sum())))
    return found


def rules_for(kind: str) -> PoolingRules:
    """How passes of a kind are pooled."""
    return pooling(COUNTRY[kind.split()[0]])


def fitted(passes: dict[str, list[Pass]], at_home: bool) -> dict[str, Any]:
    """The correlation and powers, by their names among the rules, that make the half to fit the
    most likely, of the kinds that had the country's set, or that had none."""
    best: tuple[float, dict[str, Any]] | None = None
    passes = {k: of for k, of in passes.items() if _at_home(k) == at_home}
    plain: dict[str, Any] = {"class_power": 1.0, "group_power": 1.0, "named": 0.0}
    for correlation in CORRELATIONS:
        # everything is named, so that the class claimed does not hang on its own probability
        parts = {
            kind: claims(
                [p for p in of if not p.check],
                replace(rules_for(kind), correlation=correlation, **plain),
            )
            for kind, of in passes.items()
        }
        whole = pooled_mixes(parts)
        by_class = _power(whole.probability, whole.right, whole.weight)
        by_group = _power(whole.group_probability, whole.group_right, whole.weight)
        loss = by_class[1] + by_group[1]
        place = "at home" if at_home else "elsewhere"
        print(f"{place}, correlation {correlation}: powers {by_class[0]:.2f}, {by_group[0]:.2f}, "
              f"loss {by_class[1]:.4f} + {by_group[1]:.4f}", flush=True)  # fmt: skip
        if best is None or loss < best[0]:
            found = {"class_power": by_class[0], "group_power": by_group[0]}
            best = loss, {"correlation": correlation, **found}
    assert best is not None
    return best[1]


def _at_home(kind: str) -> bool:
    return COUNTRY[kind.split()[0]] is not None


def _power(p: FloatArray, right: FloatArray, weight: FloatArray) -> tuple[float, float]:
    """The power of the odds with the least logarithmic loss, and the loss."""
    clipped = np.clip(p, 1e-7, 1 - 1e-7)
    odds = np.log(clipped / (1 - clipped))

    def loss(power: float) -> float:
        z = power * odds
        return float(weight @ (np.logaddexp(0.0, z) - right * z) / weight.sum())

    found = minimize_scalar(loss, bounds=(0.05, 3.0), method="bounded")
    return float(found.x), float(found.fun)


def pooled_mixes(parts: dict[str, Claims]) -> Claims:
    """All mixes of these parts with equal weight."""
    each = [mixed(parts, shares) for shares in MIXES.values() if shares.keys() <= parts.keys()]
    return Claims(
        *(np.concatenate([getattr(c, n) for c in each]) for n in Claims.__dataclass_fields__)
    )


def picture(path: Path, found: dict[str, Claims]) -> None:
    """The reliability diagram of class and group."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(1, 2, figsize=(8.4, 4.2), sharey=True, layout="constrained")
    for axis, what in zip(axes, ("class", "group"), strict=True):
        axis.plot([0, 1], [0, 1], color="0.7", linewidth=1)
        for label, c in found.items():
            p, right = (
                (c.probability, c.right)
                if what == "class"
                else (c.group_probability, c.group_right)
            )
            points = np.array(bins(p, right, c.weight))
            axis.plot(points[:, 0], points[:, 1], marker="o", markersize=4, label=label)
        axis.set(xlabel=f"probability told of the {what}", xlim=(0.3, 1.01), ylim=(0.3, 1.02))
    axes[0].set_ylabel("share that is right")
    axes[0].legend(loc="upper left", fontsize=8)
    figure.savefig(path, dpi=90)


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--work", type=Path, required=True)
    parser.add_argument("--fit", action="store_true", help="fit anew, on the half to fit")
    parser.add_argument("--picture", type=Path, help="where to draw the diagram")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    passes = make_passes(options.data, options.work)
    anew = {home: fitted(passes, home) for home in (True, False)} if options.fit else {}
    parts = {
        kind: claims(
            [p for p in of if p.check], replace(rules_for(kind), **anew.get(_at_home(kind), {}))
        )
        for kind, of in passes.items()
    }
    for kind, c in parts.items():
        wrong = c.named * (1.0 - c.right)
        print(f"{kind:12s} {len(c.named):4d} passes: a class named {c.named.mean():.3f}, what is "
              f"told is right {c.right.mean():.3f}, a wrong name {wrong.mean():.3f}, one above "
              f"{SURE} {(wrong * (c.probability > SURE)).mean():.4f}")  # fmt: skip
    found = {name: mixed(parts, shares) for name, shares in MIXES.items()}
    for name, c in {**found, "all three": pooled_mixes(parts)}.items():
        wrong_and_sure = c.named * (1.0 - c.right) * (c.probability > SURE)
        print(f"{name}: expected calibration error of the class "
              f"{calibration_error(c.probability, c.right, c.weight):.3f} (by chance "
              f"{by_chance(c.probability, c.weight):.3f}), of the group "
              f"{calibration_error(c.group_probability, c.group_right, c.weight):.3f} (by chance "
              f"{by_chance(c.group_probability, c.weight):.3f}); wrong and "
              f"sure {c.weight @ wrong_and_sure / c.weight.sum():.4f}")  # fmt: skip
    if options.picture is not None:
        picture(options.picture, {**found, "all three": pooled_mixes(parts)})


if __name__ == "__main__":
    main()
