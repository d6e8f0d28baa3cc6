"""Taking boxes that do not belong out of a track."""

from __future__ import annotations

import numpy as np

from automap.geolocation import limits
from automap.geolocation.landmark import Landmark, SizePrior, distances_to, fit_landmark
from automap.geolocation.tracking import link_views
from automap.geolocation.views import Views
from automap.records import IntArray


def clean_tracks(
    views: Views, tracks: list[IntArray], prior: SizePrior, max_silence_s: float
) -> tuple[list[Landmark], IntArray]:
    """Landmarks of the tracks with their misfits taken out, and the rows of the misfits.

    Boxes that a track's robust fit rejects are offered to the other tracks; what no track
    takes is linked anew among itself. A group of two and more of them that fits one place is a
    sign of its own; single ones remain misfits.
    """
    landmarks: list[Landmark] = []
    loose: list[int] = []
    for rows in tracks:
        landmark = fit_landmark(views, rows, prior)
        bad = rows[landmark.weight < limits.MISFIT_WEIGHT]
        if 0 < len(bad) < len(rows):
            loose.extend(bad.tolist())
            landmark = fit_landmark(views, np.setdiff1d(rows, bad), prior)
        landmarks.append(landmark)
    # what is adopted widens a landmark's time; one that is far in time is never the best
    span = np.array([views.t_ns[m.rows[[0, -1]]] for m in landmarks]).reshape(-1, 2)
    remaining = []
    for row in sorted(loose):
        index = _adopt(views, row, landmarks, span, prior, max_silence_s)
        if index < 0:
            remaining.append(row)
        else:
            rows = views.t_ns[landmarks[index].rows]
            span[index] = rows.min(), rows.max()
    misfits: list[int] = []
    for rows in link_views(views, prior, max_silence_s, np.array(remaining, np.int64)):
        if len(rows) == 1:
            misfits.append(int(rows[0]))
        else:
            landmarks.append(fit_landmark(views, rows, prior))
    return landmarks, np.array(sorted(misfits), np.int64)


def _adopt(
    views: Views,
    row: int,
    landmarks: list[Landmark],
    span: IntArray,
    prior: SizePrior,
    max_silence_s: float,
) -> int:
    """Give a loose box to the landmark that expects it best and has none in its frame; the
    landmark's index, -1 without one. ``span`` [m, 2] their first and last times."""
    reach, now = np.int64(max_silence_s * 1e9), views.t_ns[row]
    near = np.flatnonzero((span[:, 0] - reach <= now) & (now <= span[:, 1] + reach))
    some = [landmarks[index] for index in near]
    distances = distances_to(views, some, np.array([row]), limits.LINK_SLACK_RAD)[0]
    best, best_distance = -1, limits.LINK_GATE
    for k in np.flatnonzero(distances < limits.LINK_GATE):
        index, distance = int(near[k]), float(distances[k])
        landmark = landmarks[index]
        if (views.frame[landmark.rows] == views.frame[row]).any():
            continue
        silence = np.abs(views.t_ns[landmark.rows] - views.t_ns[row]).min() * 1e-9
        if silence > max_silence_s:
            continue
        if not (views.class_name[landmark.rows] == views.class_name[row]).any():
            distance += limits.LINK_OTHER
        if distance < best_distance:
            best, best_distance = index, distance
    if best < 0:
        return -1
    grown = fit_landmark(views, np.append(landmarks[best].rows, row), prior)
    if grown.weight[-1] < limits.MISFIT_WEIGHT:
        return -1
    landmarks[best] = grown
    return best
