"""Taking boxes that do not belong out of a track."""

from __future__ import annotations

import numpy as np

from automap.geolocation import limits
from automap.geolocation.landmark import Landmark, SizePrior, fit_landmark
from automap.geolocation.tracking import link_views
from automap.geolocation.views import Views
from automap.records import IntArray


def clean_tracks(
    views: Views, tracks: list[IntArray], prior: SizePrior, max_silence_s: float
) -> tuple[list[Landmark], IntArray]:
    """Landmarks of the tracks with their misfits taken out, and the rows of the misfits.

    Boxes that a track's robust fit rejects are linked anew among themselves. A group of two and
    more of them that fits one place is a sign of its own, or another track of one; single ones
    remain misfits.
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
    misfits: list[int] = []
    for rows in link_views(views, prior, max_silence_s, np.array(sorted(loose), np.int64)):
        if len(rows) == 1:
            misfits.append(int(rows[0]))
        else:
            landmarks.append(fit_landmark(views, rows, prior))
    return landmarks, np.array(sorted(misfits), np.int64)
