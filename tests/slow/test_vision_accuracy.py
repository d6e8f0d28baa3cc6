"""The shipped networks on street images and sign crops that they were not trained on."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from automap.signs.classes import load_classes
from automap.vision.classifier import SignClassifier, crop_faces
from automap.vision.network import default_detector
from pipeline.train.evaluate import class_of_found, labelled_kinds, run
from pipeline.train.metrics import average_precision, recall_at
from pipeline.train.street_data import load_crops, load_streets

PROJECT = Path(__file__).resolve().parents[2]
DATA = Path(os.environ.get("AUTOMAP_SHARED_DATA", PROJECT.parent / "shared" / "data"))

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        not (DATA / "gtsdb").is_dir(),
        reason=f"no street images at {DATA / 'gtsdb'}; set AUTOMAP_SHARED_DATA",
    ),
]


@pytest.mark.parametrize(("condition", "least"), [("clean", 0.85), ("JPEG 20", 0.7)])
def test_street_images_to_tune_on(condition: str, least: float) -> None:
    streets = load_streets(DATA / "gtsdb", "tune")
    found = run(default_detector("DE"), streets, condition)
    results = labelled_kinds(found)
    assert average_precision(results) >= least
    assert recall_at(results, 0.5) >= least
    if condition == "clean":
        assert class_of_found(found).value >= 0.85


def test_crops_of_tracks_to_tune_on() -> None:
    crops = load_crops(DATA / "gtsrb", "tune")[::4]
    classifier = SignClassifier("DE")
    faces = np.concatenate([crop_faces(crop.image, crop.box[None]) for crop in crops])
    number = {name: entry.gtsdb for name, entry in load_classes().items()}
    named = [classifier.judge(row) for row in classifier.probabilities(faces)]
    right = [number.get(n.name) == crop.class_id for n, crop in zip(named, crops, strict=True)]
    assert np.mean(right) >= 0.9
