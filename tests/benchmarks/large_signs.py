"""How many signs are found from small ones to such that fill the picture.

python tests/benchmarks/large_signs.py --data DATA [--part tune] [--scenes 20] [--close]

Drawn faces (stop signs of all countries drawn, and one face of each shape and colour) are set into
street images that are not trained on, with perspective, light, dirt and another camera's look, and
searched at the size of the data set and at 4K. A sign is found where a box overlaps it by half, at
the score that leaves one false box in ten images. Signs that the data set does not list are not
false: ``look_alikes.csv`` names them. ``--close`` cuts the labelled signs themselves out, so that
they are a fifth to nearly all of the picture's height, and does nothing else.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from look_alikes import SAME, verdicts

from automap.vision.network import NetworkDetector, default_detector
from pipeline.train import degrade
from pipeline.train.art import Face, load_faces
from pipeline.train.metrics import ImageResult, judge_image, overlaps, threshold_at
from pipeline.train.scenes import Image, draw_face
from pipeline.train.street_data import Street, load_streets

SIZES = ((12, 24), (24, 64), (64, 128), (128, 256), (256, 450), (450, 700))
"""Longest sides, px, at the size of the data set's pictures."""
WIDE_4K = 3840
LEAST = 0.3
"""What a search of a video reports."""
CLOSE, LEAST_CLOSE_PX = (1024, 768), 36.0
"""Size of a picture cut out, px, and of the signs for which it is: less shows no detail."""
Scene = tuple[Image, np.ndarray]


def faces_of(data: Path, cache: Path) -> dict[str, list[Face]]:
    """Stop signs, and the first face of every other shape and colour that stands alone."""
    faces = load_faces(data / "sign-art", cache)
    stops = [f for f in faces if f.name.startswith("regulatory--stop--g")]
    kinds: dict[tuple[str, str], Face] = {}
    for face in faces:
        if not face.plate and face not in stops and face.shape != "other":
            kinds.setdefault((face.shape, face.colour), face)
    return {"stop signs": stops, "other kinds": list(kinds.values())}


def scene(
    street: Street, face: Face, size: float, rng: np.random.Generator, width: int
) -> Scene | None:
    """A street with one face in it, ``width`` px wide, and the face's box."""
    scale = width / street.image.shape[1]
    image = cv2.resize(street.image, None, fx=scale, fy=scale) if scale != 1 else street.image
    image = np.asarray(image, np.uint8).copy()
    high, wide = image.shape[:2]
    shape = np.array([face.image.shape[1], face.image.shape[0]], np.float64)
    sides = size * scale * shape / shape.max()
    if (sides > 0.95 * np.array([wide, high])).any():
        sides *= 0.9 * float((np.array([wide, high]) / sides).min())
    low = rng.uniform(0.0, np.array([wide, high]) - sides)
    box = draw_face(image, face.image, np.concatenate([low, low + sides]), rng)
    if box is None:
        return None
    return degrade.at_random(image, rng), np.clip(box, 0, [wide - 1, high - 1] * 2)


def false_boxes(
    detector: NetworkDetector, streets: Sequence[Street], width: int
) -> list[ImageResult]:
    """What is found beside the signs that are labelled or were seen to be there."""
    out, looked = [], verdicts()
    for number, street in enumerate(streets):
        rng = np.random.default_rng([5, number])
        scale = width / street.image.shape[1]
        image = np.asarray(cv2.resize(street.image, None, fx=scale, fy=scale), np.uint8)
        found = detector.detect(degrade.at_random(image, rng))
        seen = [box for box, shows in looked.get(street.name, []) if shows != "none"]
        unlisted = (np.array(seen).reshape(-1, 4) + 0.5) * scale - 0.5
        clear = overlaps(found.box, unlisted).max(axis=1, initial=0.0) < SAME
        labelled = (street.boxes + 0.5) * scale - 0.5
        out.append(judge_image(found.box[clear], found.score[clear], labelled))
    return out


def close_up(street: Street, box: np.ndarray, share: float, rng: np.random.Generator) -> Scene:
    """A part of a street in which the sign in ``box`` has this share of the height, as a picture of
    CLOSE px, and its box."""
    wide, high = CLOSE
    height = min(float((box[2:] - box[:2]).max()) / share, float(street.image.shape[0]))
    size = np.array([height * wide / high, height])
    low = np.clip(box[2:] - size, 0.0, None)
    top = np.minimum(box[:2], np.array(street.image.shape[1::-1]) - size)
    start = rng.uniform(np.minimum(low, top), np.maximum(low, top))
    scale = high / height
    matrix = np.array([[scale, 0.0, 0.0], [0.0, scale, 0.0]])
    matrix[:, 2] = -start * scale + (scale - 1.0) / 2.0
    image = cv2.warpAffine(
        street.image, matrix, CLOSE, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT_101
    )
    return np.asarray(image, np.uint8), (box - np.tile(start, 2) + 0.5) * scale - 0.5


def close_ups(detector: NetworkDetector, streets: Sequence[Street]) -> None:
    """Print how many labelled signs are found that a close camera would see large."""
    for share in (0.2, 0.4, 0.7, 0.95):
        best = []
        for number, street in enumerate(streets):
            for which, box in enumerate(street.boxes):
                if (box[2:] - box[:2]).max() < LEAST_CLOSE_PX:
                    continue
                image, truth = close_up(
                    street, box, share, np.random.default_rng([21, number, which])
                )
                found = detector.detect(image)
                result = judge_image(found.box, found.score, truth[None])
                best.append(float(np.max(result.score, where=result.right, initial=0.0)))
        print(
            f"{share:.2f} of the height: {np.mean(np.array(best) > 0.8):.3f} of {len(best)} found "
            f"with over 0.8, {np.mean(np.array(best) > LEAST):.3f} with over {LEAST}",
            flush=True,
        )


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--part", choices=("tune", "test"), default="tune")
    parser.add_argument("--scenes", type=int, default=20, help="of each size and kind")
    parser.add_argument("--close", action="store_true", help="labelled signs, cut out")
    options = parser.parse_args()
    streets = load_streets(options.data / "gtsdb", options.part)
    if options.close:
        close_ups(default_detector(), streets)
        return
    with tempfile.TemporaryDirectory() as folder:
        faces = faces_of(options.data, Path(folder) / "faces.pickle")
    detector = default_detector()
    for width in (streets[0].image.shape[1], WIDE_4K):
        count = len(streets) if width < WIDE_4K else len(streets) // 5
        clear = false_boxes(detector, streets[:count], width)
        least = max(threshold_at(clear, 0.1), LEAST)
        sure = sum(int((~r.right & (r.score >= 0.9)).sum()) for r in clear)
        print(
            f"{width} px wide: a score of {least:.2f} leaves one false box in ten "
            f"of {count} images, or fewer; {sure} such above 0.9",
            flush=True,
        )
        for kind, own in faces.items():
            shares = []
            for low, high in SIZES:
                hits, tried = 0, 0
                for number in range(options.scenes):
                    rng = np.random.default_rng([9, low, number])
                    made = scene(
                        streets[int(rng.integers(len(streets)))],
                        own[number % len(own)],
                        float(np.exp(rng.uniform(np.log(low), np.log(high)))),
                        rng,
                        width,
                    )
                    if made is None:
                        continue
                    found = detector.detect(made[0])
                    at = found.score >= least
                    result = judge_image(found.box[at], found.score[at], made[1][None])
                    hits, tried = hits + int(result.right.any()), tried + 1
                shares.append(f"{low}-{high}: {hits}/{tried}")
            print(f"  {kind}, found by size in px: {', '.join(shares)}", flush=True)


if __name__ == "__main__":
    main()
