"""Taking boxes that do not belong out of a track, and joining the pieces of a broken one."""

from __future__ import annotations

import numpy as np

from automap.gates import gate
from automap.geolocation import limits
from automap.geolocation.landmark import Landmark, SizePrior, distances_to, fit_landmark
from automap.geolocation.tracking import TrackingRules, link_views
from automap.geolocation.views import Views
from automap.records import IntArray


def clean_tracks(
    views: Views, tracks: list[IntArray], prior: SizePrior, rules: TrackingRules
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
    remaining = [row for row in sorted(loose) if not _adopt(views, row, landmarks, prior, rules)]
    misfits: list[int] = []
    for rows in link_views(views, prior, rules, np.array(remaining, np.int64)):
        if len(rows) == 1:
            misfits.append(int(rows[0]))
        else:
            landmarks.append(fit_landmark(views, rows, prior))
    return landmarks, np.array(sorted(misfits), np.int64)


def _adopt(
    views: Views, row: int, landmarks: list[Landmark], prior: SizePrior, rules: TrackingRules
) -> bool:
    """Give a loose box to the landmark that expects it best and has none in its frame."""
    distances = distances_to(views, landmarks, np.array([row]), rules.slack_rad)[0]
    best, best_distance = -1, rules.gate
    for index in np.flatnonzero(distances < rules.gate):
        landmark, distance = landmarks[index], float(distances[index])
        if (views.frame[landmark.rows] == views.frame[row]).any():
            continue
        silence = np.abs(views.t_ns[landmark.rows] - views.t_ns[row]).min() * 1e-9
        if silence > rules.max_silence_s:
            continue
        if not (views.class_name[landmark.rows] == views.class_name[row]).any():
            distance += rules.other_class
        if distance < best_distance:
            best, best_distance = int(index), distance
    if best < 0:
        return False
    grown = fit_landmark(views, np.append(landmarks[best].rows, row), prior)
    if grown.weight[-1] < limits.MISFIT_WEIGHT:
        return False
    landmarks[best] = grown
    return True


def join_pieces(
    views: Views, landmarks: list[Landmark], prior: SizePrior, rules: TrackingRules
) -> list[Landmark]:
    """Join landmarks of one pass that one place explains as well as two.

    Two landmarks are pieces of one when they share no frame, follow one another within the
    tracker's silence, agree in place within their covariances, share a class, and the common
    fit costs no more than chi-square of the three coordinates saved allows.
    """
    pieces = sorted(landmarks, key=lambda item: int(item.rows.min()))
    limit_ns = int(rules.max_silence_s * 1e9)
    i = 0
    while i < len(pieces):
        j = i + 1
        while j < len(pieces):
            ended, begun = pieces[i].rows.max(), pieces[j].rows.min()
            if views.t_ns[begun] - views.t_ns[ended] > limit_ns:
                break
            both = _joined(views, pieces[i], pieces[j], prior, rules)
            if both is None:
                j += 1
            else:
                pieces[i] = both
                del pieces[j]
                j = i + 1
        i += 1
    return pieces


def _joined(
    views: Views, a: Landmark, b: Landmark, prior: SizePrior, rules: TrackingRules
) -> Landmark | None:
    if not set(views.class_name[a.rows]) & set(views.class_name[b.rows]):
        return None
    if np.isin(views.frame[a.rows], views.frame[b.rows]).any():
        return None
    one, other = (a, b) if len(a.rows) >= len(b.rows) else (b, a)
    # a cheap look first: does the longer track expect any box of the shorter one?
    nearest = [
        distances_to(views, [mark], mark_rows, rules.slack_rad).min()
        for mark, mark_rows in (
            (one, other.rows[:1]),
            (one, other.rows[-1:]),
            (other, one.rows[:1]),
        )
    ]
    if not min(nearest) < rules.gate:
        return None
    both = fit_landmark(views, np.sort(np.concatenate([a.rows, b.rows])), prior)
    if not both.ok or both.weight.min() < limits.MISFIT_WEIGHT:
        return None
    return both if both.cost - a.cost - b.cost < gate(limits.SPLIT_PROBABILITY, 3) else None
