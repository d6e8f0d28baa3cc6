"""What the detector takes for signs and is none, by hand.

python tests/benchmarks/look_alikes.py --data DATA [--fit] [--sheet FILE] [--work WORK]

Every box on the 600 street images that nobody labelled and that had a score over 0.42 was looked
at: ``look_alikes.csv`` says what each shows ("sign", "none", or "doubtful" where the picture does
not tell). Boxes over 0.9 that stand in no row are counted as not looked at. Half of the images, by
a hash of their names, is to fit how much a face that is none of the classes is doubted, the other
half to check. ``--sheet`` draws what is none, and what was not looked at.
"""

from __future__ import annotations

import argparse
import csv
import pickle
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from automap.records import FloatArray, Image
from automap.vision import limits
from automap.vision.network import default_detector
from automap.vision.scoring import doubted
from pipeline.train.metrics import overlaps
from pipeline.train.splits import rank
from pipeline.train.street_data import load_streets

LOOKED_AT = Path(__file__).with_suffix(".csv")
LEAST = 0.42
"""Score from which boxes were looked at."""
SAME = 0.4
"""IoU from which two boxes show the same thing: the detector's own."""
DOUBTS = np.linspace(0.0, 1.0, 21)


@dataclass(frozen=True)
class Told:
    """A box: image, corners [4] px, ``score`` as told, ``plain`` the same without doubt in a face
    of no class, probability of the most probable class, and what it shows: "labelled", "sign",
    "none", "doubtful" or "not looked at"."""

    image: str
    box: FloatArray
    score: float
    plain: float
    known: float
    shows: str

    @property
    def check(self) -> bool:
        """Whether the image is to check."""
        return rank(f"second/{self.image}") % 2 == 1


def verdicts() -> dict[str, list[tuple[FloatArray, str]]]:
    """By image, the boxes looked at and what each shows."""
    found: dict[str, list[tuple[FloatArray, str]]] = {}
    with LOOKED_AT.open(encoding="utf-8") as stream:
        for row in csv.DictReader(stream):
            box = np.array([float(row[k]) for k in ("x_min", "y_min", "x_max", "y_max")])
            found.setdefault(row["image"], []).append((box, row["shows"]))
    return found


def undoubted(score: float, known: float) -> float:
    """The inverse of ``doubted`` at home, by bisection."""
    low, high = limits.SURE, 1.0 - limits.SURE
    for _ in range(60):
        middle = 0.5 * (low + high)
        less = doubted(middle, known, limits.ODDS_AT_HOME) < score
        low, high = (middle, high) if less else (low, middle)
    return 0.5 * (low + high)


def search(data: Path) -> list[Told]:
    """All boxes of the 600 images that had a score over ``LEAST`` without doubt."""
    looked, detector, told = verdicts(), default_detector("DE"), []
    for part in ("train", "tune", "test"):
        for street in load_streets(data / "gtsdb", part):
            found = detector.detect(street.image)
            assert found.alternatives is not None
            known = [
                max((p for name, p in listed if "--unknown-" not in name), default=0.0)
                for listed in found.alternatives
            ]
            seen = looked.get(street.name, [])
            for i in np.flatnonzero(found.score > LEAST):
                box = found.box[i]
                labelled = overlaps(box[None], street.boxes).max(initial=0.0)
                near = [overlaps(box[None], b[None])[0, 0] for b, _ in seen]
                shows = "not looked at"
                if labelled >= 0.5:
                    shows = "labelled"
                elif near and max(near) >= SAME:
                    shows = seen[int(np.argmax(near))][1]
                elif labelled >= 0.1:
                    shows = "doubtful"
                score = float(found.score[i])
                plain = undoubted(score, known[i])
                told.append(Told(street.name, box, score, plain, known[i], shows))
    return told


def loss(told: list[Told], doubt: float) -> float:
    """Negative log likelihood of what boxes show, with ``doubt`` in faces of no class."""
    total = 0.0
    for t in told:
        over = float(np.log(t.plain / (1.0 - t.plain)))
        over -= doubt * (1.0 - t.known) * max(over, 0.0)
        total += float(np.logaddexp(0.0, over)) - (t.shows != "none") * over
    return total


def report(name: str, told: list[Told]) -> None:
    """Print how many boxes of each score show what, and how far scores can be believed."""
    counts = {
        f"over {least}": {
            kind: sum(getattr(t, of) > least and t.shows == shows for t in told)
            for kind, of, shows in (
                ("none", "score", "none"),
                ("before doubt", "plain", "none"),
                ("not looked at", "score", "not looked at"),
            )
        }
        for least in (0.9, 0.8, 0.5)
    }
    clear = [t for t in told if t.shows not in ("doubtful", "not looked at")]
    right = np.array([t.shows != "none" for t in clear], np.float64)
    errors = []
    for of in ("plain", "score"):
        p = np.array([getattr(t, of) for t in clear])
        bins = np.array_split(np.argsort(p, kind="stable"), 10)
        errors.append(sum(abs(p[b].mean() - right[b].mean()) * len(b) for b in bins) / len(p))
    signs = [t for t in clear if t.shows == "labelled"]
    now, before = (np.mean([getattr(t, of) > 0.9 for t in signs]) for of in ("score", "plain"))
    print(f"{name}: boxes that show no sign {counts}; of {len(signs)} labelled signs over 0.9 "
          f"{now:.3f}, before {before:.3f}; "
          f"calibration error {errors[1]:.3f}, before {errors[0]:.3f}")  # fmt: skip


def sheet(path: Path, told: list[Told], images: Path) -> None:
    """Draw what shows no sign, or was not looked at, the surest first."""
    cells: list[Image] = []
    for t in sorted(told, key=lambda t: -t.score):
        if t.shows not in ("none", "not looked at") or t.score < 0.5:
            continue
        picture = np.asarray(cv2.imread(str(images / t.image)), np.uint8)
        middle = (t.box[:2] + t.box[2:]) / 2.0
        reach = float((t.box[2:] - t.box[:2]).max()) + 5.0
        low = np.maximum(np.floor(middle - reach), 0).astype(int)
        high = np.ceil(middle + reach).astype(int)
        cell = np.full((176, 160, 3), 255, np.uint8)
        cell[:160] = cv2.resize(picture[low[1] : high[1], low[0] : high[0]], (160, 160))
        text = f"{t.score:.2f} {t.image[:5]} {t.shows[:4]}"
        cv2.putText(cell, text, (2, 172), cv2.FONT_HERSHEY_SIMPLEX, 0.38, (0, 0, 0), 1)
        cells.append(cell)
    while len(cells) % 10:
        cells.append(np.full((176, 160, 3), 255, np.uint8))
    rows = [np.hstack(cells[i : i + 10]) for i in range(0, len(cells), 10)]
    cv2.imwrite(str(path), np.vstack(rows))


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--work", type=Path, help="keeps the boxes found")
    parser.add_argument("--fit", action="store_true", help="fit the doubt anew")
    parser.add_argument("--sheet", type=Path, help="where to draw what shows no sign")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    kept = options.work / "look_alikes.pickle" if options.work else None
    if kept is not None and kept.is_file():
        told: list[Told] = pickle.loads(kept.read_bytes())
    else:
        told = search(options.data)
        if kept is not None:
            kept.write_bytes(pickle.dumps(told))
    told = [t for t in told if t.plain > LEAST]
    halves = {"to fit": False, "to check": True}
    for name, check in halves.items():
        report(f"half {name}", [t for t in told if t.check == check])
    if options.fit:
        for name, check in halves.items():
            use = [t for t in told if t.check == check and t.shows in ("labelled", "sign", "none")]
            losses = [loss(use, float(d)) for d in DOUBTS]
            best = int(np.argmin(losses))
            print(f"half {name}: a doubt of {DOUBTS[best]:.2f} is the most likely, loss "
                  f"{losses[best]:.1f}; without {losses[0]:.1f}; as set "
                  f"{loss(use, limits.UNKNOWN_DOUBT):.1f}")  # fmt: skip
    if options.sheet is not None:
        sheet(options.sheet, told, options.data / "gtsdb" / "images")


if __name__ == "__main__":
    main()
