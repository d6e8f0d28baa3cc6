"""Time offsets of a camera that its boxes agree with alike.

Where a drive has few signs, what tells of the time offset is how a sign rises and falls in the
picture while the car pitches over a bump. That swings at one to two hertz, and frames half a
swing early or late fit about as well: a descent ends in the minimum that is nearest to its start.
So all tracks are laid over the path at all offsets (``track_evidence.py``); where minima that are
clearly apart differ by no more than chance allows, the drive does not determine the offset.
"""

from __future__ import annotations

import numpy as np

from automap.gates import gate, sigmas
from automap.geolocation import limits
from automap.geolocation.rules import GeolocationRules
from automap.geolocation.track_evidence import offset_losses
from automap.geolocation.views import CameraCorrection
from automap.records import Camera, Detections, FloatArray, Trajectory

_STEP_S = 0.02
"""Of offsets: what tracks tell of one is a few hundredths of a second wide at the least."""


def likely_times(
    trajectory: Trajectory,
    found: Detections,
    camera: Camera,
    current: CameraCorrection,
    rules: GeolocationRules,
) -> tuple[float, ...]:
    """Offsets of a camera in s, the likeliest first, that explain the tracks of ``found`` alike; at
    least one. ``current`` is where a descent ended."""
    reach = int(limits.REACH_SIGMAS * camera.time_offset_sd / _STEP_S)
    time = _STEP_S * np.arange(-reach, reach + 1.0)
    at = time - current.time_s
    loss = offset_losses(trajectory, found, current.applied(camera), rules, at)
    loss = loss + 0.5 * (time / max(camera.time_offset_sd, 1e-9)) ** 2
    sd = max(float(np.sqrt(current.covariance[3, 3])), _STEP_S)
    return alike(time, loss, sd) or (current.time_s,)


def alike(time: FloatArray, loss: FloatArray, sd: float) -> tuple[float, ...]:
    """The minima of a ``loss`` [n] at offsets ``time`` [n], the least first, that explain the
    boxes no worse than it by more than chance and are clearly apart, by their ``sd``; none where
    the loss is unknown (NaN) everywhere."""
    known = np.where(np.isfinite(loss), loss, np.inf)
    ends = np.pad(known, 1, constant_values=np.inf)
    low = np.flatnonzero((known <= ends[:-2]) & (known <= ends[2:]) & np.isfinite(known))
    low = low[np.argsort(known[low], kind="stable")]
    found: list[float] = []
    for k in low.tolist():
        likely = known[k] - known[low[0]] < 0.5 * gate(limits.ALIKE_PROBABILITY, 1)
        if likely and all(apart(float(time[k]), other, sd) for other in found):
            found.append(float(time[k]))
    return tuple(found)


def apart(a: float, b: float, sd: float) -> bool:
    """Whether two offsets are clearly different."""
    return abs(a - b) > sigmas(limits.ALIKE_PROBABILITY) * sd
