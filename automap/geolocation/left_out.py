"""Boxes that are of no sign by the road whatever the camera is: they are left out first, so that
nothing is fitted to them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from automap.geolocation.carriers import far_carried
from automap.geolocation.fixed_in_picture import fixed_boxes
from automap.geolocation.rules import GeolocationRules
from automap.records import Camera, Detections, Trajectory

Notes = npt.NDArray[np.object_]


def no_signs(
    trajectory: Trajectory, found: Detections, camera: Camera, rules: GeolocationRules
) -> Notes:
    """Why boxes [n] of one camera are of no sign, "" for all others."""
    note = np.full(len(found), "", np.object_)
    note[fixed_boxes(trajectory, found, rules.noise)] = "fixed"
    rest = np.flatnonzero(note == "")
    some = found.at(note == "")
    note[rest[far_carried(trajectory, some, camera, rules)]] = "moving"
    return note


def without(found: Detections, note: Notes) -> Detections:
    """The boxes, of which those with a ``note`` [n] have no direction."""
    return replace(found, box=np.where((note == "")[:, None], found.box, np.nan))
