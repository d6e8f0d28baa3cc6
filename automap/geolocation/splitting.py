"""Taking boxes that do not belong out of a track, and joining the pieces of a broken one."""

from __future__ import annotations

import numpy as np

from automap.gates import gate
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


def join_pieces(
    views: Views, landmarks: list[Landmark], prior: SizePrior, max_silence_s: float
) -> list[Landmark]:
    """Join landmarks of one pass that one place explains as well as two.

    Two landmarks are pieces of one when they share no frame, follow one another within the
    tracker's silence, agree in place within their covariances, share a class, and the common
    fit costs no more than chi-square of the three coordinates saved allows.
    """
    pieces = sorted(landmarks, key=lambda item: int(item.rows.min()))
    limit_ns = int(max_silence_s * 1e9)
    i = 0
    while i < len(pieces):
        j = i + 1
        while j < len(pieces):
            ended, begun = pieces[i].rows.max(), pieces[j].rows.min()
            if views.t_ns[begun] - views.t_ns[ended] > limit_ns:
                break
            both = _joined(views, pieces[i], pieces[j], prior)
            if both is None:
                j += 1
            else:
                pieces[i] = both
                del pieces[j]
                j = i + 1
        i += 1
    return pieces


def _joined(views: Views, a: Landmark, b: Landmark, prior: SizePrior) -> Landmark | None:
    if not set(views.class_name[a.rows]) & set(views.class_name[b.rows]):
        return None
    if np.isin(views.frame[a.rows], views.frame[b.rows]).any():
        return None
    one, other = (a, b) if len(a.rows) >= len(b.rows) else (b, a)
    # a cheap look first: does the longer track expect any box of the shorter one?
    nearest = [
        distances_to(views, [mark], mark_rows, limits.LINK_SLACK_RAD).min()
        for mark, mark_rows in (
            (one, other.rows[:1]),
            (one, other.rows[-1:]),
            (other, one.rows[:1]),
        )
    ]
    if not min(nearest) < limits.LINK_GATE:
        return None
    both = fit_landmark(views, np.sort(np.concatenate([a.rows, b.rows])), prior)
    if not both.ok or both.weight.min() < limits.MISFIT_WEIGHT:
        return None
    return both if both.cost - a.cost - b.cost < gate(limits.SPLIT_PROBABILITY, 3) else None
