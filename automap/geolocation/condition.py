"""What the boxes of a sign tell of its condition: the contrast of its face, and how often it was
seen where the detector looked."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from automap.geolocation import limits
from automap.geolocation.due_frames import Pattern
from automap.geolocation.sightings import Sighting
from automap.geolocation.views import Views
from automap.records import Detections, FloatArray


@dataclass(frozen=True)
class Condition:
    """Of one sign: ``contrast`` of its face with the standard deviation from view to view (NaN:
    ``contrast_note`` says why); of the ``n_looked`` frames that should have shown it the part
    ``seen_share`` that did (NaN where none is known to have)."""

    contrast: float
    contrast_sd: float
    contrast_note: str
    seen_share: float
    n_looked: int


def conditions(
    views: Views,
    signs: Sequence[Sequence[Sighting]],
    patterns: Sequence[Sequence[Pattern]],
    detections: Sequence[Detections],
) -> list[Condition]:
    """Conditions of signs [n], each of its sightings and their ``patterns``."""
    contrast = np.concatenate([d.told("contrast") for d in detections] or [np.zeros(0)])
    notes = [
        str(note or "")
        for d in detections
        for note in ([""] * len(d) if d.contrast_note is None else d.contrast_note)
    ]
    result = []
    for members, shown in zip(signs, patterns, strict=True):
        rows = np.concatenate([s.landmark.rows for s in members])
        boxes = views.row[rows]
        value, sd, note = face_of_views(
            contrast[boxes], [notes[k] for k in boxes.tolist()], np.exp(views.measured[rows, 2])
        )
        looked = sum(int(p.due.sum()) for p in shown if p.known)
        seen = sum(int((p.due & p.seen).sum()) for p in shown if p.known)
        result.append(Condition(value, sd, note, seen / looked if looked else np.nan, looked))
    return result


def face_of_views(
    contrast: FloatArray, notes: Sequence[str], height: FloatArray
) -> tuple[float, float, str]:
    """Median contrast of the views [n] that tell one, its scatter, and "" or why there is none:
    what most of the larger views say of themselves, or that they are few. Views less than half as
    large as the largest that tells one do not count, since a lens levels out more in them."""
    known = np.isfinite(contrast)
    if known.any():
        known &= height >= 0.5 * height[known].max()
    if known.sum() >= limits.CONTRAST_VIEWS:
        values = contrast[known]
        return float(np.median(values)), float(values.std(ddof=1)), ""
    if known.any():
        return np.nan, np.nan, "too few views"
    # that it is small from afar is no reason where nearer views have another
    why = Counter(note for note in notes if note).most_common()
    return np.nan, np.nan, next((n for n, _ in why if n != "too small"), why[0][0] if why else "")
