"""How repeatable the contrast of a face is, on tracks of real signs (GTSRB's crops).

    python tests/benchmarks/face_contrast.py DATA

DATA holds ``gtsrb/crops.csv`` and the crops. Printed are how many tracks tell a contrast and why
others do not, its scatter within a track and between the signs of a class, and how much smaller it
is in views of 32 to 45 px than in ones of 64 px and more of the same track.
"""

from __future__ import annotations

import argparse
import csv
from collections import Counter
from pathlib import Path

import cv2
import numpy as np

from automap.geolocation.condition import face_of_views
from automap.vision.face_contrast import face_contrast

Row = tuple[float, float, str]


def tracks(folder: Path) -> dict[tuple[str, str], list[Row]]:
    """Height, contrast and note of each view, by class and track."""
    found: dict[tuple[str, str], list[Row]] = {}
    with (folder / "crops.csv").open(encoding="utf-8", newline="") as stream:
        for row in csv.DictReader(stream):
            image = cv2.imread(str(folder / "crops" / row["image"]))
            box = np.array([float(row[f"roi_{k}"]) for k in ("x1", "y1", "x2", "y2")])
            value, note = face_contrast(np.asarray(image, np.uint8), box)
            own = found.setdefault((row["class_id"], row["track"]), [])
            own.append((float(box[3] - box[1]), value, note))
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=Path)
    found = tracks(parser.parse_args().data / "gtsrb")
    why: Counter[str] = Counter()
    scatter: list[float] = []
    by_class: dict[str, list[float]] = {}
    fainter: list[float] = []
    for (kind, _), views in found.items():
        height, contrast = (np.array([view[k] for view in views], np.float64) for k in (0, 1))
        value, sd, note = face_of_views(contrast, [view[2] for view in views], height)
        why[note or "measured"] += 1
        if np.isfinite(value):
            scatter.append(sd)
            by_class.setdefault(kind, []).append(value)
        known = np.isfinite(contrast)
        small, large = contrast[known & (height < 45)], contrast[known & (height >= 64)]
        if len(small) and len(large):
            fainter.append(float(np.median(large) - np.median(small)))
    between = [float(np.std(own, ddof=1)) for own in by_class.values() if len(own) >= 5]
    print(f"{len(found)} tracks: {dict(why)}")
    print(f"within a track {np.median(scatter):.3f}, 95 % below {np.quantile(scatter, 0.95):.3f}")
    print(f"between the signs of a class {np.median(between):.3f} ({len(between)} classes)")
    print(f"small views lower by {np.median(fainter):.3f} ({len(fainter)} tracks)")


if __name__ == "__main__":
    main()
