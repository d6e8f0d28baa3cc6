"""How far the probabilities of whole signs, class and group, can be believed.

python tests/benchmarks/sign_probability.py --data DATA --work WORK [--fit] [--picture FILE]
    [--draws N [N ...]] [--elsewhere]

Passes of signs that the classifier was not trained on: held-out tracks of GTSRB at home, and drawn
faces set into held-out streets, of Australia with its country's set and of all countries without
one. Half of the drawings and tracks are to fit, half to check; the figures are of the latter.
With ``--fit`` each half is told by what the other makes most likely, and the figures are of both.
``--draws`` makes passes of the same drawings anew, ``--elsewhere`` those of all countries alone.
How far passes of one drawing are right together (a normal copula, with the correlation that their
errors show) is in what chance would show of probabilities that are exactly right.
WORK keeps the passes (minutes of processor time). Needs ``pip install 'automap[training]'``.
"""

from __future__ import annotations

import argparse
import pickle
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from zlib import crc32

import cv2
import numpy as np
from scipy.optimize import minimize

from automap.records import FloatArray
from automap.signs.classes import load_classes
from automap.vision.classifier import SignClassifier
from automap.vision.voting import PoolingRules, group_of, pooling, tempered, vote
from pipeline.train.art import load_faces
from pipeline.train.passes import (
    Pass,
    drawn_passes,
    held_faces,
    seen_faces,
    track_passes,
)
from pipeline.train.street_data import load_streets
from tests.benchmarks.calibration import bins, by_chance, calibration_error

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
COUNTS = {"AU": 1100, "": 1000}
"""Passes of each kind of drawn faces."""
CORRELATIONS = (0.1, 0.25, 0.5, 1.0)
SURE = 0.9


@dataclass(frozen=True)
class Claims:
    """What was told of passes [n] and whether it is right; ``named`` whether a class was named,
    ``weight`` of each pass, and a number for its ``drawing``."""

    probability: FloatArray
    right: FloatArray
    group_probability: FloatArray
    group_right: FloatArray
    named: FloatArray
    weight: FloatArray
    drawing: FloatArray


def make_passes(
    data: Path, work: Path, draw: int = 0, elsewhere: bool = False
) -> dict[str, list[Pass]]:
    """All passes by kind, or those ``elsewhere`` alone, kept in ``work``; of another ``draw`` from
    the same drawings."""
    kept = work / f"passes{f'-{draw}' if draw else ''}{'-elsewhere' if elsewhere else ''}.pickle"
    if kept.is_file():
        with kept.open("rb") as stream:
            passes: dict[str, list[Pass]] = pickle.load(stream)
        return passes
    faces = load_faces(data / "sign-art", work / "faces.pkl")
    streets = load_streets(data / "gtsdb", "tune")
    passes = {}
    if not elsewhere:
        home = SignClassifier("DE")
        passes["tracks"] = track_passes(data / "gtsrb", "tune", home)
        passes["tracks"] += track_passes(data / "gtsrb", "test", home)
    for country, count in COUNTS.items():
        if country and elsewhere:
            continue
        name, classifier = country or "all", SignClassifier(country or None)
        known, unknown = held_faces(faces, country)
        seen = seen_faces(faces, country)
        seen = [seen[i] for i in np.random.default_rng(3).permutation(len(seen))]
        for kind, drawn, number, seed in (
            ("seen", seen, count * 2 // 3, 33),
            ("held", known, count, 31),
            ("unknown", unknown, count, 32),
        ):
            passes[f"{name} {kind}"] = drawn_passes(
                drawn, streets, classifier, number, seed + 10 * draw
            )
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
        drawing = float(crc32(one.drawing.encode()))
        rows.append(
            (told.probability, right, told.group_probability, of_group, named, 1.0, drawing)
        )
    return Claims(*np.array(rows, np.float64).T)


def parts_of(passes: dict[str, list[Pass]], check: bool, fit: bool) -> dict[str, Claims]:
    """What is told of one half, by kind; with what the other half makes most likely, if wanted."""
    half, other = (
        {kind: [p for p in of if p.check == which] for kind, of in passes.items()}
        for which in (check, not check)
    )
    homes = {_at_home(kind) for kind in passes} if fit else set()
    anew = {home: fitted(other, home) for home in sorted(homes)}
    return {
        kind: claims(of, replace(rules_for(kind), **anew.get(_at_home(kind), {})))
        for kind, of in half.items()
    }


def together(parts: Sequence[Claims]) -> Claims:
    """Several claims as one."""
    names = Claims.__dataclass_fields__
    return Claims(*(np.concatenate([getattr(c, n) for c in parts]) for n in names))


def mixed(parts: dict[str, Claims], shares: dict[str, float]) -> Claims:
    """Several kinds together, each with its share of the weight."""
    chosen = [
        replace(parts[kind], weight=np.full(len(parts[kind].named), share / len(parts[kind].named)))
        for kind, share in shares.items()
    ]
    return together(chosen)


def rules_for(kind: str) -> PoolingRules:
    """How passes of a kind are pooled."""
    return pooling(COUNTRY[kind.split()[0]])


def fitted(passes: dict[str, list[Pass]], at_home: bool) -> dict[str, Any]:
    """Correlation, powers and, where no set is known, shift and lapse, by their names among the
    rules, that make passes the most likely, of the kinds that had the country's set, or had none.
    """
    best: tuple[float, dict[str, Any]] | None = None
    passes = {k: of for k, of in passes.items() if _at_home(k) == at_home}
    plain: dict[str, Any] = {
        "class_power": 1.0, "group_power": 1.0, "class_shift": 0.0, "group_lapse": 0.0,
        "named": 0.0,
    }  # fmt: skip
    for correlation in CORRELATIONS:
        # everything is named, so that the class claimed does not hang on its own probability
        parts = {
            kind: claims(of, replace(rules_for(kind), correlation=correlation, **plain))
            for kind, of in passes.items()
        }
        whole = pooled_mixes(parts)
        of_class, loss = _likeliest(
            whole.probability, whole.right, whole.weight, not at_home, False
        )
        of_group, other = _likeliest(
            whole.group_probability, whole.group_right, whole.weight, False, not at_home
        )
        print(f"{'at home' if at_home else 'elsewhere'}, correlation {correlation}: power of the "
              f"class {of_class[0]:.2f}, shift {of_class[1]:.2f}, of the group {of_group[0]:.2f}, "
              f"lapse {of_group[2]:.3f}, loss {loss:.4f} + {other:.4f}", flush=True)  # fmt: skip
        if best is None or loss + other < best[0]:
            found = {"class_power": of_class[0], "class_shift": of_class[1]}
            found |= {"group_power": of_group[0], "group_lapse": of_group[2]}
            best = loss + other, {"correlation": correlation, **found}
    assert best is not None
    return best[1]


def _at_home(kind: str) -> bool:
    return COUNTRY[kind.split()[0]] is not None


def _likeliest(
    p: FloatArray, right: FloatArray, weight: FloatArray, shifted: bool, lapsing: bool
) -> tuple[tuple[float, float, float], float]:
    """The power of the odds, the shift of their logarithm and the share of lapses with the least
    logarithmic loss, and the loss; shift and share are zero where not wanted."""

    def loss(x: FloatArray) -> float:
        told = np.array([tempered(share, *x.tolist()) for share in p.tolist()])
        return float(-weight @ np.log(np.where(right > 0, told, 1.0 - told)) / weight.sum())

    limits = [(0.05, 3.0), (-3.0, 3.0) if shifted else (0.0, 0.0), (0.0, 0.2 if lapsing else 0.0)]
    found = minimize(loss, [0.5, 0.0, 0.01 if lapsing else 0.0], bounds=limits)
    power, shift, lapse = found.x.tolist()
    return (power, shift, lapse), float(found.fun)


def pooled_mixes(parts: dict[str, Claims]) -> Claims:
    """All mixes of these parts with equal weight."""
    return together(
        [mixed(parts, shares) for shares in MIXES.values() if shares.keys() <= parts.keys()]
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
    parser.add_argument("--draws", type=int, nargs="+", default=[0], help="which passes")
    parser.add_argument("--elsewhere", action="store_true", help="without a country alone")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    passes: dict[str, list[Pass]] = {}
    for draw in options.draws:
        for kind, of in make_passes(options.data, options.work, draw, options.elsewhere).items():
            passes.setdefault(kind, []).extend(of)
    halves = [True, False] if options.fit else [True]
    each = [parts_of(passes, check, options.fit) for check in halves]
    parts = {kind: together([of[kind] for of in each]) for kind in passes}
    if options.fit:
        for home in sorted({_at_home(kind) for kind in passes}):
            print(f"of both halves: {fitted(passes, home)}")
    for kind, c in parts.items():
        wrong = c.named * (1.0 - c.right)
        print(f"{kind:12s} {len(c.named):4d} passes: a class named {c.named.mean():.3f}, what is "
              f"told is right {c.right.mean():.3f}, a wrong name {wrong.mean():.3f}, one above "
              f"{SURE} {(wrong * (c.probability > SURE)).mean():.4f}")  # fmt: skip
    found = {name: mixed(parts, s) for name, s in MIXES.items() if s.keys() <= parts.keys()}
    for name, c in {**found, "all together": pooled_mixes(parts)}.items():
        wrong_and_sure = c.named * (1.0 - c.right) * (c.probability > SURE)
        of_all = c.weight @ wrong_and_sure / c.weight.sum()
        errors = []
        for told, right in ((c.probability, c.right), (c.group_probability, c.group_right)):
            chance = by_chance(told, right, c.weight, c.drawing)
            errors.append(
                f"{calibration_error(told, right, c.weight):.3f} (by chance {chance:.3f})"
            )
        print(f"{name}: expected calibration error of the class {errors[0]}, of the group "
              f"{errors[1]}; wrong and sure {of_all:.4f}")  # fmt: skip
    if options.picture is not None:
        picture(options.picture, {**found, "all together": pooled_mixes(parts)})


if __name__ == "__main__":
    main()
