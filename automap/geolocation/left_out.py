"""Boxes that are of no sign by the road whatever the camera is: they are left out first, so that
nothing is fitted to them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from automap.geolocation.carriers import far_carried
from automap.geolocation.fixed_in_picture import fixed_boxes
from automap.geolocation.result import (
    GeolocationResult,
    Observations,
    left_out_sentences,
    nothing_observed,
)
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
    note[rest[far_carried(trajectory, some, camera, rules.noise, rules.size)]] = "moving"
    return note


def with_left_out(result: GeolocationResult, note: Notes) -> GeolocationResult:
    """What was found without the boxes that have a ``note`` [n of all], these told with those that
    were left out for the same."""
    out = np.asarray(note != "", np.bool_)
    if not out.any():
        return result
    kept = np.flatnonzero(~out)
    columns = {}
    for name, empty in vars(nothing_observed(len(note))).items():
        empty[kept] = getattr(result.observations, name)
        columns[name] = empty
    columns["note"][out] = note[out]
    told = set(left_out_sentences(result.observations.note))
    return replace(
        result,
        observations=Observations(**columns),
        signs=[replace(sign, detection_rows=kept[sign.detection_rows]) for sign in result.signs],
        warnings=[
            *left_out_sentences(columns["note"]),
            *(text for text in result.warnings if text not in told),
        ],
    )
