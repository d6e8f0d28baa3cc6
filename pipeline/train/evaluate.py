"""Figures of the detector and classifier that come with the package.

python -m pipeline.train.evaluate --data DIR --part test --out figures.json
"""

from __future__ import annotations

import argparse
import copy
import csv
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from automap.records import FloatArray
from automap.signs.classes import load_classes
from automap.signs.vocabulary import load_vocabulary
from automap.vision.classifier import SignClassifier, crop_faces
from automap.vision.detector import FoundSigns
from automap.vision.network import NetworkDetector, default_detector
from pipeline.train import degrade
from pipeline.train.art import Face, load_faces
from pipeline.train.classifier_data import CropMaker
from pipeline.train.metrics import (
    Figure,
    ImageResult,
    average_precision,
    judge_image,
    overlaps,
    recall_at,
    share_with_interval,
    small_recall_at,
    with_interval,
)
from pipeline.train.rendered import (
    australian_faces,
    foreign_faces,
    judge_scenes,
    make_scenes,
)
from pipeline.train.splits import Part
from pipeline.train.street_data import Street, load_crops, load_streets

Image = npt.NDArray[np.uint8]
_CATEGORY_OF_GROUP = {
    "red-circle": "prohibitory",
    "red-triangle-up": "danger",
    "blue-circle": "mandatory",
}
_HALF = 0.5


def _half(image: Image) -> Image:
    return np.asarray(
        cv2.resize(image, None, fx=_HALF, fy=_HALF, interpolation=cv2.INTER_AREA), np.uint8
    )


CONDITIONS: dict[str, Callable[[Image, np.random.Generator], Image]] = {
    "clean": lambda image, rng: image,
    "night": lambda image, rng: degrade.night(image, rng, 0.25, 8.0),
    "fog": lambda image, rng: degrade.fog(image, 0.55),
    "rain": lambda image, rng: degrade.rain(image, rng),
    "motion blur 8 px": lambda image, rng: degrade.motion_blur(image, 8.0),
    "JPEG 20": lambda image, rng: degrade.compress(image, 20),
    "half size": lambda image, rng: _half(image),
    "white balance": lambda image, rng: degrade.white_balance(image, 0.75, 1.25),
}
"""What is done to the held-out images: fixed amounts, fixed seeds."""


def categories(folder: Path) -> dict[int, str]:
    """Benchmark category of every class number."""
    with (folder / "classes.csv").open(encoding="utf-8") as stream:
        return {int(row["class_id"]): row["category"] for row in csv.DictReader(stream)}


def run(
    detector: NetworkDetector, streets: list[Street], condition: str
) -> list[tuple[FoundSigns, Street]]:
    """The detector on every street image under a condition, with truth at the same scale."""
    found = []
    for number, street in enumerate(streets):
        rng = np.random.default_rng([77, number])
        image = CONDITIONS[condition](street.image, rng)
        scale = image.shape[1] / street.image.shape[1]
        boxes = (street.boxes + 0.5) * scale - 0.5
        found.append(
            (detector.detect(image), Street(street.name, image[:1, :1], boxes, street.classes))
        )
    return found


def _listed(found: FoundSigns, i: int) -> dict[str, float]:
    assert found.alternatives is not None
    return dict(found.alternatives[i])


def one_class(found: list[tuple[FoundSigns, Street]]) -> list[ImageResult]:
    """All signs as one class."""
    return [judge_image(f.box, f.score, s.boxes) for f, s in found]


def labelled_kinds(found: list[tuple[FoundSigns, Street]]) -> list[ImageResult]:
    """All signs as one class, among the 43 kinds that the benchmark labels.

    A box counts with the probability that its face is one of them, so that a sign of another
    kind, which nobody labelled, is no mistake.
    """
    known = {name for name, entry in load_classes().items() if entry.gtsdb is not None}
    results = []
    for signs, street in found:
        share = [
            sum(p for name, p in _listed(signs, i).items() if name in known)
            for i in range(len(signs))
        ]
        results.append(judge_image(signs.box, signs.score * np.array(share), street.boxes))
    return results


def by_category(
    found: list[tuple[FoundSigns, Street]], category: str, of: dict[int, str]
) -> list[ImageResult]:
    """Detection and class together: one of the benchmark's three categories."""
    classes, groups = load_classes(), load_vocabulary().groups
    inside = {n for n, e in classes.items() if e.gtsdb is not None and of[e.gtsdb] == category}
    inside |= {name for group, name in groups.items() if _CATEGORY_OF_GROUP.get(group) == category}
    results = []
    for signs, street in found:
        share = np.array(
            [
                sum(p for name, p in _listed(signs, i).items() if name in inside)
                for i in range(len(signs))
            ]
        )
        keep = share > 0.02
        truth = street.boxes[[of[int(c)] == category for c in street.classes]]
        results.append(judge_image(signs.box[keep], (signs.score * share)[keep], truth))
    return results


def mean_ap(
    found: list[tuple[FoundSigns, Street]], of: dict[int, str]
) -> tuple[Figure, list[float]]:
    """Mean AP of the three categories with its interval, and the three."""
    names = ("prohibitory", "mandatory", "danger")
    tables = [by_category(found, name, of) for name in names]
    each = [average_precision(table) for table in tables]
    rng = np.random.default_rng(5)
    n, values = len(found), []
    for _ in range(500):
        chosen = rng.integers(0, n, n)
        values.append(np.nanmean([average_precision([t[i] for i in chosen]) for t in tables]))
    low, high = np.nanpercentile(values, [2.5, 97.5])
    return Figure(float(np.mean(each)), float(low), float(high)), each


def class_of_found(found: list[tuple[FoundSigns, Street]], least: float = 0.3) -> Figure:
    """Share of the labelled signs found, with a score of ``least``, whose class is right."""
    number = {name: entry.gtsdb for name, entry in load_classes().items()}
    hits, groups = [], []
    for k, (signs, street) in enumerate(found):
        result = _matches(signs, street, least)
        hits += [float(number.get(signs.class_name[i]) == street.classes[j]) for i, j in result]
        groups += [k] * len(result)
    return share_with_interval(hits, groups)


def _matches(signs: FoundSigns, street: Street, least: float) -> list[tuple[int, int]]:
    if not len(signs) or not len(street.boxes):
        return []
    table = overlaps(signs.box, street.boxes)
    table[signs.score < least] = 0.0
    pairs = []
    while table.max() >= 0.5:
        i, j = np.unravel_index(int(table.argmax()), table.shape)
        pairs.append((int(i), int(j)))
        table[i], table[:, j] = 0.0, 0.0
    return pairs


def classify_crops(data: Path, part: Part) -> dict[str, Figure]:
    """The classifier on sign crops of tracks that were not trained on."""
    crops = load_crops(data / "gtsrb", part)
    classifier = SignClassifier(country="DE")
    faces = np.concatenate([crop_faces(crop.image, crop.box[None]) for crop in crops])
    number = {name: entry.gtsdb for name, entry in load_classes().items()}
    right, sure_wrong = [], []
    for crop, row in zip(crops, classifier.probabilities(faces), strict=True):
        named = classifier.judge(row)
        hit = number.get(named.name) == crop.class_id
        best = named.alternatives[0][1] if named.alternatives else 0.0
        right.append(float(hit))
        sure_wrong.append(float(not hit and best > 0.9))
    tracks = [crop.class_id * 1000 + crop.track for crop in crops]
    return {
        "right": share_with_interval(right, tracks),
        "wrong with a score over 0.9": share_with_interval(sure_wrong, tracks),
    }


def _row(figure: Figure) -> dict[str, float]:
    return {k: round(v, 4) for k, v in figure.__dict__.items()}


def centre_errors(found: list[tuple[FoundSigns, Street]], least: float = 0.3) -> FloatArray:
    """Errors [n, 2] px of the found boxes' centres against the labels."""
    errors = []
    for signs, street in found:
        for i, j in _matches(signs, street, least):
            difference = signs.box[i] - street.boxes[j]
            errors.append((difference[:2] + difference[2:]) / 2)
    return np.array(errors).reshape(-1, 2)


def scene_figures(data: Path, work: Path, streets: list[Street]) -> dict[str, Any]:
    """Drawn faces that were not trained on, in street images that were not trained on."""
    faces = load_faces(data / "sign-art", work / "faces.pkl")
    held = CropMaker(streets, [], faces, held=True)
    nordic = [face for face in faces if face.colour == "red" and face.ground != "white"]
    nordic = [face for face in nordic if face.held and face.shape == "triangle-up"]
    yellow = replace_unknown(held, {"red-triangle-up": nordic})
    sets = {
        "Australian faces": (default_detector("AU"), australian_faces(faces), 1),
        "faces of no class, all groups": (default_detector(), foreign_faces(held), 2),
        "Nordic warnings": (default_detector(), foreign_faces(yellow), 3),
        "Australian faces of no class": (default_detector("AU"), foreign_faces(held, "AU_"), 4),
    }
    figures: dict[str, Any] = {}
    for name, (detector, draw, seed) in sets.items():
        outcome = judge_scenes(detector, make_scenes(streets, draw, seed))
        shares = {k: _row(v) for k, v in outcome.__dict__.items() if isinstance(v, Figure)}
        figures[name] = {"faces": outcome.faces, **shares}
        print(name, json.dumps(figures[name]), flush=True)
        if name == "Australian faces":
            figures["of every Australian face found and right"] = outcome.by_name
    return figures


def replace_unknown(maker: CropMaker, unknown: dict[str, list[Face]]) -> CropMaker:
    """The same maker with other unknown faces."""
    other = copy.copy(maker)
    other.unknown = unknown
    return other


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description="Figures of the shipped networks")
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--part", choices=("tune", "test"), default="tune")
    parser.add_argument("--conditions", default=",".join(CONDITIONS))
    parser.add_argument("--crops", action="store_true", help="the classifier on sign crops as well")
    parser.add_argument("--work", type=Path, help="with the faces' cache: drawn scenes as well")
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    streets = load_streets(options.data / "gtsdb", options.part)
    of = categories(options.data / "gtsdb")
    cv2.setNumThreads(1)
    detector = default_detector("DE")
    figures: dict[str, Any] = {"part": options.part, "images": len(streets)}
    for condition in filter(None, options.conditions.split(",")):
        found = run(detector, streets, condition)
        plain, known = one_class(found), labelled_kinds(found)
        row: dict[str, Any] = {
            "AP": _row(with_interval(known, average_precision)),
            "AP, unlabelled kinds of sign counted as false": _row(
                with_interval(plain, average_precision)
            ),
        }
        if condition == "clean":
            row["recall at 0.1 false an image"] = _row(with_interval(known, recall_at))
            row["recall under 32 px at 0.1 false an image"] = _row(
                with_interval(known, small_recall_at)
            )
            total, each = mean_ap(found, of)
            row["mean AP of three categories"] = _row(total)
            row["AP prohibitory, mandatory, danger"] = [round(v, 4) for v in each]
            row["class right of those found"] = _row(class_of_found(found))
            errors = centre_errors(found)
            row["centre error px, median and rms"] = [
                round(float(np.median(np.hypot(*errors.T))), 3),
                round(float(np.sqrt(np.mean(errors**2))), 3),
            ]
        figures[condition] = row
        print(condition, json.dumps(row), flush=True)
    if options.work is not None:
        figures |= scene_figures(options.data, options.work, streets)
    if options.crops:
        crops = classify_crops(options.data, options.part)
        figures["crops"] = {name: _row(value) for name, value in crops.items()}
        print("crops", json.dumps(figures["crops"]), flush=True)
    if options.out is not None:
        options.out.write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
