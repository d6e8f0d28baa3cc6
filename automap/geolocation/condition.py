"""What the boxes of a sign tell of its condition: the contrast of its face, and how often it was
seen where the detector looked."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from automap.effects.lens import focal_length
from automap.geolocation import limits
from automap.geolocation.existence import FrameGrid, apparent_heights
from automap.geolocation.landmark import Landmark
from automap.geolocation.sightings import Sighting
from automap.geolocation.views import Views
from automap.records import Camera, Detections, FloatArray, IntArray, Trajectory


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
    trajectory: Trajectory,
    detections: Sequence[Detections],
    cameras: Mapping[str, Camera],
) -> list[Condition]:
    """Conditions of signs [n], each of its sightings; ``cameras`` as they were found to be."""
    frame = np.concatenate([d.frame for d in detections] or [np.zeros(0, np.int64)])
    contrast = np.concatenate([d.told("contrast") for d in detections] or [np.zeros(0)])
    notes = [
        str(note or "")
        for d in detections
        for note in ([""] * len(d) if d.contrast_note is None else d.contrast_note)
    ]
    searched = {d.camera: _searched(d, cameras[d.camera]) for d in detections}
    usual = _usual_heights(views, [s.landmark for members in signs for s in members])
    result = []
    for members in signs:
        rows = np.concatenate([s.landmark.rows for s in members])
        boxes = views.row[rows]
        value, sd, note = face_of_views(
            contrast[boxes], [notes[k] for k in boxes.tolist()], np.exp(views.measured[rows, 2])
        )
        seen = looked = 0
        for member in members:
            name = views.camera_names[member.camera]
            shown = frame[views.row[member.landmark.rows]]
            due = _due(
                *(views, member.landmark, trajectory, searched[name], cameras[name]),
                usual[member.camera],
            )
            looked += len(due)
            seen += int(np.isin(due, shown).sum())
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


def _usual_heights(views: Views, marks: Sequence[Landmark]) -> FloatArray:
    """Height [c], over the focal length, at which three of four signs of each camera are found:
    what hides a sign from afar, seldom more than a quarter of them, does not move it."""
    first: list[list[float]] = [[] for _ in views.camera_names]
    for mark in marks:
        row = mark.rows[np.argmin(views.t_ns[mark.rows])]
        first[int(views.camera[row])].append(float(np.exp(views.measured[row, 2])))
    return np.array([np.quantile(sizes, 0.75) if sizes else np.inf for sizes in first])


@dataclass(frozen=True)
class _Searched:
    """Frames [k] of a camera that were searched, ascending: their numbers, stamps as the path has
    them, and the part of each that was seen [k, 4]."""

    frame: IntArray
    t_ns: IntArray
    region: FloatArray


def _searched(found: Detections, camera: Camera) -> _Searched:
    """None of a camera of which they are not known."""
    looked = found.looked
    if looked is None:
        none = np.zeros(0, np.int64)
        return _Searched(none, none, np.zeros((0, 4)))
    frame, t_ns = FrameGrid(found).stamped(looked.frame)
    region = looked.region[np.isin(looked.frame, frame)]
    return _Searched(frame, t_ns + np.int64(round(camera.time_offset_s * 1e9)), region)


def _due(
    views: Views,
    mark: Landmark,
    trajectory: Trajectory,
    searched: _Searched,
    camera: Camera,
    usual: float,
) -> IntArray:
    """Numbers of the frames that were searched and should have shown a sign in its pass: wholly
    within the part that was searched, from the side it was seen from, and at least as large as
    signs usually are when they are found."""
    first, last = int(views.t_ns[mark.rows].min()), int(views.t_ns[mark.rows].max())
    around = round(limits.AFTER_S * 1e9)
    near = slice(*np.searchsorted(searched.t_ns, [first - around, last + around]).tolist())
    frame, region = searched.frame[near], searched.region[near]
    if not len(frame):
        return frame
    stamps = searched.t_ns[near] - np.int64(round(camera.time_offset_s * 1e9))
    height = apparent_heights(
        *(mark.position, mark.size_m, views.centre[mark.rows], stamps, trajectory),
        *(camera, views.origin, region),
    )
    return np.asarray(frame[height >= usual * focal_length(camera)], np.int64)
