"""What the boxes of a sign tell of its condition: the contrast of its face, and how often it was
seen where the detector looked."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from automap.geolocation import limits
from automap.geolocation.due_frames import Pattern
from automap.geolocation.sightings import Sighting
from automap.geolocation.views import Views
from automap.records import Detections, FloatArray, Sign


def with_conditions(
    signs: Sequence[Sign],
    views: Views,
    seen_as: Sequence[Sequence[tuple[Sighting, Pattern]]],
    detections: Sequence[Detections],
) -> list[Sign]:
    """The signs [n] with what their sightings, and the frames of each, tell of their conditions."""
    contrast = np.concatenate([d.told("contrast") for d in detections] or [np.zeros(0)])
    notes = [
        str(note or "")
        for d in detections
        for note in ([""] * len(d) if d.contrast_note is None else d.contrast_note)
    ]
    result = []
    for sign, members in zip(signs, seen_as, strict=True):
        rows = np.concatenate([s.landmark.rows for s, _ in members])
        boxes = views.row[rows]
        value, sd, note = face_of_views(
            contrast[boxes], [notes[k] for k in boxes.tolist()], np.exp(views.measured[rows, 2])
        )
        looked = sum(int(p.due.sum()) for _, p in members if p.known)
        seen = sum(int((p.due & p.seen).sum()) for _, p in members if p.known)
        told = replace(sign, contrast=value, contrast_sd=sd, contrast_note=note, n_looked=looked)
        result.append(replace(told, seen_share=seen / looked if looked else np.nan))
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
