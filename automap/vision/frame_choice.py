"""Which frames of a video are worth a search.

What a map needs are views from places and in directions that differ: a frame for every few
metres of road and every few degrees of turn, and at a standstill one now and then. Half of
them, the coarse ones, are searched in any case; a frame between two coarse ones only where
one of these shows a sign, so that an approach is seen finely and an empty road costs little.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from automap.records import BoolArray, FloatArray, FrameTimes, IntArray
from automap.vision.camera_path import CameraPath


@dataclass(frozen=True)
class ChoiceRules:
    """``step_m`` travelled or ``step_rad`` turned between two frames of an approach, every
    ``coarse``-th of which is searched in any case; ``idle_s`` after which a frame is searched
    without any motion; ``shortest_s`` between two frames; ``speed`` m/s taken where the
    motion is not known."""

    step_m: float = 2.0
    step_rad: float = float(np.radians(3.0))
    coarse: int = 2
    idle_s: float = 2.0
    shortest_s: float = 0.06
    speed: float = 14.0


@dataclass(frozen=True)
class FramePlan:
    """Numbers ``frame`` [k] of the frames that may be searched, which of them are ``coarse``
    [k], and which may be passed over when the picture stands ``still`` [k]."""

    frame: IntArray
    coarse: BoolArray
    still: BoolArray

    def __len__(self) -> int:
        return len(self.frame)


def every_frame(times: FrameTimes, whole_s: float = 0.0) -> FramePlan:
    """All frames of a video; coarse are those from which ``whole_s`` pass at most to the next."""
    n = len(times)
    coarse = np.ones(n, np.bool_)
    if whole_s > 0.0:
        since = int(times.t_ns[0]) if n else 0
        for row in range(1, n - 1):
            coarse[row] = int(times.t_ns[row + 1]) - since > whole_s * 1e9
            since = int(times.t_ns[row]) if coarse[row] else since
    return FramePlan(times.frame, coarse, np.zeros(n, np.bool_))


def plan_frames(times: FrameTimes, path: CameraPath | None, rules: ChoiceRules) -> FramePlan:
    """Choose by the camera's path (one pose per frame), by time where it is not known."""
    t_s = (times.t_ns - times.t_ns[0]) * 1e-9 if len(times) else np.zeros(0)
    waited = np.diff(t_s, prepend=t_s[:1]).clip(min=0.0)
    if path is None:
        known = np.zeros(len(times), np.bool_)
        progress = waited * rules.speed / rules.step_m
    else:
        travelled, turned, known = path.steps()
        # the first frame has none before it, and is no guess where the path is known
        known[:1] = path.known[:1]
        moved = np.hypot(travelled / rules.step_m, turned / rules.step_rad)
        progress = np.where(known, moved, waited * rules.speed / rules.step_m)
    rows, coarse = _pick(progress, waited, rules)
    return FramePlan(times.frame[rows], coarse, ~known[rows])


def _pick(
    progress: FloatArray, waited: FloatArray, rules: ChoiceRules
) -> tuple[IntArray, BoolArray]:
    """Rows at which a whole step is done, and which of them are coarse ones.

    A frame whose own step reaches half into the next one stands for it: the grid is met on
    average, whatever the rate of the video.
    """
    rows: list[int] = []
    coarse: list[bool] = []
    done, since = 1.0, np.inf
    fine = 0
    for row, (step, seconds) in enumerate(zip(progress.tolist(), waited.tolist(), strict=True)):
        done += step
        since += seconds
        due = done + 0.5 * min(step, 1.0) >= 1.0 and since >= rules.shortest_s - 0.5 * seconds
        idle = since >= rules.idle_s
        if not (due or idle):
            continue
        first = not rows or idle or fine + 1 >= rules.coarse
        fine = 0 if first else fine + 1
        # what is over counts for the next step, but frames that were missed do not
        done = min(done - 1.0, 0.5) if due else 0.0
        since = 0.0
        rows.append(row)
        coarse.append(first)
    if coarse:
        coarse[-1] = True
    return np.array(rows, np.int64), np.array(coarse, np.bool_)
