"""Whether the probabilities of existence are what happens: simulated drives with much clutter.

    python tests/benchmarks/geolocation_existence.py [--drives N] [--first SEED] [--seconds S]
        [--scores calibrated|apart]

Besides single false boxes there are things that stay: a part of what is boxed in every frame is
made a thing of a sign's size, found at a rate q of which each is 1 / q times as likely, from 0.03
on, with the scores of false boxes; another part a wall of three to eight metres. Before some of the
signs a lorry drives for half a second to four seconds. Scores are probabilities that a box shows a
sign, as those of the shipped detector are: of all boxes with a score s the part s does, and the
boxes of one thing have nearly the same; or, ``apart``, evenly spread from 0.6 to 1 for signs and
from 0.3 to 0.8 for all else, anew for each box, which is no probability. Everything that boxes were
joined to is asked, also what the map leaves out: how often things of a probability are signs, and
the expected calibration error (Naeini, Cooper and Hauskrecht, AAAI 2015) over eight bins; and by
itself of the things that stay and of the signs behind lorries.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from unittest.mock import patch

import numpy as np
from scipy.special import expit, logit

from automap.geolocation import locate
from automap.geolocation.rules import GeolocationRules
from automap.records import BoolArray, FloatArray, IntArray, Looked
from tests.benchmarks.geolocation_facing import ROUND
from tests.benchmarks.geolocation_world import Difficulty, World, make_world

EDGES = np.array([0.0, 0.05, 0.2, 0.4, 0.6, 0.8, 0.95, 0.99, 1.0])
CLUTTER, SIGN, BEHIND, THING, WALL, COPY = range(6)
"""What a box shows: nothing that stays, a sign, a sign that a lorry hides for a while, a thing of a
sign's size, a wall; and a sign that stands elsewhere in the map."""
SHARPNESS, JITTER = 1.0, 0.5
"""Sum of the beta parameters of all boxes' scores, which is the less the more a detector knows; and
by how much the log odds of one thing's boxes differ. Chosen."""
LEAST_RATE, THINGS, WALLS, LORRIES = 0.03, 0.2, 0.05, 0.15


@dataclass(frozen=True)
class Street:
    """A ``world`` and what each of its boxes shows, ``kind`` [n]."""

    world: World
    kind: IntArray


def street(seed: int, d: Difficulty, apart: bool = False) -> Street:
    """A drive of ``geolocation_world.py`` with things, walls and lorries."""
    world = make_world(seed, d)
    rng = np.random.default_rng([seed, 11])
    found, owner = world.detections, world.owner
    of_sign = rng.choice(
        [SIGN, BEHIND, THING, WALL],
        len(world.position),
        p=[1.0 - THINGS - WALLS - LORRIES, LORRIES, THINGS, WALLS],
    )
    box, score, keep = found.box.copy(), found.score.copy(), np.ones(len(found), np.bool_)
    for number, kind in enumerate(of_sign.tolist()):
        rows = np.flatnonzero(owner == number)
        if not len(rows):
            continue
        if kind == THING:
            keep[rows] = rng.random(len(rows)) < LEAST_RATE ** rng.random()
        elif kind == BEHIND:
            begin = rng.choice(found.t_ns[rows]) - 2e9 * rng.random()
            hidden = (found.t_ns[rows] - begin) * 1e-9
            keep[rows] = (hidden < 0.0) | (hidden > rng.uniform(0.5, 4.0))
        elif kind == WALL:
            middle = np.tile(0.5 * (box[rows, :2] + box[rows, 2:]), 2)
            box[rows] = middle + rng.uniform(3.0, 8.0) / world.size[number] * (box[rows] - middle)
            # none that leaves the picture is a box
            last = [world.camera.width, world.camera.height]
            keep[rows] = (box[rows, :2] > 0.0).all(axis=1) & (box[rows, 2:] < last).all(axis=1)
        if kind in (THING, WALL):
            score[rows] = rng.uniform(0.3, 0.8, len(rows))
    frame = np.arange(int(found.frame.max()) + 1)
    whole = [0.0, 0.0, float(world.camera.width), float(world.camera.height)]
    found = replace(
        found, frame=found.frame[keep], t_ns=found.t_ns[keep], class_name=found.class_name[keep],
        box=box[keep], score=score[keep], track=found.track[keep],
        looked=Looked(frame, np.tile(whole, (len(frame), 1))),
    )  # fmt: skip
    kind = np.where(owner >= 0, of_sign[np.maximum(owner, 0)], CLUTTER)[keep]
    owner = owner[keep]
    if not apart:
        found = replace(found, score=_scores(rng, (kind == SIGN) | (kind == BEHIND), owner))
    return Street(replace(world, detections=found, owner=owner), kind)


def _scores(rng: np.random.Generator, sign: BoolArray, owner: IntArray) -> FloatArray:
    """Scores [n] of boxes of which ``sign`` ones show a sign: what has the score s is a sign with
    the probability s, as with a beta distribution of which signs are picked by s, all else by
    1 - s."""
    share = float(sign.mean())
    a, b = SHARPNESS * share, SHARPNESS * (1.0 - share)
    thing = np.where(owner >= 0, owner, owner.max() + 1 + np.arange(len(owner)))
    _, first, place = np.unique(thing, return_index=True, return_inverse=True)
    level = np.where(
        sign[first], rng.beta(a + 1.0, b, len(first)), rng.beta(a, b + 1.0, len(first))
    )
    odds = logit(np.clip(level, 1e-6, 1.0 - 1e-6))[place]
    return np.asarray(expit(odds + JITTER * rng.standard_normal(len(owner))))


def told(one: Street) -> tuple[FloatArray, IntArray, BoolArray]:
    """Of everything [n] that boxes were joined to, all passes of one place together: the
    probability that it is a sign, of what kind most of its boxes are, and whether it is a copy, a
    second place of a sign that more boxes are of."""
    rules, world = GeolocationRules(min_existence=0.0, max_single_view_m=np.inf), one.world
    # boxes that the map leaves out would look like a camera that is not as stated
    with patch.object(locate, "explain_doubted", lambda path, stated, found, again: found):
        found = locate.locate_signs(
            world.trajectory, [world.detections], {"front": world.camera}, rules
        )
    p, kind = np.zeros(len(found.signs)), np.zeros(len(found.signs), np.int64)
    copy, placed = np.zeros(len(found.signs), np.bool_), set()
    for k in sorted(range(len(p)), key=lambda k: -found.signs[k].n_views):
        rows = found.signs[k].detection_rows
        p[k], kind[k] = found.signs[k].existence, np.bincount(one.kind[rows]).argmax()
        owner = int(np.bincount(world.owner[rows] + 1).argmax()) - 1
        copy[k] = owner in placed
        placed |= {owner} - {-1}
    return p, kind, copy


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--drives", type=int, default=4)
    parser.add_argument("--first", type=int, default=0, help="seed of the first drive")
    parser.add_argument("--seconds", type=float, default=600.0, help="length of a drive")
    parser.add_argument("--scores", choices=("calibrated", "apart"), default="calibrated")
    arguments = parser.parse_args()
    apart = arguments.scores == "apart"
    for clutter in (0.1, 0.4):
        d = Difficulty(twice=False, clutter=clutter, faces=ROUND, duration_s=arguments.seconds)
        seeds = range(arguments.first, arguments.first + arguments.drives)
        drives = [told(street(seed, d, apart)) for seed in seeds]
        p, kind, copy = (np.concatenate(column) for column in zip(*drives, strict=True))
        kind[copy & ((kind == SIGN) | (kind == BEHIND))] = COPY
        sign = (kind == SIGN) | (kind == BEHIND)
        print(f"{clutter} false boxes a frame: {len(p)} things, {sign.mean():.3f} of them signs")
        print(f"  expected calibration error {_by_bins(p, sign):.4f}")
        for number, name in (
            (THING, "things that stay"), (WALL, "walls"), (BEHIND, "lorries"), (COPY, "copies"),
        ):  # fmt: skip
            here = kind == number
            kept = (p[here] >= 0.5).sum()
            said = p[here].sum() / max(here.sum(), 1)
            print(f"  {name}: {here.sum()}, said {said:.3f}, {kept} kept", flush=True)


def _by_bins(p: FloatArray, sign: FloatArray) -> float:
    """The expected calibration error, each bin printed."""
    number = np.clip(np.searchsorted(EDGES, p, side="right") - 1, 0, len(EDGES) - 2)
    error = 0.0
    for k in np.unique(number).tolist():
        here = number == k
        error += here.sum() * abs(p[here].mean() - sign[here].mean())
        print(
            f"  {EDGES[k]:.2f} to {EDGES[k + 1]:.2f}: {here.sum():5d}, "
            f"said {p[here].mean():.3f}, were {sign[here].mean():.3f}"
        )
    return float(error / len(p))


if __name__ == "__main__":
    main()
