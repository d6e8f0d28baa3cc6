"""Time offsets of a camera that its boxes agree with alike.

Where a drive has few signs, what tells of the time offset is how a sign rises and falls in the
picture while the car pitches over a bump. That swings at one to two hertz, and frames half a
swing early or late fit about as well: the sum of squares has several minima, and a descent ends
in the one that is nearest to its start. So the descent starts at several offsets; where minima
that are clearly apart differ by no more than chance allows, the drive does not determine the
offset.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from automap.gates import gate, sigmas
from automap.geolocation import limits
from automap.geolocation.boresight import prior_covariance
from automap.geolocation.landmark import Landmark
from automap.geolocation.pass_errors import solve_with_pass_errors
from automap.geolocation.rules import GeolocationRules
from automap.geolocation.views import CameraCorrection, Views
from automap.records import Camera, FloatArray

_STARTS = 3
"""On either side, a sigma apart."""


def starts(sd_s: float) -> tuple[FloatArray, FloatArray]:
    """Offsets [3] to start from on either side, the outermost first, by the sigma of the offset
    before any sign was seen."""
    side = limits.REACH_SIGMAS * sd_s * np.arange(_STARTS, 0, -1) / _STARTS
    return -side, side


def cost_of(
    views: Views,
    landmarks: Sequence[Landmark],
    camera: Camera,
    correction: CameraCorrection,
    rules: GeolocationRules,
) -> float:
    """Robust sum of squares of all signs with the errors of their passes, and of the camera, by its
    prior."""
    values = correction.values
    total = float(np.sum(values**2 / np.diag(prior_covariance(camera, rules))))
    settled = (solve_with_pass_errors(views, mark, rules.size) for mark in landmarks if mark.ok)
    return total + sum(mark.cost for mark in settled)


def alike(minima: Sequence[tuple[CameraCorrection, float]]) -> tuple[int, tuple[float, ...]]:
    """The number of the least of the minima, where descents ended with costs, and the offsets
    (s, ascending) that explain the boxes as well.

    The offsets are empty where the least stands alone; else its own is among them.
    """
    order = sorted(range(len(minima)), key=lambda k: minima[k][1])
    most = minima[order[0]][1] + gate(limits.ALIKE_PROBABILITY, 1)
    found: list[CameraCorrection] = []
    for correction, cost in (minima[k] for k in order):
        if cost < most and all(apart(correction, other) for other in found):
            found.append(correction)
    return order[0], tuple(sorted(c.time_s for c in found)) if len(found) > 1 else ()


def apart(a: CameraCorrection, b: CameraCorrection) -> bool:
    """Whether two offsets are clearly different."""
    sd = float(np.sqrt(max(a.covariance[3, 3], b.covariance[3, 3])))
    return abs(a.time_s - b.time_s) > sigmas(limits.ALIKE_PROBABILITY) * sd
