"""Linking the boxes of one sign over the frames of a drive.

Every track carries an estimate of where its sign stands and how large it is; moving the
camera along the trajectory predicts where the sign's box will be and how sure that is. The
boxes of a frame are assigned to the predictions one to one, so two boxes in a frame are
always two signs (global nearest neighbour: Blackman and Popoli, Modern Tracking Systems,
1999, chapter 6).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from automap.assignment import assign
from automap.geolocation import limits
from automap.geolocation.landmark import Landmark, SizePrior, distances_to, fit_landmark
from automap.geolocation.views import Views
from automap.records import FloatArray, IntArray

_ANEW = 1.5
"""Of its boxes when all starts were tried last, those with which they are again: the work is then
some three times that of the last such fit, and what few boxes told does not hold many."""


@dataclass
class _Track:
    rows: list[int]
    landmark: Landmark
    fitted: list[int]
    class_score: dict[str, float] = field(default_factory=dict)
    numbers: set[int] = field(default_factory=set)
    anew: int = 1

    def add(self, views: Views, row: int) -> None:
        name = str(views.class_name[row])
        self.class_score[name] = self.class_score.get(name, 0.0) + max(
            views.score[row], limits.LEAST_SCORE
        )
        if views.track[row] >= 0:
            self.numbers.add(int(views.track[row]))


def link_views(
    views: Views,
    prior: SizePrior,
    max_silence_s: float,
    rows: IntArray | None = None,
    progress: Callable[[float], None] = lambda fraction: None,
) -> list[IntArray]:
    """Group the views (or those of ``rows``, ascending) into tracks.

    Every view belongs to exactly one track, alone if need be, which ends ``max_silence_s`` after
    its last. Returns the rows of each track
    in the order of time, tracks in the order of first sight.
    """
    chosen = np.arange(len(views)) if rows is None else np.asarray(rows, np.int64)
    active: list[_Track] = []
    ended: list[_Track] = []
    boundaries = np.flatnonzero(np.diff(views.frame[chosen])) + 1
    for frame_rows in np.split(chosen, boundaries):
        if len(frame_rows) == 0:
            continue
        now = int(views.t_ns[frame_rows[0]])
        progress(float(frame_rows[0]) / len(views))
        still: list[_Track] = []
        for track in active:
            silence = (now - int(views.t_ns[track.rows[-1]])) * 1e-9
            (still if silence <= max_silence_s else ended).append(track)
        active = still
        # a box starts a new track at the price of the gate
        partner = assign(_link_costs(views, active, frame_rows), limits.LINK_GATE)
        for row, index in dict(zip(frame_rows.tolist(), partner.tolist(), strict=True)).items():
            if index < 0:
                track = _Track([row], fit_landmark(views, np.array([row]), prior), [row])
                active.append(track)
            else:
                track = active[index]
                track.rows.append(row)
                # at a standstill the thousandth view of a sign adds nothing but time
                moved = np.linalg.norm(views.centre[row] - views.centre[track.fitted[-1]])
                if moved >= limits.SAME_PLACE_M:
                    track.fitted.append(row)
                    # where one more box leads is near by; from time to time all starts are tried
                    near = track.landmark if len(track.fitted) < _ANEW * track.anew else None
                    if near is None:
                        track.anew = len(track.fitted)
                    rows_now = np.array(track.fitted)
                    track.landmark = fit_landmark(views, rows_now, prior, near=near)
            track.add(views, row)
    tracks = [np.array(t.rows, np.int64) for t in (*ended, *active)]
    return sorted(tracks, key=lambda rows: int(rows[0]))


def _link_costs(views: Views, active: list[_Track], frame_rows: IntArray) -> FloatArray:
    """Costs [boxes, tracks] of continuing a track with a box of the frame."""
    marks = [track.landmark for track in active]
    cost = distances_to(views, marks, frame_rows, limits.LINK_SLACK_RAD)
    cost[~(cost < limits.LINK_GATE)] = np.inf
    for i, j in np.argwhere(cost < limits.LINK_GATE):
        track, row = active[j], frame_rows[i]
        share = track.class_score.get(str(views.class_name[row]), 0.0)
        cost[i, j] += limits.LINK_OTHER * (1.0 - share / sum(track.class_score.values()))
        if views.track[row] >= 0 and track.numbers:
            same = int(views.track[row]) in track.numbers
            cost[i, j] += -limits.LINK_OTHER if same else limits.LINK_OTHER
    return cost
