"""Make probabilities of what the networks say, on the part of the data to tune on.

python -m pipeline.train.calibrate --data DIR --work DIR

Writes a temperature into the classifier's checkpoint and, once both networks are exported, the
weights of the joint score into ``scores.json``, which the next export takes up.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
import torch
from scipy.optimize import minimize

from automap.signs.classes import load_classes
from automap.vision.classifier import crop_faces
from automap.vision.network import NetworkDetector
from pipeline.train.art import load_faces
from pipeline.train.classifier_data import CropMaker, label_of, labels
from pipeline.train.classifier_net import Folded, membership, trained
from pipeline.train.metrics import judge_image
from pipeline.train.rendered import make_scenes
from pipeline.train.street_data import load_crops, load_streets

Floats = npt.NDArray[np.float64]
Image = npt.NDArray[np.uint8]
_DRAWN = 900
_DOUBTFUL = 0.3


def temperature(data: Path, work: Path) -> float:
    """The temperature that makes the classifier's probabilities the most likely.

    Half real crops of tracks to tune on; a quarter drawn classes, half of them by drawings that
    were held; the rest unknown faces that were held, and crops without signs.
    """
    state = torch.load(work / "classifier.pt", weights_only=True)
    folded = Folded(
        trained(state), membership([label_of(name) for name in state["labels"]], labels())
    )
    folded.eval()
    number = {e.gtsdb: name for name, e in load_classes().items() if e.gtsdb is not None}
    index = {name: i for i, name in enumerate(labels())}
    rng = np.random.default_rng(11)
    crops = load_crops(data / "gtsrb", "tune")[::2]
    samples = [(crop_faces(c.image, c.box[None])[0], number[c.class_id]) for c in crops]
    streets = load_streets(data / "gtsdb", "tune")
    faces = load_faces(data / "sign-art", work / "faces.pkl")
    seen = CropMaker(streets, crops, faces)
    held = CropMaker(streets, crops, faces, held=True)
    for make in (seen.drawn, held.drawn, held.other, seen.nothing):
        samples += [make(rng) for _ in range(_DRAWN // 4)]
    images = torch.from_numpy(np.stack([image for image, _ in samples])).permute(0, 3, 1, 2)
    with torch.no_grad():
        parts = [folded(images[i : i + 64].float()) for i in range(0, len(images), 64)]
    logits = torch.cat(parts)
    truth = torch.tensor([index[label_of(name)] for _, name in samples])
    candidates = np.exp(np.linspace(np.log(0.4), np.log(4.0), 60))
    losses = [float(torch.nn.functional.cross_entropy(logits / t, truth)) for t in candidates]
    best = float(candidates[int(np.argmin(losses))])
    state["temperature"] = best
    torch.save(state, work / "classifier.pt")
    return best


def _logit(p: Floats) -> Floats:
    p = np.clip(p, 1e-4, 1 - 1e-4)
    return np.asarray(np.log(p / (1 - p)))


def joint_score(data: Path, work: Path) -> list[float]:
    """Bias and weights of the two networks' log-odds, by logistic regression on street images.

    The images to tune on as they are, and with drawn faces of all countries set into them, so
    that signs of kinds that the benchmark does not label count as signs. A box of such a kind
    that nobody labelled may be one or not, and counts for less. Drawn towards the sum of the
    detector's and half the classifier's log-odds, since the images are few.
    """
    streets = load_streets(data / "gtsdb", "tune")
    maker = CropMaker(streets, [], load_faces(data / "sign-art", work / "faces.pkl"))
    rows: list[list[float]] = []
    for street in streets:
        _judge(street.image, street.boxes, NetworkDetector("DE"), rows)
    for seed in range(2):
        drawn = make_scenes(streets, maker.drawing, 40 + seed)
        for street, scene in zip(streets, drawn, strict=True):
            boxes = np.concatenate([street.boxes, scene.boxes])
            _judge(scene.image, boxes, NetworkDetector(), rows)
    table = np.array(rows)
    share, y = table[:, 3], table[:, 4]
    x = np.column_stack([np.ones(len(table)), _logit(table[:, 1:3])])
    prior = np.array([0.0, 1.0, 0.5])

    def loss(w: Floats) -> float:
        z = x @ w
        return float(share @ (np.logaddexp(0.0, z) - y * z) + 4.0 * np.sum((w - prior) ** 2))

    weights = minimize(loss, prior, method="BFGS").x
    return [round(float(w), 4) for w in weights]


def _judge(image: Image, truth: Floats, detector: NetworkDetector, rows: list[list[float]]) -> None:
    """Add a picture's boxes: 1, what both networks say, weight, and whether a sign is there."""
    labelled = {name for name, entry in load_classes().items() if entry.gtsdb is not None}
    boxes, scores = detector.propose(image)
    if not len(boxes):
        return
    named = detector.classifier.name(image, boxes)
    result = judge_image(boxes, scores, truth)
    order = np.argsort(-scores, kind="stable")
    for i, hit in zip(order, result.right.tolist(), strict=True):
        kind = sum(p for name, p in named[i].alternatives if name in labelled)
        doubtful = not hit and named[i].sign > 0.5 and kind < 0.5
        share = _DOUBTFUL if doubtful else 1.0
        rows.append([1.0, float(scores[i]), named[i].sign, share, float(hit)])


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description="Calibrate the trained networks")
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--work", type=Path, required=True)
    parser.add_argument("--step", choices=("temperature", "score"), required=True)
    options = parser.parse_args()
    cv2.setNumThreads(0)
    torch.set_num_threads(1)
    if options.step == "temperature":
        print("temperature", round(temperature(options.data, options.work), 3))
    else:
        weights = joint_score(options.data, options.work)
        (options.work / "scores.json").write_text(json.dumps(weights), encoding="utf-8")
        print("bias and weights", weights)


if __name__ == "__main__":
    main()
