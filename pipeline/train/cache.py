"""Training data prepared once: mapped from a file, so that many processes share one copy."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from pipeline.train.drawn_streets import drawn_streets
from pipeline.train.street_data import (
    LEAK,
    Crop,
    Street,
    leak_free_crops,
    leak_free_streets,
    load_crops,
    load_streets,
    same_signs,
    signs_of,
)


def training_streets(data: Path, work: Path) -> list[Street]:
    """Street images to train on, free of signs that held-out images show, and drawn streets."""
    pixels, table = work / "streets.npy", work / "streets.json"
    if not table.is_file():
        held = load_streets(data / "gtsdb", "test") + load_streets(data / "gtsdb", "tune")
        streets = leak_free_streets(load_streets(data / "gtsdb", "train"), held)
        shape = (len(streets), *streets[0].image.shape)
        stored = np.lib.format.open_memmap(pixels, mode="w+", dtype=np.uint8, shape=shape)
        for row, street in zip(stored, streets, strict=True):
            row[:] = street.image
        stored.flush()
        rows = [
            {"name": s.name, "boxes": s.boxes.tolist(), "classes": s.classes.tolist()}
            for s in streets
        ]
        table.write_text(json.dumps(rows), encoding="utf-8")
    mapped = np.load(pixels, mmap_mode="r")
    streets = [
        Street(
            row["name"], image, np.array(row["boxes"], float).reshape(-1, 4),
            np.array(row["classes"], np.int64),
        )
        for row, image in zip(json.loads(table.read_text(encoding="utf-8")), mapped, strict=True)
    ]  # fmt: skip
    return streets + drawn_streets(work / "drawn-streets.npy")


def face_data(data: Path, work: Path) -> tuple[list[Street], list[Crop]]:
    """Street images and crops to train the classifier on.

    Neither shows a sign of the held-out street images or of the held-out tracks.
    """
    streets = training_streets(data, work)
    chosen = work / "crops.json"
    crops = load_crops(data / "gtsrb", "train")
    if not chosen.is_file():
        held = load_streets(data / "gtsdb", "test") + load_streets(data / "gtsdb", "tune")
        free = leak_free_crops(crops, signs_of(held))
        del held
        tracks = load_crops(data / "gtsrb", "test") + load_crops(data / "gtsrb", "tune")
        shown = [(crop.image, crop.box) for crop in tracks]
        fresh = (same_signs(signs_of(streets), shown) <= LEAK).tolist()
        kept = sorted({(crop.class_id, crop.track) for crop in free})
        chosen.write_text(json.dumps({"tracks": kept, "fresh": fresh}), encoding="utf-8")
    choice = json.loads(chosen.read_text(encoding="utf-8"))
    tracks_kept = {(c, t) for c, t in choice["tracks"]}
    crops = [crop for crop in crops if (crop.class_id, crop.track) in tracks_kept]
    new, at, kept_streets = np.array(choice["fresh"], bool), 0, []
    for street in streets:
        mine = new[at : at + len(street.boxes)]
        at += len(street.boxes)
        kept_streets.append(
            Street(street.name, street.image, street.boxes[mine], street.classes[mine])
        )
    return kept_streets, crops
