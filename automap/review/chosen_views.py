"""A sign of views that a person chose: boxes of the detector, or places clicked in frames.

The same least squares as for all other signs, without the search for what belongs together. A
click says where the middle of the face is and nothing of its size, so two frames at least must see
it from places that differ.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from automap.geolocation import limits
from automap.geolocation.assembly import assemble_sign
from automap.geolocation.boresight import camera_covariances
from automap.geolocation.class_sizes import usual_sizes
from automap.geolocation.facing import find_facings
from automap.geolocation.landmark import SizePrior, fit_landmark
from automap.geolocation.pass_errors import solve_with_pass_errors
from automap.geolocation.path_relation import make_path
from automap.geolocation.rules import GeolocationRules
from automap.geolocation.sightings import Sighting, make_sighting
from automap.geolocation.trajectory_adjustment import place_signs
from automap.geolocation.views import CameraCorrection, Views, build_views
from automap.records import BoolArray, Camera, Detections, IntArray, Sign, Trajectory

_NO_SIZE_SD = 1e3
"""Logarithm of a height that is not known, one sigma."""


def locate_chosen(
    trajectory: Trajectory,
    detections: Sequence[Detections],
    cameras: Mapping[str, Camera],
    corrections: Mapping[str, CameraCorrection],
    rules: GeolocationRules,
    clicked: BoolArray,
) -> Sign:
    """The sign that all ``detections`` show, one record a camera.

    ``clicked`` [n] tells which of them, joined, have a middle and no size. ValueError says in a
    sentence why there is no place.
    """
    views = build_views(trajectory, detections, cameras, rules.noise, corrections)
    if not len(views):
        raise ValueError("the path does not reach to these frames")
    bare = np.asarray(clicked, bool)[views.row]
    sd, aspect = views.sd.copy(), views.log_aspect.copy()
    sd[bare, 2] = _NO_SIZE_SD
    aspect[bare] = np.nan
    views = replace(views, sd=sd, log_aspect=aspect)
    size = rules.size
    size = replace(size, by_class={**usual_sizes(views.class_name.tolist()), **size.by_class})
    covariances = camera_covariances(views, cameras, corrections, rules)
    passes = [np.arange(len(views))] if bare.any() else _passes(views)
    seen = [_sighting(views, rows, size, covariances, bool(bare.any())) for rows in passes]
    path = make_path(trajectory, views.origin)
    facings, _ = find_facings(views, [seen], path)
    # a person says that it is there
    placed, _ = place_signs(trajectory, seen, [range(len(seen))], {}, adjust=False)
    return assemble_sign(views, seen, placed.of(0), path, facings[0], 1, rules, 1.0)


def _passes(views: Views) -> list[IntArray]:
    gaps = np.flatnonzero(np.diff(views.t_ns) > limits.PASS_S * 1e9) + 1
    return np.split(np.arange(len(views)), gaps)


def _sighting(
    views: Views,
    rows: IntArray,
    size: SizePrior,
    covariances: Sequence[np.ndarray],
    clicked: bool,
) -> Sighting:
    mark = fit_landmark(views, rows, size)
    if not mark.ok:
        raise ValueError("the views do not meet at a place in front of the camera")
    mark = solve_with_pass_errors(views, mark, size)
    if clicked and not mark.depth_log_sd < limits.WEAK_DEPTH_LOG_SD:
        raise ValueError(
            "the frames see it from too nearly the same place; click it in one that is further off"
        )
    return make_sighting(views, mark, covariances)
