"""Which part of the data is for what: fixed by the names of files, before anything is seen.

GTSDB images: 160 for the final figures, 50 to tune on, the rest to train. GTSRB tracks: a fifth
for the final figures, a tenth to tune on. Sign faces: a tenth is kept for "other faces".
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from typing import Literal

Part = Literal["test", "tune", "train"]
TEST_IMAGES = 160
TUNE_IMAGES = 50


def rank(name: str) -> int:
    """A number that depends on nothing but the name."""
    return int.from_bytes(hashlib.sha256(name.encode()).digest()[:8], "big")


def image_parts(names: Iterable[str]) -> dict[str, Part]:
    """The part of every GTSDB image."""
    ordered = sorted(set(names), key=rank)
    ends = (TEST_IMAGES, TEST_IMAGES + TUNE_IMAGES)
    return {
        name: "test" if i < ends[0] else "tune" if i < ends[1] else "train"
        for i, name in enumerate(ordered)
    }


def track_part(class_id: int, track: int) -> Part:
    """The part of a GTSRB track."""
    place = rank(f"gtsrb/{class_id:02d}/{track:05d}") % 10
    return "test" if place < 2 else "tune" if place == 2 else "train"


def is_held_face(name: str) -> bool:
    """Whether a sign face is kept out of all training."""
    return rank(f"face/{name}") % 10 == 0
