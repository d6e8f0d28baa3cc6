"""Parts of the geolocation one by one, on a drive where no two numbers are alike."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from tests.unit.figure_levels import levelled, table
from tests.unit.geolocation_drive import (
    CLASSES,
    CORRECTIONS,
    NOISE,
    PRIOR,
    rich_drive,
)
from tests.unit.scenarios import scenario


def _landmarks(views: Any, signs: Any = range(16)) -> list[Any]:
    from automap.geolocation.landmark import fit_landmark

    drive = rich_drive()
    told = [drive.rows(views, k, camera) for k in signs for camera in (0, 1)]
    return [fit_landmark(views, rows, PRIOR) for rows in told if len(rows) > 1]


def _settled(views: Any, signs: Any = range(16)) -> list[Any]:
    from automap.geolocation.pass_errors import solve_with_pass_errors

    return [solve_with_pass_errors(views, mark, PRIOR) for mark in _landmarks(views, signs)]


def _seen(views: Any, signs: Any = range(16)) -> list[Any]:
    from automap.geolocation.sightings import make_sighting

    rng = np.random.default_rng(1)
    root = 1e-3 * rng.normal(size=(2, 10, 10))
    camera = [r @ r.T for r in root]
    return [make_sighting(views, mark, camera) for mark in _settled(views, signs)]


@scenario
def geolocation_views() -> Any:
    """Rays of two cameras, with and without corrections and errors of the stamps."""
    from automap.geolocation.views import map_origin

    drive = rich_drive()
    late = replace(NOISE, stamp_sd_s=0.013)
    gone = replace(drive.path, lat_rad=np.full(len(drive.path), np.nan))
    lost = replace(drive.path, height_m=np.full(len(drive.path), np.nan))
    found = {
        "corrected": drive.views(),
        "plain": drive.views(late, plain=True),
        "origin": [map_origin(p) for p in (drive.path, gone, lost)],
        "values": CORRECTIONS["front"].values,
    }
    return levelled(found)


@scenario
def geolocation_landmarks() -> Any:
    """Signs from their boxes, robust or not, their derivatives and where they are expected."""
    from automap.geolocation import landmark as of
    from automap.geolocation.view_errors import by_expected_heights
    from automap.robust import BY_CAUCHY, BY_HUBER, PLAIN

    drive, rng = rich_drive(), np.random.default_rng(2)
    views = drive.views()
    near = np.array([3, 3, 4, 4, 4, 9])
    still = replace(views, centre=views.centre.copy())
    still.centre[near] = views.centre[near[0]] + rng.normal(0.0, 0.01, (6, 3))
    found: dict[str, Any] = {"sd": of.view_sd(still, np.arange(20))}
    for k, robust in ((1, True), (7, True), (11, False)):
        rows = drive.rows(views, k)
        mark = of.fit_landmark(views, rows, PRIOR, robust)
        anchor = int(rows[2])
        at = of.seen_from(views, anchor, mark.position + np.array([0.5, -0.7, 0.3]), -0.4)
        assert at is not None
        columns, effects = of.columns_of(views, rows, anchor, at)
        bias = 1e-3 * rng.normal(size=columns.shape[2])
        boxes = by_expected_heights(of.boxes_of(views, rows, anchor, PRIOR), at)
        found[str(k)] = {
            "mark": mark,
            # its residuals are nothing but rounding
            "alone": of.fit_landmark(views, rows[4:5], PRIOR).parameters,
            "two": of.fit_landmark(views, rows[[1, 5]], of.SizePrior(0.9, 0.2)),
            "told": [mark.depth_m, mark.size_m, mark.depth_log_sd],
            "at": at,
            "columns": columns.reshape(-1, columns.shape[2]).T.copy(),
            "effects": effects,
            "drift": of.view_drift(views, rows, anchor),
            "elapsed": of.elapsed_s(views, rows, anchor),
            "residuals": of.direction_residuals(views, mark),
            "jacobian": of.position_jacobian(views, mark),
            "place": of.place(views, anchor, at),
            "behind": of.seen_from(views, anchor, views.centre[anchor] - drive.place[0], 0.1),
            "equations": [
                of.sign_equations(at, boxes, columns, bias, kind)
                for kind in (PLAIN, BY_HUBER, BY_CAUCHY)
            ],
        }
    marks = _landmarks(views, (2, 3, 5, 6))
    frame = np.flatnonzero(views.frame == views.frame[marks[1].rows[2]])
    found["distances"] = of.distances_to(views, marks, frame, 0.004)
    found["prior"] = [PRIOR.of(names).size_m for names in (CLASSES[2:3], CLASSES, CLASSES[1:4])]
    return levelled(found)


@scenario
def geolocation_passes() -> Any:
    """Signs with the errors of their passes, what they tell of the camera, and their sizes."""
    from automap.geolocation import boresight, class_sizes, time_minima
    from automap.geolocation.box_noise import margin_scatter, measured_noise, scatter
    from automap.geolocation.pass_errors import pass_sd
    from automap.geolocation.rules import GeolocationRules
    from automap.geolocation.track_evidence import offset_losses
    from automap.signs.classes import load_classes

    drive, rng = rich_drive(), np.random.default_rng(3)
    views = drive.views()
    marks = _settled(views)
    camera = drive.cameras["front"]
    priors = GeolocationRules(size=PRIOR, focal_sd=0.007, camera_margin_sd_px=1.4)
    current = CORRECTIONS["front"]
    corrected = boresight.refine_correction(views, marks, 0, camera, current, priors)
    offset = np.linspace(-0.4, 0.4, 9)
    found = replace(drive.detections[0], track=drive.owner[0])
    walk = [np.cumsum(rng.normal(size=n)) * 0.4 + rng.normal(size=n) for n in (9, 14, 11, 30)]
    walk[2][3] = 40.0
    each = [np.ones(len(w)) for w in walk]
    return levelled(
        {
            "marks": table(marks),
            "sd": [pass_sd(views, mark.rows, a) for mark in marks[:2] for a in (True, False)],
            "prior": boresight.prior_covariance(camera, priors),
            "usable": [len(boresight.usable_landmarks(views, marks, c)) for c in (0, 1)],
            "first": boresight.refine_correction(
                views, marks, 1, drive.cameras["left"], None, priors
            ),
            "corrected": corrected,
            "losses": offset_losses(drive.path, found, camera, priors, offset),
            "likely": time_minima.likely_times(drive.path, found, camera, current, priors),
            "usual": class_sizes.usual_sizes([*load_classes(), *CLASSES, "other", "white--circle"]),
            "sizes": class_sizes.sizes_of_others(views, marks, PRIOR),
            "noise": measured_noise(views, _landmarks(views), PRIOR, NOISE),
            "margin": margin_scatter(views, _landmarks(views, (1, 7, 9)), PRIOR),
            "scatter": [
                scatter(walk, each),
                scatter(walk[:1], each[:1], 2.0),
                scatter([0.01 * w for w in walk], each),
            ],
        }
    )


@scenario
def geolocation_sightings() -> Any:
    """Sightings of two cameras, grouped, combined, faced, surveyed and adjusted."""
    from automap.earth import from_local_ned
    from automap.geolocation import trajectory_adjustment as adjusting
    from automap.geolocation.assembly import assemble_sign
    from automap.geolocation.condition import with_conditions
    from automap.geolocation.control import match_control
    from automap.geolocation.due_frames import patterns_of
    from automap.geolocation.facing import find_facings
    from automap.geolocation.passes import group_sightings, join_passes, of_stretches
    from automap.geolocation.path_relation import make_path
    from automap.geolocation.rules import GeolocationRules
    from automap.mapping.posts import support_numbers
    from automap.records import SignPoints

    drive, rng = rich_drive(), np.random.default_rng(4)
    views = drive.views()
    seen = _seen(views)
    other = replace(seen[3], class_score={CLASSES[2]: 1.3, CLASSES[0]: 2.1, CLASSES[1]: 0.2})
    mixed = replace(seen[2], class_score={CLASSES[2]: 3.3, CLASSES[0]: 1.1, CLASSES[3]: 0.4})
    groups = group_sightings(views, seen)
    joined = [[seen[k] for k in group] for group in groups]
    alone, _ = adjusting.place_signs(drive.path, seen, groups, {}, False)
    places = alone.place
    lat, lon, _ = from_local_ned(places + rng.normal(0.0, 0.5, places.shape), views.origin)
    names = np.array([joined[k][0].class_name if k % 3 else "" for k in range(len(joined))], object)
    names[1] = CLASSES[3]
    sd = rng.uniform(0.1, 0.6, len(lat[1::2]))
    none = np.full((len(sd), 2, 2), np.nan)
    control = SignPoints(lat[1::2], lon[1::2], names[1::2], none, sd)
    called = {k: joined[k][0].class_name for k in range(len(joined))}
    controlled = match_control(control, called, alone, views.origin)
    placed, adjustment = adjusting.place_signs(drive.path, seen, groups, controlled)
    assert adjustment is not None
    path = make_path(drive.path, views.origin, adjustment)
    facings, faces = find_facings(views, joined, path)
    marks = [sighting.landmark for sighting in seen]
    shown = patterns_of(views, marks, drive.path, drive.detections, drive.cameras)
    told = [[(seen[k], shown[k]) for k in group] for group in groups]
    rules = GeolocationRules(imu_above_road_m=1.1, imu_above_road_sd_m=0.07, drive="round")
    signs = [
        assemble_sign(views, members, alone.of(k), path, facing, k, rules, 0.5 + 0.02 * k)
        for k, (members, facing) in enumerate(zip(joined, facings, strict=True))
    ]
    bend = [
        np.array([[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]]) for a in 0.22 * np.arange(9)
    ]
    back = [
        replace(
            s, position=s.position + k * np.array([0.3, -0.2, 0.05]), facing=-bend[k] @ s.facing
        )
        for k, s in enumerate(seen[:9])
    ]
    off = (views.frame.max() + 1 + np.arange(len(views))).astype(np.int64)
    apart = replace(
        views,
        centre=np.concatenate([views.centre, views.centre]),
        frame=np.concatenate([views.frame, off]),
    )
    back = [
        replace(
            s,
            landmark=replace(s.landmark, rows=s.landmark.rows + len(views)),
            class_score={"information--sign--back": 2.0},
        )
        for s in back
    ]
    both, some = [*seen[:9], *back], [*seen, mixed, other]
    return levelled(
        {
            "seen": table(seen),
            "covariance": [s.covariance for s in seen],
            "stretches": of_stretches(
                some, [np.unique(s.landmark.rows) for s in some], views.origin
            ),
            "groups": groups,
            "placed": [alone, placed],
            "controlled": controlled,
            "adjustment": adjustment,
            "shifted": adjusting.shift_sighting(seen[5], adjustment).position,
            "adjusted": adjusting.shifted(drive.path, adjustment, views.origin),
            "path": path,
            "facings": table(facings),
            "faces": faces,
            "signs": table(signs),
            "condition": {
                name: table(with_conditions(signs, views, told, drive.detections))[name]
                for name in ("contrast", "contrast_sd", "contrast_note", "seen_share", "n_looked")
            },
            "passes": [
                {n: v for n, v in vars(join_passes(*way)).items() if n != "sightings"}
                for way in (
                    (views, seen, drive.path, control, True),
                    (views, seen, drive.path, None, False),
                    (apart, both, drive.path, control, True),
                )
            ],
            "supports": support_numbers(
                rng.uniform(0.0, 30.0, (25, 3)),
                rng.uniform(0.01, 0.5, 25),
                (rng.random(25) < 0.4).tolist(),
            ),
        }
    )
